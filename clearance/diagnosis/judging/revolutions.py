"""Statistics of a machine that runs steadily: its average revolution and its spectrum."""

from dataclasses import dataclass, replace

import numpy as np

_WINDOW = 1024  # samples of a spectrum's windows, at most
_BANDS = 120  # of a spectrum, of equal ratio
_MISPLACED = 0.02  # rad, by which the crank angle at a recording's start may be wrong
_STEPS = 6  # of Gauss and Newton towards it


@dataclass(frozen=True)
class Running:
    """Signals of a machine that runs steadily, once or several times.

    Attributes:
        values: (runs, samples, channels).
        angle: (runs, samples) crank angle [rad], unwrapped.
        rate: [Hz].
    """

    values: np.ndarray
    angle: np.ndarray
    rate: float


@dataclass(frozen=True)
class PhaseAverage:
    """Time-synchronous average: a signal over one revolution of the crank.

    Attributes:
        mean: (bins, channels) at the bins' centres, not a number in bins that no sample fell into.
        spread: (bins, channels) standard deviation from one revolution to another.
        drift: (bins, channels) standard deviation from one run to another.
        runs: that the mean is of.
        revolutions: (bins,) likewise.
        samples: (bins,) likewise.
        slope: (bins, channels) of the mean [1/rad].
    """

    mean: np.ndarray
    spread: np.ndarray
    drift: np.ndarray
    runs: int
    revolutions: np.ndarray
    samples: np.ndarray
    slope: np.ndarray


def phase_average(run: Running, bins: int) -> PhaseAverage:
    """Average over revolutions in bins of the crank angle (McFadden 1987, Mech. Syst. Signal Process. 1).

    Samples fall elsewhere in a bin from one recording to another: what they show is moved to the bin's
    centre along the average's slope.

    Args:
        run: any length, either sense.
        bins: of a revolution.
    """
    width = 2.0 * np.pi / bins
    place = np.floor(run.angle / width).astype(int)
    off_centre = run.angle - (place + 0.5) * width
    place -= place.min(axis=1, keepdims=True) // bins * bins
    turns = place.max(axis=1) // bins + 1
    first = np.append(0, np.cumsum(turns))  # turn of each run, one after the other
    place += first[:-1, None] * bins

    def gathered(values: np.ndarray) -> np.ndarray:
        return np.bincount(place.ravel(), values.ravel(), first[-1] * bins).reshape(-1, bins)

    count = gathered(np.ones(place.shape))
    share = 1.0 / np.maximum(count, 1)
    present = (count > 0)[..., None]
    revolutions = (count > 0).sum(axis=0)
    each = np.stack([gathered(run.values[..., i]) * share for i in range(run.values.shape[2])], 2)
    mean = each.sum(axis=0) / np.maximum(revolutions, 1)[:, None]
    slope = (np.roll(mean, -1, axis=0) - np.roll(mean, 1, axis=0)) / (2.0 * width)
    known = revolutions > 0
    slope[~(known & np.roll(known, 1) & np.roll(known, -1))] = 0.0
    each -= (gathered(off_centre) * share)[..., None] * slope
    mean = each.sum(axis=0) / np.maximum(revolutions, 1)[:, None]
    square = (present * (each - mean) ** 2).sum(axis=0) / np.maximum(revolutions - 1, 1)[:, None]
    mean[~known] = np.nan
    square[revolutions < 2] = np.nan
    drift = np.zeros_like(mean)
    if len(turns) > 1:
        parts = np.add.reduceat(each, first[:-1]) / np.maximum(np.add.reduceat(present, first[:-1]), 1)
        drift = parts.std(axis=0, ddof=1)
    return PhaseAverage(mean, np.sqrt(square), drift, len(turns), revolutions, count.sum(axis=0), slope)


def registered(recorded: PhaseAverage, run: Running, sigma: np.ndarray) -> tuple[PhaseAverage, np.ndarray]:
    """A model's phase average at the crank angle where it lies best, and how far it is from the recording's.

    The angle at a recording's first sample is not known to a bin's width, and no model gets blamed for it.
    The distance is the root mean square difference over its standard error, 1 for a right model. The error
    is what the model says: what its own runs vary by from one revolution to the next, or from one run to
    another where that is more, for as many revolutions as the recording has and as were simulated, and the
    sensor's noise.

    Args:
        recorded: of few revolutions.
        run: of the model, many revolutions.
        sigma: (channels,) standard deviation of the noise of one sample.

    Returns:
        The average, and (channels,) distances; not a number where nothing can be compared.
    """
    bins, turned = len(recorded.mean), 0.0
    for _ in range(_STEPS):
        model = phase_average(replace(run, angle=run.angle + turned), bins)
        use = (recorded.revolutions > 0) & (model.revolutions > 1)
        if not use.any():
            return model, np.full(len(sigma), np.nan)
        shares = 1.0 / recorded.revolutions[use] + 1.0 / model.revolutions[use]
        a_run = model.revolutions[use] / model.runs  # revolutions
        varying = np.maximum(model.spread[use] ** 2, model.drift[use] ** 2 * a_run[:, None])
        bend = np.roll(model.mean, 1, axis=0) + np.roll(model.mean, -1, axis=0) - 2.0 * model.mean
        variance = varying * shares[:, None] + sigma**2 / recorded.samples[use, None]
        variance += np.nan_to_num(bend[use] / 24.0) ** 2  # what a bin's mean and its centre may differ by
        difference, slope = model.mean[use] - recorded.mean[use], model.slope[use]
        step = float((slope * difference / variance).sum() / max((slope**2 / variance).sum(), 1e-300))
        turned = float(np.clip(turned + step, -_MISPLACED, _MISPLACED))
    return model, np.sqrt((difference**2 / variance).mean(axis=0))


def spectrum(run: Running, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """One-sided amplitude spectral density (Welch 1967), averaged in power over bands of equal ratio.

    Args:
        run: the signals.
        samples: of the shortest run that is compared; windows are a third of it, or shorter.

    Returns:
        (bands,) centre frequencies [Hz] and (bands, channels) densities [unit/sqrt(Hz)].
    """
    from scipy.signal import welch

    length = int(min(_WINDOW, max(16, samples // 3)))
    frequency, power = welch(run.values, run.rate, nperseg=length, axis=1)
    frequency, power = frequency[1:], power.mean(axis=0)[1:]  # the mean is in the phase average
    band = np.round(np.log(frequency / frequency[0]) / np.log(frequency[-1] / frequency[0]) * (_BANDS - 1))
    starts = np.flatnonzero(np.diff(band, prepend=-1.0))
    width = np.diff(starts, append=len(band))
    centres = np.add.reduceat(frequency, starts) / width
    return centres, np.sqrt(np.add.reduceat(power, starts, axis=0) / width[:, None])
