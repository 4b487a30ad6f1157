"""Conceal: draw cases, write their recordings, seal their truth, publish the commitment."""

import json
import os
import secrets
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from clearance.errors import InputError
from clearance.provenance import describe
from clearance.trial.draw import Drawing, Scope
from clearance.trial.exudyn_plant import load_exudyn
from clearance.trial.plant import write_parquet
from clearance.trial.seal import TRUTH, close, digest, lock, unlock, write_private
from clearance.trial.simulate import simulate
from clearance.whole_files import read_json, write_atomically, write_json

COMMITMENT, CASES, CASE = "commitment.json", "cases", "case.json"
_PLAN = "plan.json"


def conceal(
    scope: Scope, seed: int | None, folder: Path, sealed: Path, parallel: int, report: Callable[[str], None]
) -> dict[str, Any]:
    """Make the cases of a trial, or go on with making them; returns the published commitment.

    Args:
        scope: how cases are drawn.
        seed: of the cases; ``None``: one that only the sealed folder knows.
        folder: of the trial; recordings go to ``cases``.
        sealed: folder of the truth, outside of ``folder``.
        parallel: cases at a time.
        report: called with progress.

    Raises:
        InputError: if the folder holds a trial of another scope, one of the two lies inside the other, the
            truth's holds other files, or beams are wanted without Exudyn.
    """
    if sealed.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"sealed = {sealed} lies inside folder = {folder}; set sealed to a folder elsewhere")
    if folder.resolve().is_relative_to(sealed.resolve()):
        raise InputError(
            f"folder = {folder} lies inside sealed = {sealed}, which nobody may enter; change one"
        )
    if (folder / COMMITMENT).exists():
        done: dict[str, Any] = read_json(folder / COMMITMENT, "folder")
        if _whole(done["scope"]) != _plain(scope):
            raise InputError(
                f"folder = {folder} holds a trial that was drawn otherwise; choose another folder"
            )
        report(f"{folder} holds this trial already, with the seed it was drawn from; it goes on")
        return done
    if scope.shares.get("beam", 0.0) > 0.0:
        load_exudyn()
    try:
        drawing = Drawing(scope, _plan(scope, seed, sealed))
        with ThreadPoolExecutor(parallel) as pool:
            parts = list(pool.map(lambda i: _make(drawing, i, folder, sealed, report), range(scope.cases)))
    except InputError:
        # Another trial's truth stays sealed; Path.exists would raise on a folder without rights.
        if os.path.exists(sealed / TRUTH):  # noqa: PTH110
            lock(sealed)
        raise
    commitment = close(sealed, {"seed": drawing.seed, "scope": _plain(scope), "cases": parts})
    published = {
        "sha256": commitment,
        "scope": _plain(scope),
        "recordings": {name: sha for part in parts for name, sha in part["recordings"].items()},
    }
    write_json(folder / COMMITMENT, published)
    return published


def names_of(folder: Path) -> list[str]:
    """The cases of a trial.

    Raises:
        InputError: if nothing was concealed there, to the end.
    """
    if not (folder / COMMITMENT).exists():
        raise InputError(f"folder = {folder}: no concealed cases there; run stage=conceal or set folder")
    return sorted(path.name for path in (folder / CASES).iterdir())


def _plain(scope: Scope) -> Any:
    return json.loads(json.dumps(describe(scope)))


def _whole(stored: Any) -> Any:
    """A stored scope, perhaps of an older version, with what it did not know of yet as it was."""
    return {**_plain(Scope()), **stored}


def _plan(scope: Scope, seed: int | None, sealed: Path) -> int:
    """The seed, kept beside the truth so that an interrupted concealment goes on with the same cases."""
    sealed.mkdir(mode=0o700, parents=True, exist_ok=True)
    with suppress(PermissionError):  # only a seal may not be looked into
        others = [
            p.name for p in sealed.iterdir() if p.name not in (_PLAN, TRUTH, CASES) and p.name[0] != "."
        ]
        if others:
            raise InputError(f"sealed = {sealed} holds other files ({others[0]}); choose an empty folder")
    unlock(sealed)
    path = sealed / _PLAN
    if not path.exists():
        write_private(path, {"seed": secrets.randbits(63) if seed is None else seed, "scope": _plain(scope)})
    plan = read_json(path, "sealed")
    if _whole(plan["scope"]) != _plain(scope) or seed not in (None, plan["seed"]):
        raise InputError(
            f"sealed = {sealed} holds the truth of a trial drawn otherwise; choose another sealed"
        )
    return int(plan["seed"])


def _make(
    drawing: Drawing, index: int, folder: Path, sealed: Path, report: Callable[[str], None]
) -> dict[str, Any]:
    """One case: recordings and what the tool is told into the folder, then the truth beside the seal."""
    private = sealed / CASES / f"{index:04d}.json"
    if private.exists():
        found: dict[str, Any] = read_json(private, "sealed")
        for name, sha in found["recordings"].items():
            if not (folder / name).exists() or digest((folder / name).read_bytes()) != sha:
                raise InputError(
                    f"sealed = {sealed} holds the truth of recordings that are not in folder = {folder}, or "
                    f"not as they were ({name}); choose another sealed, or the folder where they are"
                )
        return found
    for attempt in range(10):
        try:
            simulated = simulate(drawing.case(index, attempt))
            break
        except FloatingPointError:  # a machine that flies apart is drawn again
            continue
    else:
        raise InputError(f"case {index + 1}: no machine of ten that were drawn could run; change seed")
    case = simulated.case
    place = folder / CASES / case.name
    place.mkdir(parents=True, exist_ok=True)
    hashes = {}
    for number, table in enumerate(simulated.recordings, 1):
        path = place / f"{number}.parquet"
        write_atomically(path, partial(_write, table))
        hashes[str(path.relative_to(folder))] = digest(path.read_bytes())
    write_json(place / CASE, case.public())
    for one in (place / CASE, place):
        os.utime(one, (0, 0))
    part = {"truth": case.to_json(), "secrets": simulated.secrets, "recordings": hashes}
    write_private(private, part)
    report(f"{case.name} of {drawing.scope.cases} concealed")
    return part


def _write(table: Mapping[str, np.ndarray], path: Path) -> None:
    """A recording; when it was written would tell how long its case took."""
    write_parquet(table, path)
    os.utime(path, (0, 0))
