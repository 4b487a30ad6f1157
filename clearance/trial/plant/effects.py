"""The named effects as entries of a plant's parameters; names and meaning as in docs/effects.md."""

from collections.abc import Callable, Mapping
from math import pi
from typing import Any

import numpy as np

from clearance.trial.plant.kernels import J, P

Values = Mapping[str, Any]
HYSTERESIS: Mapping[str, Callable[[float], float]] = {
    "lankarani_nikravesh": lambda e: 0.75 * (1.0 - e * e),
    "hunt_crossley": lambda e: 1.5 * (1.0 - e),
    "flores": lambda e: 1.6 * (1.0 - e) / e,
}

DEFAULTS: Mapping[str, Values] = {
    "joint_friction": {"friction_coefficient": 0.1, "smoothing_speed": 1e-3},
    "joint_lubrication": {"damping": 10.0},
    "second_clearance": {"clearance": 1e-4},
    "worn_bearing": {"amplitude": 2e-5, "order": 2, "phase": 0.0},
    "restitution": {"restitution": 0.9, "law": "lankarani_nikravesh"},
    "contact_stiffness": {"scale": 1.0},
    "guide_friction": {
        "coulomb_force": 0.0,
        "viscous_damping": 0.0,
        "stribeck_force": 0.0,
        "stribeck_velocity": 0.05,
        "friction_coefficient": 0.0,
        "smoothing_speed": 1e-3,
    },
    "guide_clearance": {"gap": 1e-4, "stiffness": 1e7, "damping": 50.0, "shoe_half_length": 0.0075},
    "slider_offset": {"offset": 0.0},
    "rod_inertia": {"mass_ratio": 1.0, "inertia_ratio": 1.0, "com_shift": 0.0},
    "rod_flexibility": {"frequency": 800.0, "damping_ratio": 0.01, "second_order": 1.0},
    "torque_ripple": {"amplitude": 0.1, "order": 6.0, "phase": 0.0},
    "soft_drive": {"proportional": None, "integral": None, "stall_torque": None, "no_load_rpm": None},
    "slider_spring": {"stiffness": 500.0, "free_position": 0.12},
    "process_load": {"force": 20.0, "start": 0.10, "end": 0.14},
    "gravity": {"gravity_x": 0.0, "gravity_y": 0.0},
    "flexible_base": {"frequency": 60.0, "damping_ratio": 0.03, "mass": 20.0},
}
"""Parameters of each effect, and what they are where none is given; SI units (rpm where named so)."""


def complete(name: str, given: Values) -> dict[str, Any]:
    """The values of one effect, defaults filled in.

    Raises:
        ValueError: if the effect or one of the parameters is unknown.
    """
    if name not in DEFAULTS:
        raise ValueError(f"effect {name!r} is unknown; choose from {', '.join(DEFAULTS)}")
    values = dict(DEFAULTS[name])
    for key, value in given.items():
        if key not in values:
            raise ValueError(f"{name} has no parameter {key!r}; choose from {', '.join(values)}")
        values[key] = value
    return values


def apply(p: np.ndarray, diagnosed: tuple[int, ...], effects: Mapping[str, Values]) -> None:
    """Write the effects that are not part of the joints' or links' own numbers.

    Args:
        p: parameters, changed.
        diagnosed: offsets of the blocks of the diagnosed joints.
        effects: name to completed values.
    """
    for name, v in effects.items():
        if name == "joint_friction":
            for o in diagnosed:
                p[o + J.MU], p[o + J.SMOOTHING] = v["friction_coefficient"], v["smoothing_speed"]
        elif name == "joint_lubrication":
            for o in diagnosed:
                p[o + J.FILM] = v["damping"]
        elif name == "worn_bearing":
            for o in diagnosed:
                p[o + J.WEAR], p[o + J.WEAR_ORDER] = v["amplitude"], v["order"]
                p[o + J.WEAR_PHASE] = v["phase"]
        elif name == "guide_friction":
            p[P.GUIDE_RUBS] = 1.0
            p[P.GUIDE_COULOMB], p[P.GUIDE_VISCOUS] = v["coulomb_force"], v["viscous_damping"]
            p[P.GUIDE_STRIBECK], p[P.GUIDE_STRIBECK_SPEED] = v["stribeck_force"], v["stribeck_velocity"]
            p[P.GUIDE_MU], p[P.GUIDE_SMOOTHING] = v["friction_coefficient"], v["smoothing_speed"]
        elif name == "guide_clearance":
            p[P.LOOSE_GUIDE], p[P.SHOE_GAP], p[P.SHOE_STIFFNESS] = 1.0, v["gap"], v["stiffness"]
            p[P.SHOE_DAMPING], p[P.SHOE_HALF] = v["damping"], v["shoe_half_length"]
        elif name == "slider_offset":
            p[P.OFFSET] = v["offset"]
        elif name == "rod_inertia":
            p[P.ROD_MASS] *= v["mass_ratio"]
            p[P.ROD_INERTIA] *= v["inertia_ratio"]
            p[P.ROD_TO_B] -= v["com_shift"]
            p[P.ROD_TO_C] -= v["com_shift"]
        elif name == "rod_flexibility":
            omega = 2.0 * pi * v["frequency"]
            p[P.MODE_SHARE], p[P.MODE_OMEGA2] = 2.0 / pi, omega**2
            p[P.MODE_DAMPING], p[P.MODE_SECOND] = 2.0 * v["damping_ratio"] * omega, v["second_order"]
        elif name == "torque_ripple":
            p[P.RIPPLE], p[P.RIPPLE_ORDER], p[P.RIPPLE_PHASE] = v["amplitude"], v["order"], v["phase"]
        elif name == "soft_drive":
            _soften(p, v)
        elif name == "slider_spring":
            p[P.SPRING], p[P.SPRING_FREE] = v["stiffness"], v["free_position"]
        elif name == "process_load":
            p[P.PROCESS], p[P.PROCESS_START], p[P.PROCESS_END] = v["force"], v["start"], v["end"]
        elif name == "gravity":
            p[P.GRAVITY_X] += v["gravity_x"]
            p[P.GRAVITY_Y] += v["gravity_y"]
        elif name == "flexible_base":
            omega = 2.0 * pi * v["frequency"]
            p[P.FRAME_MASS], p[P.FRAME_STIFFNESS] = v["mass"], v["mass"] * omega**2
            p[P.FRAME_DAMPING] = 2.0 * v["damping_ratio"] * omega * v["mass"]


def _soften(p: np.ndarray, v: Values) -> None:
    """Other gains, or a motor at constant voltage: T = stall (1 - omega / no-load), no ramp, no integral."""
    if v["stall_torque"] is None and v["no_load_rpm"] is None:
        for entry, key in ((P.KP, "proportional"), (P.KI, "integral")):
            if v[key] is not None:
                p[entry] = v[key]
        return
    speed = p[P.SPEED] if v["no_load_rpm"] is None else v["no_load_rpm"] * pi / 30.0
    stall = 1.0 if v["stall_torque"] is None else v["stall_torque"]
    p[P.SPEED], p[P.KP], p[P.KI], p[P.RAMP] = speed, stall / speed, 0.0, 0.0
