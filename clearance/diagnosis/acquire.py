"""From nothing to a simulator that runs beside the recording: step in at a match, then follow it outwards."""

import numpy as np

from clearance.diagnosis.fit import GOAL, Model, fit
from clearance.diagnosis.follow import Follower
from clearance.diagnosis.start import STRETCH, Match

ANNEALING = (100.0, 31.6, 10.0, 3.16, 1.0)  # factors on the noise while a guess is far from a solution
GOOD = 3.0  # robust cost a sample up to which a stretch counts as followed


def _fixed(model: Model, values: np.ndarray) -> Model:
    machine = model.machine(values)
    return Model((), lambda _: machine)


_NOTHING = np.zeros((1, 0))


def step_in(
    follower: Follower, model: Model, values: np.ndarray, match: Match, length: int
) -> tuple[np.ndarray, float, float]:
    """Fit the first stretch, then lengthen it while clearance and speed settle.

    Args:
        follower: with an empty path.
        model: whose unknowns are fitted as the stretch grows.
        values: (unknowns,) start.
        match: where to begin.
        length: segments to follow.

    Returns:
        (unknowns,) values, the scale of the noise at which the path is followed, and the cost a sample.
    """
    first = match.segment
    last = first + STRETCH
    follower.path.nodes[first:last] = match.nodes
    follower.path.inputs[:] = 0.0
    fixed = _fixed(model, values)
    for scale in ANNEALING:
        before = follower.path.copy()
        found = fit([follower], fixed, _NOTHING, 8, 2e-2, 1, first=first, last=last, scale=scale)
        if scale < ANNEALING[0] and found.level > GOOD:
            follower.path = before
            break
        reached = scale
    while True:
        before = follower.path.copy()
        found = fit(
            [follower], model, values[None], 4, 5e-2, 1, goal=GOAL, first=first, last=last, scale=reached
        )  # fmt: skip
        level = found.level
        if level > GOOD and reached < ANNEALING[0]:
            follower.path = before
            reached *= STEP
            continue
        values = found.values[0]
        if last >= min(first + length, follower.segments):
            return values, reached, level
        new = min(max(3, (last - first) // 4), follower.segments - last)
        follower.extend(model.machine(values), last - 1, new)
        last += new


STEP = 10.0**0.5  # by which the scale of the noise rises where the model cannot follow
