"""Which joints have clearance: a threshold a joint on the estimates of whole recordings."""

from collections.abc import Sequence

import numpy as np

LOCATIONS = ("neither", "B", "C", "both")
"""Where a machine has clearance, by the place that ``location`` gives."""


def location(loose: Sequence[bool] | np.ndarray) -> np.ndarray:
    """Whether B and whether C have clearance, (..., 2), as a place in ``LOCATIONS``, (...)."""
    return np.asarray(loose) @ np.array([1, 2])


def choose_threshold(estimates: np.ndarray, loose: np.ndarray, limit: float) -> float:
    """The estimate above which a joint is best said to have clearance.

    Best is the largest balanced accuracy: the mean of the shares of loose and of tight joints that are told
    rightly, so that how many there are of each does not matter. It is the same between two neighbouring
    estimates, and there the middle is taken; of several such gaps the one in the middle, of two the lower.

    Args:
        estimates: (recordings,) of one joint [m].
        loose: (recordings,) whether it has clearance.
        limit: largest clearance [m]; with 0 the outermost ends of the gaps.

    Returns:
        The threshold [m].
    """
    edges = np.unique([0.0, *estimates, limit])
    middles = (edges[:-1] + edges[1:]) / 2
    above = estimates > middles[:, None]  # (gaps, recordings)
    right = [
        (above[:, loose == kind] == kind).mean(axis=1) for kind in (False, True) if (loose == kind).any()
    ]
    accuracy = np.mean(right, axis=0)
    best = np.flatnonzero(accuracy >= accuracy.max() - 1e-9)  # 1e-9: round-off of means is no difference
    return float(middles[best[(len(best) - 1) // 2]])
