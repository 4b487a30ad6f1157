"""What accelerometers feel and which forces the joints carry, from the motion alone: no law of contact.

The motion is that of rigid links with one or both joints loose. Positions are exact; their rates and
accelerations along a given motion are differences over two hundredths of a millisecond, which is exact to
1e-6 of an acceleration and needs no second set of formulas. The forces follow from Newton and Euler
(inverse dynamics), whatever holds the joints together.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clearance.compilation import entry
from clearance.diagnosis.lift import Lift
from clearance.mechanism.applied_force import Argument, applied, choose_argument, look_up
from clearance.mechanism.guide import guide_friction
from clearance.mechanism.load import process_force, spring_force
from clearance.mechanism.parameters import Parameter
from clearance.simulation.layout import Signal

_H = 2e-5  # s, of the differences
CRANK_ANGLE, CRANK_SPEED, TORQUE, GRAVITY_X, GRAVITY_Y, FIRST_JOINT = range(6)
"""Columns of a motion's state; then, for each loose joint, eccentricity x and its rate, y and its rate."""


_LOADS = [
    Parameter.SPRING_STIFFNESS, Parameter.PROCESS_FORCE, Parameter.GUIDE_COULOMB, Parameter.GUIDE_VISCOUS,
    Parameter.GUIDE_STRIBECK, Parameter.GUIDE_FRICTION, Parameter.FORCE_SLIDER_X, Parameter.TABLE_SLIDER_X,
]  # fmt: skip
_TIME = float(Argument.TIME)


@dataclass(frozen=True)
class Felt:
    """What belongs to a motion.

    Attributes:
        signals: (samples, channels).
        force_b: (samples, 2) on the rod at B [N].
        force_c: (samples, 2) on the rod at C [N].
        imbalance: (samples,) torque on the crank beyond what moves it [N m].
        rod_angle: (samples,) [rad].
    """

    signals: np.ndarray
    force_b: np.ndarray
    force_c: np.ndarray
    imbalance: np.ndarray
    rod_angle: np.ndarray


def feel(
    p: np.ndarray,
    joints: Sequence[str],
    signals: Sequence[int],
    state: np.ndarray,
    inputs: np.ndarray,
    lifted: Lift | None = None,
) -> Felt:
    """Signals and forces of a motion.

    Args:
        p: (PARAMETERS,) of the mechanism.
        joints: loose ones, B, C or both in this order.
        signals: rows of ``Signal`` to compute.
        state: (samples, 5 + 4 joints), see ``CRANK_ANGLE`` and the following.
        inputs: (samples, 1 + 2 joints) accelerations: of the crank, then of each eccentricity.
        lifted: motion of a slider that is loose in its guide.
    """
    crank, offset = p[Parameter.CRANK_LENGTH], p[Parameter.GUIDE_OFFSET]
    to_b, to_c = p[Parameter.ROD_TO_B], p[Parameter.ROD_TO_C]
    length = to_b + to_c
    moments = []
    for moment in (-_H, 0.0, _H):
        half = 0.5 * moment * moment
        angle = state[:, CRANK_ANGLE] + moment * state[:, CRANK_SPEED] + half * inputs[:, 0]
        nothing = np.zeros(len(state))
        gap = {"B": (nothing, nothing), "C": (nothing, nothing)}
        for j, joint in enumerate(joints):
            first = FIRST_JOINT + 4 * j
            gap[joint] = (
                state[:, first] + moment * state[:, first + 1] + half * inputs[:, 1 + 2 * j],
                state[:, first + 2] + moment * state[:, first + 3] + half * inputs[:, 2 + 2 * j],
            )
        bx, by = crank * np.cos(angle) - gap["B"][0], crank * np.sin(angle) - gap["B"][1]
        height = nothing if lifted is None else lifted.at(moment)
        sine = (offset + height + gap["C"][1] - by) / length
        moments.append(
            np.stack([bx, by, np.arcsin(sine), bx + length * np.sqrt(1.0 - sine**2) - gap["C"][0]])
        )
    before, now, after = moments
    bax, bay, turn, slider = (before - 2.0 * now + after) / _H**2
    swing, slide = ((after - before) / (2.0 * _H))[2:]
    gx, gy = state[:, GRAVITY_X] + p[Parameter.GRAVITY_X], state[:, GRAVITY_Y] + p[Parameter.GRAVITY_Y]
    sine, cosine = np.sin(now[2]), np.cos(now[2])
    crank_sine, crank_cosine = np.sin(state[:, CRANK_ANGLE]), np.cos(state[:, CRANK_ANGLE])
    speed = state[:, CRANK_SPEED]
    bax, bay, slider = bax - gx, bay - gy, slider - gx  # as felt: acceleration minus gravity
    across, along = bay * cosine - bax * sine, bax * cosine + bay * sine
    crank_across, crank_along = gx * crank_sine - gy * crank_cosine, -gx * crank_cosine - gy * crank_sine

    def of(signal: int) -> np.ndarray:
        match signal:
            case Signal.CRANK_A_TRANSVERSE:
                return crank_across + p[Parameter.SENSOR_CRANK_A] * inputs[:, 0]
            case Signal.CRANK_B_TRANSVERSE:
                return crank_across + p[Parameter.SENSOR_CRANK_B] * inputs[:, 0]
            case Signal.CRANK_A_AXIAL:
                return crank_along - p[Parameter.SENSOR_CRANK_A] * speed**2
            case Signal.CRANK_B_AXIAL:
                return crank_along - p[Parameter.SENSOR_CRANK_B] * speed**2
            case Signal.ROD_B_TRANSVERSE:
                return across + p[Parameter.SENSOR_ROD_B] * turn
            case Signal.ROD_C_TRANSVERSE:
                return across + p[Parameter.SENSOR_ROD_C] * turn
            case Signal.ROD_B_AXIAL:
                return along - p[Parameter.SENSOR_ROD_B] * swing**2
            case Signal.ROD_C_AXIAL:
                return along - p[Parameter.SENSOR_ROD_C] * swing**2
            case Signal.SLIDER_HORIZONTAL:
                return slider
            case Signal.SLIDER_VERTICAL:
                return (0.0 if lifted is None else lifted.acceleration) - gy
            case Signal.CRANK_ANGLE:
                return state[:, CRANK_ANGLE]
            case Signal.CRANK_SPEED:
                return speed
            case Signal.SLIDER_POSITION:
                return now[3]
            case Signal.SLIDER_VELOCITY:
                return slide
            case _:
                return state[:, TORQUE]

    mass, inertia = p[Parameter.ROD_MASS], 1.0 / p[Parameter.ROD_INVERSE_INERTIA]
    centre_x = bax - to_b * (sine * turn + cosine * swing**2)
    centre_y = bay + to_b * (cosine * turn - sine * swing**2)
    cx = -p[Parameter.SLIDER_MASS] * slider
    moment_b = inertia * turn + mass * to_b * (cosine * centre_y - sine * centre_x)
    cy = (moment_b / length + sine * cx) / cosine
    if p[_LOADS].any():
        push = np.zeros(len(state))
        load(p, np.stack([state[:, CRANK_ANGLE], speed, now[2], swing, now[3], slide, cy]), push)
        cx = cx + push
        cy = (moment_b / length + sine * cx) / cosine
    rod_bx, rod_by = mass * centre_x - cx, mass * centre_y - cy
    needed = inputs[:, 0] / p[Parameter.CRANK_INVERSE_INERTIA]
    needed += crank * (crank_cosine * rod_by - crank_sine * rod_bx)
    needed -= p[Parameter.CRANK_MOMENT] * (crank_cosine * gy - crank_sine * gx)
    return Felt(
        np.stack([of(s) for s in signals], axis=1), np.stack([rod_bx, rod_by], axis=1),
        np.stack([cx, cy], axis=1), state[:, TORQUE] - needed, now[2],
    )  # fmt: skip


@entry
def load(p: np.ndarray, motion: np.ndarray, push: np.ndarray) -> None:
    """What acts on the slider along its guide, beside the joint: spring, process, friction, a table.

    A table over time or over the contact's force is not known here.

    Args:
        p: (PARAMETERS,); a law that is off has size zero.
        motion: (7, samples) angle and speed of crank and rod, position and velocity of the slider, force of
            the guide [N].
        push: (samples,) written [N].
    """
    table = p[Parameter.TABLE_SLIDER_X] != 0.0 and p[Parameter.TABLE_ARGUMENT] != _TIME
    rubs = p[Parameter.GUIDE_FRICTION_SPEED] > 0.0
    for i in range(motion.shape[1]):
        angle, speed, rod_angle, rod_speed, place, velocity, reaction = motion[:, i]
        push[i] = spring_force(p, place) + process_force(p, place)
        if rubs:
            push[i] += guide_friction(p, velocity, reaction)
        value = 0.0
        if table:
            argument = choose_argument(
                p, angle, speed, rod_angle, rod_speed, place, velocity, 0.0, 0.0, 0.0, 0.0, 0.0
            )
            value = look_up(p, argument)
        push[i] += applied(p, Parameter.FORCE_SLIDER_X, value)
