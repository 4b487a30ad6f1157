"""How far the likelihood lets each parameter go: a curvature at its top may be that of a ripple.

An impact that an edge of a force, or a clearance, moves a little past a sample makes the cost of a fit steep
there and nowhere else. So every parameter is moved by what its curvature allows, everything else is fitted
again, and where that costs less than it should the parameter is moved further. What costs less than the fit
itself is a better fit. The derivatives of the fit serve where the cost rises as its curvature says; where it
rises more, new ones are computed on the way.

Reference: profile likelihood, Venzon & Moolgavkar 1988, Applied Statistics 37(1), 87-94.
"""

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, tightened
from clearance.diagnosis.shooting.covariance import covariance, deviations
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.looks import observe, solve
from clearance.diagnosis.shooting.nearby import settle_nearby
from clearance.diagnosis.shooting.settle import settle, unsteady
from clearance.errors import InputError

_QUANTILE = 1.96  # standard deviations of a 95 % interval
_RISE = _QUANTILE**2  # of the sum of squares at its ends
_BETTER = 1.0  # fall of the sum of squares that is a better fit
_MOVES = 3  # to a better fit, at most
_FURTHER = 3  # times that a parameter is moved twice as far, at most
_LEAP = 4.0  # times as far, over a ripple
_UP_TO = 0.98  # of the way to a bound, beyond which no law may be
_STEEP = 1.1  # rise over what the curvature says, from which on its derivatives do not serve
_LARGE = 8  # parameters from which on the clearance alone is asked for: a table's knots are many
_ITERATIONS, _TOLERANCE = 4, 1e-7


def ask_likelihood(attempt: Attempt, workers: int) -> None:
    """Set the ``reach`` of an attempt that explains; move it where a better fit shows.

    Args:
        attempt: changed.
        workers: threads.
    """
    found = fit(attempt.followers, attempt.model, attempt.fit.values, 3 * _ITERATIONS, _TOLERANCE, workers)
    attempt.fit, attempt.level = found, found.level
    for move in range(_MOVES + 1):
        attempt.reach = np.zeros((attempt.model.shared, 2))
        if not _moved(attempt, workers, move < _MOVES):
            return


def _moved(attempt: Attempt, workers: int, may: bool) -> bool:
    """Whether a better fit was found, which the attempt then has if it ``may``; if not its reach is set."""
    assert attempt.reach is not None
    model, base = attempt.model, attempt.fit
    sizes, spread, shared = deviations(base), covariance(base), model.shared
    low, high = np.array([[u.low, u.high] for u in model.unknowns]).T
    # where an effect sets in is a place in the motion: beyond a ripple may lie a deeper valley
    rough = [False, *(shape for h in attempt.hypotheses for shape in h.shapes)]
    passes = observe(tightened(attempt.followers), model, base.values, workers, forces=False)
    solve(passes, [unsteady(len(one.local)) for one in passes], workers, judged=False)
    for i, unknown in enumerate(model.unknowns[:shared]):
        if unknown.low == unknown.high or (i > 0 and shared > _LARGE):
            continue
        along = _rows(spread[i] / spread[i, i], attempt)
        kept = [j for j in range(len(model.unknowns)) if j != i]
        for side, sign in enumerate((-1.0, 1.0)):
            before, step, whole = 0.0, _QUANTILE * float(sizes[i]), 0.0
            for _ in range(2 if rough[i] else _FURTHER + 1):
                target = base.values[0, i] + sign * step
                bound = not unknown.low < target < unknown.high
                if bound and before == 0.0:
                    break  # what the curvature says reaches it
                if bound:
                    whole = abs((unknown.low if sign < 0.0 else unknown.high) - base.values[0, i])
                    step = _UP_TO * whole
                    target = base.values[0, i] + sign * step
                followers = tightened(attempt.followers)
                values = np.clip(base.values + along * sign * step, low, high)
                values[:, i] = target
                try:
                    other = settle_nearby(followers, base, passes, values, i, workers)
                    values = other.values
                    if not other.cost - base.cost < _STEEP * step**2 / spread[i, i]:
                        part = model.only(kept, values[0])
                        other = settle(followers, part, values[:, kept], _ITERATIONS, _TOLERANCE, workers)
                        values[:, kept] = other.values
                except InputError:  # no law takes these values together
                    break
                rise = other.cost - base.cost
                if may and rise < -_BETTER:
                    found = fit(followers, model, values, 3 * _ITERATIONS, _TOLERANCE, workers)
                    if found.cost < base.cost - _BETTER:
                        attempt.fit, attempt.level, attempt.followers = found, found.level, followers
                        return True
                if rise < _RISE:
                    attempt.reach[i, side] = whole if bound else step
                elif not rough[i]:
                    attempt.reach[i, side] = max(before, step * np.sqrt(_RISE / rise))
                    break
                if bound:
                    break
                before, step = step, (_LEAP if rough[i] else 2.0) * step
    return False


def _rows(change: np.ndarray, attempt: Attempt) -> np.ndarray:
    """(recordings, unknowns) of a change of all parameters."""
    shared, count = attempt.model.shared, len(attempt.model.unknowns)
    own = change[shared:].reshape(-1, count - shared)
    return np.column_stack([np.repeat(change[None, :shared], len(own), axis=0), own])
