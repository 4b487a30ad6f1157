"""What may be concealed: effects, faults and forces without a name, each in three plausible sizes.

Effects, parameters and places have the names of docs/effects.md. The table is written out here, and not
read from the diagnosis' own files: an error there must not become the truth here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi

Sizes = tuple[float, float, float]


@dataclass(frozen=True)
class Variant:
    """One form of something missing.

    Attributes:
        sizes: parameter to its small, medium and large value.
        shape: parameter to the range from which it is drawn (a pair) or the values it may have (a list).
        off: parameter to the value that means nothing missing, 0 where not given.
        of_clearance: parameters that are given as a share of the clearance.
        signed: whether the sizes are as often negative.
    """

    sizes: Mapping[str, Sizes]
    shape: Mapping[str, Sequence[float]] = field(default_factory=dict)
    off: Mapping[str, float] = field(default_factory=dict)
    of_clearance: frozenset[str] = frozenset()
    signed: bool = False


@dataclass(frozen=True)
class Place:
    """Where something missing acts: every body and direction that is a right answer.

    ``{joint}`` and ``{other_joint}`` stand for the diagnosed joint and the other one.
    """

    bodies: frozenset[str]
    directions: frozenset[str]


def _place(bodies: str, directions: str) -> Place:
    return Place(frozenset(bodies.split()), frozenset(directions.split()))


_TURN = (-pi, pi)

EFFECTS: Mapping[str, tuple[Variant, ...]] = {
    "joint_friction": (Variant({"friction_coefficient": (0.03, 0.1, 0.25)}),),
    "joint_lubrication": (Variant({"damping": (0.01, 0.1, 1.0)}),),
    "second_clearance": (Variant({"clearance": (2e-5, 8e-5, 3e-4)}),),
    "worn_bearing": (
        Variant(
            {"amplitude": (0.005, 0.03, 0.15)},
            {"order": [2, 3, 4], "phase": _TURN},
            of_clearance=frozenset({"amplitude"}),
        ),
    ),
    "restitution": (Variant({"restitution": (0.8, 0.6, 0.35)}, off={"restitution": 0.9}),),
    "contact_stiffness": (Variant({"stiffness_scale": (0.6, 0.3, 0.1)}),),
    "guide_friction": (
        Variant({"coulomb_force": (1.0, 4.0, 12.0)}),
        Variant({"viscous_damping": (0.5, 2.0, 6.0)}),
        Variant({"friction_coefficient": (0.02, 0.08, 0.25)}),
        Variant(
            {"coulomb_force": (1.0, 4.0, 10.0), "stribeck_force": (1.0, 4.0, 10.0)},
            {"stribeck_velocity": (0.05, 0.5)},
        ),
    ),
    "guide_clearance": (
        Variant(
            {"gap": (2e-5, 8e-5, 3e-4)},
            {"stiffness": (1e7, 1e7), "damping": (50.0, 50.0), "shoe_half_length": (0.0075, 0.0075)},
        ),
    ),
    "slider_offset": (Variant({"offset": (5e-4, 2e-3, 6e-3)}, signed=True),),
    "rod_inertia": (
        Variant({"mass_ratio": (1.05, 1.15, 1.5)}, off={"mass_ratio": 1.0}),
        Variant({"inertia_ratio": (1.1, 1.3, 2.0)}, off={"inertia_ratio": 1.0}),
        Variant({"com_shift": (1e-3, 4e-3, 0.012)}, signed=True),
    ),
    "rod_flexibility": (Variant({"frequency": (2000.0, 900.0, 400.0)}, {"damping_ratio": (0.01, 0.05)}),),
    "torque_ripple": (
        Variant({"amplitude": (0.15, 0.6, 3.0)}, {"order": [2, 3, 4, 5, 6, 8, 12], "phase": _TURN}),
    ),
    "soft_drive": (
        Variant({"proportional": (2.5, 1.0, 0.3), "integral": (100.0, 40.0, 10.0)}),
        Variant(
            {"stall_torque": (50.0, 20.0, 6.0), "no_load_ratio": (1.01, 1.03, 1.08)},
            off={"no_load_ratio": 1.0},
        ),
    ),
    "slider_spring": (Variant({"stiffness": (80.0, 250.0, 800.0)}, {"free_position": (0.1, 0.14)}),),
    "process_load": (Variant({"force": (3.0, 10.0, 30.0)}, {"start": (0.085, 0.115), "end": (0.13, 0.16)}),),
    "gravity": (
        Variant({"gravity_y": (-2.0, -5.0, -9.81)}),
        Variant({"gravity_x": (-2.0, -5.0, -9.81)}, signed=True),
    ),
    "flexible_base": (
        Variant({"frequency": (150.0, 60.0, 25.0)}, {"damping_ratio": (0.02, 0.06), "mass": (10.0, 40.0)}),
    ),
}

FAULTS: Mapping[str, Variant] = {
    "sensor_gain": Variant({"gain": (1.05, 1.15, 1.35)}, off={"gain": 1.0}, signed=True),
    "sensor_bias": Variant({"bias": (5.0, 20.0, 80.0)}, signed=True),
    "sensor_misalignment": Variant({"angle": (0.05, 0.15, 0.35)}, signed=True),
    "sensor_delay": Variant({"delay": (2e-5, 6e-5, 2e-4)}),
    "sensor_resonance": Variant({"frequency": (3000.0, 1500.0, 700.0)}, {"damping_ratio": (0.03, 0.1)}),
    "sensor_saturation": Variant({"limit": (0.05, 0.2, 0.4)}),
    "timebase": Variant({"rate_error": (5e-3, 1.5e-2, 5e-2)}, signed=True),
}
"""Angles in rad; the limit of a saturation by the share of the samples that it clips."""


@dataclass(frozen=True)
class Force:
    """A kind of force that no effect describes: where it acts, and on what it depends.

    Attributes:
        target: see ``plant.ExtraForce``.
        argument: likewise.
        shapes: kind of curve to its variant; ``size`` among the sizes, ``centre`` and ``width`` in the shape.
        place: of the right answer.
    """

    target: str
    argument: str
    shapes: Mapping[str, Variant]
    place: Place


_SLIDER: Sizes = (3.0, 9.0, 25.0)
_MOMENT: Sizes = (0.05, 0.2, 0.8)
_TORQUE: Sizes = (0.5, 2.0, 6.0)
_FRAME: Sizes = (60.0, 200.0, 600.0)

FORCES: Mapping[str, Force] = {
    "slider_by_position": Force(
        "slider_x", "slider_position",
        {
            "bump": Variant(
                {"size": _SLIDER}, {"centre": (0.09, 0.15), "width": (0.005, 0.015)}, signed=True
            ),
            "dead_band_spring": Variant({"size": _SLIDER}, {"centre": (0.11, 0.13), "width": (0.015, 0.03)}),
            "exponential_wall": Variant({"size": _SLIDER}, {"centre": (0.16, 0.17), "width": (0.006, 0.015)}),
        },
        _place("slider", "x"),
    ),
    "slider_by_velocity": Force(
        "slider_x", "slider_velocity",
        {
            "quadratic_drag": Variant({"size": _SLIDER}, {"centre": (0.0, 0.0), "width": (2.5, 3.5)}),
            "one_sided_quadratic": Variant({"size": _SLIDER}, {"centre": (-0.5, 0.5), "width": (2.0, 3.0)}),
        },
        _place("slider", "x"),
    ),
    "slider_by_time": Force(
        "slider_x", "time",
        {
            "square_wave": Variant({"size": _SLIDER}, {"width": (0.03, 0.2), "phase": _TURN}),
            "random_periodic": Variant({"size": _SLIDER}, {"width": (0.1, 0.3), "seed": range(1000)}),
        },
        _place("slider", "x"),
    ),
    "rod": Force(
        "rod_moment", "rod_angle",
        {
            "cubic_spring": Variant({"size": _MOMENT}, {"width": (0.25, 0.4)}),
            "bump": Variant({"size": _MOMENT}, {"centre": (-0.2, 0.2), "width": (0.05, 0.1)}, signed=True),
        },
        _place("rod", "moment"),
    ),
    "crank": Force(
        "crank_torque", "crank_angle",
        {
            "pulse_train": Variant({"size": _TORQUE}, {"width": [2 * pi, pi], "phase": _TURN}, signed=True),
            "random_periodic": Variant({"size": _TORQUE}, {"width": [2 * pi], "seed": range(1000)}),
        },
        _place("crank", "torque"),
    ),
    "frame": Force(
        "frame_x", "time",
        {
            "square_wave": Variant({"size": _FRAME}, {"width": (0.03, 0.2), "phase": _TURN}),
            "random_periodic": Variant({"size": _FRAME}, {"width": (0.1, 0.3), "seed": range(1000)}),
        },
        _place("frame", "x"),
    ),
}  # fmt: skip
"""Six kinds: on the slider by position, velocity and time; on the rod, the crank and the frame."""

LEFT_OUT = (
    "guide_friction", "slider_spring", "process_load", "torque_ripple", "joint_friction", "joint_lubrication",
)  # fmt: skip
"""Effects whose hypothesis may be taken away: forces that a free-form one can stand in for."""

PLACES: Mapping[str, Place] = {
    "joint_friction": _place("{joint}", "tangential"),
    "joint_lubrication": _place("{joint}", "normal"),
    "second_clearance": _place("{other_joint}", "normal"),
    "worn_bearing": _place("{joint}", "normal"),
    "restitution": _place("{joint}", "normal"),
    "contact_stiffness": _place("{joint}", "normal"),
    "guide_friction": _place("slider", "x"),
    "guide_clearance": _place("slider", "y"),
    "slider_offset": _place("slider", "y"),
    "rod_inertia": _place("rod", "moment x y axial transverse"),
    "rod_flexibility": _place("rod", "transverse"),
    "torque_ripple": _place("crank", "torque"),
    "soft_drive": _place("crank", "torque"),
    "slider_spring": _place("slider", "x"),
    "process_load": _place("slider", "x"),
    "gravity": _place("crank rod slider", "x y"),
    "flexible_base": _place("frame", "x y"),
} | {name: _place("instrument", "along across") for name in FAULTS}

SENSORS: Mapping[str, tuple[str, ...]] = {
    "all": (
        "crank_a_transverse", "crank_a_axial", "crank_b_transverse", "crank_b_axial", "rod_b_transverse",
        "rod_b_axial", "rod_c_transverse", "rod_c_axial", "slider_vertical", "slider_horizontal",
    ),
    "seven": (
        "crank_b_transverse", "crank_b_axial", "rod_b_transverse", "rod_b_axial", "rod_c_transverse",
        "rod_c_axial", "slider_horizontal",
    ),
    "rod": ("rod_b_transverse", "rod_b_axial", "rod_c_transverse", "rod_c_axial"),
}  # fmt: skip
