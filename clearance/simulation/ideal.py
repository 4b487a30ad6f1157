"""Sixteen runs of a mechanism whose joints are ideal, each with its own numbers and its own start.

Such a mechanism has one degree of freedom and is not chaotic: a run of a minute from a slightly wrong start
stays near the right one. That is what recordings at the rate of an encoder are compared with.
"""

from enum import IntEnum, auto
from typing import Any

from clearance.compilation import entry
from clearance.lanes import get, put, square_root
from clearance.simulation.equations import evaluate
from clearance.simulation.integrator import WORKSPACE, step
from clearance.simulation.kinematics import project
from clearance.simulation.layout import RESULTS, Result, State

_TINY = 1e-12  # N^2, added under the square root of a force: no force has no direction


class Motion(IntEnum):
    """What is kept of each sample."""

    CRANK_ANGLE = 0  # rad
    CRANK_SPEED = auto()  # rad/s
    DRIVE_TORQUE = auto()  # N m
    SLIDER_POSITION = auto()  # m
    SLIDER_VELOCITY = auto()  # m/s
    SLACK_B = auto()  # -, change of the slider's position by a clearance in joint B, over that clearance
    SLACK_C = auto()  # -, likewise joint C


MOTIONS = len(Motion)
WORK_ROWS = RESULTS + WORKSPACE


@entry
def run_ideal(codes: Any, p: Any, s: Any, work: Any, scheme: int, h: float, substeps: int, out: Any) -> None:
    """Simulate ``WIDTH`` runs and keep a sample every ``substeps`` steps.

    A journal that is pressed against its bearing lies off the centre by the clearance, in the direction of
    the force between them. With ideal joints this direction is that of the reaction; its effect on the
    slider's place follows from the rod's slope: (F_x + F_y tan(psi)) / |F|.
    Reference: Flores, Ambrosio, Claro, Lankarani 2008, Kinematics and Dynamics of Multibody Systems with
    Imperfect Joints, ch. 3 (massless link in place of a clearance).

    Args:
        codes: (families,) chosen laws, the same for all runs; joints ideal.
        p: (PARAMETERS, WIDTH).
        s: (STATES, WIDTH) start states; the end states on return.
        work: (WORK_ROWS, WIDTH) scratch.
        scheme: a ``Scheme``.
        h: step [s].
        substeps: steps from one sample to the next.
        out: (samples, MOTIONS, WIDTH) written, rows ``Motion``.
    """
    r = work[:RESULTS]
    w = work[RESULTS:]
    project(codes, p, s)
    for k in range(out.shape[0]):
        for m in range(substeps):
            evaluate(codes, p, s, r)
            if m == 0:
                y = out[k]
                put(y, Motion.CRANK_ANGLE, get(s, State.CRANK_ANGLE))
                put(y, Motion.CRANK_SPEED, get(s, State.CRANK_SPEED))
                put(y, Motion.DRIVE_TORQUE, get(r, Result.DRIVE_TORQUE))
                put(y, Motion.SLIDER_POSITION, get(s, State.SLIDER_X) - get(s, State.FRAME_X))
                put(y, Motion.SLIDER_VELOCITY, get(s, State.SLIDER_X_RATE) - get(s, State.FRAME_X_RATE))
                slope = get(s, State.ROD_SINE) / get(s, State.ROD_COSINE)
                fx, fy = get(r, Result.FORCE_B_X), get(r, Result.FORCE_B_Y)
                put(y, Motion.SLACK_B, (fx + fy * slope) / square_root(fx * fx + fy * fy + _TINY))
                fx, fy = get(r, Result.FORCE_C_X), get(r, Result.FORCE_C_Y)
                put(y, Motion.SLACK_C, (fx + fy * slope) / square_root(fx * fx + fy * fy + _TINY))
            step(codes, p, s, r, w, scheme, h, 1)


@entry
def accelerate(codes: Any, p: Any, motion: Any, work: Any, out: Any) -> None:
    """Angular acceleration of an ideal machine's crank at each instant of a motion.

    Args:
        codes: (families,) chosen laws; joints ideal.
        p: (PARAMETERS, WIDTH), all lanes alike.
        motion: (4, instants) crank angle [rad], speed [rad/s], integral of the drive [rad], time [s].
        work: (RESULTS + STATES, WIDTH) scratch.
        out: (instants,) written [rad/s^2].
    """
    r, s = work[:RESULTS], work[RESULTS:]
    width, count = p.shape[1], motion.shape[1]
    for begin in range(0, count, width):
        for lane in range(width):
            k = min(begin + lane, count - 1)
            s[State.CRANK_ANGLE, lane] = motion[0, k]
            s[State.CRANK_SPEED, lane] = motion[1, k]
            s[State.DRIVE_INTEGRAL, lane] = motion[2, k]
            s[State.TIME, lane] = motion[3, k]
        project(codes, p, s)
        evaluate(codes, p, s, r)
        for lane in range(min(width, count - begin)):
            out[begin + lane] = r[Result.CRANK, lane]
