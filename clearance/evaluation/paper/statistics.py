"""Means with their spread over trainings, and whether two models differ (paper, Section 4.5)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
SIGNIFICANCE = 0.01  # the paper's


@dataclass(frozen=True)
class Summary:
    """A quantity over trainings; what one value cannot tell is ``None``."""

    count: int
    mean: float
    deviation: float | None  # standard deviation of the sample
    low: float | None  # of the interval of the mean, Student's t
    high: float | None


@dataclass(frozen=True)
class Comparison:
    """A paired difference, first less second; ``None`` where there are too few pairs.

    Attributes:
        pairs: trainings that both models have by split and initialisation.
        splits: among them.
        difference: mean of the splits' means.
        paired_p: of the t-test over pairs, as in the paper. It takes them as independent, which they are not.
        corrected_p: of the corrected resampled t-test over splits.
        low: of the difference's 95 % interval by the corrected test.
        high: likewise.
    """

    pairs: int
    splits: int
    difference: float
    paired_p: float | None
    corrected_p: float | None
    low: float | None
    high: float | None


def summarise(values: Sequence[float]) -> Summary:
    """Mean, standard deviation and 95 % interval of the mean, as if the values were independent."""
    count, mean = len(values), float(np.mean(values))
    if count < 2:
        return Summary(count, mean, None, None, None)
    deviation = float(np.std(values, ddof=1))
    reach = float(stats.t.ppf((1 + CONFIDENCE) / 2, count - 1)) * deviation / count**0.5
    return Summary(count, mean, deviation, mean - reach, mean + reach)


def compare(
    one: dict[tuple[int, int], float], other: dict[tuple[int, int], float], test_to_training: float
) -> Comparison | None:
    """Compare two models.

    Args:
        one: value by split and initial seed.
        other: likewise.
        test_to_training: number of test recordings over that of training recordings.

    Returns:
        ``None`` where they share no split and seed.
    """
    shared = sorted(one.keys() & other.keys())
    if not shared:
        return None
    differences = np.array([one[key] - other[key] for key in shared])
    splits = sorted({split for split, _ in shared})
    # Initialisations of a split share its test recordings: their mean is one resample.
    by_split = [
        float(np.mean([d for d, (place, _) in zip(differences, shared, strict=True) if place == split]))
        for split in splits
    ]
    paired_p = None
    if len(differences) > 1 and np.ptp(differences) > 0:
        paired_p = float(stats.ttest_1samp(differences, 0.0).pvalue)
    mean, error = float(np.mean(by_split)), corrected_error(by_split, test_to_training)
    corrected_p = low = high = None
    if error:
        freedom = len(splits) - 1
        corrected_p = float(2 * stats.t.sf(abs(mean) / error, freedom))
        reach = float(stats.t.ppf((1 + CONFIDENCE) / 2, freedom)) * error
        low, high = mean - reach, mean + reach
    return Comparison(
        len(shared), len(splits), mean, paired_p, corrected_p, low, high
    )  # fmt: skip


def corrected_error(differences: Sequence[float], test_to_training: float) -> float | None:
    """Standard error of a mean over J overlapping splits: sqrt((1/J + n_test/n_train) s^2), s^2 with J - 1.

    Reference: Nadeau & Bengio 2003, Machine Learning 52, 239-281, the corrected resampled t-test.
    """
    if len(differences) < 2:
        return None
    return float(np.sqrt((1 / len(differences) + test_to_training) * np.var(differences, ddof=1)))


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjusted for as many tests (Holm 1979, Scandinavian Journal of Statistics 6, 65-70)."""
    order = np.argsort(p_values)
    adjusted, least = np.empty(len(p_values)), 0.0
    for rank, place in enumerate(order):
        least = max(least, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = least
    return [float(value) for value in adjusted]
