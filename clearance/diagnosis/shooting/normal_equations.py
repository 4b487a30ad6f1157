"""All parameters of a fit together: the normal equations of all recordings, and their bounded solution."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.stretch import Pass


def assemble(passes: Sequence[Pass], model: Model, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (P, P) and score (P,) of all parameters in their own units."""
    shared, count = model.shared, len(model.unknowns)
    own = count - shared
    total = shared + own * len(passes)
    information, score = np.zeros((total, total)), np.zeros(total)
    for r, one in enumerate(passes):
        places = [*range(shared), *range(shared + r * own, shared + (r + 1) * own)]
        scale = 1.0 / np.array([model.step(values[r], i) for i in range(count)])
        information[np.ix_(places, places)] += one.gram[:-1, :-1] * np.outer(scale, scale)
        score[places] += one.gram[:-1, -1] * scale
    return information, score


def spread(change: np.ndarray, model: Model, recordings: int) -> np.ndarray:
    """(recordings, unknowns) from a vector of all parameters; ``flatten`` goes back."""
    shared, own = model.shared, len(model.unknowns) - model.shared
    rows = [
        np.concatenate([change[:shared], change[shared + r * own : shared + (r + 1) * own]])
        for r in range(recordings)
    ]
    return np.array(rows)


def flatten(rows: np.ndarray, model: Model) -> np.ndarray:
    """(P,) of all parameters from (recordings, unknowns)."""
    shared = model.shared
    return np.concatenate([rows[0, :shared], rows[:, shared:].ravel()])


def solve_bounded(
    information: np.ndarray, score: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Change that maximises the quadratic, parameters held inside [low, high] (active set)."""
    count = len(score)
    change, free = np.zeros(count), np.ones(count, dtype=bool)
    for _ in range(count + 1):
        index = np.flatnonzero(free)
        if not len(index):
            break
        part = information[np.ix_(index, index)]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(part), 1e-300))
        right = score[index] - information[np.ix_(index, np.flatnonzero(~free))] @ change[~free]
        scaled = part * np.outer(scale, scale) + 1e-10 * np.eye(len(index))
        change[index] = scale * np.linalg.solve(scaled, scale * right)
        outside = free & ((change < low) | (change > high))
        if not outside.any():
            break
        change[outside] = np.clip(change[outside], low[outside], high[outside])
        free &= ~outside
    return change
