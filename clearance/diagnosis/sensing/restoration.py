"""What faultless instruments would have recorded: each of an instrument's faults undone, last one first.

The counterpart of ``sensing.instrument``. A converter clips what the measurement chain has already filtered
and the electronics' noise has entered, so a clipped run ends sharply: no filter rings around it. But undoing
a delay or a resonance looks at the neighbours of a sample and carries what was clipped, or lies beyond the
ends, a few samples further.

References: as ``sensing.instrument``; an inverse of bounded gain: Bertero & Boccacci 1998,
Introduction to Inverse Problems in Imaging, ch. 5.
"""

from collections.abc import Iterator, Sequence
from math import ceil

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clearance.errors import InputError
from clearance.recording.channels import AXIS_PAIRS

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

STILL = ("crank_a_axial", "crank_a_transverse", "slider_vertical")
"""Channels that are zero in a nominal mechanism: A and the guide stand still."""

_NEAR_LIMIT = 0.99  # of the limit: a limit that was fitted, or a converter that rounds, is not met exactly
_REACH = 16  # samples that an unknown one spoils on each side by more than about 1 % of its error
_CONTINUED = 64  # samples by which a signal is continued at both ends, fading to a common level
_AMPLIFICATION = 30.0  # largest gain of an undone resonance: what exceeds the noise by 30 dB is restored
_BANDS = 512  # of the frequencies over which noise is added up
_TURNED = 0.1  # smallest cosine by which a turned axis is divided


def unclipped(signals: FloatArray, limit: ArrayLike) -> BoolArray:
    """Where saturation at plus and minus a limit has certainly left the signals alone, same shape."""
    known: BoolArray = np.abs(signals) < _NEAR_LIMIT * np.asarray(limit, dtype=float)
    return known


def undo_response(
    signals: FloatArray,
    known: BoolArray,
    rate: float,
    delay: ArrayLike,
    resonance: ArrayLike,
    damping_ratio: ArrayLike,
) -> tuple[FloatArray, BoolArray]:
    """Signals without their delay and the resonance that they went through, and which of them are known.

    The inverse of the second-order response grows with the square of the frequency; noise is amplified by no
    more than 30, so that above the frequency where this is reached (5.5 times the resonance) the result is
    low-passed. Only then is it not what was there before.

    Args:
        signals: (samples, channels), at least two samples.
        known: (samples, channels), which samples may be trusted.
        rate: [Hz].
        delay: [s], of either sign; one number or one a channel, as the next two.
        resonance: natural frequency [Hz]; infinite: none.
        damping_ratio: of the resonance [-].
    """
    samples, count = signals.shape
    late, natural, damping = (
        np.broadcast_to(np.asarray(value, dtype=float), count) for value in (delay, resonance, damping_ratio)
    )
    active = np.flatnonzero((late != 0.0) | np.isfinite(natural))
    if active.size == 0:
        return signals, known
    continued = _continued(signals[:, active])
    frequency = np.fft.rfftfreq(len(continued), 1.0 / rate)[:, None]
    inverse = _inverse_resonance(frequency / natural[active], damping[active])
    inverse *= np.exp(2j * np.pi * frequency * late[active])
    restored, trusted = signals.copy(), known.copy()
    restored[:, active] = np.fft.irfft(np.fft.rfft(continued, axis=0) * inverse, len(continued), axis=0)[
        _CONTINUED : _CONTINUED + samples
    ]
    for column in map(int, active):
        trusted[:, column] = _shrunk(known[:, column], late[column] * rate)
    return restored, trusted


def noise_gain(rate: float, resonance: ArrayLike, damping_ratio: ArrayLike) -> FloatArray:
    """(channels,) by which undoing responses makes white noise louder; a delay leaves it as loud as it was.

    Args:
        rate: [Hz].
        resonance: (channels,) natural frequencies [Hz]; infinite: none.
        damping_ratio: (channels,) of the resonances [-].
    """
    frequency = (np.arange(_BANDS) + 0.5)[:, None] * (0.5 * rate / _BANDS)
    inverse = _inverse_resonance(frequency / np.asarray(resonance), np.asarray(damping_ratio))
    gain: FloatArray = np.sqrt((np.abs(inverse) ** 2).mean(axis=0))
    return gain


def _inverse_resonance(ratio: FloatArray, damping_ratio: FloatArray) -> NDArray[np.complex128]:
    """Of a second-order response at these ratios of frequency to its natural one, of bounded size."""
    inverse = np.asarray(1.0 - ratio**2 + 2j * damping_ratio * ratio, dtype=np.complex128)
    inverse /= np.maximum(1.0, np.abs(inverse) / _AMPLIFICATION)
    return inverse


def _continued(signals: FloatArray) -> FloatArray:
    """Signals with both ends continued by their image in the last point, smooth in value and slope.

    The images fade to the mean of the signal's two ends, so that they also meet each other smoothly.
    """
    padded = np.pad(signals, ((_CONTINUED, _CONTINUED), (0, 0)), mode="reflect", reflect_type="odd")
    fade = np.ones((len(padded), 1))
    fade[:_CONTINUED, 0] = 0.5 - 0.5 * np.cos(np.pi * np.arange(_CONTINUED) / _CONTINUED)
    fade[-_CONTINUED:] = fade[_CONTINUED - 1 :: -1]
    return fade * padded + (1.0 - fade) * 0.5 * (signals[0] + signals[-1])


def _shrunk(known: BoolArray, shift: float) -> BoolArray:
    """Which samples are known once each is made of those around the one ``shift`` later, (samples,)."""
    first, last = int(np.floor(shift)) - _REACH, ceil(shift) + _REACH
    margin = max(abs(first), abs(last))
    unknown = np.pad(~known, margin, constant_values=True)
    total = np.concatenate([[0], np.cumsum(unknown)])
    place = np.arange(len(known)) + margin
    fine: BoolArray = total[place + last + 1] == total[place + first]
    return fine


def turn_back(signals: FloatArray, channels: Sequence[str], degrees: ArrayLike) -> FloatArray:
    """Signals along the nominal axes, from accelerometers that were turned.

    Both axes of a point are solved for together. An axis that was not recorded is taken as zero where a
    nominal mechanism has it so (``STILL``).

    Args:
        signals: (samples, channels).
        channels: names of the columns.
        degrees: angle of each channel's axis, counter-clockwise [deg].

    Raises:
        InputError: a turned channel lacks the other axis of its point, or the axes of a point became one.
    """
    along = signals.copy()
    for columns, back in _turned_pairs(channels, degrees):
        along[:, columns] = signals[:, columns] @ back.T
    return along


def known_along(known: BoolArray, channels: Sequence[str], degrees: ArrayLike) -> BoolArray:
    """Of (samples, channels) known of turned accelerometers, which are along the nominal axes: ``turn_back``.

    An unknown sample spoils every axis that it enters.
    """
    trusted = known.copy()
    for columns, back in _turned_pairs(channels, degrees):
        trusted[:, columns] = ~((~known[:, columns]).astype(int) @ (back.T != 0.0)).astype(bool)
    return trusted


def noise_along(sigma: FloatArray, channels: Sequence[str], degrees: ArrayLike) -> FloatArray:
    """(channels,) noise along the nominal axes, from that of turned accelerometers: ``turn_back``."""
    squares = sigma**2
    for columns, back in _turned_pairs(channels, degrees):
        squares[columns] = back**2 @ squares[columns]
    along: FloatArray = np.sqrt(squares)
    return along


def _turned_pairs(channels: Sequence[str], degrees: ArrayLike) -> Iterator[tuple[list[int], FloatArray]]:
    """Columns of the axes of each point where one is turned, and the matrix that turns them back."""
    names = list(channels)
    angles = np.radians(np.broadcast_to(np.asarray(degrees, dtype=float), len(names)))
    turned = {name: angle for name, angle in zip(names, angles, strict=True) if angle != 0.0}
    for first, second in AXIS_PAIRS:
        present = [name for name in (first, second) if name in names]
        if not any(name in turned for name in present):
            continue
        missing = [name for name in (first, second) if name not in names]
        if any(name not in STILL for name in missing):
            raise InputError(
                f"sensor_misalignment: {present[0]} turned by {np.degrees(turned[present[0]]):g} deg mixes "
                f"in {missing[0]}, which was not recorded; record {missing[0]} too, or set the angle to 0"
            )
        one, other = turned.get(first, 0.0), turned.get(second, 0.0)
        # what was seen = mixing @ what was there; of a pair of which one is missing, the other alone
        mixing = np.array([[np.cos(one), np.sin(one)], [-np.sin(other), np.cos(other)]])
        rows = [(first, second).index(name) for name in present]
        mixing = mixing[np.ix_(rows, rows)]
        if abs(np.linalg.det(mixing)) < _TURNED:
            raise InputError(
                f"sensor_misalignment: {' and '.join(present)} turned by "
                f"{' and '.join(f'{np.degrees(turned.get(name, 0.0)):g}' for name in present)} deg cannot be "
                "turned back; give angles within -45 and 45 deg"
            )
        yield [names.index(name) for name in present], np.linalg.inv(mixing)
