"""Where residuals lie: by channel, crank angle and frequency."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

from clearance.diagnosis.judging.mismatch import ranges

BINS = 36  # of the crank's angle
_FALSE_DISCOVERIES = 0.05
_LOUD = 1.3  # a root mean square over noise that stands out
_SPECTRUM = 128  # samples of a spectrum, fewer where there are fewer

Rests = Sequence[np.ndarray]
"""Of each recording (samples, channels): residuals over the noise."""


def heat(rests: Rests, angles: Rests) -> tuple[np.ndarray, np.ndarray]:
    """(channels, BINS) root mean squares by crank angle, and which are too large for noise.

    Reference: Benjamini & Hochberg 1995, J. R. Stat. Soc. B 57(1), 289-300.
    """
    channels = rests[0].shape[1]
    square, count = np.zeros((channels, BINS)), np.zeros(BINS)
    for rest, angle in zip(rests, angles, strict=True):
        place = (np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi) * BINS).astype(int) % BINS
        count += np.bincount(place, minlength=BINS)
        for i in range(channels):
            square[i] += np.bincount(place, rest[:, i] ** 2, minlength=BINS)
    tail = chi2.sf(square, np.maximum(count, 1e-9))
    order = np.sort(tail.ravel())
    passing = order <= _FALSE_DISCOVERIES * np.arange(1, order.size + 1) / order.size
    limit = order[passing].max() if passing.any() else -1.0
    return np.sqrt(square / np.maximum(count, 1.0)), tail <= limit


def spectrum(rests: Rests, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and (channels, frequencies) amplitude over that of the noise (Welch 1967)."""
    size = min(_SPECTRUM, *(len(rest) for rest in rests))
    window = np.hanning(size)
    power = []
    for rest in rests:
        blocks = len(rest) // size
        frames = rest[: blocks * size].reshape(blocks, size, -1) * window[:, None]
        power.append(np.abs(np.fft.rfft(frames, axis=1)) ** 2 / (window**2).sum())
    return np.fft.rfftfreq(size, 1.0 / rate), np.sqrt(np.concatenate(power).mean(axis=0).T)


def maps(
    before: Rests, after: Rests, angles: tuple[Rests, Rests], channels: Sequence[str], rate: float
) -> dict[str, Any]:
    """What the report draws of residuals before and after."""
    first, significant = heat(before, angles[0])
    second, _ = heat(after, angles[1])
    frequency, level = spectrum(before, rate)
    _, level_after = spectrum(after, rate)
    return {
        "title": "Error of the whole run, in units of the noise",
        "channels": list(channels),
        "crank_angle_deg": [(k + 0.5) * 360.0 / BINS for k in range(BINS)],
        "heat": first,
        "heat_after": second,
        "significant": significant,
        "frequency_hz": frequency,
        "spectrum": {c: level[i] for i, c in enumerate(channels)},
        "spectrum_after": {c: level_after[i] for i, c in enumerate(channels)},
    }


def summary(rests: Rests, angles: Rests, channels: Sequence[str], rate: float) -> dict[str, Any]:
    """Each channel's share of what is more than noise, and the angles and frequencies that stand out."""
    stacked = np.concatenate(list(rests))
    excess = np.maximum((stacked**2).mean(axis=0) - 1.0, 0.0)
    share = excess / max(float(excess.sum()), 1e-12)
    by_angle, _ = heat(rests, angles)
    frequency, level = spectrum(rests, rate)
    angle_level = np.sqrt((by_angle**2).mean(axis=0))
    frequency_level = np.sqrt((level**2).mean(axis=0))
    width = 360.0 / BINS
    return {
        "regime": "all",
        "channels": {c: round(float(s), 4) for c, s in zip(channels, share, strict=True) if s > 0.005},
        "crank_angle_deg": [
            [a * width, b * width] for a, b in ranges(angle_level > max(_LOUD, 0.7 * angle_level.max()))
        ],
        "frequency_hz": [
            [float(frequency[a]), float(frequency[min(b, len(frequency) - 1)])]
            for a, b in ranges(frequency_level > max(_LOUD, 0.3 * frequency_level.max()))
        ],
    }
