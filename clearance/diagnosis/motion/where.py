"""Where residuals lie: by channel, crank angle and frequency."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from clearance.diagnosis.judging.mismatch import ANGLE_BINS, by_angle, by_tone, ranges, too_large

_LOUD = 1.3  # a root mean square over noise that stands out

Rests = Sequence[np.ndarray]
"""Of each recording (samples, channels): residuals over the noise."""


def maps(
    before: Rests, after: Rests, angles: tuple[Rests, Rests], channels: Sequence[str], rate: float
) -> dict[str, Any]:
    """What the report draws of residuals before and after."""
    first, second = by_angle(before, angles[0]), by_angle(after, angles[1])
    (frequency, tones), (_, tones_after) = by_tone(before, rate), by_tone(after, rate)
    turning, ringing = too_large([first, tones])
    return {
        "title": "Error of the whole run, in units of the noise",
        "channels": list(channels),
        "crank_angle_deg": [(k + 0.5) * 360.0 / ANGLE_BINS for k in range(ANGLE_BINS)],
        "heat": first.level,
        "heat_after": second.level,
        "significant": turning,
        "frequency_hz": frequency,
        "spectrum": {c: tones.level[i] for i, c in enumerate(channels)},
        "spectrum_after": {c: tones_after.level[i] for i, c in enumerate(channels)},
        "significant_spectrum": {c: ringing[i] for i, c in enumerate(channels)},
    }


def summary(rests: Rests, angles: Rests, channels: Sequence[str], rate: float) -> dict[str, Any]:
    """Each channel's share of what is more than noise, and the angles and frequencies that stand out."""
    stacked = np.concatenate(list(rests))
    excess = np.maximum((stacked**2).mean(axis=0) - 1.0, 0.0)
    share = excess / max(float(excess.sum()), 1e-12)
    frequency, tones = by_tone(rests, rate)
    angle_level = np.sqrt((by_angle(rests, angles).level ** 2).mean(axis=0))
    frequency_level = np.sqrt((tones.level**2).mean(axis=0))
    width = 360.0 / ANGLE_BINS
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
