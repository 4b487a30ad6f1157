"""A recording of angles, speeds, positions and torques at an encoder's rate, and the filter it passed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from clearance.diagnosis.sensing.encoder import encoder_counts
from clearance.errors import InputError
from clearance.recording.chain import MeasurementChain, declared_chain
from clearance.recording.channels import OTHER_CHANNELS
from clearance.recording.recording import Recording

FASTEST = 1000.0  # Hz: of a faster recording every n-th sample is looked at
FINE = 500.0  # Hz at least, at which motion is simulated before it is filtered, delayed and sampled
_SHORTEST = 60  # samples
LATEST = 0.05  # s, of a channel's delay: so much at both ends it does not know
_TAIL = 20  # samples at both ends over which the filter sees what was not recorded
_STILL = 2e-5  # of a channel's deviation: smaller noise is below the solver's own error
_TURNED = 1e-5  # rad, likewise of the crank's angle


@dataclass(frozen=True)
class LowPass:
    """A zero-phase Chebyshev filter of type I as a gain over frequency, 1 at zero frequency.

    Reference: Oppenheim & Schafer 2010, Discrete-Time Signal Processing, 3rd ed., app. B.3.

    Attributes:
        cutoff: [Hz].
        order: of one direction, even.
        ripple_db: of one direction [dB].
    """

    cutoff: float
    order: int
    ripple_db: float

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """Gain at each frequency [Hz], of both directions together."""
        ripple = 10.0 ** (self.ripple_db / 10.0) - 1.0
        ratio = np.minimum(np.abs(frequency) / self.cutoff, 1e6)
        inside = np.cos(self.order * np.arccos(np.minimum(ratio, 1.0)))
        outside = np.cosh(np.minimum(self.order * np.arccosh(np.maximum(ratio, 1.0)), 300.0))
        polynomial = np.where(ratio <= 1.0, inside, outside)
        return (1.0 + ripple) / (1.0 + ripple * polynomial**2)


@dataclass(frozen=True)
class Track:
    """What was recorded of a machine's motion.

    Attributes:
        name: of the recording.
        values: (samples, channels).
        channels: out of ``OTHER_CHANNELS``.
        rate: [Hz].
        low_pass: what filtered it, but the crank's angle; ``None``: sampled as it was.
        declared: whether the recording says so itself.
        silent: channels that were left out because they are constant.
    """

    name: str
    values: np.ndarray
    channels: tuple[str, ...]
    rate: float
    low_pass: LowPass | None = None
    declared: bool = False
    silent: tuple[str, ...] = ()

    @staticmethod
    def of(recording: Recording, name: str) -> "Track":
        """The channels of motion of a recording, at ``FASTEST`` or a little less.

        Raises:
            InputError: too few samples, or channels that never change.
        """
        known = [c for c in OTHER_CHANNELS if c in recording.channels]
        every = max(1, int(np.ceil(recording.rate / FASTEST - 1e-9)))
        values = np.stack([recording.channel(c) for c in known], axis=1)[::every]
        if len(values) < _SHORTEST:
            raise InputError(f"{name}: {len(values)} samples are too few; give at least {_SHORTEST}")
        alive = [i for i in range(len(known)) if np.ptp(values[:, i]) > 0.0]
        if not alive:
            raise InputError(f"{name}: every channel is constant; check the sensors or the columns' names")
        channels = tuple(known[i] for i in alive)
        chain = recording.metadata.get("chain")
        track = Track(
            name, values[:, alive], channels, recording.rate / every, declared=bool(chain),
            silent=tuple(c for i, c in enumerate(known) if i not in alive),
        )  # fmt: skip
        return replace(track, low_pass=_declared(chain, recording.rate)) if chain else track

    @property
    def usual_low_pass(self) -> LowPass:
        """The measurement chain's filter for this rate."""
        usual = MeasurementChain()
        return LowPass(usual.cutoff * self.rate / 2.0, usual.filter_order, usual.ripple_db)

    def filtered(self, usually: bool) -> "Track":
        """The same as filtered by the usual chain, or as not filtered, unless its file says."""
        return self if self.declared else replace(self, low_pass=self.usual_low_pass if usually else None)

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return len(self.values) / self.rate

    @property
    def oversampling(self) -> int:
        """Simulated samples to one that was recorded."""
        return max(1, int(np.ceil(FINE / self.rate - 1e-9)))

    @property
    def judged(self) -> slice:
        """Samples that are compared: not those at the ends, before which nobody knows what happened."""
        count = len(self.values)
        edge = int(np.ceil(LATEST * self.rate - 1e-9))
        if self.low_pass is not None:
            edge = max(edge, _TAIL)
        edge = min(edge, count // 10)
        return slice(edge, count - edge)

    @property
    def smallest(self) -> np.ndarray:
        """(channels,) noise below which no channel is trusted: that of the solver, and of counting.

        The rounding of a steady turn repeats itself: its root mean square is anything up to half a count.
        """
        spread = self.values.std(axis=0)
        return np.array(
            [
                max(_TURNED, np.pi / (encoder_counts(self.values[:, i]) or np.inf))
                if c == "crank_angle"
                else _STILL * spread[i]
                for i, c in enumerate(self.channels)
            ]
        )

    def only(self, channel: str) -> "Track":
        """One channel alone."""
        place = self.channels.index(channel)
        return replace(self, values=self.values[:, place : place + 1], channels=(channel,))

    def cut(self, size: int) -> list["Track"]:
        """Stretches one after the other, of about as many samples."""
        ends = np.linspace(0, len(self.values), max(1, len(self.values) // size) + 1).astype(int)
        return [self.part(int(first), int(last)) for first, last in pairwise(ends)]

    def turned(self, zero: float) -> "Track":
        """The crank's angle alone, from another zero [rad]."""
        return replace(self, values=self.values - zero)

    def part(self, first: int, last: int) -> "Track":
        """Samples ``first`` to ``last`` alone."""
        return replace(self, values=self.values[first:last])


def _declared(chain: Mapping[str, Any], rate: float) -> LowPass | None:
    """The filter that a recording of this rate [Hz] declares, where it is silent the usual one."""
    said = declared_chain(chain)
    base, usual = chain.get("base_rate"), said["decimation"]
    if chain.get("decimation", usual if base is None else round(base / rate)) <= 1:
        return None
    return LowPass(float(said["cutoff"]) * rate / 2.0, int(said["filter_order"]), float(said["ripple_db"]))


def respond(
    signals: np.ndarray, rate: float, low_pass: LowPass | None, delay: np.ndarray, filtered: np.ndarray
) -> np.ndarray:
    """Signals that come late, behind a filter.

    What lies beyond the ends is continued as the point reflection of what lies before them, which has no jump
    and no kink for the filter to ring on.

    Args:
        signals: (samples, lanes, channels).
        rate: [Hz].
        low_pass: the filter.
        delay: (lanes, channels) [s].
        filtered: (channels,) which pass the filter.
    """
    active = delay.any(axis=0) | (filtered & (low_pass is not None))
    if not active.any():
        return signals
    chosen, late = signals[..., active], delay[:, active]
    count = len(chosen)
    first, slope = chosen[0], (chosen[-1] - chosen[0]) / (count - 1)
    line = first + slope * np.arange(count)[:, None, None]
    rest = chosen - line
    periodic = np.concatenate([rest[:-1], -rest[:0:-1]])
    frequency = np.fft.rfftfreq(len(periodic), 1.0 / rate)[:, None, None]
    response = np.exp(-2j * np.pi * frequency * late)
    if low_pass is not None:
        response = np.where(filtered[active], response * low_pass.gain(frequency), response)
    moved = np.fft.irfft(np.fft.rfft(periodic, axis=0) * response, len(periodic), axis=0)[:count]
    result = signals.copy()
    result[..., active] = moved + line - slope * (late * rate)
    return result
