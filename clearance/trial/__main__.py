"""Prove the diagnosis on machines whose truth is sealed: ``python -m clearance.trial``."""

import logging
import os
import sys
from collections.abc import Sequence
from datetime import date
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig, ListConfig

from clearance.commands import command, shard
from clearance.errors import InputError
from clearance.evaluation.results import put_between_marks
from clearance.recording.bounds import whole
from clearance.trial import closed_loop, pictures
from clearance.trial.closed_loop import close_loop
from clearance.trial.conceal import conceal
from clearance.trial.examine import DIAGNOSIS, VERDICTS, Examiner
from clearance.trial.pool import pool
from clearance.trial.reveal import commit_verdicts, reveal
from clearance.trial.score import score_case
from clearance.trial.summary import comparison, failures, history, summarise, table
from clearance.whole_files import read_json, write_atomically, write_json

log = logging.getLogger(__name__)

STAGES = ("conceal", "diagnose", "baselines", "reveal", "loop", "pool")
BASELINES = {
    "trajectory": "least squares on the trajectory",
    "sparse": "sparse regression",
    "two_sample": "two-sample test",
}
_BESIDE = "baselines"
_PUBLISHED = "trial-*.json"


@command("trial")
def main(cfg: DictConfig) -> None:
    """Conceal, diagnose, reveal, score; with baselines and the loop if asked; or one stage alone."""
    _check(cfg)
    drawn = [] if cfg.pictures is None else [Path(cfg.pictures)]
    if cfg.stage == "pool":
        facts, rows = pool([Path(path) for path in _words(cfg, "pooled")])
        result, text = _score(facts, rows, drawn)
        result.pop("rows")  # they stand in the results that were added up
        _publish(result, text, "trial", cfg.results, cfg.readme)
        return
    program, arguments = _words(cfg, "program"), _words(cfg, "arguments")
    methods = _methods(_words(cfg, "baselines"))
    part = shard(cfg.shard)
    if part != (1, 1) and cfg.stage not in ("diagnose", "baselines"):
        raise InputError(
            f"shard = {cfg.shard}: cases are diagnosed in parts, and concealed and revealed at once; set "
            "stage=diagnose, or shard=1/1"
        )
    if cfg.stage == "baselines" and not methods:
        raise InputError(
            f"stage = baselines runs those of baselines, which is []; list {', '.join(BASELINES)}"
        )
    folder, sealed, parallel = Path(cfg.folder), Path(cfg.sealed), int(cfg.parallel)
    scope, loop = instantiate(cfg.scope, _convert_="all"), instantiate(cfg.loop, _convert_="all")
    if cfg.stage == "loop" and loop is None:
        raise InputError(
            "stage = loop needs to know how to train; choose experiment=closed_loop, or set loop"
        )
    if loop is not None:
        loop.check(scope)
    if methods and scope.tolerances:
        raise InputError(
            f"baselines = {methods}: they know nothing of sensors within tolerances; set baselines=[], or "
            "leave these out: ~scope.tolerances"
        )
    if cfg.stage in ("all", "conceal"):
        published = conceal(scope, cfg.seed, folder, sealed, parallel, log.info)
        log.info("%d cases concealed; commitment SHA-256 %s", scope.cases, published["sha256"])
    if cfg.stage in ("all", "diagnose"):
        examiner = Examiner(program or DIAGNOSIS, arguments, VERDICTS, cfg.time_limit, cfg.retry)
        examiner.examine(folder, parallel, log.info, part)
    if cfg.stage in ("all", "baselines"):
        for method in methods:
            log.info("baseline: %s", BASELINES[method])
            judge = [sys.executable, "-m", "clearance.trial.baselines", f"method={method}"]
            examiner = Examiner(judge, [], f"{_BESIDE}/{method}", cfg.time_limit, cfg.retry)
            examiner.examine(folder, parallel, log.info, part)
    if cfg.stage in ("all", "reveal", "loop"):
        others = [] if cfg.stage == "loop" else [f"{_BESIDE}/{method}" for method in methods]
        for verdicts in (VERDICTS, *others):
            log.info("%s committed: SHA-256 %s", verdicts, commit_verdicts(folder, verdicts))
        facts, cases = reveal(folder, sealed)
        if len(facts["asked"]) > 1:
            log.warning("the verdicts are not of one version: %s", facts["asked"])
        if cfg.seed not in (None, facts["seed"]):
            raise InputError(
                f"seed = {cfg.seed}: folder = {folder} holds the trial of seed {facts['seed']}; set "
                "that seed, or choose another folder"
            )
        if cfg.stage != "loop":
            rows = [score_case(one) for one in cases]
            content = _score(facts, rows, [folder, *drawn])
            beside = _compare(folder, sealed, methods, content[0])
            write_json(folder / "result.json", content[0])
            if loop is None or cfg.stage == "reveal":
                _publish(*content, "trial", cfg.results, cfg.readme)
                if beside:
                    _publish(content[0], beside, "baselines", cfg.results, cfg.readme)
                if cfg.history is not None:
                    page = Path(cfg.history)
                    _renew(page, "trials", _beside(page, Path(cfg.results)))
        if loop is not None and cfg.stage != "reveal":
            closed = close_loop(cases, folder, loop, parallel, log.info)
            _publish(*_write_loop(folder, facts, closed), "loop", cfg.results, cfg.readme)
        log.info("written to %s", folder)


def _check(cfg: DictConfig) -> None:
    """What is wrong is said before anything is begun."""
    if cfg.stage not in ("all", *STAGES):
        raise InputError(f"stage = {cfg.stage!r} is unknown; choose from all, {', '.join(STAGES)}")
    for name in ("parallel", "time_limit"):
        whole(cfg[name], name, 1)
    whole(cfg.seed, "seed", 0, null=True)
    for name in ("folder", "sealed"):
        if not isinstance(cfg[name], str):
            raise InputError(f"{name} = {cfg[name]!r} is no folder; set {name} to the path of one")
    if not isinstance(cfg.scope, DictConfig):
        raise InputError(f"scope = {cfg.scope!r} says nothing of how cases are drawn; set scope.cases alone")
    if not isinstance(cfg.retry, bool):
        raise InputError(f"retry = {cfg.retry!r} is neither true nor false; change retry")
    _check_readme(cfg)
    _check_history(cfg.history, cfg.results)
    if cfg.stage == "pool" and cfg.results is None:
        raise InputError("stage = pool writes its result to results, which is null; set results to a file")
    if cfg.pictures is not None and Path(cfg.pictures).is_file():
        raise InputError(f"pictures = {cfg.pictures}: is a file; set pictures to a folder")


def _score(
    facts: dict[str, Any], rows: Sequence[dict[str, Any]], folders: Sequence[Path]
) -> tuple[dict[str, Any], str]:
    """The score of all rows, shown, and its pictures in each of some folders.

    Returns:
        The result, summary and rows, and its table.
    """
    summary = {"date": date.today().isoformat()} | facts | summarise(rows)
    for name, figure in {
        "power": pictures.power(rows, summary["power"]),
        "power_by_effect": pictures.power_by_effect(summary["power_by_effect"]),
        "confusion": pictures.confusion(summary["confusion"]),
        "estimates": pictures.estimates(rows),
        "curves": pictures.curves(rows),
    }.items():
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
            write_atomically(folder / f"{name}.png", figure.savefig)
    text = table(summary)
    sys.stdout.write(f"\n{text}\n{failures(summary) or 'no failures'}\n")
    return summary | {"rows": list(rows)}, text


def _words(cfg: DictConfig, name: str) -> list[str]:
    """The words that a key lists; none where it is null."""
    given = cfg[name]
    if given is None:
        return []
    if not isinstance(given, ListConfig) or not all(isinstance(one, str) for one in given):
        raise InputError(f"{name} = {given!r} is no list of words; write '{name}=[word, \"5\"]'")
    return [str(one) for one in given]


def _methods(methods: list[str]) -> list[str]:
    unknown = [one for one in methods if one not in BASELINES]
    if unknown:
        raise InputError(f"baselines: {unknown[0]!r} is unknown; choose from {', '.join(BASELINES)}")
    return methods


def _compare(folder: Path, sealed: Path, methods: Sequence[str], result: dict[str, Any]) -> str:
    """The table of baselines, whose summaries are added to the result; empty where there are none."""
    summaries = {"this diagnosis": dict(result)}
    for method in methods:
        _, cases = reveal(folder, sealed, f"{_BESIDE}/{method}")
        rows = [score_case(one) for one in cases]
        summaries[BASELINES[method]] = summarise(rows)
        write_json(folder / f"{method}.json", summaries[BASELINES[method]] | {"rows": rows})
    if not methods:
        return ""
    result["baselines"] = {method: summaries[BASELINES[method]] for method in methods}
    text = comparison(summaries)
    sys.stdout.write(f"\n{text}\n")
    return text


def _write_loop(
    folder: Path, facts: dict[str, Any], rows: Sequence[dict[str, Any]]
) -> tuple[dict[str, Any], str]:
    """Likewise what the estimators made of it."""
    content = facts | closed_loop.summarise(rows) | {"rows": list(rows)}
    write_json(folder / closed_loop.RESULT, content)
    write_atomically(folder / "closed_loop.png", pictures.loop(rows).savefig)
    text = closed_loop.table(rows)
    sys.stdout.write(f"\n{text}\n")
    return content, text


def _publish(content: dict[str, Any], text: str, block: str, results: str | None, readme: str | None) -> None:
    if results is not None:
        Path(results).parent.mkdir(parents=True, exist_ok=True)
        write_json(Path(results), content)
    if readme is not None:
        _renew(Path(readme), block, text)


def _check_readme(cfg: DictConfig) -> None:
    """Whether the page has the marks of every table that it is to get."""
    if cfg.readme is None or cfg.stage in ("conceal", "diagnose", "baselines"):
        return
    if not Path(cfg.readme).is_file():
        raise InputError(f"readme = {cfg.readme}: there is no such page; change readme")
    looped = cfg.loop is not None and cfg.stage in ("all", "loop")
    compared = cfg.baselines and cfg.stage != "pool"
    for block in ["loop"] if looped else ["trial", *(["baselines"] if compared else [])]:
        _renewed(Path(cfg.readme), block, "")


def _check_history(history: str | None, results: str | None) -> None:
    """What would make the list of trials fail is said before the hours that a trial takes, not after them."""
    if history is None:
        return
    if results is None or not fnmatch(Path(results).name, _PUBLISHED):
        raise InputError(
            f"history = {history} lists the files {_PUBLISHED} beside results, which is {results!r}; "
            "set results to one of them"
        )
    if not Path(history).is_file():
        raise InputError(f"history = {history}: there is no such page; change history")
    _renewed(Path(history), "trials", _beside(Path(history), Path(results)))


def _beside(page: Path, results: Path) -> str:
    """The table of all trials that are published beside one."""
    found = {
        os.path.relpath(p, page.parent): read_json(p, "results") for p in results.parent.glob(_PUBLISHED)
    }
    for name, one in found.items():
        lacking = [key for key in ("date", "seed") if key not in one]
        if lacking:
            raise InputError(
                f"history: {name} has no {lacking[0]}, as results of older versions or of several trials; "
                "move it"
            )
    return history(found)


def _renew(page: Path, block: str, text: str) -> None:
    renewed = _renewed(page, block, text)
    write_atomically(page, lambda file: file.write_text(renewed, encoding="utf-8"))


def _renewed(page: Path, block: str, text: str) -> str:
    return put_between_marks(page.read_text(encoding="utf-8"), block, text, "trial")


if __name__ == "__main__":
    main()
