"""The detectability map of the nominal machine: computed by ``make detectability``, kept beside this file."""

import json
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from hydra.utils import instantiate
from omegaconf import OmegaConf

from clearance.configuration import CONFIGURATION
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Setting, gather, settled
from clearance.diagnosis.judging.detectability import detectability_map, faults_of_sensors
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
_MACHINES = {"B": SliderCrank(joint_b=Joint(SOME_CLEARANCE)), "C": SliderCrank(joint_c=Joint(SOME_CLEARANCE))}


def write_nominal_map() -> None:
    """Compute the maps of both joints, with the paper's sets of sensors, in a few minutes."""
    effects, sensor_sets = load_effects("all", []), _sensor_sets()
    faults = faults_of_sensors(effects)
    maps = {}
    for joint, machine in _MACHINES.items():
        groups = gather([e for e in effects if e.kind == "physics"], machine, joint, ())
        setting = Setting(machine, joint)
        maps[joint] = detectability_map(setting, groups, CLEARANCES, SPEEDS, sensor_sets, faults)
    write_json(Path(str(resources.files(__package__).joinpath(_STORED))), maps)


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
