"""How the frame moves, and on what kind of springs it stands, from what accelerometers feel.

What all links are accelerated with, the frame has to give: its own mass, damper and springs answer, and the
crank's sensors at A show how it moves. The balance of the two is linear in mass, damping and stiffness. It is
filtered by s²/(s + λ)², so that no signal is differentiated and no integral drifts.

Reference: Garnier and Wang 2008, Identification of Continuous-time Models from Sampled Data, ch. 1 (state
variable filters).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import minimize
from scipy.signal import bilinear, lfilter

from clearance.diagnosis.kinematics.regression import cost_of, regressed, scatter_of
from clearance.diagnosis.kinematics.rhythm import Needed, Rhythm, find_rhythm
from clearance.diagnosis.kinematics.rigid_motion import tilt
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.mechanism.applied_force import shares
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import Link, SliderCrank

AT_A = ("crank_a_axial", "crank_a_transverse")
NEEDED = (
    *AT_A, "crank_b_transverse", "crank_b_axial", "rod_b_transverse",
    "rod_b_axial", "rod_c_transverse", "rod_c_axial", "slider_horizontal",
)  # fmt: skip
"""Channels that tell what all links are accelerated with, but for a slider that leaves its guide line."""
LIFTED = "slider_vertical"
"""The channel that feels a slider leave its guide line, and the guide push it back."""
FOUND = ("frequency", "damping_ratio", "mass")
"""What they tell of the frame, by the names of its effect's parameters."""
_SHOWN = 5.0  # times the noise: what the sensors at A feel of a frame that moves
KNOTS = 48
"""Over the period of a force that shakes the frame."""
_TRIED = 40  # rhythms for each recording
_HARDLY = 0.9  # of the variance: a table that leaves more before its rhythm is sharpened is none
_CORNER = 100.0  # rad/s, of the filter
_SETTLED = 6.0  # times its time constant, after which it has forgotten how the recording began


def shakes(one: Measured, angle: float, speed: float) -> bool:
    """Whether the crank's sensors at A feel a frame that moves, beside gravity and what they err by.

    Args:
        one: a recording.
        angle: of the crank at its first sample [rad].
        speed: of the crank [rad/s].
    """
    if any(channel not in one.channels for channel in AT_A):
        return False
    at = [one.channels.index(channel) for channel in AT_A]
    axial, across = one.values.reshape(-1, len(one.channels))[:, at].T
    turned = angle + speed * np.arange(len(axial)) / one.chain.rate
    cosine, sine, one_each, none = np.cos(turned), np.sin(turned), np.ones_like(turned), np.zeros_like(turned)
    columns = np.concatenate([
        np.stack([cosine, sine, one_each, none], axis=1), np.stack([-sine, cosine, none, one_each], axis=1),
    ])  # fmt: skip
    felt = np.concatenate([axial, across])
    left = (felt - columns @ np.linalg.lstsq(columns, felt, rcond=None)[0]).reshape(2, -1)
    return bool((left.std(axis=1) > _SHOWN * one.sigma[at]).all())


def measure_frame(
    recordings: Sequence[Measured], turning: Sequence[tuple[float, float]], machine: SliderCrank
) -> np.ndarray | None:
    """(3,) frequency [Hz] and damping ratio of the frame alone, and its mass [kg].

    Args:
        recordings: of one machine.
        turning: angle of the crank at the first sample [rad] and its speed [rad/s] in each.
        machine: whose links they are.

    Returns:
        ``None`` where a channel of ``NEEDED`` is not recorded, or what is found is no frame on springs.
    """
    if not _told(recordings, machine):
        return None
    parts = [_balance(one, *turns, machine) for one, turns in zip(recordings, turning, strict=True)]
    both = [np.concatenate([part.real, part.imag]) for part in map(np.concatenate, zip(*parts, strict=True))]
    rest = np.repeat(np.eye(2), len(both[0]) // 2, axis=0)  # what sensors err by all along
    rows = np.column_stack([*both[:3], rest])
    mass, damping, stiffness, *_ = np.linalg.lstsq(rows, both[3], rcond=None)[0]
    if not (mass > 0.0 and stiffness > 0.0):
        return None
    ratio = max(damping, 0.0) / (2.0 * np.sqrt(stiffness * mass))
    return np.array([np.sqrt(stiffness / mass) / (2.0 * np.pi), ratio, mass])


@dataclass(frozen=True)
class Shaking:
    """A force on the frame that repeats by a clock of its own.

    Attributes:
        rhythm: its period, and the recordings' clocks.
        direction: x or y.
        forces: (KNOTS,) over a period, about their mean, which only moves the frame [N].
        share: of the variance of what shakes the frame in that direction.
        deviation: standard deviation of each, by how far the recordings agree [N]; infinite of a single one.
        interpolation: between them, linear or cubic.
    """

    rhythm: Rhythm
    direction: str
    forces: np.ndarray
    share: float
    deviation: float
    interpolation: str = "cubic"


def deviation_of(each: Sequence[np.ndarray]) -> float:
    """Standard deviation of the mean of the forces that recordings show, each (places,) about its mean."""
    if len(each) < 2:
        return np.inf
    apart = np.var(np.array(each), axis=0, ddof=1).mean()
    return float(np.sqrt(apart / len(each)))


def find_shaking(
    recordings: Sequence[Measured], turning: Sequence[tuple[float, float]], machine: SliderCrank
) -> Shaking | None:
    """The repeating force that explains most of what shakes a frame that is known to give way.

    ``None`` if none stands out from the noise of the sensors at A, or links have no sensors.

    Args:
        recordings: of one machine.
        turning: angle of the crank at the first sample [rad] and its speed [rad/s] in each.
        machine: with its frame.
    """
    if not (_told(recordings, machine) and isinstance(machine.frame, FlexibleFrame)):
        return None
    each = [_shaken_by(one, *turns, machine) for one, turns in zip(recordings, turning, strict=True)]
    noise = max(one.sigma[[one.channels.index(channel) for channel in AT_A]].max() for one in recordings)
    least = _SHOWN * machine.frame.mass * float(noise)
    found = [_repeating(recordings, [force.real for force in each], "x", least)]
    found += [_repeating(recordings, [force.imag for force in each], "y", least)]
    return max([one for one in found if one is not None], key=lambda one: one.share, default=None)


def _repeating(
    recordings: Sequence[Measured], forces: Sequence[np.ndarray], direction: str, least: float
) -> Shaking | None:
    """The repeating force of (samples,) ``filtered`` ones in each recording, if it reaches ``least`` [N]."""
    if min(len(force) for force in forces) < 3 * SAMPLES:
        return None
    if np.concatenate(forces).std() < least:  # no part of it is more than all
        return None
    rate = recordings[0].chain.rate
    count = [len(one.values.reshape(-1, len(one.channels))) for one in recordings]
    times = [np.arange(samples) / rate for samples in count]
    needed = []
    for time, force in zip(times, forces, strict=True):
        bins = len(force) // SAMPLES
        mean = [x[-bins * SAMPLES :].reshape(bins, SAMPLES).mean(axis=1) for x in (time, force)]
        needed.append(Needed(mean[0], np.ones(bins), mean[1], np.zeros((bins, 0))))
    scatter = scatter_of([one.torque for one in needed])
    rhythm = find_rhythm(needed, scatter)
    if rhythm is None:
        return None
    force = np.concatenate(forces)

    def over(period: float, clocks: Sequence[float], between: str = "linear") -> np.ndarray:
        rows = []
        for time, clock in zip(times, clocks, strict=True):
            own = shares((time + clock) / period * KNOTS, KNOTS, True, between)
            columns = filtered(own, 0, rate)
            rows.append(np.column_stack([columns, np.ones(len(columns))]))
        return np.concatenate(rows)  # the last column: of its weight on the spring a frame leaves a constant

    columns = over(rhythm.period, rhythm.clocks)
    left = force - columns @ regressed(columns, force, scatter)
    if left.var() > _HARDLY * force.var():  # no flank of a jump that is met later gives so much
        return None
    rhythm = _sharper(rhythm, over, force, scatter, max(float(time[-1]) for time in times), rate)
    either = list[tuple[float, str, np.ndarray, np.ndarray]]()
    for between in ("linear", "cubic"):  # where it jumps, or where it is smooth
        columns = over(rhythm.period, rhythm.clocks, between)
        found = regressed(columns, force, scatter)
        either.append((cost_of(force - columns @ found, scatter), between, columns, found))
    _, between, columns, found = min(either, key=lambda one: one[0])
    ends = np.cumsum([len(one) for one in forces])[:-1]
    own = [
        regressed(part, one, scatter)
        for part, one in zip(np.split(columns, ends), forces, strict=True)
        if len(one) >= rhythm.period * rate  # a whole period, or parts of the table are not seen
    ]
    given = columns @ found
    if given.std() < least:
        return None
    share = 1.0 - float((force - given).var() / force.var())
    deviation = deviation_of([one[:-1] - one[:-1].mean() for one in own])
    return Shaking(rhythm, direction, found[:-1] - found[:-1].mean(), share, deviation, between)


def _sharper(
    rhythm: Rhythm,
    over: Callable[[float, Sequence[float]], np.ndarray],
    force: np.ndarray,
    scatter: float,
    longest: float,
    rate: float,
) -> Rhythm:
    """The rhythm with which a table leaves least: where a force jumps, samples say more than harmonics."""
    step = SAMPLES / rate

    def at(x: np.ndarray) -> Rhythm:
        period = rhythm.period * (1.0 + x[0] * step / longest)
        later = zip(rhythm.clocks[1:], x[1:], strict=True)
        return Rhythm(float(period), (0.0, *(float(clock + step * one) for clock, one in later)))

    def left(x: np.ndarray) -> float:
        columns = over(at(x).period, at(x).clocks)
        return cost_of(force - columns @ regressed(columns, force, scatter), scatter)

    count = len(rhythm.clocks)
    found = minimize(
        left, np.zeros(count), method="Nelder-Mead",
        options={
            "maxfev": _TRIED * count, "xatol": 0.02, "fatol": 1e-5,
            "initial_simplex": np.vstack([np.zeros(count), np.eye(count)]),
        },
    )  # fmt: skip
    return at(found.x)


def _shaken_by(one: Measured, angle: float, speed: float, machine: SliderCrank) -> np.ndarray:
    """(samples,) force on a frame that is known to give way, as x + iy, ``filtered`` [N].

    Args:
        one: a recording, with the channels of ``NEEDED``.
        angle: of the crank at its first sample [rad].
        speed: of the crank [rad/s].
        machine: with its frame.
    """
    frame = machine.frame
    assert isinstance(frame, FlexibleFrame)
    omega = 2.0 * np.pi * frame.frequency
    acceleration, rate, place, asked = _balance(one, angle, speed, machine)
    damped = 2.0 * frame.damping_ratio * omega * rate
    force: np.ndarray = frame.mass * (acceleration + damped + omega**2 * place) - asked
    return force


def _told(recordings: Sequence[Measured], machine: SliderCrank) -> bool:
    """Whether all links have the sensors that are needed, those at A in A."""
    told = all(channel in one.channels for one in recordings for channel in NEEDED)
    return bool(told and machine.parameters()[Parameter.SENSOR_CRANK_A] == 0.0)


def _balance(
    one: Measured, angle: float, speed: float, machine: SliderCrank
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Each (samples,) as x + iy: the frame's acceleration, speed and place, and the force asked of it."""
    p = machine.parameters()
    values, rate = one.values.reshape(-1, len(one.channels)), one.chain.rate
    crank = angle + speed * np.arange(len(values)) / rate
    rod = tilt(p, crank)

    def weighed(link: Link, near: np.ndarray, far: np.ndarray, at: np.ndarray) -> np.ndarray:
        """(samples,) mass times the acceleration of its centre, from that of two places on it."""
        share = (link.center_of_mass * link.length - at[0]) / (at[1] - at[0])
        return link.mass * (near + share * (far - near))

    frame = felt(one, "crank_a", crank)
    lifted = values[:, one.channels.index(LIFTED)] if LIFTED in one.channels else frame.imag
    sliding = values[:, one.channels.index("slider_horizontal")] + 1j * lifted
    asked = -(
        weighed(machine.crank, frame, felt(one, "crank_b", crank), p[Parameter.SENSOR_CRANK_A :])
        + weighed(machine.rod, felt(one, "rod_b", rod), felt(one, "rod_c", rod), p[Parameter.SENSOR_ROD_B :])
        + machine.slider.mass * sliding
    )
    return (
        filtered(frame, 0, rate),
        filtered(frame, 1, rate),
        filtered(frame, 2, rate),
        filtered(asked, 0, rate),
    )


def felt(one: Measured, place: str, angle: np.ndarray) -> np.ndarray:
    """(samples,) acceleration of a place on a link that is turned by ``angle`` [rad], x + iy [m/s^2]."""
    values = one.values.reshape(-1, len(one.channels))
    axial, across = (values[:, one.channels.index(f"{place}_{way}")] for way in ("axial", "transverse"))
    turned: np.ndarray = (axial + 1j * across) * np.exp(1j * angle)
    return turned


def filtered(signal: np.ndarray, integrals: int, rate: float) -> np.ndarray:
    """(samples, ...) of a signal and some integrals, high-pass filtered, once its begin is forgotten."""
    return lfilter(*_high_pass(integrals, rate), signal, axis=0)[round(_SETTLED / _CORNER * rate) :]


@cache
def _high_pass(integrals: int, rate: float) -> tuple[np.ndarray, np.ndarray]:
    below = np.polymul([1.0, _CORNER], [1.0, _CORNER])
    above, below = bilinear([1.0, *[0.0] * (2 - integrals)], below, rate)
    return above, below
