"""Close the loop: does an estimator read the clearance again once its simulator was corrected?

Of each revealed case one network was trained on the nominal simulator, one goes on from it on the simulator
that the diagnosis corrected, one was trained on the true physics (the floor), and one on random physics from
the start (domain randomisation: Tobin et al. 2017, IROS, 23-30). All read recordings of the independent plant
with the case's effect at clearances and speeds of its own, which no training and no diagnosis has seen.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect, load_effects
from clearance.errors import InputError
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.description import write_mechanism
from clearance.mechanism.parameters import TABLE_KNOTS
from clearance.mechanism.slider_crank import SliderCrank
from clearance.models.run_folder import METRICS
from clearance.predict import estimate_file, load_gauge
from clearance.trial.case import Case, Session
from clearance.trial.examine import VERDICTS
from clearance.trial.plant import ACCELERATIONS, ExtraForce, write_parquet
from clearance.trial.reveal import Revealed
from clearance.trial.score import item_of
from clearance.whole_files import write_json

LOOP, RESULT = "loop", "closed_loop.json"
ESTIMATORS = ("nominal", "corrected", "true", "random")
_ROOT = Path(__file__).parents[2]
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)  # multiples of it fill an interval evenly
_TOUCHING = 2.0  # times a worn bore's amplitude: less clearance would close the gap
_PLACES = {
    "slider_x": ("slider", "x"), "rod_x": ("rod", "x"), "rod_y": ("rod", "y"),
    "rod_moment": ("rod", "moment"), "crank_torque": ("crank", "torque"), "frame_x": ("frame", "x"),
}  # fmt: skip
_RANGES = {
    "slider_position": (0.07, 0.17), "slider_velocity": (-6.0, 6.0), "rod_angle": (-0.43, 0.43),
    "crank_angle": (0.0, 2.0 * np.pi),
}  # fmt: skip


@dataclass(frozen=True)
class Loop:
    """How estimators are trained and tested.

    Attributes:
        tests: recordings of each case's machine that are read.
        clearance_range: of these, spread evenly [m].
        speed_range: likewise [rpm].
        seconds: length of each [s].
        label_range: errors are given in percent of it [m].
        train: overrides of every training.
        corrected: more for one that goes on from the nominal machine's weights.
        random: more for one on random physics; ``{joint}`` and ``{other}`` stand for b and c.
    """

    tests: int
    clearance_range: Sequence[float]
    speed_range: Sequence[float]
    seconds: float
    label_range: float
    train: Sequence[str]
    corrected: Sequence[str]
    random: Sequence[str]


def close_loop(
    cases: Sequence[Revealed], folder: Path, loop: Loop, parallel: int, report: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Train and test for every case; what was done before is not done again.

    Args:
        cases: after the reveal.
        folder: of the trial.
        loop: how.
        parallel: recordings that are simulated at a time.
        report: called with progress.

    Returns:
        A row a case: mean absolute errors in percent of ``label_range`` by estimator, and of the diagnosis.
    """
    rows = []
    for one in cases:
        case, place = one.case, folder / LOOP / one.case.name
        tests = record(case, place / "tests", loop, parallel)
        report(f"{case.name}: {len(tests)} recordings of a machine with {' and '.join(case.missing)}")
        runs = _trained(case, folder, loop, report)
        found = {name: _estimates(run, tests) for name, run in runs.items()}
        row = score(one, np.array([t for _, t in tests]), found, loop.label_range)
        write_json(place / RESULT, row)
        rows.append(row)
        errors = ", ".join(f"{name} {row['error'][name]:.2f} %" for name in found)
        report(f"{case.name}: mean errors of the clearance: {errors}")
    return rows


def record(case: Case, folder: Path, loop: Loop, parallel: int) -> list[tuple[Path, float]]:
    """Recordings of a case's machine with other clearances, noise free, and these clearances [m].

    A machine that cannot run with one is left out.
    """
    low, high = loop.clearance_range
    worn = case.effects.get("worn_bearing", {}).get("amplitude", 0.0)
    low = max(low, _TOUCHING * worn)
    slow, fast = loop.speed_range

    def one(i: int) -> tuple[Path, float] | None:
        clearance = low + (i + 0.5) / loop.tests * (high - low)
        path = folder / f"{i + 1:03d}.parquet"
        if path.exists():
            return path, clearance
        speed = slow + (_GOLDEN * (i + 1)) % 1.0 * (fast - slow)
        session = Session(speed_rpm=speed, start_angle=float(i), record_start=0.5, duration=loop.seconds)
        plant = replace(case, clearance=clearance).plant(session)
        try:
            table = plant.recording(
                loop.seconds, session.record_start, ACCELERATIONS, noise=0.0, start_angle=session.start_angle,
                start_speed_rpm=speed,
            )  # fmt: skip
        except FloatingPointError:
            return None
        folder.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(".part")
        write_parquet(table, temporary)
        temporary.replace(path)
        return path, clearance

    with ThreadPoolExecutor(parallel) as pool:
        return [found for found in pool.map(one, range(loop.tests)) if found is not None]


def true_machine(case: Case) -> SliderCrank:
    """The simulator's machine with what is true of a case; a force without a name as a fine table.

    Raises:
        InputError: a force over time, which no machine of a training shares.
    """
    joint = f"joint_{case.joint.lower()}"
    machine = SliderCrank()
    machine = replace(machine, **{joint: replace(getattr(machine, joint), clearance=case.clearance)})
    for name, values in case.effects.items():
        (effect,) = load_effects([name])
        variant = _variant(effect, values)
        own = {key: float(value) for key, value in values.items() if key in variant.parameters}
        machine = variant.machine(machine, case.joint, own)
    if case.force is not None:
        machine = replace(machine, force=_table(case.force))
    return machine


def _variant(effect: Effect, values: Mapping[str, float]) -> Effect:
    """The smallest form of an effect that has all of a case's numbers, as far as it knows them."""
    known = {key for form in effect.variants() for key in form.parameters} & set(values)
    forms = [form for form in effect.variants() if known <= set(form.parameters)]
    return min(forms, key=lambda form: len(form.parameters))


def _table(force: Mapping[str, Any]) -> TabulatedForce:
    argument = str(force["argument"])
    if argument not in _RANGES:
        raise InputError(f"scope.items: a force over {argument} cannot be trained on; choose another item")
    law = ExtraForce(**{key: value for key, value in force.items() if key != "of"})
    turn, (low, high) = argument == "crank_angle", _RANGES[argument]
    knots = np.linspace(low, high, TABLE_KNOTS, endpoint=not turn)
    body, direction = _PLACES[law.target]
    return TabulatedForce(
        body, direction, argument, low, None if turn else float(knots[1] - knots[0]),
        tuple(map(float, law.value(knots))), "cubic",
    )  # fmt: skip


def _trained(case: Case, folder: Path, loop: Loop, report: Callable[[str], None]) -> dict[str, Path]:
    """The folder of each estimator's training; what is not there is trained."""
    shared, own = folder / LOOP, folder / LOOP / case.name
    joint = f"joint={case.joint}"
    names = {"joint": case.joint.lower(), "other": "c" if case.joint == "B" else "b"}
    nominal = shared / f"nominal_{case.joint}"
    own.mkdir(parents=True, exist_ok=True)
    truth = own / "truth.yaml"
    write_mechanism(truth, true_machine(case), "what was true of the case")
    corrected = (folder / VERDICTS / case.name / "corrected.yaml").resolve()
    plans = {
        "nominal": (nominal, []),
        "corrected": (
            own / "corrected", [f"mechanism={corrected}", f"begin={nominal.resolve()}", *loop.corrected],
        ),
        "true": (own / "true", [f"mechanism={truth.resolve()}"]),
        "random": (
            shared / f"random_{case.joint}",
            [o.replace("{joint}", names["joint"]).replace("{other}", names["other"]) for o in loop.random],
        ),
    }  # fmt: skip
    if not corrected.exists():  # no verdict: nothing was corrected
        plans["corrected"] = plans["nominal"]
    for name, (place, more) in plans.items():
        if not (place / METRICS).exists():
            report(f"{case.name}: training on the {name} simulator")
            _train(place, [joint, *loop.train, *more])
    return {name: place for name, (place, _) in plans.items()}


def _train(place: Path, overrides: Sequence[str]) -> None:
    place.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "clearance.train", *overrides, f"hydra.run.dir='{place.resolve()}'"]
    paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    log = place / "output.txt"
    with log.open("wb") as out:
        code = subprocess.call(
            command, stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        )  # fmt: skip
    if code != 0:
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise InputError(f"{place}: a training ended with {lines[-1][:300] if lines else code}; see {log}")


def _estimates(run: Path, tests: Sequence[tuple[Path, float]]) -> np.ndarray:
    gauge = load_gauge(run)
    return np.array([estimate_file(gauge, path).clearance_m for path, _ in tests])


def score(
    one: Revealed, true: np.ndarray, found: Mapping[str, np.ndarray], label_range: float
) -> dict[str, Any]:
    """One row: errors in percent of the range, and the share of the gap to the floor that was closed."""
    case, said = one.case, one.diagnosis
    error = {name: float(100.0 * np.abs(v - true).mean() / label_range) for name, v in found.items()}
    gap = error["nominal"] - error["true"]
    own = said["clearance"]["after_m"] if said else None
    return {
        "name": case.name, "item": item_of(case), "size": case.size, "joint": case.joint,
        "clearance_m": case.clearance, "verdict": said["verdict"] if said else one.failure,
        "named": [effect["name"] for effect in said["effects"]] if said else [],
        "error": error,
        "closed": (error["nominal"] - error["corrected"]) / gap if gap > 0.0 else None,
        "diagnosis_error": None if own is None else 100.0 * abs(own - case.clearance) / label_range,
        "true_m": true.tolist(), "estimates_m": {name: v.tolist() for name, v in found.items()},
    }  # fmt: skip


def summarise(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean errors over all cases, and the share of the whole gap that was closed."""
    mean = {name: float(np.mean([row["error"][name] for row in rows])) for name in ESTIMATORS}
    gap = mean["nominal"] - mean["true"]
    return {
        "cases": len(rows), "error": mean,
        "closed": (mean["nominal"] - mean["corrected"]) / gap if gap > 0.0 else None,
        "closed_by_random": (mean["nominal"] - mean["random"]) / gap if gap > 0.0 else None,
    }  # fmt: skip


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The rows as a Markdown table."""
    lines = [
        "| what the simulator lacks | said | nominal | corrected | true physics | gap closed "
        "| random physics | the diagnosis itself |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        said = ", ".join(row["named"]) or row["verdict"]
        lines.append(_line(f"{row['item']}, joint {row['joint']}", said, row, row["diagnosis_error"]))
    own = [row["diagnosis_error"] for row in rows if row["diagnosis_error"] is not None]
    lines.append(_line("mean", "", summarise(rows), float(np.mean(own)) if own else None))
    return "\n".join(lines) + "\n"


def _line(label: str, said: str, row: Mapping[str, Any], own: float | None) -> str:
    error, closed = row["error"], row["closed"]
    cells = [
        label, said, *(f"{error[name]:.2f} %" for name in ("nominal", "corrected", "true")),
        "" if closed is None else f"{closed:.0%}", f"{error['random']:.2f} %",
        "" if own is None else f"{own:.3f} %",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"
