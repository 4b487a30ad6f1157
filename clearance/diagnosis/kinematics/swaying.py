"""A frame that gives way where no sensor is at A: from the crank's end and the forces of all links.

Of a crank that turns about a point which stands still the two accelerations of its end are tied, whatever
turns it: axial = -r w^2 and transverse = r dw/dt, so that 2 w transverse + d(axial)/dt = 0. What a moving A
adds is what is left of it. How A moves follows from what the links ask of the frame, through its mass, damper
and springs; three numbers, and how the frame moved when the recording began, are fitted to what is left.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import bilinear, lfilter

from clearance.diagnosis.kinematics.rigid_motion import tilt
from clearance.diagnosis.kinematics.shaking import felt
from clearance.diagnosis.sensing.measured import Measured
from clearance.mechanism.applied_force import Argument, looked_up
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank

NEEDED = (
    "crank_b_transverse", "crank_b_axial", "rod_b_transverse", "rod_b_axial",
    "rod_c_transverse", "rod_c_axial", "slider_horizontal",
)  # fmt: skip
"""Channels that tell what all links ask of the frame."""
_CORNER = 300.0  # rad/s, of the filter
_SETTLED = 9.0  # times its time constant, after which it has forgotten how the recording began
LOOKED_AT = 2000  # segments of each recording that are looked at for a frame
_SHOWN = 5.0  # times the noise: what is left of the tie where A moves
_SLOWEST = 0.3  # of w²: the axial acceleration between impacts never falls below
_FREQUENCIES, _MASSES = np.geomspace(8.0, 120.0, 28), np.geomspace(8.0, 100.0, 5)  # Hz, kg: begun with
_RATIO = 0.04  # of damping, begun with
_BOUNDS = (np.array([np.log(2.0), 0.0, np.log(0.5)]), np.array([np.log(400.0), 1.0, np.log(1e4)]))
_LEFT = 0.2  # of the variance of what is left, beyond which it is no frame on springs


@dataclass(frozen=True)
class Swaying:
    """A recording as it concerns the frame.

    Attributes:
        turned: (samples,) crank angle [rad].
        speed: (samples,) of the crank [rad/s].
        asked: (samples,) force on the frame, x + iy [N]: of the links, but for what moves along with it, and
            of a table over time that repeats.
        along: (2,) masses [kg] that move along with the frame, in x and in y.
        rate: [Hz].
    """

    turned: np.ndarray
    speed: np.ndarray
    asked: np.ndarray
    along: np.ndarray
    rate: float

    @staticmethod
    def of(one: Measured, angle: float, speed: float, p: np.ndarray) -> "Swaying":
        """From a recording with the channels of ``NEEDED``; ``p`` are the machine's parameters."""
        values, rate = one.values.reshape(-1, len(one.channels)), one.chain.rate
        turned = angle + speed * np.arange(len(values)) / rate
        rod = tilt(p, turned)

        end = felt(one, "crank_b", turned)
        near, far = felt(one, "rod_b", rod), felt(one, "rod_c", rod)
        first, last = p[Parameter.SENSOR_ROD_B], p[Parameter.SENSOR_ROD_C]
        share = (p[Parameter.ROD_TO_B] - first) / (last - first)
        arm, reach = p[Parameter.CRANK_MOMENT], p[Parameter.SENSOR_CRANK_B]
        slider = p[Parameter.SLIDER_MASS]
        sliding = values[:, one.channels.index("slider_horizontal")]
        asked = -(
            arm / reach * end + p[Parameter.ROD_MASS] * (near + share * (far - near)) + slider * sliding
        )
        if p[Parameter.TABLE_ARGUMENT] == Argument.TIME and p[Parameter.TABLE_PERIOD] > 0.0:
            pushed = looked_up(p, one.begin + np.arange(len(values)) / rate)
            asked = asked + (p[Parameter.TABLE_FRAME_X] + 1j * p[Parameter.TABLE_FRAME_Y]) * pushed
        axial = values[:, one.channels.index("crank_b_axial")]
        fast = np.sign(speed) * np.sqrt(np.maximum(-axial / reach, _SLOWEST * speed**2))
        crank = p[Parameter.CRANK_MASS] - arm / reach
        return Swaying(turned, fast, asked, np.array([crank, crank + slider]), rate)

    @property
    def settled(self) -> int:
        """Samples after which the filter of the tie has settled."""
        return _settled(self.rate)

    def tie(self, axial: np.ndarray, transverse: np.ndarray) -> np.ndarray:
        """(samples,) what two accelerations of the crank's end leave of their tie, filtered [m/s^3]."""
        return _filtered(2.0 * self.speed * transverse, 1, self.rate) + _filtered(axial, 2, self.rate)

    def moved(self, frequency: float, ratio: float, mass: float) -> tuple[np.ndarray, np.ndarray]:
        """(samples,) acceleration of a frame at rest at first, and (samples, 4) of one let go, x + iy."""
        omega, time = 2.0 * np.pi * frequency, np.arange(len(self.turned)) / self.rate
        forced, free = np.zeros(len(time), dtype=complex), []
        for force, along, way in zip((self.asked.real, self.asked.imag), self.along, (1.0, 1j), strict=True):
            whole = mass + along
            system = [whole, 2.0 * ratio * omega * mass, omega**2 * mass]
            forced += way * lfilter(*bilinear([1.0, 0.0, 0.0], system, self.rate), force - force[0])
            decay = ratio * omega * mass / whole
            swing = np.sqrt(max(omega**2 * mass / whole - decay**2, 1.0))
            free += [way * np.exp(-decay * time) * of(swing * time) for of in (np.cos, np.sin)]
        return forced, np.stack(free, axis=1)

    def tied(self, motion: np.ndarray) -> np.ndarray:
        """What accelerations (samples, ...) of A, x + iy, leave of the tie at the crank's end."""
        turn = np.exp(-1j * self.turned)
        own = (motion.T * turn).astype(complex)
        return np.stack([self.tie(one.real, one.imag) for one in own], axis=1)[self.settled :]


def told(one: Measured) -> bool:
    """Whether a recording has the channels of ``NEEDED`` and is long enough."""
    long = one.values[..., 0].size > 2 * _settled(one.chain.rate)
    return long and all(name in one.channels for name in NEEDED)


def sways(one: Measured, angle: float, speed: float, p: np.ndarray, loose: bool = False) -> bool:
    """Whether the crank's end contradicts, beyond the noise, that A stands still.

    Args:
        one: a recording.
        angle: of the crank at its first sample [rad].
        speed: of the crank [rad/s].
        p: (PARAMETERS,) of the machine.
        loose: that A moves as its frame lets it, instead.
    """
    if not told(one):
        return False
    swaying = Swaying.of(one, angle, speed, p)
    impulse = np.zeros(2 * swaying.settled)
    impulse[1] = 1.0
    across, along = (one.sigma[one.channels.index(f"crank_b_{way}")] for way in ("transverse", "axial"))
    noise = np.hypot(
        2.0 * speed * across * np.linalg.norm(_filtered(impulse, 1, swaying.rate)),
        along * np.linalg.norm(_filtered(impulse, 2, swaying.rate)),
    )
    if loose:
        left = loosely(one, angle, speed, p)[2]
    else:
        left = _without(swaying.tied(_resting(swaying)), _left(one, swaying))
    return bool(left.std() > _SHOWN * noise)


def find_frame(
    recordings: Sequence[Measured], turning: Sequence[tuple[float, float]], machine: SliderCrank
) -> np.ndarray | None:
    """(3,) frequency [Hz] and damping ratio of the frame alone, and its mass [kg].

    Args:
        recordings: of one machine, that all ``sway``.
        turning: angle of the crank at the first sample [rad] and its speed [rad/s] in each.
        machine: whose links they are.

    Returns:
        ``None`` if what is left of the tie is not what a frame on springs would leave.
    """
    p = machine.parameters()
    recordings = [one.part(0, LOOKED_AT) for one in recordings]
    each = [Swaying.of(one, *turns, p) for one, turns in zip(recordings, turning, strict=True)]
    left = [_left(one, swaying) for one, swaying in zip(recordings, each, strict=True)]

    def rest(x: np.ndarray) -> np.ndarray:
        """(samples,) what frames and what they did before leave, in all recordings."""
        parts = []
        for swaying, whole in zip(each, left, strict=True):
            forced, free = swaying.moved(float(np.exp(x[0])), float(x[1]), float(np.exp(x[2])))
            columns = swaying.tied(np.column_stack([free, _resting(swaying)]))
            parts.append(_without(columns, whole - swaying.tied(forced[:, None])[:, 0]))
        return np.concatenate(parts)

    grid = [np.array([np.log(f), _RATIO, np.log(mass)]) for f in _FREQUENCIES for mass in _MASSES]
    start = min(grid, key=lambda x: float(np.sum(rest(x) ** 2)))
    found = least_squares(rest, start, bounds=_BOUNDS, x_scale=[0.01, 0.01, 0.05])
    still = [_without(one.tied(_resting(one)), whole) for one, whole in zip(each, left, strict=True)]
    if 2.0 * found.cost > _LEFT * sum(float(np.sum(whole**2)) for whole in still):
        return None
    return np.array([np.exp(found.x[0]), found.x[1], np.exp(found.x[2])])


def sway(one: Measured, angle: float, speed: float, p: np.ndarray) -> np.ndarray | None:
    """(samples,) acceleration of A [m/s^2], x + iy, of a machine whose frame gives way as ``p`` says.

    ``None`` where that leaves much of the tie: the frame is another one, or something else pushes it.
    """
    swaying = Swaying.of(one, angle, speed, p)
    forced, free = swaying.moved(*_springs(p))
    columns = swaying.tied(np.column_stack([free, _resting(swaying)]))
    whole, rest = _left(one, swaying), swaying.tied(forced[:, None])[:, 0]
    begun = np.linalg.lstsq(columns, whole - rest, rcond=None)[0]
    still = _without(columns[:, free.shape[1] :], whole)
    if np.sum((whole - rest - columns @ begun) ** 2) > _LEFT * np.sum(still**2):
        return None
    motion: np.ndarray = forced + free @ begun[: free.shape[1]]
    return motion


def loosely(
    one: Measured, angle: float, speed: float, p: np.ndarray
) -> tuple[Swaying, np.ndarray, np.ndarray]:
    """What a frame that gives way as ``p`` says leaves of the tie.

    Returns:
        The recording as it concerns the frame; (samples, 6) orthonormal directions in which nothing is known,
        how the frame was let go and gravity; (samples,) what is left across them [m/s^3].
    """
    swaying = Swaying.of(one, angle, speed, p)
    forced, free = swaying.moved(*_springs(p))
    unknown, _ = np.linalg.qr(swaying.tied(np.column_stack([free, _resting(swaying)])))
    left = _left(one, swaying) - swaying.tied(forced[:, None])[:, 0]
    return swaying, unknown, left - unknown @ (unknown.T @ left)


def _springs(p: np.ndarray) -> tuple[float, float, float]:
    """Frequency [Hz] and damping ratio of a machine's frame alone, and its mass [kg]."""
    mass = 1.0 / float(p[Parameter.FRAME_INVERSE_MASS_X]) - float(p[Parameter.CRANK_MASS])
    omega = float(np.sqrt(p[Parameter.FRAME_STIFFNESS] / mass))
    return omega / (2.0 * np.pi), float(p[Parameter.FRAME_DAMPING]) / (2.0 * omega * mass), mass


def _left(one: Measured, swaying: Swaying) -> np.ndarray:
    """(samples,) what a recording leaves of the tie once the filter is settled [m/s^3]."""
    values = one.values.reshape(-1, len(one.channels))
    axial, across = (values[:, one.channels.index(f"crank_b_{way}")] for way in ("axial", "transverse"))
    return swaying.tie(axial, across)[swaying.settled :]


def _resting(swaying: Swaying) -> np.ndarray:
    """(samples, 2) what accelerometers feel of gravity in x and in y: as if A fell the other way."""
    return np.repeat(np.array([[1.0, 1j]]), len(swaying.turned), axis=0)


def _without(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


def _filtered(signal: np.ndarray, derivatives: int, rate: float) -> np.ndarray:
    """(samples,) of a signal and some of its derivatives, smoothed and without their means alike."""
    below = np.poly([-_CORNER] * 3)
    above = np.zeros(4)
    above[3 - derivatives] = _CORNER**2
    return lfilter(*bilinear(above, below, rate), signal - signal[0])


def _settled(rate: float) -> int:
    return round(_SETTLED / _CORNER * rate)


def smoothed(frequency: np.ndarray) -> np.ndarray:
    """Answer of the filter of a tie to angular frequencies [rad/s]."""
    s = 1j * frequency
    answer: np.ndarray = _CORNER**2 * s / (s + _CORNER) ** 3
    return answer
