"""Robust linear regression of what a motion needs: many bins around a badly understood impact say nothing.

References: Huber 1964, Ann. Math. Stat. 35(1), 73-101; Holland & Welsch 1977, Commun. Stat. A6(9), 813-827
(weights, the Cauchy function among them).
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg.lapack import dposv

_ROBUST = 2.0  # times the scatter beyond which a bin loses weight
_NOTHING = 1e-12  # of a column's square
_REWEIGHTED = 4  # times with Huber's weights, then as often with Cauchy's


def regressed(columns: np.ndarray, left: np.ndarray, scatter: float) -> np.ndarray:
    """(columns,) coefficients: far bins weigh less (Huber), then nearly nothing (Cauchy).

    Args:
        columns: (bins, columns).
        left: (bins,) to explain.
        scatter: of a bin, in the same unit.

    Raises:
        LinAlgError: numbers that are not finite.
    """
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0.0, size, 1.0)
    found: np.ndarray = np.zeros(columns.shape[1])
    weight: np.ndarray = np.ones(len(left))
    for k in range(2 * _REWEIGHTED if len(found) else 0):
        heavy = unit.T * weight
        gram = heavy @ unit
        gram.flat[:: len(gram) + 1] += _NOTHING  # what nothing is known of stays at zero
        _, found, failed = dposv(gram, heavy @ left)
        if failed or not np.isfinite(found).all():
            raise np.linalg.LinAlgError("the columns' products have no factor, or are not finite")
        far = np.abs(left - unit @ found) / (_ROBUST * scatter)
        weight = 1.0 / (np.maximum(far, 1.0) if k < _REWEIGHTED else 1.0 + far**2)
    scaled: np.ndarray = found / np.where(size > 0.0, size, 1.0)
    return scaled


def cost_of(left: np.ndarray, scatter: float) -> float:
    """Robust mean square (Cauchy) of what is left, in units of its scatter."""
    return float((_ROBUST**2 * np.log1p((left / (_ROBUST * scatter)) ** 2)).mean())


def scatter_of(parts: Sequence[np.ndarray]) -> float:
    """Of a bin of what varies slowly, from how much it bends, in the same unit."""
    bends = np.concatenate([np.diff(part, 2) for part in parts])
    return float(1.4826 * np.median(np.abs(bends)) / np.sqrt(6.0))
