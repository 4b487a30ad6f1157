"""Reveal: when every verdict is in and hashed, open the seal and check that nothing was changed."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from clearance.errors import InputError
from clearance.trial.case import Case
from clearance.trial.conceal import CASE, CASES, COMMITMENT, names_of
from clearance.trial.examine import VERDICT, VERDICTS, hashes_of
from clearance.trial.seal import digest, open_seal
from clearance.whole_files import read_json, write_json


@dataclass(frozen=True)
class Revealed:
    """A case with its truth and its verdict.

    Attributes:
        case: what was true.
        secrets: see ``simulate.Simulated``.
        diagnosis: what the tool said, or ``None`` where it failed.
        seconds: that it took.
        failure: why there is no diagnosis, or ``None``.
        corrected: the machine that the tool handed on, as a configuration, or ``None``.
        tries: how often it was asked: again where it failed and that was wished for.
        asked: the program, its limit of time [s] and the commit of its sources, or ``None``.
    """

    case: Case
    secrets: dict[str, Any]
    diagnosis: dict[str, Any] | None
    seconds: float
    failure: str | None
    corrected: str | None = None
    asked: dict[str, Any] | None = None
    tries: int = 1


def commit_verdicts(folder: Path, verdicts: str = VERDICTS) -> str:
    """Store the hash of all verdicts, once, beside their folder; returns it.

    Args:
        folder: of the trial.
        verdicts: folder of one program's answers within it.

    Raises:
        InputError: if a verdict is missing, or was changed after the hash was stored.
    """
    names = names_of(folder)
    missing = [name for name in names if not (folder / verdicts / name / VERDICT).exists()]
    if missing:
        raise InputError(
            f"{folder / verdicts}: {len(missing)} of {len(names)} cases have no verdict yet ({missing[0]} "
            f"first); nothing is revealed; run stage={'diagnose' if verdicts == VERDICTS else 'baselines'}"
        )
    hashes = {name: digest((folder / verdicts / name / VERDICT).read_bytes()) for name in names}
    total = digest(json.dumps(hashes, sort_keys=True).encode())
    path = hashes_of(folder, verdicts)
    if path.exists():
        stored = read_json(path, "folder")
        changed = [name for name in names if stored["cases"].get(name) != hashes[name]]
        if changed:
            raise InputError(
                f"{folder / verdicts / changed[0]} was changed after the seal was opened; "
                "choose another folder"
            )
    else:
        write_json(path, {"sha256": total, "cases": hashes})
    return total


def reveal(folder: Path, sealed: Path, verdicts: str = VERDICTS) -> tuple[dict[str, Any], list[Revealed]]:
    """Commit the verdicts, open the seal, check truth and recordings.

    Args:
        folder: of the trial.
        sealed: folder of the truth.
        verdicts: folder of one program's answers within that of the trial.

    Returns:
        ``seed``, ``commitment``, ``verdicts`` (hashes), ``scope`` and ``asked``, and the cases.

    Raises:
        InputError: if a verdict is missing or anything was changed.
    """
    hashed = commit_verdicts(folder, verdicts)
    published = read_json(folder / COMMITMENT, "folder")
    truth = open_seal(sealed, published["sha256"])
    for part in truth["cases"]:
        _refuse_changed(folder, part, published["recordings"])
    cases = [_revealed(folder / verdicts, part) for part in truth["cases"]]
    facts = {"seed": truth["seed"], "commitment": published["sha256"], "verdicts": hashed}
    asked = [one.asked for one in cases if one.asked is not None]
    once = [one for i, one in enumerate(asked) if one not in asked[:i]]
    return facts | {"scope": published["scope"], "asked": once}, cases


def _refuse_changed(folder: Path, part: dict[str, Any], published: dict[str, str]) -> None:
    """Refuse a case whose recordings, or what the tool is told besides, are not as they were concealed.

    Raises:
        InputError: if something was changed, with the file.
    """
    for name, sha in part["recordings"].items():
        if digest((folder / name).read_bytes()) != sha or published.get(name) != sha:
            raise InputError(f"{folder / name} is not the recording that was concealed; nothing is scored")
    case = Case.from_json(part["truth"])
    told = folder / CASES / case.name / CASE
    if read_json(told, "folder") != case.public():
        raise InputError(f"{told} is not what was to be told of the case; nothing is scored")


def _revealed(verdicts: Path, part: dict[str, Any]) -> Revealed:
    case = Case.from_json(part["truth"])
    return Revealed(case, part["secrets"], **read_json(verdicts / case.name / VERDICT, "folder"))
