"""A force of free form: what acts where no named law is at hand.

It acts in one of fifteen directions, or in several: a torque on the crank; forces and a moment on rod and
slider; forces on the frame; and forces between journal and bearing of a joint. In each it is a constant plus
a weight times one table of one argument. The diagnosis fits it to find where a force is missing and what that
force depends on; a fitted table stands for physics that has no name here.

A direction is conjugate to a coordinate of the state, so that its power is the force times that coordinate's
rate, and nothing else feels it: a force on the slider is not held by the frame, a force on the rod does not
bend it. The force inside a joint acts on the journal where it is nearest to the bearing and, opposite, on the
bearing's body at the same point; normal is along the eccentricity e/|e|, positive where it pushes the journal
outwards, tangential is against the journal's sliding over the bearing. Damping is no force but one over a
velocity: what fills the gap resists the journal's motion in the bearing by it, where the journal's centre is.
All are zero in an ideal joint, which has no eccentricity. A force on the slider across an ideal guide changes
the guide's reaction and therefore the friction on it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum, auto
from functools import cache
from math import pi
from typing import Any, ClassVar

import numpy as np

from clearance.compilation import kernel
from clearance.errors import InputError
from clearance.lanes import absolute, get, logarithm, maximum, minimum, nearest_integer, where, zero
from clearance.mechanism.film import ECCENTRICITY_LIMIT
from clearance.mechanism.parameters import TABLE_KNOTS, Family, Law, Parameter, require

DIRECTIONS: tuple[tuple[str, str], ...] = (
    ("crank", "torque"),
    ("rod", "x"),
    ("rod", "y"),
    ("rod", "moment"),
    ("slider", "x"),
    ("slider", "y"),
    ("slider", "moment"),
    ("frame", "x"),
    ("frame", "y"),
    ("joint_b", "normal"),
    ("joint_b", "tangential"),
    ("joint_b", "damping"),
    ("joint_c", "normal"),
    ("joint_c", "tangential"),
    ("joint_c", "damping"),
)
"""Body and direction of each entry from ``FORCE_CRANK_TORQUE`` and from ``TABLE_CRANK_TORQUE`` on."""

_NEVER = 1e30  # spacings; compiled code takes infinity for no number
_FUNCTIONS = TABLE_KNOTS + 3  # one function before the first knot, two after the last
_WEIGHT = Parameter.TABLE_CRANK_TORQUE - Parameter.FORCE_CRANK_TORQUE  # entries from a constant to its weight


TRACTION_SPEED = 1e-3
"""Sliding speed below which a tangential force fades [m/s]."""


class Argument(IntEnum):
    """What a table can depend on, as numbered in ``TABLE_ARGUMENT``."""

    CRANK_ANGLE = 0  # rad; the table repeats every turn
    CRANK_SPEED = auto()  # rad/s
    ROD_ANGLE = auto()  # rad
    ROD_SPEED = auto()  # rad/s
    SLIDER_POSITION = auto()  # m, from the frame's A
    SLIDER_VELOCITY = auto()  # m/s, against the frame
    FRAME_X = auto()  # m
    FRAME_X_RATE = auto()  # m/s
    FORCE_B = auto()  # N, normal force of the contact in joint B; 0 where the joint is ideal
    FORCE_C = auto()
    TIME = auto()  # s
    CLOSENESS_B = auto()  # see ``closeness``; 0 where the joint is ideal
    CLOSENESS_C = auto()


# plain numbers: Numba compares no lanes with members of an enumeration
_, _CRANK_SPEED, _ROD_ANGLE, _ROD_SPEED, _SLIDER_POSITION, _SLIDER_VELOCITY, *_OTHERS = map(float, Argument)
_FRAME_X, _FRAME_X_RATE, _FORCE_B, _FORCE_C, _TIME, _CLOSENESS_B, _CLOSENESS_C = _OTHERS


@kernel
def closeness(ex: Any, ey: Any, clearance: Any) -> Any:
    """-ln(1 - eps²), eps = eccentricity over clearance: 0 in the middle of the gap, at most 3.9, at 0.99.

    What resists in a gap goes by powers of its thickness, which a table over this follows everywhere.
    """
    ratio = (ex * ex + ey * ey) / (clearance * clearance)
    return -logarithm(maximum(1.0 - ratio, 1.0 - ECCENTRICITY_LIMIT * ECCENTRICITY_LIMIT))


@kernel
def look_up(p: Any, argument: Any) -> Any:
    """The table's value at ``argument``: a line or a spline from knot to knot.

    Beyond the ends it repeats, or is constant, or goes on straight after the last; what returns goes back to
    the first the way it came.

    Written as a sum of hat functions or of cubic B-splines, since lanes cannot each read another entry.
    """
    period = get(p, Parameter.TABLE_PERIOD)
    repeats = period > 0.0
    place = argument - get(p, Parameter.TABLE_START)
    turns = nearest_integer(place / where(repeats, period, zero(period) + 1.0) - 0.5)
    place = where(repeats, place - turns * period, place) * get(p, Parameter.TABLE_INVERSE_SPACING)
    place = minimum(place, get(p, Parameter.TABLE_RETURN) - place)
    last = get(p, Parameter.TABLE_LAST)
    beyond = get(p, Parameter.TABLE_SLOPE) * maximum(place - last, 0.0)
    place = minimum(maximum(place, 0.0), last)
    linear, cubic = get(p, Parameter.TABLE_LINEAR), get(p, Parameter.TABLE_CUBIC)
    value = zero(place)
    for k in range(_FUNCTIONS):
        away = absolute(place - (k - 1.0))
        near, far = maximum(1.0 - away, 0.0), maximum(2.0 - away, 0.0)
        spline = far * far * far - 4.0 * near * near * near
        value = value + get(p, Parameter.TABLE_VALUE_0 + k) * (linear * near + cubic * spline)
    return value + beyond


def shares(
    place: np.ndarray, count: int, repeats: bool, interpolation: str, straight: bool = False
) -> np.ndarray:
    """What each value of a table adds to the force at places along it.

    Args:
        place: (places,) of the argument, in spacings from the first knot.
        count: number of values.
        repeats: whether the table repeats after as many spacings as it has values.
        interpolation: linear or cubic.
        straight: whether the table goes on straight after its last value.

    Returns:
        (places, count) shares, which sum to one at each place.
    """
    beyond = np.maximum(place - (count - 1.0), 0.0)[:, None] * (straight * _end(count))
    place = place % count if repeats else np.clip(place, 0.0, count - 1.0)
    away = np.abs(place[:, None] - np.arange(-1.0, count + 2.0))
    near, far = np.maximum(1.0 - away, 0.0), np.maximum(2.0 - away, 0.0)
    found: np.ndarray = near if interpolation == "linear" else (far**3 - 4.0 * near**3) / 6.0
    return found @ _coefficients(count, repeats, interpolation) + beyond


def looked_up(p: np.ndarray, argument: np.ndarray) -> np.ndarray:
    """(arguments,) what ``look_up`` gives of (PARAMETERS,) of a machine whose table repeats."""
    along = (argument - p[Parameter.TABLE_START]) % p[Parameter.TABLE_PERIOD]
    place = along * p[Parameter.TABLE_INVERSE_SPACING]
    place = np.clip(np.minimum(place, p[Parameter.TABLE_RETURN] - place), 0.0, p[Parameter.TABLE_LAST])
    away = np.abs(place[:, None] - np.arange(-1.0, _FUNCTIONS - 1.0))
    near, far = np.maximum(1.0 - away, 0.0), np.maximum(2.0 - away, 0.0)
    spline = far**3 - 4.0 * near**3
    weights = p[Parameter.TABLE_LINEAR] * near + p[Parameter.TABLE_CUBIC] * spline
    found: np.ndarray = weights @ p[Parameter.TABLE_VALUE_0 :][:_FUNCTIONS]
    return found


def _end(count: int) -> np.ndarray:
    """(count,) coefficients of the slope with which a table goes on after its last value, per spacing."""
    own: np.ndarray = np.eye(count)
    return own[-1] - own[max(count - 2, 0)]


@cache
def _coefficients(count: int, repeats: bool, interpolation: str) -> np.ndarray:
    """(count + 3, count) coefficients of the functions around knots -1 to count + 1, for one at each knot."""
    own: np.ndarray = np.eye(count)
    around = np.arange(count)
    if interpolation == "cubic":
        values = 4.0 * own
        for step in (-1, 1):
            values[around, (around + step) % count] += 1.0
        values /= 6.0
        if not repeats:  # no bend at the ends
            values[[0, -1]] = own[[0, -1]]
        own = np.linalg.inv(values)
    if repeats:
        return own[np.arange(-1, count + 2) % count]
    second = min(1, count - 1)
    before, after = 2.0 * own[0] - own[second], 2.0 * own[-1] - own[-1 - second]
    return np.vstack([before, own, after, np.zeros(count)])


@kernel
def choose_argument(
    p: Any,
    crank_angle: Any,
    crank_speed: Any,
    rod_angle: Any,
    rod_speed: Any,
    slider_position: Any,
    slider_velocity: Any,
    frame_x: Any,
    frame_x_rate: Any,
    force_b: Any,
    force_c: Any,
    time: Any,
    closeness_b: Any,
    closeness_c: Any,
) -> Any:
    """The argument that the parameter vector asks for, out of all of them."""
    number = get(p, Parameter.TABLE_ARGUMENT)
    argument = where(number == _CRANK_SPEED, crank_speed, crank_angle)
    argument = where(number == _ROD_ANGLE, rod_angle, argument)
    argument = where(number == _ROD_SPEED, rod_speed, argument)
    argument = where(number == _SLIDER_POSITION, slider_position, argument)
    argument = where(number == _SLIDER_VELOCITY, slider_velocity, argument)
    argument = where(number == _FRAME_X, frame_x, argument)
    argument = where(number == _FRAME_X_RATE, frame_x_rate, argument)
    argument = where(number == _FORCE_B, force_b, argument)
    argument = where(number == _FORCE_C, force_c, argument)
    argument = where(number == _TIME, time, argument)
    argument = where(number == _CLOSENESS_B, closeness_b, argument)
    return where(number == _CLOSENESS_C, closeness_c, argument)


@kernel
def applied(p: Any, entry: int, table: Any) -> Any:
    """Generalised force [N or N m] in the direction whose constant is at ``entry``."""
    return get(p, entry) + get(p, entry + _WEIGHT) * table


CONSTANTS = 2
"""Code with which constant forces act and no table is read; no law has it, the diagnosis does."""


@dataclass(frozen=True)
class NoForce(Law):
    """Nothing beside the named laws: the nominal machine."""

    family: ClassVar[Family] = Family.FORCE
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class TabulatedForce(Law):
    """One generalised force as a table of one argument, a line or a cubic spline from knot to knot.

    The knots lie at ``start``, ``start + spacing``, ...; beyond them the force stays what it is at the end,
    but over a contact's force it goes on straight after the last: impacts are far beyond what is carried.
    Over ``crank_angle`` the table repeats every turn, over ``time`` after its period if it has one; its
    spacing is then that over the number of values. A force that is on and off again reaches its last value
    after so many spacings, stays there, and goes back the same way until it ``returns`` to the first, once in
    a turn or period. One value is a constant force. A line follows a kink or a jump between two knots without
    overshoot; a spline (natural, or periodic over the angle) that is fitted to a harmonic of four knots a
    period leaves a hundredth of it (root mean square), a line an eighth. Valid as a description of what was
    seen, between the ends of the table.
    Reference: de Boor 1978, A Practical Guide to Splines, ch. III, IV and IX (B-splines).

    Attributes:
        body: crank, rod, slider, frame, joint_b or joint_c.
        direction: torque (crank); x, y or moment (rod, slider); x or y (frame); normal, tangential or
            damping (joints).
        argument: an ``Argument``, in small letters.
        start: argument at the first knot, in SI units.
        spacing: argument from knot to knot; ``None`` where the table repeats, but for one that returns.
        values: force at up to 48 knots [N or N m, N s/m for damping].
        interpolation: linear or cubic.
        period: after which a table over time repeats [s]; ``None``: it does not.
        returns: argument from ``start`` to where a force is back at its first value, of those that repeat and
            are on and off; ``None``: the values cover all of a turn or period.
    """

    body: str = "slider"
    direction: str = "x"
    argument: str = "crank_angle"
    start: float = 0.0
    spacing: float | None = None
    values: tuple[float, ...] = (0.0,)
    interpolation: str = "linear"
    period: float | None = None
    returns: float | None = None

    family: ClassVar[Family] = Family.FORCE
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        bodies = dict.fromkeys(body for body, _ in DIRECTIONS)
        _require_name("body", self.body, bodies)
        _require_name("direction", self.direction, [d for body, d in DIRECTIONS if body == self.body])
        _require_name("argument", self.argument, [one.name.lower() for one in Argument])
        _require_name("interpolation", self.interpolation, ("linear", "cubic"))
        require(self, -1e9, 1e9, start=self.start)
        if isinstance(self.values, str) or not isinstance(self.values, Sequence):
            raise InputError(
                f"TabulatedForce.values = {self.values!r} is not a list of 1 to {TABLE_KNOTS} numbers; "
                "change the key that ends in 'values'"
            )
        if not 1 <= len(self.values) <= TABLE_KNOTS:
            raise InputError(
                f"TabulatedForce.values has {len(self.values)} numbers, not 1 to {TABLE_KNOTS}; change the "
                "key that ends in 'values'"
            )
        for value in self.values:
            require(self, -1e6, 1e6, values=value)
        object.__setattr__(self, "values", tuple(float(value) for value in self.values))
        if self.spacing is not None:
            require(self, 0.0, 1e9, strict=True, spacing=self.spacing)
        if self.period is not None:
            require(self, 0.0, 1e9, strict=True, period=self.period)
            if self.argument != Argument.TIME.name.lower():
                raise InputError(
                    f"TabulatedForce.period = {self.period:g} has no meaning over {self.argument}; change "
                    "the key that ends in 'period' to null"
                )
        if self.returns is not None:
            self._require_return(self.returns)
        if self.repeats and self.spacing is not None and self.returns is None:
            raise InputError(
                f"TabulatedForce.spacing = {self.spacing:g} has no meaning where the table covers one turn "
                "or period; change the key that ends in 'spacing' to null"
            )
        if not self.repeats and self.spacing is None and len(self.values) > 1:
            raise InputError(
                f"TabulatedForce.spacing = None is not a number above 0, which a table over {self.argument} "
                "needs; change the key that ends in 'spacing'"
            )

    def _require_return(self, returns: float) -> None:
        if not self.repeats or self.spacing is None:
            raise InputError(
                f"TabulatedForce.returns = {returns} has no meaning but where a table repeats and has a "
                "spacing; change the key that ends in 'returns' to null"
            )
        there = 2.0 * self.spacing * (len(self.values) - 1)
        require(self, there, self.repeats_after, returns=returns)

    @property
    def repeats(self) -> bool:
        """Whether the table repeats."""
        return self.repeats_after > 0.0

    @property
    def repeats_after(self) -> float:
        """Argument after which the table repeats: a turn of the crank, a period; 0: it does not."""
        return 2.0 * pi if self.argument == Argument.CRANK_ANGLE.name.lower() else self.period or 0.0

    @property
    def straight(self) -> bool:
        """Whether the table goes on straight after its last knot."""
        return self.argument in (Argument.FORCE_B.name.lower(), Argument.FORCE_C.name.lower())

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        index = DIRECTIONS.index((self.body, self.direction))
        period = self.repeats_after
        count, cubic = len(self.values), self.interpolation == "cubic"
        covers = self.repeats and self.returns is None
        spacing = period / count if covers else self.spacing or 1.0
        coefficients = _coefficients(count, covers, self.interpolation) @ self.values
        return {
            Parameter(Parameter.TABLE_CRANK_TORQUE + index): 1.0,
            Parameter.TABLE_ARGUMENT: float(Argument[self.argument.upper()]),
            Parameter.TABLE_START: self.start,
            Parameter.TABLE_INVERSE_SPACING: 1.0 / spacing,
            Parameter.TABLE_PERIOD: period,
            Parameter.TABLE_LAST: float(count if covers else count - 1),
            Parameter.TABLE_RETURN: _NEVER if self.returns is None else self.returns / spacing,
            Parameter.TABLE_SLOPE: float(self.straight * (_end(count) @ self.values)),
            Parameter.TABLE_LINEAR: 0.0 if cubic else 1.0,
            Parameter.TABLE_CUBIC: 1.0 / 6.0 if cubic else 0.0,
            **{Parameter(Parameter.TABLE_VALUE_0 + k): float(one) for k, one in enumerate(coefficients)},
        }


def _require_name(key: str, value: object, allowed: Iterable[str]) -> None:
    names = list(allowed)
    if value not in names:
        raise InputError(
            f"TabulatedForce.{key} = {value!r} is not one of {', '.join(names)}; change the key that ends in "
            f"{key!r}"
        )
