"""The detectability map: sizes of effects that can be seen, by clearance, speed and sensor set.

That of the nominal machine is computed by ``make detectability`` and kept beside this file.
"""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from importlib import resources
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from hydra.utils import instantiate
from omegaconf import OmegaConf
from tqdm import tqdm

from clearance.configuration import CONFIGURATION
from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Hypothesis, Setting, gather, settled
from clearance.diagnosis.judging.detectability import (
    NOISE,
    differentiable,
    faults_of_sensors,
    linearised,
    rounded,
    shown_size,
)
from clearance.diagnosis.judging.finite_sizes import (
    Ladder,
    highest,
    ladder_of,
    left_by_sensor_set,
    limits_of_sensors,
    rungs,
    weakest,
    without_derivative,
)
from clearance.diagnosis.sensing.restoration import STILL
from clearance.mechanism.drive import Drive
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import SensorSet
from clearance.whole_files import write_json

CLEARANCES = (5e-5, 1e-4, 2e-4, 3e-4, 5e-4, 8e-4)  # m
SPEEDS = (500.0, 600.0, 700.0, 800.0, 900.0, 1000.0)  # rpm
_SETS = ("all", "crank", "no_crank", "no_rod", "no_slider", "rod")  # options of sensors; the paper's Table 9
_STORED = "nominal_map.json"
_BEGUN = 4  # rung of a ladder that is asked first at the first speed
_MACHINES = {"B": SliderCrank(joint_b=Joint(SOME_CLEARANCE)), "C": SliderCrank(joint_c=Joint(SOME_CLEARANCE))}


def write_nominal_map() -> None:
    """Compute the maps of both joints, with the paper's sets of sensors, in half an hour."""
    effects, sensor_sets = load_effects("all", []), _sensor_sets()
    maps = {
        joint: detectability_map(Setting(machine, joint), effects, CLEARANCES, SPEEDS, sensor_sets)
        for joint, machine in _MACHINES.items()
    }
    write_json(Path(str(resources.files(__package__).joinpath(_STORED))), maps)


def detectability_map(
    setting: Setting,
    effects: Sequence[Effect],
    clearances: Sequence[float],
    speeds: Sequence[float],
    sensor_sets: Sequence[SensorSet],
) -> dict[str, Any]:
    """The sizes of effects that are seen in one second of recording.

    Args:
        setting: the nominal machine and the joint.
        effects: of each, its first variant and trial are asked.
        clearances: [m].
        speeds: [rpm].
        sensor_sets: of accelerations.

    Returns:
        As the report takes it: ``effects``, each with ``size`` by sensor set, (clearances, speeds); smaller
        than that it cannot be seen, or larger where ``seen`` is ``below``. What is ``of`` the machine's
        ``structure`` adds coordinates; its size does not fall with a recording's length. ``weakest`` is the
        last that was asked, where that is an end: what is seen there may be seen beyond it.
    """
    machine = setting.with_clearance(clearances[0])
    groups = gather(effects, machine, setting.joint, ())
    smooth, finite = differentiable(groups, machine), without_derivative(groups, machine)
    faults = [fault.effect for fault in faults_of_sensors(effects)] + limits_of_sensors(effects)
    entries = [
        *(_told(one.effect, "machine") for one in smooth if one.effect),
        *(_of_structure(one) for one in finite),
        *(_told(one, "sensor", weakest(one) if one.free[0].off == np.inf else None) for one in faults),
    ]
    with ThreadPoolExecutor() as pool:
        each = pool.map(
            lambda clearance: _row(setting, smooth, finite, effects, clearance, speeds, sensor_sets),
            clearances,
        )
        rows = list(tqdm(each, total=len(clearances), unit="clearance", desc=f"joint {setting.joint}"))
    for k, one in enumerate(entries):
        one["size"] = {s.name: [[cell[s.name][k] for cell in row] for row in rows] for s in sensor_sets}
    return {
        "joint": setting.joint, "noise": NOISE, "seconds": 1.0,
        "clearance_m": list(clearances), "speed_rpm": list(speeds),
        "sensor_sets": {s.name: list(s.channels) for s in sensor_sets}, "effects": entries,
    }  # fmt: skip


def _told(effect: Effect, of: str, end: float | None = None) -> dict[str, Any]:
    """An entry of the map without its sizes; ``of``: what it is an effect of; ``end``: the weakest asked."""
    first = effect.free[0]
    seen = "below" if first.off == np.inf else "above"
    told = {"name": effect.name, "parameter": first.name, "unit": first.unit, "of": of, "seen": seen}
    return told if end is None else {**told, "weakest": rounded(end)}


def _of_structure(hypothesis: Hypothesis) -> dict[str, Any]:
    """An entry of what adds coordinates, with the shape that it has at every size."""
    assert hypothesis.effect is not None
    shape = [
        {"name": one.name, "value": float(value), "unit": one.unit}
        for one, value in zip(hypothesis.effect.free, hypothesis.start, strict=True)
        if one.shape
    ]
    return {**_told(hypothesis.effect, "structure", float(ladder_of(hypothesis)[-1])), "shape": shape}


def _row(
    setting: Setting,
    smooth: Sequence[Hypothesis],
    finite: Sequence[Hypothesis],
    effects: Sequence[Effect],
    clearance: float,
    speeds: Sequence[float],
    sensor_sets: Sequence[SensorSet],
) -> list[dict[str, list[float | None]]]:
    """At each speed, by sensor set, all sizes: of ``smooth``, of ``finite``, and of faults of sensors."""
    begin = dict.fromkeys((one.name for one in finite), _BEGUN)
    row = []
    for speed in speeds:
        found = _linear(setting, smooth, effects, clearance, speed, sensor_sets)
        for one in finite:
            ladder = Ladder(one, partial(left_by_sensor_set, setting, one, clearance, speed, sensor_sets))
            sizes, begin[one.name] = ladder.smallest(begin[one.name])
            for name, size in sizes.items():
                found[name][0].append(rounded(size))
        row.append({name: [*of_machine, *of_sensors] for name, (of_machine, of_sensors) in found.items()})
    return row


def _linear(
    setting: Setting,
    smooth: Sequence[Hypothesis],
    effects: Sequence[Effect],
    clearance: float,
    speed: float,
    sensor_sets: Sequence[SensorSet],
) -> dict[str, tuple[list[float | None], list[float | None]]]:
    """By sensor set: sizes of effects with a derivative, and of all faults of sensors."""
    look = linearised(setting, smooth, clearance, speed)
    spans = [one.unknowns[0].high - one.unknowns[0].low for one in smooth]
    plain = faults_of_sensors(effects)
    ladders = [rungs(effect, look.signals) for effect in limits_of_sensors(effects)]
    found = {}
    for sensors in sensor_sets:
        errors, each = look.errors(sensors, [*plain, *chain.from_iterable(ladders)])
        of_sensors, place = [], len(plain)
        for fault, own in zip(plain, each, strict=False):
            low, high = fault.effect.free[0].bounds
            of_sensors.append(shown_size(own[np.isfinite(own)].max(initial=0.0) or np.inf, high - low))
        for ladder in ladders:
            of_sensors.append(rounded(highest(ladder, each[place : place + len(ladder)])))
            place += len(ladder)
        found[sensors.name] = [*map(shown_size, errors, spans)], of_sensors
    return found


def nominal_map(
    setting: Setting, clearance: float, speed: float, channels: Sequence[str], here: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """The stored map with the place of a recording on it, for the report; of another machine there is none.

    Args:
        setting: the machine as it is, and the joint.
        clearance: of the recording [m].
        speed: of the recording, either sense [rpm].
        channels: of the recording.
        here: what the fit of the recording itself could have shown, see ``detectability.seen_beside``.
    """
    stored: dict[str, Any] = {"sensor_sets": {}}
    if _alike(setting):
        file = resources.files(__package__).joinpath(_STORED)
        stored = json.loads(file.read_text(encoding="utf-8"))[setting.joint]
    known = {name: len(own) for name, own in stored["sensor_sets"].items() if _has(channels, own)}
    return {
        **stored,
        "here": {
            "clearance_m": clearance, "speed_rpm": abs(speed), "effects": list(here),
            "sensors": max(known, key=lambda name: known[name]) if known else None,
        },
    }  # fmt: skip


def _alike(setting: Setting) -> bool:
    """Whether a machine is the map's but for its clearance and speed."""

    def at_one_speed(machine: SliderCrank) -> SliderCrank:
        assert isinstance(machine.drive, Drive)
        return replace(machine, drive=settled(machine.drive.at_speed(SPEEDS[0])))

    own, drawn = at_one_speed(setting.with_clearance(SOME_CLEARANCE)), at_one_speed(_MACHINES[setting.joint])
    if not np.array_equal(own.codes(), drawn.codes()):
        return False
    return bool(np.allclose(own.parameters(), drawn.parameters()))


def _has(channels: Sequence[str], needed: Sequence[str]) -> bool:
    """Whether a recording is of a sensor set; what shows nothing in the nominal machine may be left out."""
    return set(needed) - set(STILL) <= set(channels)


def _sensor_sets() -> list[SensorSet]:
    files = [CONFIGURATION / f"sensors/{name}.yaml" for name in _SETS]
    return [instantiate(OmegaConf.load(file), _convert_="all") for file in files]
