"""Close the loop: does an estimator read the clearance again once its simulator was corrected?

A network that was trained on the nominal simulator goes on there, on the simulator that the diagnosis of a
revealed case corrected, and on the true physics (the floor); another was trained on random physics from the
start, and goes on there (domain randomisation: Tobin et al. 2017, IROS, 23-30). So each has seen as many
runs for as long. All read recordings of the independent plant with the case's effect at clearances and speeds
of its own, which no training and no diagnosis has seen.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.errors import InputError
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.description import write_mechanism
from clearance.mechanism.parameters import TABLE_KNOTS, require, require_list
from clearance.mechanism.slider_crank import SliderCrank
from clearance.models.gauge import Estimate
from clearance.predict import estimate_file, load_gauge
from clearance.processes import quoted
from clearance.provenance import describe
from clearance.trial.case import Case, Session
from clearance.trial.draw import Scope
from clearance.trial.examine import CORRECTED
from clearance.trial.plant import ACCELERATIONS, ExtraForce, write_parquet
from clearance.trial.repertoire import FORCES
from clearance.trial.reveal import Revealed
from clearance.trial.score import item_of
from clearance.trial.trainings import PLAN, Training, train_all
from clearance.whole_files import read_json, write_atomically, write_json

LOOP, RESULT = "loop", "closed_loop.json"
ESTIMATORS = ("nominal", "corrected", "true", "random")
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)  # multiples of it fill an interval evenly
_GAP = 0.5  # percent between the nominal and the true simulator: what is closed of less is chance
_TOUCHING = 2.0  # times a worn bore's amplitude: less clearance would close the gap
_PLACES = {
    "slider_x": ("slider", "x"), "rod_moment": ("rod", "moment"), "crank_torque": ("crank", "torque"),
    "frame_x": ("frame", "x"),
}  # fmt: skip
_RANGES = {
    "slider_position": (0.068, 0.172), "slider_velocity": (-6.0, 6.0), "rod_angle": (-0.43, 0.43),
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
        goes_on: more for one that goes on from another's weights: on the nominal machine, on what was
            corrected and on what is true from the nominal machine's, on random physics from its own.
        random: more for those on random physics; ``{joint}`` and ``{other}`` stand for b and c.
    """

    tests: int
    clearance_range: Sequence[float]
    speed_range: Sequence[float]
    seconds: float
    label_range: float
    train: Sequence[str]
    goes_on: Sequence[str]
    random: Sequence[str]

    def __post_init__(self) -> None:
        require(self, 1, 10_000, whole=True, tests=self.tests)
        require(self, 0.1, 60.0, seconds=self.seconds)
        require(self, 0.0, 1.0, strict=True, label_range=self.label_range)
        require_list(self, 2, 0.0, 2e-3, clearance_range=self.clearance_range)
        require_list(self, 2, 1.0, 2e4, speed_range=self.speed_range)
        for name in ("clearance_range", "speed_range"):
            if not getattr(self, name)[0] < getattr(self, name)[1]:
                raise InputError(f"{name} = {list(getattr(self, name))} does not rise; change loop.{name}")
        for name in ("train", "goes_on", "random"):
            given = getattr(self, name)
            if not isinstance(given, list | tuple) or not all(isinstance(one, str) for one in given):
                raise InputError(f"{name} = {given!r} is no list of overrides; change loop.{name}")

    def check(self, scope: Scope) -> None:
        """Refuse a scope whose cases could not be trained on, before any is concealed.

        Raises:
            InputError: a frame that is known to move, or a force over time.
        """
        if scope.known_frame > 0.0:
            raise InputError(
                f"known_frame = {scope.known_frame:g}: a loop trains on a frame at rest; set "
                "scope.known_frame=0"
            )
        forces = [name for name in FORCES if name in scope.items] or list(FORCES)
        passing = [name for name in forces if FORCES[name].argument not in _RANGES]
        if passing and scope.shares.get("outside", 0.0) > 0.0:
            raise InputError(
                f"items: {passing[0]} is a force over time, which no other run shares; name others in "
                "scope.items"
            )


def close_loop(
    cases: Sequence[Revealed], folder: Path, loop: Loop, parallel: int, report: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Train and test for every case; what was done before is not done again.

    Args:
        cases: after the reveal.
        folder: of the trial.
        loop: how.
        parallel: recordings that are simulated, and networks that are trained, at a time.
        report: called with progress.

    Returns:
        A row a case: mean absolute errors in percent of ``label_range`` by estimator, and of the diagnosis.
    """
    tests = {}
    for case in (one.case for one in cases):
        tests[case.name] = record(case, folder / LOOP / case.name / "tests", loop, parallel)
        report(
            f"{case.name}: {len(tests[case.name])} recordings of a machine with {' and '.join(case.missing)}"
        )
    trained = _trained(cases, folder / LOOP, loop, parallel, report)
    rows = []
    for one in cases:
        case, read = one.case, tests[one.case.name]
        gauges = {name: load_gauge(run) for name, run in trained[case.name].items()}
        found = {name: [estimate_file(gauge, path)[0] for path, _ in read] for name, gauge in gauges.items()}
        row = score(one, [true for _, true in read], found, loop)
        write_json(folder / LOOP / case.name / RESULT, row)
        rows.append(row)
        errors = ", ".join(f"{name} {row['error'][name]:.2f} %" for name in found)
        report(f"{case.name}: mean errors of the clearance: {errors}")
    return rows


def record(case: Case, folder: Path, loop: Loop, parallel: int) -> list[tuple[Path, float]]:
    """Recordings of a case's machine with other clearances, noise free, and these clearances [m].

    A machine that cannot run with one is left out.

    Raises:
        InputError: others than these were made there, or no machine runs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plan, asked = folder / PLAN, describe([case.to_json(), *_asked(loop)])
    if plan.exists() and read_json(plan, "folder") != asked:
        raise InputError(
            f"{folder} holds recordings of another machine or loop; set folder to another one, or loop back"
        )
    write_json(plan, asked)
    low, high = _clearances(case, loop)
    slow, fast = loop.speed_range

    def one(i: int) -> tuple[Path, float] | None:
        clearance = low + (i + 0.5) / loop.tests * (high - low)
        path = folder / f"{i + 1:03d}.parquet"
        if path.exists():
            return path, clearance
        speed = slow + (_GOLDEN * (i + 1)) % 1.0 * (fast - slow)
        session = Session(speed_rpm=speed, start_angle=float(i), record_start=0.5, duration=loop.seconds)
        try:
            table = replace(case, clearance=clearance).plant(session).recording(
                loop.seconds, session.record_start, ACCELERATIONS, noise=0.0,
                start_angle=session.start_angle, start_speed_rpm=speed,
            )  # fmt: skip
        except FloatingPointError:
            return None
        write_atomically(path, lambda file: write_parquet(table, file))
        return path, clearance

    with ThreadPoolExecutor(parallel) as pool:
        found = [made for made in pool.map(one, range(loop.tests)) if made is not None]
    if not found:
        raise InputError(f"{case.name}: no machine of {loop.tests} could run; change loop.clearance_range")
    return found


def _asked(loop: Loop) -> list[Any]:
    return [loop.tests, list(loop.clearance_range), list(loop.speed_range), loop.seconds]


def _clearances(case: Case, loop: Loop) -> tuple[float, float]:
    """Limits [m] of the clearances at which a case is read: a worn bore must not close."""
    worn = case.effects.get("worn_bearing", {}).get("amplitude", 0.0)
    return max(loop.clearance_range[0], _TOUCHING * worn), loop.clearance_range[1]


def true_machine(case: Case) -> SliderCrank:
    """The simulator's machine with what is true of a case; a force without a name as a fine table."""
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
    law = ExtraForce(**{key: value for key, value in force.items() if key != "of"})
    turn, (low, high) = argument == "crank_angle", _RANGES[argument]
    knots = np.linspace(low, high, TABLE_KNOTS, endpoint=not turn)
    body, direction = _PLACES[law.target]
    return TabulatedForce(
        body, direction, argument, low, None if turn else float(knots[1] - knots[0]),
        tuple(map(float, law.value(knots))), "cubic",
    )  # fmt: skip


def _trained(
    cases: Sequence[Revealed], folder: Path, loop: Loop, parallel: int, report: Callable[[str], None]
) -> dict[str, dict[str, Path]]:
    """The folder of each estimator's training, by case; what is not there is trained.

    A machine that the diagnosis got so wrong that it cannot be trained on leaves the nominal estimator.
    """
    plans = {one.case.name: _plans(one, folder, loop) for one in cases}
    failed = dict[Path, str]()
    for goes_on in (False, True):  # those that the others go on from come first
        wanted = {
            plan.place: plan
            for each in plans.values()
            for name, plan in each.items()
            if (name in ESTIMATORS) == goes_on
        }
        failed |= train_all(list(wanted.values()), parallel, report)
    trained = {case: {name: each[name].place for name in ESTIMATORS} for case, each in plans.items()}
    for case, runs in trained.items():
        if runs["corrected"] in failed:
            report(f"{case}: {failed[runs['corrected']]}; it counts as not corrected")
            runs["corrected"] = runs["nominal"]
    return trained


def _plans(one: Revealed, folder: Path, loop: Loop) -> dict[str, Training]:
    """The trainings of a case, by estimator; those that others go on from, too."""
    case, own = one.case, folder / one.case.name
    own.mkdir(parents=True, exist_ok=True)
    truth, corrected = own / "truth.yaml", own / CORRECTED
    write_mechanism(truth, true_machine(case), "what was true of the case")
    low, high = _clearances(case, loop)
    said = max(low, _TOUCHING * _lobes(one.corrected, case.joint))  # may be larger than they are
    names = {"{joint}": case.joint.lower(), "{other}": "c" if case.joint == "B" else "b"}
    random = [_filled(override, names) for override in loop.random]

    def of_all(name: str, *more: str) -> Training:
        title = f"the {name} estimator of joint {case.joint}"
        place = folder / f"{name}_{case.joint}"
        return Training(title, place, (f"joint={case.joint}", *loop.train, *more))

    def of_case(name: str, machine: Path, low: float) -> Training:
        more = (f"joint={case.joint}", *loop.train, f"mechanism={machine.resolve()}", *on(begun, low))
        return Training(f"the {name} estimator of {case.name}", own / name, more, name == "corrected")

    def on(begun: Training, low: float) -> list[str]:
        drawn = f"campaign.clearance_range=[{low},{high}]"
        return [f"begin={quoted(begun.place)}", drawn, *loop.goes_on]

    begun, begun_random = of_all("nominal_begun"), of_all("random_begun", *random)
    plans = {
        "nominal_begun": begun,
        "random_begun": begun_random,
        "nominal": of_all("nominal", *on(begun, loop.clearance_range[0])),
        "corrected": of_case("corrected", corrected, said),
        "true": of_case("true", truth, low),
        "random": of_all("random", *random, *on(begun_random, loop.clearance_range[0])),
    }
    if one.corrected is None:  # no verdict: nothing was corrected
        plans["corrected"] = plans["nominal"]
    else:
        text = one.corrected
        write_atomically(corrected, lambda file: file.write_text(text, encoding="utf-8"))
    return plans


def _lobes(corrected: str | None, joint: str) -> float:
    """Amplitude [m] of the worn bore that a corrected machine has in a joint, if it has one."""
    laws = (yaml.safe_load(corrected) or {} if corrected else {}).get(f"joint_{joint.lower()}", {})
    return float(laws.get("bearing", {}).get("amplitude", 0.0))


def _filled(text: str, names: Mapping[str, str]) -> str:
    for name, value in names.items():
        text = text.replace(name, value)
    return text


def score(
    one: Revealed, true: Sequence[float], found: Mapping[str, Sequence[Estimate]], loop: Loop
) -> dict[str, Any]:
    """One row: errors in percent of the range, and the share of the gap to the floor that was closed."""
    case, said = one.case, one.diagnosis
    read = {name: np.array([e.clearance_m for e in each]) for name, each in found.items()}
    error = {name: float(100.0 * np.abs(v - true).mean() / loop.label_range) for name, v in read.items()}
    own = said["clearance"]["after_m"] if said else None
    return {
        "name": case.name, "item": item_of(case), "size": case.size, "joint": case.joint,
        "clearance_m": case.clearance, "verdict": said["verdict"] if said else "no verdict",
        "named": [effect["name"] for effect in said["effects"]] if said else [],
        "left_out": loop.tests - len(true), "error": error, "closed": _closed(error, "corrected"),
        "diagnosis_error": None if own is None else 100.0 * abs(own - case.clearance) / loop.label_range,
        "trusted": {name: float(np.mean([e.trusted for e in each])) for name, each in found.items()},
        "true_m": list(true), "estimates_m": {name: v.tolist() for name, v in read.items()},
    }  # fmt: skip


def _closed(error: Mapping[str, float], name: str) -> float | None:
    """Share of the gap between the nominal and the true simulator; ``None`` where there is hardly one."""
    gap = error["nominal"] - error["true"]
    return (error["nominal"] - error[name]) / gap if gap > _GAP else None


def summarise(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean errors over all cases, the share of the mean gap that was closed, and the mean of their shares."""
    error = {name: float(np.mean([row["error"][name] for row in rows])) for name in ESTIMATORS}
    shares = [row["closed"] for row in rows if row["closed"] is not None]
    return {
        "mean_of_shares": float(np.mean(shares)) if shares else None,
        "cases": len(rows), "error": error, "closed": _closed(error, "corrected"),
        "closed_by_random": _closed(error, "random"),
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
    label = "mean" if len(own) == len(rows) else f"mean (the diagnosis: of {len(own)})"
    lines.append(_line(label, "", summarise(rows), float(np.mean(own)) if own else None))
    return "\n".join(lines) + "\n"


def _line(label: str, said: str, row: Mapping[str, Any], own: float | None) -> str:
    error, closed, by_random = row["error"], row["closed"], row.get("closed_by_random")
    random = f"{error['random']:.2f} %" + ("" if by_random is None else f" (closes {by_random:.0%})")
    shares = row.get("mean_of_shares")
    cells = [
        label, said, *(f"{error[name]:.2f} %" for name in ("nominal", "corrected", "true")),
        ("" if closed is None else f"{closed:.0%}") + ("" if shares is None else f" (shares: {shares:.0%})"),
        random,
        "" if own is None else f"{own:.3f} %",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"
