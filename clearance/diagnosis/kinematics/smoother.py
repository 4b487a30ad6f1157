"""A smoother of a motion under unknown accelerations, without an inverse of a covariance.

Forward a filter, row by row; backward the adjoint of what it saw.

Reference: Bierman 1973, Int. J. Control 18(1), 65-75 (the smoother of Bryson and Frazier for discrete
measurements).
"""

import numpy as np

from clearance.compilation import entry
from clearance.diagnosis.kinematics.rigid_motion import FIRST_JOINT, TORQUE


@entry
def smooth(
    period: float,
    start: np.ndarray,
    variance: np.ndarray,
    drift: np.ndarray,
    torque_drift: float,
    slopes: np.ndarray,
    seen: np.ndarray,
    noise: np.ndarray,
    sight: np.ndarray,
    target: np.ndarray,
    doubt: np.ndarray,
) -> np.ndarray:
    """Smooth a linear motion under white accelerations.

    Args:
        period: of the samples [s].
        start: (states,) mean of the first state.
        variance: (states,) its variances.
        drift: (inputs,) variances of the accelerations, new at every sample.
        torque_drift: variance by which the torque changes in a sample.
        slopes: (samples, rows, states + inputs) derivative of the rows seen.
        seen: (samples, rows).
        noise: (samples, rows) their variances.
        sight: (samples, 2 joints, 2) direction in which an eccentricity is seen.
        target: (samples, 2 joints) how large it is there.
        doubt: (samples, 2 joints) variances; infinite: not seen.

    Returns:
        (samples, states + inputs); not finite where the rows are not.
    """
    count, rows, total = slopes.shape
    inputs = drift.size
    states = total - inputs
    every = rows + target.shape[1]
    # accelerations run straight from sample to sample: both ends of an interval move the state
    full, half, rest = period * period / 3.0, 0.5 * period, period * period / 6.0
    moved_by = np.zeros(inputs, np.int64)  # place of what each acceleration moves; its rate follows it
    for i in range(1, inputs):
        moved_by[i] = FIRST_JOINT + 2 * (i - 1)
    mean, cover = np.zeros((count, total)), np.zeros((count, total, total))
    gains, weights = np.zeros((count, every, total)), np.zeros((count, every))
    x, c = np.zeros(total), np.zeros((total, total))
    x[:states] = start
    for i in range(states):
        c[i, i] = variance[i]
    for i in range(inputs):
        c[states + i, states + i] = drift[i]
    row, across = np.zeros(total), np.zeros(total)
    for t in range(count):
        for m in range(every):
            if m < rows:
                row[:] = slopes[t, m]
                value, error = seen[t, m], noise[t, m]
            else:
                k = m - rows
                value, error = target[t, k], doubt[t, k]
                if not np.isfinite(error):
                    continue
                row[:] = 0.0
                place = FIRST_JOINT + 4 * (k // 2)
                row[place], row[place + 2] = sight[t, k, 0], sight[t, k, 1]
            across[:] = 0.0
            for i in range(total):
                if row[i] != 0.0:
                    for j in range(total):
                        across[j] += row[i] * c[i, j]
            spread, miss = error, value
            for i in range(total):
                spread += row[i] * across[i]
                miss -= row[i] * x[i]
            weights[t, m] = miss / spread
            for i in range(total):
                gain = across[i] / spread
                gains[t, m, i] = gain
                x[i] += gain * miss
                for j in range(total):
                    c[i, j] -= gain * across[j]
        for i in range(total):
            for j in range(i):
                c[i, j] = c[j, i] = 0.5 * (c[i, j] + c[j, i])
        mean[t], cover[t] = x, c
        for i in range(inputs):
            place = moved_by[i]
            x[place] += period * x[place + 1] + full * x[states + i]
            x[place + 1] += half * x[states + i]
            x[states + i] = 0.0
            for j in range(total):
                c[place, j] += period * c[place + 1, j] + full * c[states + i, j]
                c[place + 1, j] += half * c[states + i, j]
                c[states + i, j] = 0.0
        for i in range(inputs):
            place = moved_by[i]
            for j in range(total):
                c[j, place] += period * c[j, place + 1] + full * c[j, states + i]
                c[j, place + 1] += half * c[j, states + i]
                c[j, states + i] = 0.0
            # what is new at the next sample has moved the state already
            c[place, place] += rest * rest * drift[i]
            c[place, place + 1] += rest * half * drift[i]
            c[place + 1, place] += rest * half * drift[i]
            c[place + 1, place + 1] += half * half * drift[i]
            c[place, states + i] += rest * drift[i]
            c[states + i, place] += rest * drift[i]
            c[place + 1, states + i] += half * drift[i]
            c[states + i, place + 1] += half * drift[i]
            c[states + i, states + i] += drift[i]
        c[TORQUE, TORQUE] += torque_drift
    adjoint = np.zeros(total)
    for t in range(count - 1, -1, -1):
        for i in range(total):
            moved = mean[t, i]
            for j in range(total):
                moved += cover[t, i, j] * adjoint[j]
            mean[t, i] = moved
        for m in range(every - 1, -1, -1):
            pull = weights[t, m]
            for i in range(total):
                pull -= gains[t, m, i] * adjoint[i]
            if m < rows:
                for i in range(total):
                    adjoint[i] += slopes[t, m, i] * pull
            elif np.isfinite(doubt[t, m - rows]):
                place = FIRST_JOINT + 4 * ((m - rows) // 2)
                adjoint[place] += sight[t, m - rows, 0] * pull
                adjoint[place + 2] += sight[t, m - rows, 1] * pull
        for i in range(inputs):
            place = moved_by[i]
            adjoint[states + i] = full * adjoint[place] + half * adjoint[place + 1]
            adjoint[place + 1] += period * adjoint[place]
    return mean
