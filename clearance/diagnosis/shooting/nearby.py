"""Where a fit comes to rest when one of its parameters is moved a little and held there.

The derivatives of the fit itself serve: near it they are the same but for little, and a step that uses them
costs one run of the machine in place of one for each unknown.

Reference: chord method, Kelley 1995, Iterative Methods for Linear and Nonlinear Equations, ch. 5.4.
"""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.looks import compare, same_coordinates, solve
from clearance.diagnosis.shooting.normal_equations import assemble, flatten, solve_bounded, spread
from clearance.diagnosis.shooting.settle import Settled, unsteady
from clearance.diagnosis.shooting.stretch import Pass

_STEPS = 4  # at most
_LITTLE = 0.02  # fall of the sum of squares that is not worth another step


def settle_nearby(
    followers: Sequence[Follower],
    base: Settled,
    passes: Sequence[Pass],
    begin: np.ndarray,
    place: int,
    workers: int = 2,
) -> Settled:
    """Take followers from where a fit rests to where it would with a parameter held elsewhere.

    Args:
        followers: one a recording, on the paths of the fit; moved.
        base: the fit.
        passes: its linearisation without unknown forces, at the noise's own scale, solved.
        begin: (recordings, unknowns) values to begin with.
        place: unknown that stays as it is there.
        workers: threads.

    Raises:
        InputError: a law does not take the values.
    """
    model, values = base.model, begin.copy()
    low = np.array([u.low for u in model.unknowns])
    high = np.array([u.high for u in model.unknowns])
    steps = np.array([[model.step(row, i) for i in range(len(low))] for row in base.values])
    for follower, one, change in zip(followers, passes, (begin - base.values) / steps, strict=True):
        follower.move(one.change(change), one.chart)
    seen = compare(followers, model, values, workers)
    cost = sum(c.cost for c in seen)
    for _ in range(_STEPS if same_coordinates(passes, seen) else 0):
        chords = [f.beside(one, c) for f, one, c in zip(followers, passes, seen, strict=True)]
        solve(chords, [unsteady(len(c.local)) for c in seen], workers, judged=False)
        information, score = assemble(chords, model, base.values)
        lows, highs = flatten(low - values, model), flatten(high - values, model)
        lows[place] = highs[place] = 0.0
        change = spread(solve_bounded(information, score, lows, highs), model, len(followers))
        paths = [follower.path.copy() for follower in followers]
        for follower, one, own in zip(followers, chords, change / steps, strict=True):
            follower.move(one.change(own), one.chart)
        other = compare(followers, model, values + change, workers)
        fall = cost - sum(c.cost for c in other)
        if not fall > 0.0 or not same_coordinates(passes, other):
            for follower, path in zip(followers, paths, strict=True):
                follower.path = path
            break
        values, seen, cost = values + change, other, cost - fall
        if fall < _LITTLE:
            break
    return Settled(model, values, cost, seen)
