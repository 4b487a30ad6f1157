"""How surely a fit knows its parameters: by its information, and by how the pulls of segments scatter."""

import numpy as np

from clearance.diagnosis.shooting.fit import Fit

_BLOCK = 5  # segments that count as one in the robust covariance
_BLIND, _UNSEEN = (
    1e-8,
    1e-16,
)  # share of its information that a direction is seen with; what it counts with if not


def deviations(fit: Fit, combined: np.ndarray | None = None) -> np.ndarray:
    """(P,) or (N,) standard deviations of shared parameters: the larger of own and block-robust ones.

    Args:
        fit: of a model.
        combined: (N, P) combinations of the parameters, whose deviations are wanted instead.

    Reference: White 1982, Econometrica 50(1), 1-25 (sandwich); blocks, since neighbouring segments share
    what the states could not explain.
    """
    root, middle = _root(fit.information), _scatter(fit)
    total, shared = len(root), fit.model.shared
    rows = np.eye(shared, total) if combined is None else np.pad(combined, ((0, 0), (0, total - shared)))
    seen = rows @ root  # what nobody sees cancels here, before it is squared
    robust = np.einsum("ij,jk,ik->i", seen, root.T @ middle @ root, seen)
    return np.sqrt(np.maximum(np.maximum(robust, 0.0), (seen**2).sum(axis=1)))


def optimism(fit: Fit) -> float:
    """By how much more a fit would leave of its recordings, had each part been predicted by the others alone.

    To first order that is twice the trace of the scatter of the parts' pulls over the information: what the
    parameters have taken from the part that they are asked to predict. Parts are blocks of neighbouring
    segments, left out one at a time.

    Args:
        fit: at the noise itself.

    Reference: Stone 1977, J. R. Stat. Soc. B 39(1), 44-47.
    """
    root = _root(fit.information)
    return float(2.0 * np.trace(root.T @ _scatter(fit) @ root))


def _scatter(fit: Fit) -> np.ndarray:
    """(P, P) sum of squares of the pulls that blocks of segments have at all parameters."""
    model = fit.model
    shared, count = model.shared, len(model.unknowns)
    own, total = count - shared, len(fit.information)
    scatter = np.zeros((total, total))
    for r, one in enumerate(fit.passes):
        places = [*range(shared), *range(shared + r * own, shared + (r + 1) * own)]
        scale = 1.0 / np.array([model.step(fit.values[r], i) for i in range(count)])
        scores = np.nan_to_num(one.parts, nan=0.0, posinf=0.0, neginf=0.0) * scale
        blocks = len(scores) // _BLOCK
        summed = scores[: blocks * _BLOCK].reshape(blocks, _BLOCK, count).sum(axis=1)
        scatter[np.ix_(places, places)] += summed.T @ summed
    return scatter


def covariance(fit: Fit) -> np.ndarray:
    """(P, P) of all parameters, shared ones first; huge along what the recordings say nothing about."""
    root = _root(fit.information)
    return root @ root.T


def _root(information: np.ndarray) -> np.ndarray:
    """(P, P) root of the covariance, which is huge along what the recordings say nothing about.

    Its product with its own transpose is the inverse of the information.

    A direction that derivatives by differences leave below ``_BLIND`` of what its parameters would tell alone
    is no direction that was seen: a motor's no-load speed beside the unknown speed, for example.
    """
    clean = np.nan_to_num(information, nan=0.0, posinf=0.0, neginf=0.0)  # a segment that does not run
    unit = np.sqrt(np.where(np.diag(clean) > 0.0, np.diag(clean), 1.0))
    values, vectors = np.linalg.eigh(clean / np.outer(unit, unit))
    seen = np.where(values > _BLIND, values, _UNSEEN)
    root: np.ndarray = vectors / np.sqrt(seen) / unit[:, None]
    return root
