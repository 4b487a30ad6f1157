"""What an instrument's faults make of predicted signals: pure functions, each off by default.

The order is that of the signal's way through an instrument, as in ``clearance.recording.sensors``, which
makes such faults; here they are fitted, so that everything is smooth in its parameters (but for clipping) and
a fault may be put on a few channels of many. Signals are (samples, channels); a parameter is one number or
one a channel.

References: second-order instrument: Doebelin 2004, Measurement Systems, 5th ed., ch. 3.3. Band-limited shift
and change of rate: Oppenheim & Schafer 2010, Discrete-Time Signal Processing, 3rd ed., sec. 4.5 and 4.6.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clearance.diagnosis.sensing.restoration import (
    STILL,
    BoolArray,
    known_along,
    noise_along,
    noise_gain,
    turn_back,
    unclipped,
    undo_response,
)
from clearance.errors import InputError
from clearance.recording.channels import ACCELERATIONS, AXIS_PAIRS, require_channel

FloatArray = NDArray[np.float64]

OTHER_AXIS = {first: (second, 1.0) for first, second in AXIS_PAIRS}
OTHER_AXIS |= {second: (first, -1.0) for first, second in AXIS_PAIRS}
_SINC_HALF = 16  # samples on each side of an interpolated one
_KAISER = 8.0  # shape of the window over them: 80 dB, up to 0.85 of the Nyquist frequency


def misalign(signals: FloatArray, channels: Sequence[str], degrees: ArrayLike) -> FloatArray:
    """Signals of accelerometers whose axes are turned counter-clockwise by an angle [deg].

    Raises:
        InputError: a turned channel lacks the other axis of its point.
    """
    angles = np.radians(np.broadcast_to(np.asarray(degrees, dtype=float), len(channels)))
    if not angles.any():
        return signals
    across = np.zeros_like(signals)
    for column in map(int, np.flatnonzero(angles)):
        name = channels[column]
        other, sign = OTHER_AXIS.get(name, ("", 0.0))
        if other in channels:
            across[:, column] = sign * signals[:, channels.index(other)]
        elif other not in STILL:
            raise InputError(
                f"sensor_misalignment: {name} turned by {np.degrees(angles[column]):g} deg mixes in "
                f"{other or 'another axis, which it does not have'}; predict that channel too"
            )
    return np.cos(angles) * signals + np.sin(angles) * across


def amplify(signals: FloatArray, gain: ArrayLike) -> FloatArray:
    """Signals times a gain [-]."""
    return signals * np.asarray(gain, dtype=float)


def offset(signals: FloatArray, bias: ArrayLike) -> FloatArray:
    """Signals plus a bias [unit of the channel]."""
    return signals + np.asarray(bias, dtype=float)


def saturate(signals: FloatArray, limit: ArrayLike) -> FloatArray:
    """Signals kept within plus and minus a limit [unit of the channel]."""
    bound = np.asarray(limit, dtype=float)
    return np.clip(signals, -bound, bound)


def respond(
    signals: FloatArray,
    rate: float,
    delay: ArrayLike = 0.0,
    resonance: ArrayLike = inf,
    damping_ratio: ArrayLike = 0.05,
) -> FloatArray:
    """Signals that come late, behind a resonance of second order.

    The signal is continued by its mirror image, which has no jump for a band-limited shift to ring on; a few
    periods of the resonance at both ends are not to be trusted.

    Args:
        signals: (samples, channels), at least two samples.
        rate: [Hz].
        delay: [s], of either sign.
        resonance: natural frequency [Hz]; infinite: none.
        damping_ratio: of the resonance [-].
    """
    count = signals.shape[1]
    late = np.broadcast_to(np.asarray(delay, dtype=float), count)
    natural = np.broadcast_to(np.asarray(resonance, dtype=float), count)
    active = np.flatnonzero((late != 0.0) | np.isfinite(natural))
    if active.size == 0:
        return signals
    mirrored = np.concatenate([signals[:, active], signals[::-1, active]])
    frequency = np.fft.rfftfreq(len(mirrored), 1.0 / rate)[:, None]
    ratio = frequency / natural[active]
    damping = np.broadcast_to(np.asarray(damping_ratio, dtype=float), count)[active]
    response = np.exp(-2j * np.pi * frequency * late[active]) / (1.0 - ratio**2 + 2j * damping * ratio)
    result = signals.copy()
    result[:, active] = np.fft.irfft(np.fft.rfft(mirrored, axis=0) * response, len(mirrored), axis=0)[
        : len(signals)
    ]
    return result


def stretch(signals: FloatArray, rate_error: float, start: float = 0.0) -> FloatArray:
    """Signals as a clock shows them that runs slow: a sample lasts ``1 + rate_error`` times what it says.

    Sample ``k`` is what was true at sample ``(1 + rate_error) k`` counted from ``start``; beyond the ends the
    signal is continued by its mirror image. A prediction that is made in short pieces is better made at the
    true rate, ``rate / (1 + rate_error)``, from the outset.

    Args:
        signals: (samples, channels).
        rate_error: [-], well below one.
        start: sample at which both clocks agree.
    """
    if rate_error == 0.0:
        return signals
    samples = len(signals)
    place = start + (1.0 + rate_error) * (np.arange(samples) - start)
    nearest = np.floor(place).astype(int)
    steps = np.arange(1 - _SINC_HALF, _SINC_HALF + 1)
    distance = (place - nearest)[:, None] - steps
    shape = np.sqrt(np.maximum(1.0 - (distance / _SINC_HALF) ** 2, 0.0))
    weights = np.sinc(distance) * np.i0(_KAISER * shape) / np.i0(_KAISER)
    weights /= weights.sum(axis=1, keepdims=True)  # a constant stays what it is
    rows = (nearest[:, None] + steps) % (2 * samples)
    rows = np.where(rows < samples, rows, 2 * samples - 1 - rows)
    return np.einsum("kj,kjc->kc", weights, signals[rows])


@dataclass(frozen=True)
class Instrument:
    """The faults of a recording's instruments; without arguments, none.

    Attributes:
        misalignment: channel to the angle between its axis and the nominal one, counter-clockwise [deg].
        resonance: channel to natural frequency [Hz].
        resonance_damping: channel to damping ratio of its resonance [-]; 0.05 where not named.
        delay: channel to the time by which it is late [s].
        gain: channel to gain [-].
        bias: channel to offset [unit of the channel].
        saturation: channel to limit [unit of the channel].
        timebase: how much longer a sample lasts than it says, as a fraction [-].
    """

    misalignment: Mapping[str, float] = field(default_factory=dict)
    resonance: Mapping[str, float] = field(default_factory=dict)
    resonance_damping: Mapping[str, float] = field(default_factory=dict)
    delay: Mapping[str, float] = field(default_factory=dict)
    gain: Mapping[str, float] = field(default_factory=dict)
    bias: Mapping[str, float] = field(default_factory=dict)
    saturation: Mapping[str, float] = field(default_factory=dict)
    timebase: float = 0.0

    def changed(self, fault: str, value: float, channel: str | None = None) -> "Instrument":
        """The same instruments with one fault set.

        Args:
            fault: an attribute's name.
            value: in the attribute's unit.
            channel: whose; ``None`` for the timebase, which all share.
        """
        if fault not in FAULTS:
            raise InputError(f"instrument fault {fault!r} is not one of {', '.join(FAULTS)}")
        if fault == "timebase":
            return replace(self, timebase=float(value))
        name = require_channel(channel, f"instrument fault {fault}")
        settings: dict[str, Any] = {fault: {**getattr(self, fault), name: float(value)}}
        return replace(self, **settings)

    def beside(self, other: "Instrument") -> "Instrument":
        """Both together: small ones add up, gains multiply; what only the other has is the other's."""
        angle, late = _both(self.misalignment, other.misalignment), _both(self.delay, other.delay)
        gain = {**self.gain, **{c: g * self.gain.get(c, 1.0) for c, g in other.gain.items()}}
        bias = _both(self.bias, other.bias)
        return replace(other, misalignment=angle, delay=late, gain=gain, bias=bias)

    def differing(self, other: "Instrument") -> set[str] | None:
        """Channels that the other treats differently; ``None``: all, whose clock is another."""
        if self.timebase != other.timebase:
            return None
        found = set[str]()
        for name in FAULTS:
            if name != "timebase":
                one, two = getattr(self, name), getattr(other, name)
                found |= {c for c in {*one, *two} if c not in one or c not in two or one[c] != two[c]}
        return found

    def apply(self, signals: FloatArray, channels: Sequence[str], rate: float) -> FloatArray:
        """What the instruments make of predicted signals.

        Args:
            signals: (samples, channels).
            channels: names of the columns; a turned accelerometer needs both axes of its point.
            rate: [Hz].
        """
        columns = list(channels)
        seen = stretch(signals, self.timebase)
        seen = misalign(seen, columns, _each(columns, self.misalignment, 0.0))
        seen = respond(
            seen,
            rate,
            _each(columns, self.delay, 0.0),
            _each(columns, self.resonance, inf),
            _each(columns, self.resonance_damping, 0.05),
        )
        seen = offset(amplify(seen, _each(columns, self.gain, 1.0)), _each(columns, self.bias, 0.0))
        return saturate(seen, _each(columns, self.saturation, inf))

    def correct(
        self, signals: FloatArray, channels: Sequence[str], rate: float
    ) -> tuple[FloatArray, BoolArray]:
        """What faultless instruments would have recorded, from what these have: ``apply`` backwards.

        The timebase is not undone: samples keep their number, and what uses them counts time at the true
        rate. Noise is changed as the signal is: divided by the gain, and amplified above a resonance, see
        ``clearance.diagnosis.sensing.restoration``.

        Args:
            signals: (samples, channels) recorded, at least two samples.
            channels: names of the columns; a turned accelerometer needs both axes of its point, or one of
                which the other stands still in a nominal mechanism.
            rate: [Hz].

        Returns:
            (samples, channels) corrected, and (samples, channels) whether a value can be known: not where it
            was clipped, nor within a few samples of it or of an end where neighbours are needed.

        Raises:
            InputError: a gain of zero; a turned channel lacks its other axis.
        """
        felt, known = self.felt(signals, channels, rate)
        trusted = known_along(known, channels, _each(channels, self.misalignment, 0.0))
        return self.turned_back(felt, channels), trusted

    def felt(self, signals: FloatArray, channels: Sequence[str], rate: float) -> tuple[FloatArray, BoolArray]:
        """What the housings felt along their own axes: ``correct``, but for the angles, likewise."""
        columns = list(channels)
        gain = _each(columns, self.gain, 1.0)
        if not gain.all():
            raise InputError(
                f"sensor_gain: {columns[int(np.argmin(np.abs(gain)))]} has gain 0, which leaves nothing to "
                "correct; give a gain other than 0"
            )
        known = unclipped(signals, _each(columns, self.saturation, inf))
        return undo_response(
            (signals - _each(columns, self.bias, 0.0)) / gain,
            known,
            rate,
            _each(columns, self.delay, 0.0),
            _each(columns, self.resonance, inf),
            _each(columns, self.resonance_damping, 0.05),
        )

    def turned_back(self, felt: FloatArray, channels: Sequence[str]) -> FloatArray:
        """What was felt along the housings' axes, along the nominal ones."""
        return turn_back(felt, channels, _each(channels, self.misalignment, 0.0))

    def noise(self, sigma: FloatArray, channels: Sequence[str], rate: float) -> FloatArray:
        """(channels,) standard deviations that white noise of the recorded signals has in corrected ones.

        Args:
            sigma: (channels,) of the recorded signals.
            channels: their names.
            rate: [Hz].
        """
        damping = _each(channels, self.resonance_damping, 0.05)
        response = noise_gain(rate, _each(channels, self.resonance, inf), damping)
        louder = response / np.abs(_each(channels, self.gain, 1.0))
        return noise_along(sigma * louder, channels, _each(channels, self.misalignment, 0.0))

    def felt_instead(
        self, other: "Instrument", felt: FloatArray, recorded: FloatArray, channel: str, rate: float
    ) -> FloatArray:
        """(samples,) that the housing of a channel felt if the instrument is another one.

        Gain and offset have the same response before them, which is not undone a second time.

        Args:
            other: the instrument instead.
            felt: (samples,) by this one.
            recorded: (samples,).
            channel: whose.
            rate: [Hz].
        """
        response, theirs = (
            [getattr(faults, name).get(channel) for name in _RESPONSE] for faults in (self, other)
        )
        if response == theirs and response != [None] * len(_RESPONSE):
            signal = felt * self.gain.get(channel, 1.0) + self.bias.get(channel, 0.0)
            instead: FloatArray = (signal - other.bias.get(channel, 0.0)) / other.gain.get(channel, 1.0)
            return instead
        return other.felt(recorded[:, None], [channel], rate)[0][:, 0]


def _both(one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    return {**one, **{channel: value + one.get(channel, 0.0) for channel, value in other.items()}}


def _each(channels: Sequence[str], fault: Mapping[str, float], neutral: float) -> FloatArray:
    """(channels,) of a fault that some of them have."""
    return np.array([fault.get(name, neutral) for name in channels])


_RESPONSE = ("delay", "resonance", "resonance_damping")
FAULTS = tuple(entry.name for entry in fields(Instrument))
FAULTY_CHANNELS = ACCELERATIONS
"""Channels that a fault of one sensor is looked for in."""


def sensitivity(
    instrument: Instrument,
    fault: str,
    value: float,
    step: float,
    signals: FloatArray,
    channels: Sequence[str],
    rate: float,
    channel: str | None = None,
) -> FloatArray:
    """Derivative of the seen signals by one fault, (samples, channels), by a central difference.

    Args:
        instrument: the other faults.
        fault: which, see ``Instrument``.
        value: where.
        step: half the distance of the two evaluations, in the fault's unit.
        signals: (samples, channels) predicted.
        channels: names of the columns.
        rate: [Hz].
        channel: whose fault.
    """
    above, below = (
        instrument.changed(fault, value + sign * step, channel).apply(signals, channels, rate)
        for sign in (1.0, -1.0)
    )
    return (above - below) / (2.0 * step)
