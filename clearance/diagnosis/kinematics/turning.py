"""The motion as the crank feels it, and what an ideal machine would do there.

The simulator's own equations are asked, with ideal joints, rigid links and a frame at rest.
"""

from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.kinematics.reconstruction import Reconstruction
from clearance.diagnosis.kinematics.rigid_motion import tilt
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.mechanism.applied_force import CONSTANTS
from clearance.mechanism.parameters import STRUCTURE, Family, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import aligned
from clearance.simulation.ideal import accelerate
from clearance.simulation.layout import RESULTS, STATES

_EDGE = 3  # bins at both ends, which the smoother knows from one side only
_EVERY = 2  # samples: bins are their means, so that a law may begin or end within one
_TORQUE = 1e-3  # N m, that tells how much turning the crank takes


@dataclass(frozen=True)
class Turning:
    """A recording's motion as the crank feels it, instant by instant.

    Attributes:
        time: (instants,) since its beginning [s].
        angle: (instants,) of the crank [rad].
        speed: (instants,) [rad/s].
        acceleration: (instants,) [rad/s^2].
        torque: (instants,) that the motion needs [N m].
        place: (instants,) of an ideal machine's slider [m].
        slide: (instants,) its change by the crank's angle [m/rad].
        begin: what the recording's clock shows at the first instant [s].
        clocked: whether the path was reconstructed by that clock.
    """

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    place: np.ndarray
    slide: np.ndarray
    begin: float
    clocked: bool

    @staticmethod
    def along(path: Reconstruction, machine: SliderCrank, measured: Measured) -> "Turning":
        """The motion of a path through a recording, at every other sample of whole bins."""
        rows = path.turning[:, : path.turning.shape[1] // SAMPLES * SAMPLES]
        angle, speed, acceleration, torque = rows[:, _EDGE * SAMPLES : -_EDGE * SAMPLES : _EVERY]
        time = _EVERY / measured.chain.rate * np.arange(len(angle))
        begin = measured.begin + _EDGE * measured.segment
        place, slide = _ideal(machine.parameters(), angle)
        return Turning(time, angle, speed, acceleration, torque, place, slide, begin, measured.period > 0.0)


def binned(values: np.ndarray) -> np.ndarray:
    """(bins,) means of what was taken along a motion."""
    mean: np.ndarray = values.reshape(-1, SAMPLES // _EVERY).mean(axis=1)
    return mean


def answer(machine: SliderCrank, turning: Turning) -> tuple[np.ndarray, np.ndarray]:
    """(instants,) inertia that the crank feels [kg m^2]; (instants,) acceleration of an ideal machine.

    Args:
        machine: its joints are taken as ideal, its links, guide and frame as rigid.
        turning: motion; the integral of the drive's speed error begins at zero with it.
    """
    codes, p = machine.codes(), aligned(len(machine.parameters()))
    codes[STRUCTURE] = 0
    p[:] = machine.parameters()[:, None]
    if not codes[Family.FORCE]:
        codes[Family.FORCE] = CONSTANTS
    integral = p[Parameter.DRIVE_SPEED, 0] * turning.time - (turning.angle - turning.angle[0])
    motion = np.stack([turning.angle, turning.speed, integral, turning.begin + turning.time])
    out = np.zeros((2, motion.shape[1]))
    work = aligned(RESULTS + STATES)
    accelerate(codes, p, motion, work, out[0])
    p[Parameter.FORCE_CRANK_TORQUE] += _TORQUE
    accelerate(codes, p, motion, work, out[1])
    return _TORQUE / (out[1] - out[0]), out[0]


def _ideal(p: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position of an ideal machine's slider [m], and its change by the crank's angle [m/rad]."""
    length = p[Parameter.ROD_TO_B] + p[Parameter.ROD_TO_C]
    crank, rod = p[Parameter.CRANK_LENGTH], tilt(p, angle)
    sine, cosine = np.sin(rod), np.cos(rod)
    swing = -crank * np.cos(angle) / (length * cosine)
    place = crank * np.cos(angle) + length * cosine
    return place, -crank * np.sin(angle) - length * sine * swing
