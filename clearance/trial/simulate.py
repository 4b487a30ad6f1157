"""One case simulated: its recordings, and what the scorer needs to know of it beyond its truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from clearance.trial.case import Case, Session
from clearance.trial.chart import chart
from clearance.trial.plant import (
    ACCELERATIONS,
    BASE_RATE,
    CHANNELS,
    MARGIN,
    FloatArray,
    Instant,
    measure,
)
from clearance.trial.repertoire import SENSORS
from clearance.trial.visibility import STILL, WINDOW, Scene, averaged, later, response, unexplained

INSTANTS = 10  # of each recording, after its end: nobody has seen them
AFTER = 0.2  # s over which they are spread: a turn and a half at the slowest
_CURVE = 60  # samples of the true force in each piece between two instants
_RATE = 10_000.0  # Hz
_ARGUMENTS = ("crank_angle", "crank_speed", "slider_position", "slider_velocity")
_FORCES = {"force": "EXTRA", "guide_friction": "FRICTION", "slider_spring": "LOAD", "process_load": "LOAD"}


@dataclass(frozen=True)
class Simulated:
    """A case after its simulation.

    Attributes:
        case: with the limit of a saturation in m/s².
        recordings: one a session, ``time`` and channels.
        secrets: plain data: ``visibility`` of each thing that is missing, ``scenes``, ``spread`` (standard
            deviations of the accelerations), ``curve`` (the true force and its possible arguments); of a
            beam ``responses``, (50, 10) accelerations over the 5 ms of each scene [m/s²].
    """

    case: Case
    recordings: list[dict[str, FloatArray]]
    secrets: dict[str, Any]


def simulate(case: Case) -> Simulated:
    """Simulate the recordings of a case and the instants after them.

    Raises:
        FloatingPointError: if the machine of the case cannot run.
    """
    run = _run_beam if case.kind == "beam" else _run
    parts = [run(case, number) for number in range(len(case.sessions))]
    case = _with_limit(case, [signals for signals, _, _ in parts])
    channels = [*SENSORS[case.sensors], *(["crank_angle"] if case.encoder else [])]
    recordings = [
        _measure(case, session, signals[: _samples(session)], channels, case.noise, case.noise_seed + i)
        for i, (session, (signals, _, _)) in enumerate(zip(case.sessions, parts, strict=True))
    ]
    scenes = [scene for _, some, _ in parts for scene in some]
    signals = [one for one, _, _ in parts]
    spread, responses = _spread(case, signals), _responses(case, scenes, signals)
    secrets = {
        "visibility": {
            name: _visibility(case, name, scenes, spread, signals, responses) for name in case.missing
        },
        "scenes": [
            {"session": s.session, "time": s.time, "state": s.state.tolist(), "memory": s.memory.tolist()}
            for s in scenes
        ],
        "spread": spread.tolist(),
        "curve": _curve(case, [truth for _, _, truth in parts]),
    }  # fmt: skip
    if case.kind == "beam":
        secrets["responses"] = [[_short(row) for row in one] for one in responses]
    return Simulated(case, recordings, secrets)


def scenes_of(secrets: Mapping[str, Any]) -> list[Scene]:
    """The instants that ``simulate`` kept."""
    return [
        Scene(one["session"], one["time"], np.array(one["state"]), np.array(one["memory"]))
        for one in secrets["scenes"]
    ]


def responses_of(case: Case, secrets: Mapping[str, Any]) -> list[FloatArray]:
    """What the case's machine does over the 5 ms of each instant: (50, 10) accelerations [m/s²]."""
    if "responses" in secrets:
        return [np.array(one) for one in secrets["responses"]]
    return _responses(case, scenes_of(secrets), [])


def _end(session: Session) -> float:
    # a slow clock's recording lasts a little longer than it says
    return round(session.record_start + 1.07 * session.duration + 2 * MARGIN, 4)


def _samples(session: Session) -> int:
    return round(_end(session) * BASE_RATE)


def _run(case: Case, number: int) -> tuple[FloatArray, list[Scene], dict[str, FloatArray]]:
    """Signals of a recording and beyond, instants after its end, and the true force with its arguments."""
    session = case.sessions[number]
    plant = case.plant(session)
    start = Instant(0.0, plant.start(session.start_angle, session.speed_rpm), np.zeros(2))
    run, instant = plant.go_on(start, _end(session))
    signals, scenes, kept = [run.signals], [], []
    for _ in range(INSTANTS):
        scenes.append(Scene(number, instant.time, chart(plant, instant.state), instant.memory))
        run, after = plant.go_on(instant, round(AFTER / INSTANTS, 4), truth=True)
        signals.append(run.signals)
        every = len(run.signals) // _CURVE
        rows = slice(None, None, every)
        table = {name: run.signals[rows, CHANNELS.index(name)] for name in _ARGUMENTS}
        table["time"] = instant.time - session.record_start + np.arange(len(run.signals))[rows] / BASE_RATE
        table |= {
            name: run.true(name)[rows] for name in ("EXTRA", "FRICTION", "LOAD", "NORMAL_B", "NORMAL_C")
        }
        kept.append(table)
        instant = after
    truth = {name: np.concatenate([table[name] for table in kept]) for name in kept[0]}
    return np.concatenate(signals), scenes, truth


def _run_beam(case: Case, number: int) -> tuple[FloatArray, list[Scene], dict[str, FloatArray]]:
    """Likewise with a rod of beam elements; no force is missing."""
    session = case.sessions[number]
    run = case.beam(session).run(_end(session) + AFTER)
    scenes = []
    for instant in range(INSTANTS):
        time = round(_end(session) + instant * AFTER / INSTANTS, 4)
        sample = round(time * BASE_RATE)
        scenes.append(Scene(number, time, run.states[sample], np.array([0.0, run.memory[sample]])))
    return run.signals, scenes, {}


def _responses(case: Case, scenes: Sequence[Scene], signals: Sequence[FloatArray]) -> list[FloatArray]:
    """See ``responses_of``; a beam's is what it did there, since a mode is not all of its state."""
    if case.kind == "beam":
        count = round(WINDOW * BASE_RATE)
        firsts = [round(scene.time * BASE_RATE) for scene in scenes]
        return [
            averaged(signals[scene.session][first : first + count, : len(ACCELERATIONS)])
            for scene, first in zip(scenes, firsts, strict=True)
        ]
    plants = [case.plant(session) for session in case.sessions]
    return [response(plants[scene.session], scene) for scene in scenes]


def _measure(
    case: Case, session: Session, signals: FloatArray, channels: Sequence[str], noise: float, seed: int
) -> dict[str, FloatArray]:
    return measure(
        signals, BASE_RATE, session.duration, session.record_start, channels, _RATE, noise, seed, 4096,
        case.plant_faults(),
    )  # fmt: skip


def _with_limit(case: Case, signals: Sequence[FloatArray]) -> Case:
    """The limit of a saturation, given by the share of the samples that it clips, as a value."""
    fault = case.faults.get("sensor_saturation")
    if fault is None:
        return case
    column = CHANNELS.index(fault["channel"])
    sizes = np.concatenate(
        [
            np.abs(averaged(one)[round(s.record_start * _RATE) :, column])
            for one, s in zip(signals, case.sessions, strict=True)
        ]
    )
    limit = float(np.quantile(sizes, 1.0 - fault["limit"]))
    return replace(case, faults={**case.faults, "sensor_saturation": {**fault, "limit": limit}})


def _spread(case: Case, signals: Sequence[FloatArray]) -> FloatArray:
    """(10,) standard deviations [m/s²] of the accelerations; 0 where one rests or is not recorded."""
    rows = [
        averaged(one)[round(s.record_start * _RATE) :, : len(ACCELERATIONS)]
        for one, s in zip(signals, case.sessions, strict=True)
    ]
    spread = np.concatenate(rows).std(axis=0)
    recorded = np.array([name in SENSORS[case.sensors] for name in ACCELERATIONS])
    found: FloatArray = np.where(recorded & (spread > STILL * spread.max()), spread, 0.0)
    return found


def _visibility(
    case: Case, name: str, scenes: Sequence[Scene], spread: FloatArray, signals: Sequence[FloatArray],
    responses: Sequence[FloatArray],
) -> float:  # fmt: skip
    """Change over the detection threshold that one missing thing makes, the others being known."""
    other = case.lacking(name)
    if name in case.faults:
        plants = [case.plant(session) for session in case.sessions]
        changes = [_fault_change(case, other, name, scene, signals[scene.session]) for scene in scenes]
        return unexplained(scenes, changes, plants, spread)
    without = [other.plant(session) for session in case.sessions]
    changes = [one - response(without[s.session], s) for one, s in zip(responses, scenes, strict=True)]
    return unexplained(scenes, changes, without, spread)


def _fault_change(case: Case, other: Case, name: str, scene: Scene, signals: FloatArray) -> FloatArray:
    """(50, 10) what a fault changes over the 5 ms of a scene."""
    first, count = round(scene.time * BASE_RATE), round(WINDOW * BASE_RATE)
    if name == "timebase":
        # from the window's own beginning: what a clock has lost before is lost in the start state
        piece = signals[first : first + count + count // 10, : len(ACCELERATIONS)]
        error = float(case.faults[name]["rate_error"])
        return averaged((later(piece, error) - piece)[:count])
    session = Session(speed_rpm=0.0, start_angle=0.0, record_start=2 * MARGIN, duration=round(WINDOW, 6))
    piece = signals[first - round(2 * MARGIN * BASE_RATE) : first + count + round(MARGIN * BASE_RATE)]
    one, two = (_measure(c, session, piece, ACCELERATIONS, 0.0, 0) for c in (case, other))
    return np.stack([one[channel] - two[channel] for channel in ACCELERATIONS], axis=1)


def _curve(case: Case, truths: Sequence[Mapping[str, FloatArray]]) -> dict[str, list[float]] | None:
    """The force that a free-form one should find, [N or N m], and its possible arguments."""
    if case.kind not in ("outside", "left_out"):
        return None
    (name,) = case.missing
    table = {key: np.concatenate([truth[key] for truth in truths]) for key in truths[0]}
    if name == "torque_ripple":
        v = case.effects[name]
        force = v["amplitude"] * np.cos(v["order"] * table["crank_angle"] + v["phase"])
    elif name in _FORCES:
        force = table[_FORCES[name]]
    else:
        return None
    crank, rod = (case.plant(case.sessions[0]).crank[2], case.plant(case.sessions[0]).rod[2])
    found = {key: table[key] for key in (*_ARGUMENTS, "time")}
    found["rod_angle"] = np.arcsin(-crank * np.sin(table["crank_angle"]) / rod)  # but for the clearance
    found |= {"contact_force": table[f"NORMAL_{case.joint}"], "force": force}
    return {key: _short(values) for key, values in found.items()}


def _short(values: FloatArray) -> list[float]:
    return [float(f"{x:.6g}") for x in values]
