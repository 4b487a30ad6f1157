"""From nothing to a simulator that runs beside the recording: step in at a match, then follow it outwards."""

from collections.abc import Callable

import numpy as np

from clearance.diagnosis.fit import GOAL, Fit, Model, fit
from clearance.diagnosis.follow import Follower
from clearance.diagnosis.start import STRETCH, Match

ANNEALING = (100.0, 31.6, 10.0, 3.16, 1.0)  # factors on the noise while a guess is far from a solution
GOOD = 3.0  # robust cost a sample up to which a stretch counts as followed
_OVERLAP = 14  # segments that are fitted once more when new ones join
_LONGEST, _SHORTEST = 12, 2  # segments predicted at once
_STEADY = 0.002  # how far a node may be wrong whose past was followed, against a guess


def _fixed(model: Model, values: np.ndarray) -> Model:
    machine = model.machine(values)
    return Model((), lambda _: machine)


_NOTHING = np.zeros((1, 0))


def step_in(
    follower: Follower,
    model: Model,
    values: np.ndarray,
    match: Match,
    length: int,
) -> tuple[np.ndarray, float, float]:
    """Fit the first stretch, then lengthen it while clearance and speed settle.

    Args:
        follower: with an empty path.
        model: whose unknowns are fitted as the stretch grows.
        values: (unknowns,) start.
        match: where to begin.
        length: segments to follow.

    Returns:
        (unknowns,) values; the path is followed from ``match.segment`` on for ``settled`` segments.
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
    level = np.inf
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


def follow_on(
    follower: Follower,
    model: Model,
    values: np.ndarray,
    first: int,
    start: int,
    scale: float = 1.0,
    report: Callable[[int], None] | None = None,
) -> tuple[np.ndarray, float, list[tuple[int, float]]]:
    """Follow the recording from segment ``start`` to its end; its past is followed from ``first`` on.

    Returns:
        (unknowns,) values, and segments where the simulator could not follow, with the cost a sample there.
    """
    machine, fixed = model.machine(values), _fixed(model, values)
    last, hop, refit = start, _LONGEST, start + (start - first) // 2
    trouble = []
    while last < follower.segments:
        if last >= refit:
            values = fit(
                [follower], model, values[None], 3, 1e-2, 1, first=first, last=last, scale=scale
            ).values[0]
            machine, fixed = model.machine(values), _fixed(model, values)
            refit = last + max((last - first) // 2, 2)
        new = min(hop, follower.segments - last)
        before = follower.path.copy()
        follower.extend(machine, last - 1, new)
        found = _settle(follower, fixed, max(first, last - _OVERLAP), last + new, scale)
        level = found.level
        if level > GOOD and new > _SHORTEST:
            follower.path = before
            hop = max(_SHORTEST, new // 2)
            continue
        if level > GOOD:
            if scale < ANNEALING[0]:
                follower.path = before
                scale *= STEP
                continue
            trouble.append((last, level))
        last += new
        hop = min(_LONGEST, hop + 3)
        if report is not None:
            report(last)
    return values, scale, trouble


def _settle(
    follower: Follower, model: Model, first: int, last: int, scale: float = 1.0, doubt: float = _STEADY
) -> Fit:
    return fit(
        [follower],
        model,
        _NOTHING,
        4,
        5e-2,
        1,
        mending=False,
        goal=GOAL,
        first=first,
        last=last,
        scale=scale,
        doubt=doubt,
    )
