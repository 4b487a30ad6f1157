"""Impacts in the joint, counted from an accelerometer: how many a revolution, and how strong."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

CHANNELS = ("slider_horizontal", "rod_c_axial", "rod_c_transverse", "rod_b_axial", "rod_b_transverse")
"""Where impacts are counted: the first of these that a recording has."""
LEAST_RATE = 4e3  # Hz, below which impacts a few milliseconds apart run together

_HIGH_PASS = 0.4  # of the Nyquist frequency: above the motion and the journal's rolling
_THRESHOLD = 6.0  # robust standard deviations of the high-passed recording
_APART = 1e-3  # s: the filter's ringing is not a second impact


def count_impacts(
    signals: Mapping[str, np.ndarray], angles: Mapping[str, np.ndarray], rate: float
) -> dict[str, Any]:
    """Impacts of a recording and of models by one rule: the threshold is the recording's.

    Args:
        signals: (runs, samples) of one acceleration by kind, one of which is ``recorded``.
        angles: (runs, samples) crank angle of each kind [rad], unwrapped.
        rate: [Hz].

    Returns:
        ``threshold`` [unit of the channel] and, by kind, ``per_revolution`` with its 95 % interval ``low``
        to ``high`` and ``median_strength``.
    """
    high = {kind: high_passed(values) for kind, values in signals.items()}
    threshold = _THRESHOLD * float(np.median(np.abs(high["recorded"]))) / 0.6745
    counted: dict[str, Any] = {"threshold": round(threshold, 2)}
    for kind, values in high.items():
        each, strengths = [], []
        for one, angle in zip(values, angles[kind], strict=True):
            places, sizes = impacts(one, threshold, rate)
            turned = np.abs(angle - angle[0]) / (2.0 * np.pi)
            each.append(np.bincount(turned[places].astype(int), minlength=int(turned[-1]) + 1))
            strengths.append(sizes)
        turns = float(np.abs(angles[kind][:, -1] - angles[kind][:, 0]).sum() / (2.0 * np.pi))
        sizes = np.concatenate(strengths)
        mean = len(sizes) / turns
        error = 1.96 * _error(each, turns)
        counted[kind] = {
            "per_revolution": round(mean, 2),
            "low": round(max(mean - error, 0.0), 2),
            "high": round(max(mean + error, 3.0 / turns), 2),  # none in n revolutions: below 3 / n
            "median_strength": round(float(np.median(sizes)), 2) if len(sizes) else None,
        }
    return counted


def impacts(values: np.ndarray, threshold: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Peaks of a high-passed acceleration's size above a threshold, at least a millisecond apart.

    Returns:
        (impacts,) their samples and (impacts,) their sizes.
    """
    from scipy.signal import find_peaks

    size = np.abs(values)
    places, _ = find_peaks(size, height=threshold, distance=max(1, round(_APART * rate)))
    return places, size[places]


def high_passed(values: np.ndarray) -> np.ndarray:
    """(..., samples) without what is slower than an impact; zero phase."""
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(sosfiltfilt(butter(4, _HIGH_PASS, "highpass", output="sos"), values))


def _error(each: Sequence[np.ndarray], turns: float) -> float:
    """Standard error of a number a revolution, from each run's counts by revolution.

    Impacts come in flocks and runs have moods, so that Poisson's would be too small.
    """
    whole = [counts[:-1] for counts in each]  # the last revolution is not
    pooled = np.concatenate(whole)
    error = (
        pooled.std(ddof=1) / np.sqrt(len(pooled)) if len(pooled) > 1 else np.sqrt(sum(map(sum, each))) / turns
    )
    if len(whole) > 1:
        error = max(error, np.std([counts.mean() for counts in whole], ddof=1) / np.sqrt(len(whole)))
    return float(error)
