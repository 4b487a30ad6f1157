"""What accelerometers feel and which forces the joints carry, from the motion alone: no law of contact.

The motion is that of rigid links with one or both joints loose. Positions are exact; their rates and
accelerations along a given motion are differences over two hundredths of a millisecond, which is exact to
1e-6 of an acceleration and needs no second set of formulas. The forces follow from Newton and Euler
(inverse dynamics), whatever holds the joints together.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from clearance.compilation import entry, kernel, subroutine
from clearance.diagnosis.kinematics.lift import Lift
from clearance.mechanism.applied_force import Argument, applied, choose_argument, look_up
from clearance.mechanism.guide import guide_friction
from clearance.mechanism.load import process_force, spring_force
from clearance.mechanism.parameters import Parameter
from clearance.simulation.layout import Signal

_H = 2e-5  # s, of the differences
CRANK_ANGLE, CRANK_SPEED, TORQUE, GRAVITY_X, GRAVITY_Y, FIRST_JOINT = range(6)
"""Columns of a motion's state; then, for each loose joint, eccentricity x and its rate, y and its rate."""


# rad, rad/s, N m, m/s^2; m and m/s of the eccentricities: by which derivatives are taken
_STEPS = np.array([1e-6, 1e-3, 1e-3, 1e-2, 1e-2, 1e-7, 1e-4, 1e-7, 1e-4, 1e-7, 1e-4, 1e-7, 1e-4])
_FORCES = 6  # on the rod at B and at C, the angle of the rod, on the slider along its guide
_FORCE_B = float(Argument.FORCE_B)  # of the arguments from here on the motion knows none but the time
_TIME = float(Argument.TIME)
# plain numbers: compiled code compares none with members of an enumeration
(
    _CRANK_A_TRANSVERSE, _CRANK_B_TRANSVERSE, _CRANK_A_AXIAL, _CRANK_B_AXIAL, _ROD_B_TRANSVERSE,
    _ROD_C_TRANSVERSE, _ROD_B_AXIAL, _ROD_C_AXIAL, _SLIDER_HORIZONTAL, _SLIDER_VERTICAL, _CRANK_ANGLE,
    _CRANK_SPEED, _SLIDER_POSITION, _SLIDER_VELOCITY,
) = map(int, (
    Signal.CRANK_A_TRANSVERSE, Signal.CRANK_B_TRANSVERSE, Signal.CRANK_A_AXIAL, Signal.CRANK_B_AXIAL,
    Signal.ROD_B_TRANSVERSE, Signal.ROD_C_TRANSVERSE, Signal.ROD_B_AXIAL, Signal.ROD_C_AXIAL,
    Signal.SLIDER_HORIZONTAL, Signal.SLIDER_VERTICAL, Signal.CRANK_ANGLE, Signal.CRANK_SPEED,
    Signal.SLIDER_POSITION, Signal.SLIDER_VELOCITY,
))  # fmt: skip


def tilt(p: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Angle of an ideal machine's rod at angles of its crank, both from the x axis [rad].

    Args:
        p: (PARAMETERS,) of the machine.
        angle: any shape.
    """
    length = p[Parameter.ROD_TO_B] + p[Parameter.ROD_TO_C]
    return np.arcsin((p[Parameter.GUIDE_OFFSET] - p[Parameter.CRANK_LENGTH] * np.sin(angle)) / length)


@dataclass(frozen=True)
class Felt:
    """What belongs to a motion.

    Attributes:
        signals: (samples, channels).
        force_b: (samples, 2) on the rod at B [N].
        force_c: (samples, 2) on the rod at C [N].
        imbalance: (samples,) torque on the crank beyond what moves it [N m].
        rod_angle: (samples,) [rad].
        along: (samples,) force on the slider along its guide, beside the joint's [N].
    """

    signals: np.ndarray
    force_b: np.ndarray
    force_c: np.ndarray
    imbalance: np.ndarray
    rod_angle: np.ndarray
    along: np.ndarray


def feel(
    p: np.ndarray,
    joints: Sequence[str],
    signals: Sequence[int],
    state: np.ndarray,
    inputs: np.ndarray,
    lifted: Lift | None = None,
    clock: np.ndarray | None = None,
) -> Felt:
    """Signals and forces of a motion.

    Args:
        p: (PARAMETERS,) of the mechanism.
        joints: loose ones, B, C or both in this order.
        signals: rows of ``Signal`` to compute.
        state: (samples, 5 + 4 joints), see ``CRANK_ANGLE`` and the following.
        inputs: (samples, 1 + 2 joints) accelerations: of the crank, then of each eccentricity.
        lifted: motion of a slider that is loose in its guide.
        clock: (samples,) what the clock of a table over time shows [s]; the table is left out if ``None``.
    """
    rows, forces = np.zeros((len(state), len(signals) + 1)), np.zeros((len(state), _FORCES))
    known = _known(lifted, clock, len(state))
    _feel(p, _places(joints), np.array(signals), state, inputs, known, rows, forces)
    return Felt(rows[:, :-1], forces[:, :2], forces[:, 2:4], rows[:, -1], *forces[:, 4:].T)


def slopes(
    p: np.ndarray,
    joints: Sequence[str],
    signals: Sequence[int],
    state: np.ndarray,
    inputs: np.ndarray,
    lifted: Lift | None = None,
    clock: np.ndarray | None = None,
) -> np.ndarray:
    """(samples, channels + 1, states + inputs) derivatives of signals and imbalance, as of ``feel``."""
    steps = np.concatenate([_STEPS[: state.shape[1]], np.ones(inputs.shape[1])])
    found = np.zeros((len(state), len(signals) + 1, len(steps)))
    known = _known(lifted, clock, len(state))
    _differentiate(p, _places(joints), np.array(signals), state, inputs, known, steps, found)
    return found


def _places(joints: Sequence[str]) -> np.ndarray:
    """(2,) number of joint B and of joint C among the loose ones, -1 of an ideal one."""
    return np.array([joints.index(joint) if joint in joints else -1 for joint in ("B", "C")])


def _known(lifted: Lift | None, clock: np.ndarray | None, samples: int) -> np.ndarray:
    """(4, samples) height, rate and acceleration of the slider across its guide; clock, NaN where none is."""
    rows = np.zeros((4, samples))
    if lifted is not None:
        rows[:3] = lifted.height, lifted.rate, lifted.acceleration
    rows[3] = np.nan if clock is None else clock
    return rows


@kernel
def _gap(number: int, moment: float, x: Any, u: Any) -> tuple[float, float]:
    """Eccentricity in a joint of this number among the loose ones a moment later; none in an ideal one."""
    if number < 0:
        return 0.0, 0.0
    first, own, half = FIRST_JOINT + 4 * number, 1 + 2 * number, 0.5 * moment * moment
    along = x[first] + moment * x[first + 1] + half * u[own]
    return along, x[first + 2] + moment * x[first + 3] + half * u[own + 1]


@kernel
def _place(
    p: Any, places: Any, moment: float, x: Any, u: Any, height: float, rate: float, acceleration: float
) -> tuple[float, float, float, float]:
    """Journal of the crank, angle of the rod and place of the slider a moment later."""
    half = 0.5 * moment * moment
    angle = x[CRANK_ANGLE] + moment * x[CRANK_SPEED] + half * u[0]
    gap_bx, gap_by = _gap(places[0], moment, x, u)
    gap_cx, gap_cy = _gap(places[1], moment, x, u)
    crank, length = p[Parameter.CRANK_LENGTH], p[Parameter.ROD_TO_B] + p[Parameter.ROD_TO_C]
    bx, by = crank * math.cos(angle) - gap_bx, crank * math.sin(angle) - gap_by
    above = height + moment * rate + half * acceleration
    sine = (p[Parameter.GUIDE_OFFSET] + above + gap_cy - by) / length
    return bx, by, math.asin(sine), bx + length * math.sqrt(1.0 - sine * sine) - gap_cx


@kernel
def counts(p: Any, clocked: bool) -> bool:
    """Whether a table acts on slider or rod that is counted here.

    Not over a contact's force; over time where a recording is ``clocked``, as the table's clock is known.
    """
    acts = p[Parameter.TABLE_SLIDER_X] != 0.0 or p[Parameter.TABLE_ROD_MOMENT] != 0.0
    number = p[Parameter.TABLE_ARGUMENT]
    return acts and (number < _FORCE_B or (number == _TIME and clocked))


@kernel
def _tabulated(
    p: Any, angle: float, speed: float, rod_angle: float, rod_speed: float, place: float, velocity: float,
    time: float,
) -> float:  # fmt: skip
    """What the table of a force of free form says; nothing over what is not known here."""
    if not counts(p, not math.isnan(time)):
        return 0.0
    argument = choose_argument(
        p, angle, speed, rod_angle, rod_speed, place, velocity, 0.0, 0.0, 0.0, 0.0, time, 0.0, 0.0
    )
    return float(look_up(p, argument))


@kernel
def _push(p: Any, place: float, velocity: float, reaction: float, table: float) -> float:
    """What acts on the slider along its guide, beside the joint: spring, process, friction, a table [N]."""
    push = spring_force(p, place) + process_force(p, place)
    if p[Parameter.GUIDE_FRICTION_SPEED] > 0.0:
        push += guide_friction(p, velocity, reaction)
    return push + applied(p, Parameter.FORCE_SLIDER_X, table)


@subroutine
def _one(
    p: Any, places: Any, signals: Any, x: Any, u: Any, height: float, rate: float, acceleration: float,
    time: float, rows: Any, forces: Any,
) -> None:  # fmt: skip
    """Signals, imbalance and forces at one instant."""
    bx0, by0, turn0, slider0 = _place(p, places, -_H, x, u, height, rate, acceleration)
    bx1, by1, rod_angle, place = _place(p, places, 0.0, x, u, height, rate, acceleration)
    bx2, by2, turn2, slider2 = _place(p, places, _H, x, u, height, rate, acceleration)
    inverse = 1.0 / (_H * _H)
    gx, gy = x[GRAVITY_X] + p[Parameter.GRAVITY_X], x[GRAVITY_Y] + p[Parameter.GRAVITY_Y]
    # as felt: acceleration minus gravity
    bax, bay = (bx0 - 2.0 * bx1 + bx2) * inverse - gx, (by0 - 2.0 * by1 + by2) * inverse - gy
    turn, slider = (
        (turn0 - 2.0 * rod_angle + turn2) * inverse,
        (slider0 - 2.0 * place + slider2) * inverse - gx,
    )
    swing, slide = (turn2 - turn0) / (2.0 * _H), (slider2 - slider0) / (2.0 * _H)
    sine, cosine = math.sin(rod_angle), math.cos(rod_angle)
    angle, speed = x[CRANK_ANGLE], x[CRANK_SPEED]
    crank_sine, crank_cosine = math.sin(angle), math.cos(angle)
    across, along = bay * cosine - bax * sine, bax * cosine + bay * sine
    crank_across, crank_along = gx * crank_sine - gy * crank_cosine, -gx * crank_cosine - gy * crank_sine
    for k in range(signals.size):
        signal = signals[k]
        if signal == _CRANK_A_TRANSVERSE:
            rows[k] = crank_across + p[Parameter.SENSOR_CRANK_A] * u[0]
        elif signal == _CRANK_B_TRANSVERSE:
            rows[k] = crank_across + p[Parameter.SENSOR_CRANK_B] * u[0]
        elif signal == _CRANK_A_AXIAL:
            rows[k] = crank_along - p[Parameter.SENSOR_CRANK_A] * speed * speed
        elif signal == _CRANK_B_AXIAL:
            rows[k] = crank_along - p[Parameter.SENSOR_CRANK_B] * speed * speed
        elif signal == _ROD_B_TRANSVERSE:
            rows[k] = across + p[Parameter.SENSOR_ROD_B] * turn
        elif signal == _ROD_C_TRANSVERSE:
            rows[k] = across + p[Parameter.SENSOR_ROD_C] * turn
        elif signal == _ROD_B_AXIAL:
            rows[k] = along - p[Parameter.SENSOR_ROD_B] * swing * swing
        elif signal == _ROD_C_AXIAL:
            rows[k] = along - p[Parameter.SENSOR_ROD_C] * swing * swing
        elif signal == _SLIDER_HORIZONTAL:
            rows[k] = slider
        elif signal == _SLIDER_VERTICAL:
            rows[k] = acceleration - gy
        elif signal == _CRANK_ANGLE:
            rows[k] = angle
        elif signal == _CRANK_SPEED:
            rows[k] = speed
        elif signal == _SLIDER_POSITION:
            rows[k] = place
        elif signal == _SLIDER_VELOCITY:
            rows[k] = slide
        else:
            rows[k] = x[TORQUE]
    crank, to_b = p[Parameter.CRANK_LENGTH], p[Parameter.ROD_TO_B]
    length = to_b + p[Parameter.ROD_TO_C]
    mass, inertia = p[Parameter.ROD_MASS], 1.0 / p[Parameter.ROD_INVERSE_INERTIA]
    centre_x = bax - to_b * (sine * turn + cosine * swing * swing)
    centre_y = bay + to_b * (cosine * turn - sine * swing * swing)
    cx = -p[Parameter.SLIDER_MASS] * slider
    table = _tabulated(p, angle, speed, rod_angle, swing, place, slide, time)
    moment_b = inertia * turn + mass * to_b * (cosine * centre_y - sine * centre_x)
    moment_b -= applied(p, Parameter.FORCE_ROD_MOMENT, table)
    # friction on the guide follows from the guide's force without it, which carries the slider, too
    carried = p[Parameter.SLIDER_MASS] * (acceleration - gy)
    pushed = _push(p, place, slide, (moment_b / length + sine * cx) / cosine + carried, table)
    cx += pushed
    cy = (moment_b / length + sine * cx) / cosine
    rod_bx, rod_by = mass * centre_x - cx, mass * centre_y - cy
    needed = u[0] / p[Parameter.CRANK_INVERSE_INERTIA] + crank * (crank_cosine * rod_by - crank_sine * rod_bx)
    needed -= p[Parameter.CRANK_MOMENT] * (crank_cosine * gy - crank_sine * gx)
    rows[signals.size] = x[TORQUE] - needed
    forces[0], forces[1], forces[2], forces[3] = rod_bx, rod_by, cx, cy
    forces[4], forces[5] = rod_angle, pushed


@entry
def _feel(
    p: np.ndarray,
    places: np.ndarray,
    signals: np.ndarray,
    state: np.ndarray,
    inputs: np.ndarray,
    known: np.ndarray,
    rows: np.ndarray,
    forces: np.ndarray,
) -> None:
    for t in range(len(state)):
        height, rate, acceleration, time = known[0, t], known[1, t], known[2, t], known[3, t]
        _one(p, places, signals, state[t], inputs[t], height, rate, acceleration, time, rows[t], forces[t])


@entry
def _differentiate(
    p: np.ndarray,
    places: np.ndarray,
    signals: np.ndarray,
    state: np.ndarray,
    inputs: np.ndarray,
    known: np.ndarray,
    steps: np.ndarray,
    found: np.ndarray,
) -> None:
    rows, states = signals.size + 1, state.shape[1]
    now, moved, forces = np.zeros(rows), np.zeros(rows), np.zeros(_FORCES)
    x, u = np.zeros(states), np.zeros(inputs.shape[1])
    for t in range(len(state)):
        height, rate, acceleration, time = known[0, t], known[1, t], known[2, t], known[3, t]
        x[:], u[:] = state[t], inputs[t]
        _one(p, places, signals, x, u, height, rate, acceleration, time, now, forces)
        for i in range(steps.size):
            if i < states:
                x[i] = state[t, i] + steps[i]
            else:
                u[i - states] = inputs[t, i - states] + steps[i]
            _one(p, places, signals, x, u, height, rate, acceleration, time, moved, forces)
            for k in range(rows):
                found[t, k, i] = (moved[k] - now[k]) / steps[i]
            if i < states:
                x[i] = state[t, i]
            else:
                u[i - states] = inputs[t, i - states]
