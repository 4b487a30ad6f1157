"""A force that repeats and pushes a frame which is known to give way, where no sensor is at A.

What the frame's own motion leaves of the tie at the crank's end (``swaying``) is linear in the Fourier series
of a force on the frame, whose springs answer each harmonic. All periods are tried, each recording with a
series of its own, since nobody knows when it began; then the recordings' clocks are set by one another.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.kinematics.shaking import KNOTS, Shaking, deviation_of
from clearance.diagnosis.kinematics.swaying import LOOKED_AT, loosely, smoothed, sways, told
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.slider_crank import SliderCrank

_FASTEST, _LONGEST = 60.0, 0.5  # Hz, and of the longest recording: what comes once is no rhythm
_COARSE, _FINE = 6, 12  # harmonics that find the frequency, and that tell it from others
_APART, _CLOSER, _NEAR = (
    0.04,
    0.01,
    6,
)  # steps of frequency, over one turn in the longest recording; to each side
_SLOWER, _BETTER = (2, 3), 0.7  # the period may be so many times the one found, where it leaves that share
_TURNS = 240  # places in a period at which series are compared


@dataclass(frozen=True)
class _Left:
    """What the frame's own motion leaves of the tie in a recording, in means over a segment.

    Attributes:
        time: (segments,) [s].
        turned: (segments,) crank angle [rad].
        speed: of the crank [rad/s].
        along: (2,) masses that move along with the frame, in x and in y [kg].
        unknown: (segments, 6) orthonormal: how the frame was let go, gravity.
        rest: (segments,) [m/s^3].
    """

    time: np.ndarray
    turned: np.ndarray
    speed: float
    along: np.ndarray
    unknown: np.ndarray
    rest: np.ndarray

    @staticmethod
    def of(one: Measured, angle: float, speed: float, p: np.ndarray) -> "_Left":
        """From a recording and the machine's parameters."""
        swaying, unknown, rest = loosely(one, angle, speed, p)
        count = len(rest) // SAMPLES
        time = np.arange(len(swaying.turned))[-len(rest) :] / swaying.rate

        def mean(values: np.ndarray) -> np.ndarray:
            averaged: np.ndarray = values[: count * SAMPLES].reshape(count, SAMPLES, -1).mean(axis=1)
            return averaged

        middle = mean(time)[:, 0]
        known, _ = np.linalg.qr(mean(unknown))
        left = mean(rest)[:, 0]
        left -= known @ (known.T @ left)
        return _Left(middle, angle + speed * middle, speed, swaying.along, known, left)

    def series(
        self, frame: FlexibleFrame, frequency: float, harmonics: int, way: int
    ) -> tuple[np.ndarray, float]:
        """(harmonics,) complex amplitudes [N] of a force in x (0) or y (1), and the squares that it leaves.

        Of A moving by Re(g exp(i v t)) in x, with the crank at angle o t, the tie is the real part of
        i g / 2 [(v + 3 o) exp(i (v + o) t) + (v - 3 o) exp(i (v - o) t)].
        """
        mean = float(self.time[1] - self.time[0])  # of what is seen: beyond half its rate nothing is
        resolved = int((np.pi / mean - abs(self.speed)) / (2.0 * np.pi * frequency))
        v = 2.0 * np.pi * frequency * np.arange(1, min(harmonics, max(resolved, 1)) + 1)
        omega, mass = 2.0 * np.pi * frame.frequency, frame.mass
        springs = mass * omega * (2j * frame.damping_ratio * v + omega)
        answer = -(v**2) / (springs - (mass + self.along[way]) * v**2)
        wave, turn = np.exp(1j * np.outer(self.time, v)), np.exp(1j * self.turned)[:, None]

        def seen(w: np.ndarray) -> np.ndarray:
            answered: np.ndarray = smoothed(w) * np.sinc(w * mean / (2.0 * np.pi))
            return answered

        faster = (v + 3.0 * self.speed) * seen(v + self.speed) * wave * turn
        slower = (v - 3.0 * self.speed) * seen(v - self.speed) * wave / turn
        tie = 0.5 * answer * (1j * (faster + slower) if way == 0 else faster - slower)
        columns = np.hstack([tie.real, -tie.imag])
        columns -= self.unknown @ (self.unknown.T @ columns)
        parts = np.linalg.lstsq(columns, self.rest, rcond=None)[0]
        cost = float(np.sum((self.rest - columns @ parts) ** 2))
        count = len(v)
        return np.pad(parts[:count] + 1j * parts[count:], (0, harmonics - count)), cost


def find_pushing(
    recordings: Sequence[Measured], turning: Sequence[tuple[float, float]], machine: SliderCrank
) -> Shaking | None:
    """The repeating force that explains most of what pushes a known frame; ``None`` if nothing shows.

    Args:
        recordings: of one machine.
        turning: angle of the crank at the first sample [rad] and its speed [rad/s] in each.
        machine: with its frame.
    """
    frame, p = machine.frame, machine.parameters()
    if not isinstance(frame, FlexibleFrame) or not all(map(told, recordings)):
        return None
    pairs = [(one.part(0, LOOKED_AT), turns) for one, turns in zip(recordings, turning, strict=True)]
    if not all(sways(one, *turns, p, loose=True) for one, turns in pairs):
        return None
    each = [_Left.of(one, *turns, p) for one, turns in pairs]
    whole = sum(float(np.sum(one.rest**2)) for one in each)
    longest = max(float(one.time[-1]) for one in each)

    def left(frequency: float, harmonics: int, way: int) -> float:
        """Share that a force of this frequency leaves."""
        return sum(one.series(frame, frequency, harmonics, way)[1] for one in each) / whole

    found: list[tuple[float, float, int]] = []
    coarse = np.arange(1.0 / (_LONGEST * longest), _FASTEST, _APART / longest)
    near = _CLOSER / longest * np.arange(-_NEAR, _NEAR + 1)
    for way in range(2):
        first = float(coarse[np.argmin([left(f, _COARSE, way) for f in coarse])])
        best = min((left(f, _FINE, way), f) for f in first + near)
        for times in _SLOWER:  # a frame answers some harmonics more than the first
            slower = [f for f in (first + near) / times if f > coarse[0]]
            other = min(((left(f, _FINE, way), f) for f in slower), default=(np.inf, 0.0))
            best = other if other[0] < _BETTER * best[0] else best
        found.append((*best, way))
    share, frequency, way = min(found)
    frequency = float(frequency)  # of what a file will hold
    series = [one.series(frame, frequency, _FINE, way)[0] for one in each]
    places = np.arange(_TURNS) / _TURNS
    first_wave = _wave(series[0], places)
    clocks = [float(places[np.argmax(_agreement(first_wave, _wave(one, places)))]) for one in series]
    waves = [_wave(one, places - clock) for one, clock in zip(series, clocks, strict=True)]
    forces = np.mean(waves, axis=0)[:: _TURNS // KNOTS]
    rhythm = Rhythm(1.0 / frequency, tuple(clock / frequency for clock in clocks))
    return Shaking(rhythm, "xy"[way], forces - forces.mean(), 1.0 - share, deviation_of(waves))


def _wave(series: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(places,) of a Fourier series without its mean; places in turns."""
    order = np.arange(1, len(series) + 1)
    wave: np.ndarray = (series * np.exp(2j * np.pi * np.outer(places, order))).real.sum(axis=1)
    return wave


def _agreement(first: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(places,) how well ``other`` agrees with ``first`` from a place on."""
    return np.fft.ifft(np.fft.fft(first) * np.conj(np.fft.fft(other))).real
