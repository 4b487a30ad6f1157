"""Turn finished trainings into tables: ``python -m clearance.evaluate``."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from clearance.benchmark import report
from clearance.commands import command
from clearance.errors import InputError
from clearance.evaluation.curves import EXPERIMENTS
from clearance.evaluation.fresh import FRESH, evaluate_fresh, read_fresh
from clearance.evaluation.overview import overview
from clearance.evaluation.paper.perturbation import (
    PERTURBED,
    Perturbation,
    TrainingData,
    asked,
    evaluate_perturbed,
)
from clearance.evaluation.paper.results import RECORD, write_results
from clearance.evaluation.paper.trainings import finished_trainings, trainings_of
from clearance.evaluation.results import collect, markdown, put_between_marks, with_recorded
from clearance.models.run_folder import CONFIG, METRICS
from clearance.models.trusted import instantiate_trusted
from clearance.predict import load_gauge
from clearance.recording.bounds import whole
from clearance.whole_files import read_json, read_yaml, write_atomically, write_json

log = logging.getLogger(__name__)
_SIMULATED = ("SimulatedSource", "StreamingSource")  # of whose machine the campaign makes more


@command("evaluate")
def main(cfg: DictConfig) -> None:
    """Measure on new recordings where asked, collect the rows, write tables and pictures."""
    for name in ("fresh", "perturbed"):
        whole(cfg[name], name, 0)
    if cfg.report is not None and cfg.results is not None:
        raise InputError(f"report={cfg.report} and results={cfg.results}: one at a time; leave one out")
    for name in ("readme", "picture"):
        if cfg[name] and cfg.results is None:
            raise InputError(
                f"{name}={cfg[name]}: made only together with the results; set results to a folder"
            )
    runs = Path(str(cfg.runs))  # a name of digits alone is a number
    figures = instantiate(cfg.figures, _convert_="all")
    perturbations = instantiate(cfg.perturbations, _convert_="all")
    if cfg.fresh:
        for metrics in sorted(runs.rglob(METRICS)):
            measure_coverage(metrics.parent, cfg.fresh)
    if cfg.perturbed:
        measure_perturbed(runs, perturbations, cfg.perturbed)
    if cfg.report is not None:
        page = Path(str(cfg.report))
        pictures = page.with_suffix("") if cfg.pictures is None else Path(str(cfg.pictures))
        if not runs.is_dir() and not (pictures / RECORD).exists():
            raise InputError(
                f"runs = {runs}: there is no such folder, and no record of trainings in pictures = "
                f"{pictures}; set runs to a folder of finished trainings"
            )
        trainings = Path(str(cfg.trainings))
        rows = read_json(trainings, "trainings") if trainings.exists() else []
        if not rows:
            log.warning("trainings=%s: not there, so that the report has none of its curves", trainings)
        write_results(runs, page, pictures, figures, rows)
        log.info("written to %s, with pictures in %s", page, pictures)
        return
    rows = collect(runs)
    log.info("%s", markdown(rows))
    if cfg.results is None:
        return
    # Everything is read and made before anything is written.
    results, shown, bench = (Path(str(path)) for path in (cfg.results, cfg.picture, cfg.bench))
    rows = with_recorded(rows, results / "trainings.json")
    measured = read_json(bench, "bench") if bench.exists() else None
    picture = None
    if cfg.picture:
        fresh = read_json(shown / FRESH, "picture")
        picture = overview(fresh, (read_yaml(shown / CONFIG, "picture") or {}).get("name", ""))
    text = renewed(Path(str(cfg.readme)), rows, measured) if cfg.readme else None
    results.mkdir(parents=True, exist_ok=True)
    write_json(results / "trainings.json", rows)
    if picture is not None:
        write_atomically(results / "overview.png", lambda file: picture.savefig(file, dpi=110))
    if measured is not None:
        write_json(results / "bench.json", measured)
    if text is not None:
        write_atomically(Path(str(cfg.readme)), lambda file: file.write_text(text, encoding="utf-8"))


def renewed(page: Path, rows: Sequence[dict[str, Any]], measured: dict[str, Any] | None) -> str:
    """The text of a page with the tables of trainings and, where it was measured, of the benchmark.

    Raises:
        InputError: the page, or lines that mark where tables belong in it, are not there.
    """
    try:
        text = page.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"readme = {page}: not a readable page ({error}); change readme") from error
    blocks = {"results": markdown([row for row in rows if row["experiment"] not in EXPERIMENTS])}
    if measured is not None:
        blocks["bench"] = report.markdown(measured)
    for block, content in blocks.items():
        text = put_between_marks(text, block, content)
    return text


def measure_coverage(run: Path, recordings: int) -> None:
    """Write ``fresh.json`` beside a training unless it is there with as many recordings."""
    known = read_fresh(run)
    if known and known[0].get("asked", known[0]["summary"]["recordings"]) >= recordings:
        return
    if not any(run.glob("model.*")):
        log.warning("%s: left out, its weights are gone", run)
        return
    config: dict[str, Any] = read_yaml(run / CONFIG, "runs") or {}
    if "campaign" not in config:
        raise InputError(f"{run / CONFIG}: no campaign there, so nothing fresh can be simulated; set fresh=0")
    source = config["data"]["source"]
    kind = str(source["_target_"]).rpartition(".")[2]
    if kind not in _SIMULATED:
        log.info("%s: left out, nothing fresh can be simulated like the recordings of %s", run, kind)
        return
    campaign = instantiate_trusted(config["campaign"], str(run / CONFIG))
    begin = float(source.get("start_time") or 0.0)  # the training may have left out more of each recording
    campaign = replace(campaign, record_start=max(begin, campaign.record_start), device="cpu")
    log.info("%s: %d fresh recordings", run, recordings)
    gauge = load_gauge(run)
    try:
        fresh = evaluate_fresh(gauge, campaign, recordings)
    except InputError as error:
        raise InputError(f"{run}: {error}") from error
    write_json(run / FRESH, [{"asked": recordings, **joint.to_json()} for joint in fresh])


def measure_perturbed(runs: Path, perturbations: Mapping[str, Perturbation], recordings: int) -> None:
    """Write ``perturbed.json`` beside each training of Table 7 unless it is there and was asked the same."""
    wanted = set(trainings_of("table6"))
    for one in finished_trainings(runs):
        assert one.path is not None
        path = one.path / PERTURBED
        if one.training not in wanted:
            continue
        if path.exists() and read_json(path, "runs").get("asked") == asked(perturbations, recordings):
            continue
        if not any(one.path.glob("model.*")):
            log.info("%s: left out, its weights are elsewhere", one.path)
            continue
        log.info("%s: %d recordings a perturbation", one.path, recordings)
        metrics = instantiate_trusted(dict(one.config["metrics"]), str(one.path / CONFIG))
        data = TrainingData.of(one.path)
        write_json(path, evaluate_perturbed(load_gauge(one.path), data, perturbations, recordings, metrics))


if __name__ == "__main__":
    main()
