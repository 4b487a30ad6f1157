"""What a channel shows of its own noise, and of a limit at which its sensor stops."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from clearance.diagnosis.sensing.encoder import ENCODER_COUNTS, encoder_counts, rounding_noise
from clearance.simulation.layout import Signal

_BLOCK, _FRAMES = 64, 50_000  # samples that show the noise; how often it is looked for between limits
_REPEATED = 5  # times as often as values near it comes a limit
_OUTER, _NEXT = 0.9, 4  # share of it, and levels, that are near
_STUCK, _FEW = 0.02, 20  # s, and samples, for which no accelerometer that works shows one value
_ROUNDED = 4.7  # times the noise of a count: more than its rounding alone shows in third differences


def limit(values: np.ndarray) -> float:
    """At which a channel stops [its unit]: the largest value, where it comes again and again; or infinity.

    Noise enters before a converter clips, so that no value comes twice but its limit. Where values are
    rounded to steps, however coarse, the largest one is rarer than the next ones unless it is the limit. What
    rests most of the time does so at no limit.
    """
    stops = min(_stop(values), _stop(-values))
    return stops if np.abs(values).max() <= stops / _OUTER else np.inf


def _stop(values: np.ndarray) -> float:
    """The largest positive value, if it comes again and again: a sensor's zero may lie aside."""
    levels, counts = np.unique(np.maximum(values, 0.0), return_counts=True)
    near = levels > _OUTER * levels[-1]
    near[-_NEXT:] = True
    often = counts[-1] >= _REPEATED * counts[near][:-1].max(initial=1)
    return float(levels[-1]) if often and 2 * counts[-1] < len(values) else np.inf


def noise_level(values: np.ndarray, signal: int, limit: float = np.inf) -> float:
    """Noise of a channel [its unit], from where a signal that went through the filter has nothing to say.

    The filter leaves 0.05 of the amplitude at 0.95 of the Nyquist frequency; noise added after it does not
    fall. The quietest quarter of the recording is taken, since impacts reach even there. A sampled channel is
    judged by its third differences, and has at least the noise of its own resolution; an encoder has at least
    the noise of its counts, whose differences tell nothing of how long their errors stand still. Where a
    sensor is at its limit it has none; one that is never long enough away from it says nothing.
    """
    if signal < Signal.CRANK_ANGLE:
        window = np.hanning(_BLOCK)
        step = _BLOCK if np.isinf(limit) else max(1, len(values) // _FRAMES)
        frames = sliding_window_view(values, _BLOCK)[::step]
        frames = frames[(np.abs(frames) < limit).all(axis=1)] * window
        if len(frames) == 0:
            return float(limit)
        power = np.abs(np.fft.rfft(frames, axis=1)[:, -3:-1]) ** 2 / (window**2).sum()
        # Lower quartile of the mean of two neighbouring bins, 0.42 of the expectation with this window.
        estimate = np.sqrt(np.quantile(power.mean(axis=1), 0.25) / 0.42)
    else:
        estimate = np.median(np.abs(np.diff(values, 3))) / 0.6745 / np.sqrt(20.0)
    if signal == Signal.CRANK_ANGLE:
        counts = encoder_counts(values)
        least = 2.0 * np.pi / (counts or ENCODER_COUNTS) / np.sqrt(12.0)
        if counts is not None and estimate < _ROUNDED * least:
            return rounding_noise(values, counts)
        estimate = max(estimate, least)
    elif signal > Signal.CRANK_ANGLE:  # of coarse counts most third differences are zero
        steps = np.abs(np.diff(values))
        if (steps > 0.0).any():
            estimate = max(estimate, steps[steps > 0.0].min() / np.sqrt(12.0))
    return float(max(estimate, 1e-6 * max(values.std(), 1e-6)))


def still(channel: str, values: np.ndarray, rate: float) -> bool:
    """Whether a channel shows one value all along, or an accelerometer is stuck at one for a time.

    No sensor that works shows the same for 20 ms, unless it has reached its limit.

    Args:
        channel: name.
        values: (samples,).
        rate: [Hz].
    """
    changed = np.flatnonzero(np.diff(values))
    if not len(changed):
        return True
    starts = np.concatenate([[0], changed + 1])
    lengths = np.diff(np.append(starts, len(values)))
    held = values[starts]
    stuck = (lengths > max(_STUCK * rate, _FEW)) & (held > values.min()) & (held < values.max())
    return channel != "crank_angle" and bool(stuck.any())
