"""The one vector of numbers and the one vector of codes that the compiled step reads.

``Parameter`` names each entry of the vector that a run carries; ``Family`` names each place where a law can
be chosen. Both are documented here and nowhere else. A law writes its entries; only its own kernel reads
them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from enum import IntEnum, auto
from math import isfinite
from typing import Any, ClassVar

from clearance.errors import InputError


class Parameter(IntEnum):
    """Entries of the parameter vector, SI units."""

    GRAVITY_X = 0  # m/s^2
    GRAVITY_Y = auto()
    CRANK_LENGTH = auto()  # m, from A to B
    CRANK_MASS = auto()  # kg
    CRANK_MOMENT = auto()  # kg m, mass times distance of the centre of mass from A
    CRANK_INVERSE_INERTIA = auto()  # 1/(kg m^2), about A
    ROD_MASS = auto()  # kg
    ROD_INVERSE_MASS = auto()  # 1/kg
    ROD_INVERSE_INERTIA = auto()  # 1/(kg m^2), about the centre of mass
    ROD_TO_B = auto()  # m, from the centre of mass back to B
    ROD_TO_C = auto()  # m, from the centre of mass on to C
    SLIDER_MASS = auto()  # kg
    SLIDER_INVERSE_MASS = auto()  # 1/kg
    SLIDER_INVERSE_INERTIA = auto()  # 1/(kg m^2), 0 where the guide holds it straight
    GUIDE_OFFSET = auto()  # m, height of the guide line above A
    SENSOR_CRANK_A = auto()  # m, place of each link's sensors from the link's first joint
    SENSOR_CRANK_B = auto()
    SENSOR_ROD_B = auto()
    SENSOR_ROD_C = auto()
    # joint B, then joint C in the same order (see JOINT_STRIDE)
    JOINT_CLEARANCE = auto()  # m, radial
    JOINT_STIFFNESS = auto()  # N/m^1.5
    JOINT_HYSTERESIS = auto()  # -, factor of penetration rate over approach speed
    JOINT_JOURNAL_RADIUS = auto()  # m
    JOINT_FRICTION = auto()  # -, Coulomb coefficient
    JOINT_FRICTION_SPEED = auto()  # m/s, over which Coulomb's step is smoothed
    JOINT_FILM_DAMPING = auto()  # N s/m, journal centred
    JOINT_WEAR_AMPLITUDE = auto()  # m
    JOINT_WEAR_ORDER = auto()  # -, lobes around the bearing
    JOINT_WEAR_SINE = auto()  # -, of the wear's phase
    JOINT_WEAR_COSINE = auto()
    SECOND_JOINT = 40  # last entry of joint C: JOINT_STRIDE after the line above
    GUIDE_GAP = auto()  # m, free travel on each side
    GUIDE_STIFFNESS = auto()  # N/m
    GUIDE_DAMPING = auto()  # N s/m
    SHOE_HALF_LENGTH = auto()  # m
    GUIDE_COULOMB = auto()  # N
    GUIDE_VISCOUS = auto()  # N s/m
    GUIDE_STRIBECK = auto()  # N
    GUIDE_INVERSE_STRIBECK_SPEED = auto()  # s/m
    GUIDE_FRICTION = auto()  # -, on the guide's reaction
    GUIDE_FRICTION_SPEED = auto()  # m/s
    ROD_MODE_STIFFNESS = auto()  # 1/s^2, squared angular frequency
    ROD_MODE_DAMPING = auto()  # 1/s
    ROD_MODE_COUPLING = auto()  # -, of the mode to the rod's translation
    DRIVE_PROPORTIONAL = auto()  # N m s/rad
    DRIVE_INTEGRAL_GAIN = auto()  # N m/rad
    DRIVE_SPEED = auto()  # rad/s, reference (or no-load speed)
    DRIVE_RAMP_START = auto()  # -, share of the speed asked for at time 0
    DRIVE_RAMP_RATE = auto()  # 1/s
    RIPPLE_AMPLITUDE = auto()  # N m
    RIPPLE_ORDER = auto()  # -, per revolution
    RIPPLE_PHASE = auto()  # rad
    SPRING_STIFFNESS = auto()  # N/m
    SPRING_FREE = auto()  # m, slider position at which it is relaxed
    PROCESS_FORCE = auto()  # N, towards -x
    PROCESS_START = auto()  # m
    PROCESS_END = auto()  # m
    FRAME_STIFFNESS = auto()  # N/m
    FRAME_DAMPING = auto()  # N s/m
    FRAME_INVERSE_MASS_X = auto()  # 1/kg, of what moves along with the frame; 0 where it stands fast
    FRAME_INVERSE_MASS_Y = auto()
    # an applied force of free form: its constant part in each direction (see applied_force.DIRECTIONS)
    FORCE_CRANK_TORQUE = auto()  # N m
    FORCE_ROD_X = auto()  # N, at the centre of mass
    FORCE_ROD_Y = auto()
    FORCE_ROD_MOMENT = auto()  # N m
    FORCE_SLIDER_X = auto()  # N, at C
    FORCE_SLIDER_Y = auto()
    FORCE_SLIDER_MOMENT = auto()  # N m
    FORCE_FRAME_X = auto()  # N
    FORCE_FRAME_Y = auto()
    FORCE_B_NORMAL = auto()  # N, on the journal along its eccentricity, outwards
    FORCE_B_TANGENTIAL = auto()  # N, on the journal against its sliding
    FORCE_B_DAMPING = auto()  # N s/m, against the journal's velocity in the bearing
    FORCE_C_NORMAL = auto()
    FORCE_C_TANGENTIAL = auto()
    FORCE_C_DAMPING = auto()
    # the weight of its tabulated part in each direction, in the same order
    TABLE_CRANK_TORQUE = auto()
    TABLE_ROD_X = auto()
    TABLE_ROD_Y = auto()
    TABLE_ROD_MOMENT = auto()
    TABLE_SLIDER_X = auto()
    TABLE_SLIDER_Y = auto()
    TABLE_SLIDER_MOMENT = auto()
    TABLE_FRAME_X = auto()
    TABLE_FRAME_Y = auto()
    TABLE_B_NORMAL = auto()
    TABLE_B_TANGENTIAL = auto()
    TABLE_B_DAMPING = auto()
    TABLE_C_NORMAL = auto()
    TABLE_C_TANGENTIAL = auto()
    TABLE_C_DAMPING = auto()
    TABLE_ARGUMENT = auto()  # number of an applied_force.Argument
    TABLE_START = auto()  # argument at the first knot, in the argument's own unit
    TABLE_INVERSE_SPACING = auto()  # 1 / (argument from knot to knot)
    TABLE_PERIOD = auto()  # after which the table repeats; 0: never
    TABLE_LAST = auto()  # spacings from the first knot to where the table ends
    TABLE_RETURN = auto()  # spacings from the first knot to where it is left again, going back from the last
    TABLE_SLOPE = auto()  # N or N m a spacing, after the last knot
    TABLE_LINEAR = auto()  # weights of the hat functions, and of the cubic B-splines
    TABLE_CUBIC = auto()
    TABLE_VALUE_0 = auto()  # N or N m, coefficient of the function around the knot before the first one
    TABLE_VALUE_1 = auto()
    TABLE_VALUE_2 = auto()
    TABLE_VALUE_3 = auto()
    TABLE_VALUE_4 = auto()
    TABLE_VALUE_5 = auto()
    TABLE_VALUE_6 = auto()
    TABLE_VALUE_7 = auto()
    TABLE_VALUE_8 = auto()
    TABLE_VALUE_9 = auto()
    TABLE_VALUE_10 = auto()
    TABLE_VALUE_11 = auto()
    TABLE_VALUE_12 = auto()
    TABLE_VALUE_13 = auto()
    TABLE_VALUE_14 = auto()
    TABLE_VALUE_15 = auto()
    TABLE_VALUE_16 = auto()
    TABLE_VALUE_17 = auto()
    TABLE_VALUE_18 = auto()
    TABLE_VALUE_19 = auto()
    TABLE_VALUE_20 = auto()
    TABLE_VALUE_21 = auto()
    TABLE_VALUE_22 = auto()
    TABLE_VALUE_23 = auto()
    TABLE_VALUE_24 = auto()
    TABLE_VALUE_25 = auto()
    TABLE_VALUE_26 = auto()
    TABLE_VALUE_27 = auto()
    TABLE_VALUE_28 = auto()
    TABLE_VALUE_29 = auto()
    TABLE_VALUE_30 = auto()
    TABLE_VALUE_31 = auto()
    TABLE_VALUE_32 = auto()
    TABLE_VALUE_33 = auto()
    TABLE_VALUE_34 = auto()
    TABLE_VALUE_35 = auto()
    TABLE_VALUE_36 = auto()
    TABLE_VALUE_37 = auto()
    TABLE_VALUE_38 = auto()
    TABLE_VALUE_39 = auto()
    TABLE_VALUE_40 = auto()
    TABLE_VALUE_41 = auto()
    TABLE_VALUE_42 = auto()
    TABLE_VALUE_43 = auto()
    TABLE_VALUE_44 = auto()
    TABLE_VALUE_45 = auto()
    TABLE_VALUE_46 = auto()
    TABLE_VALUE_47 = auto()
    TABLE_VALUE_48 = auto()
    TABLE_VALUE_49 = auto()
    TABLE_VALUE_50 = auto()


TABLE_KNOTS = 48  # values of a tabulated force
JOINT_STRIDE = 11  # entries a joint
PARAMETERS = max(Parameter) + 1


class Family(IntEnum):
    """Places where a law is chosen; code 0 is the family's null member."""

    JOINT_B = 0  # ideal, clearance
    JOINT_C = auto()
    FRICTION = auto()  # joints: frictionless, coulomb
    FILM = auto()  # joints: dry, lubricated
    BEARING = auto()  # joints: round, worn
    GUIDE = auto()  # ideal, loose
    GUIDE_FRICTION = auto()  # frictionless, stribeck
    LINK = auto()  # rigid, flexible
    DRIVE = auto()  # free, speed control, motor at constant voltage
    RIPPLE = auto()  # smooth, harmonic
    SPRING = auto()  # none, linear
    PROCESS = auto()  # idle, constant over part of the stroke
    FRAME = auto()  # fixed, flexible
    FORCE = auto()  # none, tabulated


FAMILIES = len(Family)
STRUCTURE = [Family.JOINT_B, Family.JOINT_C, Family.GUIDE, Family.LINK, Family.FRAME]
"""Families whose laws give the machine coordinates that an ideal one lacks."""


class Law:
    """A member of a family: its code, and what it writes into the parameter vector."""

    family: ClassVar[Family]
    code: ClassVar[int]

    def numbers(self) -> Mapping[Parameter, float]:
        """Entries of the parameter vector, SI units."""
        return {}


def require(
    owner: Any,
    low: float = 0.0,
    high: float = float("inf"),
    strict: bool = False,
    whole: bool = False,
    **named: float,
) -> None:
    """Check that numbers lie in [low, high] ((low, high] if ``strict``) and are ``whole`` where they must.

    Raises:
        InputError: with the value, the allowed range and the configuration key.
    """
    for name, value in named.items():
        where, change = f"{type(owner).__name__}.{name}", f"change the key that ends in {name!r}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{where} = {value!r} is not a number; {change}")
        if not isfinite(value) or value > high or value < low or (strict and value == low):
            bounds = f"{'(' if strict else '['}{low:g}, {high:g}{']' if isfinite(high) else ')'}"
            raise InputError(f"{where} = {value:g} is outside {bounds}; {change}")
        if whole and not isinstance(value, int):  # nor 1e3, which counts nothing
            raise InputError(f"{where} = {value!r} is not a whole number; {change}")


def require_kind(owner: Any, kind: type | Family, instead: str = "", **named: Any) -> None:
    """Check that each value is of a class, or a law of a family: YAML takes names, numbers and null there.

    Args:
        owner: whose values these are.
        kind: the class or the family.
        instead: what to write; how a law is chosen if empty.
        named: values by key.

    Raises:
        InputError: with the value, and what to write at which key.
    """
    for name, value in named.items():
        if isinstance(kind, Family):
            fits, noun = getattr(value, "family", None) is kind, f"{name.replace('_', ' ')} law"
        else:
            fits, noun = isinstance(value, kind), kind.__name__
        if not fits:
            shown = type(value).__name__ if is_dataclass(value) else repr(value)
            option = value if isinstance(value, str) else "NAME"
            how = instead or f"write {name}={option} on the command line or {{_target_: CLASS}} in a file"
            raise InputError(
                f"{type(owner).__name__}.{name} = {shown} is no {noun}; {how}, or change the key that "
                f"ends in {name!r}"
            )


def require_list(owner: Any, count: int, low: float, high: float, **named: Any) -> None:
    """Check that each value is a list of ``count`` numbers in [low, high]."""
    for name, values in named.items():
        if isinstance(values, str) or not isinstance(values, Sequence) or len(values) != count:
            raise InputError(
                f"{type(owner).__name__}.{name} = {values!r} is not a list of {count} numbers; "
                f"change the key that ends in {name!r}"
            )
        for value in values:
            require(owner, low, high, **{name: value})
