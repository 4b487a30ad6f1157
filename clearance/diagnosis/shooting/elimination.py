"""Least squares along a chain: unknowns in time order, each measurement touching three neighbours.

Row by row the unknowns of a segment are eliminated by Householder reflections (a square-root information
filter; Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. V and VI). What remains
of every block of measurements once the states are gone is the evidence about the parameters: with a right
model the leftover right-hand sides are independent standard normal numbers.

The unknowns of a segment are its node and its constant forces; parameters come last and stay symbolic, as
further columns beside the right-hand side. All rows are in units of their own standard deviation.
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _reflect(r: np.ndarray, b: np.ndarray, rows: int, n: int, total: int) -> None:
    """Annihilate the first ``n`` columns of ``b[:rows]`` against the triangle ``r``."""
    projection = np.zeros(total)
    for j in range(n):
        square = 0.0
        for i in range(rows):
            square += b[i, j] * b[i, j]
        if square == 0.0:
            continue
        head = r[j, j]
        norm = np.sqrt(head * head + square)
        alpha = -norm if head > 0.0 else norm
        v0 = head - alpha
        scale = 1.0 / (norm * norm - head * alpha)
        for c in range(j, total):
            projection[c] = v0 * r[j, c]
        for i in range(rows):
            bij = b[i, j]
            if bij != 0.0:
                for c in range(j, total):
                    projection[c] += bij * b[i, c]
        for c in range(j, total):
            projection[c] *= scale
            r[j, c] -= v0 * projection[c]
        for i in range(rows):
            bij = b[i, j]
            if bij != 0.0:
                for c in range(j, total):
                    b[i, c] -= bij * projection[c]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _predict(
    r: np.ndarray, b: np.ndarray, n: int, half: np.ndarray, innovation: np.ndarray, spread: np.ndarray
) -> None:
    """Errors of the measurements ``b`` predicted from the triangle ``r``, and their standard deviations.

    With R the triangle, d its right-hand side and H the measurements' derivatives, the prediction is
    H R^-1 d and its covariance H R^-1 (H R^-1)'; ``half`` is (H R^-1)', all measurements side by side.
    """
    rows, last = innovation.size, b.shape[1] - 1
    for i in range(rows):
        innovation[i] = b[i, last]
        spread[i] = 1.0
    for j in range(n):
        for i in range(rows):
            half[j, i] = b[i, j]
        for c in range(j):
            factor = r[c, j]
            if factor != 0.0:
                for i in range(rows):
                    half[j, i] -= factor * half[c, i]
        inverse, right = 1.0 / r[j, j], r[j, last]
        for i in range(rows):
            half[j, i] *= inverse
            innovation[i] -= half[j, i] * right
            spread[i] += half[j, i] * half[j, i]
    for i in range(rows):
        spread[i] = np.sqrt(spread[i])


@njit(cache=True, nogil=True, error_model="numpy")
def eliminate(
    flow: np.ndarray,
    defect: np.ndarray,
    inputs: np.ndarray,
    own: np.ndarray,
    prior: np.ndarray,
    damping: np.ndarray,
    jacobian: np.ndarray,
    sensitivity: np.ndarray,
    residual: np.ndarray,
    kept: np.ndarray,
    gram: np.ndarray,
    parts: np.ndarray,
    innovation: np.ndarray,
    spread: np.ndarray,
) -> None:
    """Eliminate the states of all segments.

    Args:
        flow: (segments, nz, nz + nw + P) derivative of a segment's end by its node, forces and the
            parameters, each row in units of its process noise.
        defect: (segments, nz) end minus next node, in the same units.
        inputs: (segments, nw) present forces in units of their prior standard deviation.
        own: (segments, nz, nz) derivative of a node by its unknowns, in units of the process noise.
        prior: (nz,) standard deviation of the first node's unknowns.
        damping: (segments, nv) weights that hold the unknowns where they are (Levenberg-Marquardt).
        jacobian: (segments, 3, rows, nz + nw) derivative of the measurements of blocks k - 1, k, k + 1.
        sensitivity: (segments, rows, P) derivative of block k by the parameters.
        residual: (segments, rows) measured minus predicted; rows without weight are zero throughout.
        kept: (segments, nv, 3 nv + P + 1) written: eliminated rows, for the substitution.
        gram: (P + 1, P + 1) added to: inner products of what is left of [sensitivity, residual].
        parts: (segments, P) written: each segment's share of the gram's last column.
        innovation: (segments, rows) written: residual against the prediction from earlier blocks; none
            where it is empty.
        spread: (segments, rows) written: its standard deviation.
    """
    segments, nz, width = flow.shape
    nw = inputs.shape[1]
    nv = nz + nw
    parameters = width - nv
    rows = residual.shape[1]
    n, total = 3 * nv, 3 * nv + parameters + 1
    last = total - 1
    r = np.zeros((n, total))
    b = np.zeros((max(rows, 2 * nv), total))
    half = np.zeros((n, rows))
    for j in range(nz):
        r[j, j] = 1.0 / prior[j]
    for j in range(nw):
        r[nz + j, nz + j] = 1.0
        r[nz + j, last] = -inputs[0, j]
    for j in range(nv):
        b[j, j] = damping[0, j]
    _reflect(r, b, nv, n, total)
    for ahead in range(2):  # segments 1 and 2 join the first
        place = (ahead + 1) * nv
        _join(
            flow, defect, inputs, own, damping, ahead, gram, parts, r, b, place, nz, nw, parameters, n, total
        )
    for k in range(1, segments - 1):
        for i in range(rows):
            for j in range(total):
                b[i, j] = 0.0
            for j in range(nv):
                b[i, j] = jacobian[k - 1, 2, i, j]
                b[i, nv + j] = jacobian[k, 1, i, j]
                b[i, 2 * nv + j] = jacobian[k + 1, 0, i, j]
            for j in range(parameters):
                b[i, n + j] = sensitivity[k, i, j]
            b[i, last] = residual[k, i]
        if innovation.shape[0] > 0:
            _predict(r, b, n, half, innovation[k], spread[k])
        _reflect(r, b, rows, n, total)
        for i in range(rows):
            for j in range(n, total):
                if b[i, j] != 0.0:
                    for c in range(n, total):
                        gram[j - n, c - n] += b[i, j] * b[i, c]
                    if j < last:
                        parts[k, j - n] += b[i, j] * b[i, last]
        for i in range(nv):
            for j in range(total):
                kept[k - 1, i, j] = r[i, j]
        if k + 2 < segments:
            for i in range(2 * nv):
                for j in range(2 * nv):
                    r[i, j] = r[i + nv, j + nv]
                for j in range(2 * nv, n):
                    r[i, j] = 0.0
                for j in range(n, total):
                    r[i, j] = r[i + nv, j]
            for i in range(2 * nv, n):
                for j in range(total):
                    r[i, j] = 0.0
            place = 2 * nv
            _join(
                flow,
                defect,
                inputs,
                own,
                damping,
                k + 1,
                gram,
                parts,
                r,
                b,
                place,
                nz,
                nw,
                parameters,
                n,
                total,
            )
    for i in range(2 * nv):  # of the last two segments
        for j in range(2 * nv):
            kept[segments - 2 + i // nv, i % nv, j - (i // nv) * nv] = r[i + nv, j + nv]
        for j in range(n, total):
            kept[segments - 2 + i // nv, i % nv, j] = r[i + nv, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _join(
    flow: np.ndarray,
    defect: np.ndarray,
    inputs: np.ndarray,
    own: np.ndarray,
    damping: np.ndarray,
    k: int,
    gram: np.ndarray,
    parts: np.ndarray,
    r: np.ndarray,
    b: np.ndarray,
    place: int,
    nz: int,
    nw: int,
    parameters: int,
    n: int,
    total: int,
) -> None:
    """Take the node after segment ``k`` into the triangle at column ``place``; ``k`` lies just before it."""
    nv = nz + nw
    for i in range(2 * nv):
        for j in range(total):
            b[i, j] = 0.0
    for i in range(nv):
        b[nv + i, place + i] = damping[k + 1, i]
    for i in range(nz):
        for j in range(nz):
            b[i, place + j] = own[k + 1, i, j]
        for j in range(nv):
            b[i, place - nv + j] = -flow[k, i, j]
        for j in range(parameters):
            b[i, n + j] = -flow[k, i, nv + j]
        b[i, total - 1] = defect[k, i]
    for j in range(nw):
        b[nz + j, place + nz + j] = 1.0
        b[nz + j, total - 1] = -inputs[k + 1, j]
    _reflect(r, b, 2 * nv, n, total)
    for i in range(2 * nv):  # what damping leaves over
        for j in range(n, total):
            for c in range(n, total):
                gram[j - n, c - n] += b[i, j] * b[i, c]
            if j < total - 1:
                parts[k + 1, j - n] += b[i, j] * b[i, total - 1]


@njit(cache=True, nogil=True, error_model="numpy")
def substitute(kept: np.ndarray, parameters: np.ndarray, solution: np.ndarray) -> None:
    """Solve for all segments' unknowns, given a change of the parameters.

    Args:
        kept: see ``eliminate``.
        parameters: (P,).
        solution: (segments, nv) written.
    """
    segments, nv, total = kept.shape
    n = 3 * nv
    ahead = np.zeros(n)
    for k in range(segments - 1, -1, -1):
        for j in range(n - 1, nv - 1, -1):
            ahead[j] = ahead[j - nv]
        for i in range(nv - 1, -1, -1):
            value = kept[k, i, total - 1]
            for j in range(parameters.size):
                value -= kept[k, i, n + j] * parameters[j]
            for j in range(i + 1, n):
                value -= kept[k, i, j] * ahead[j]
            ahead[i] = value / kept[k, i, i]
            solution[k, i] = ahead[i]


def draw(kept: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(segments, nv) deviation of all unknowns from the solution, as likely as what is known says.

    The triangle R of what is kept is a square root of the information: with e standard normal, R^-1 e has
    its covariance (Rue & Held 2005, Gaussian Markov Random Fields, sec. 2.3). Parameters stay as they are.

    Args:
        kept: see ``eliminate``.
        random: generator.
    """
    segments, nv, total = kept.shape
    rows, deviation = kept.copy(), np.zeros((segments, nv))
    rows[:, :, -1] = random.normal(size=(segments, nv))
    substitute(rows, np.zeros(total - 3 * nv - 1), deviation)
    return deviation
