"""From nothing to a simulator that runs beside the recording: step in at a match, then follow it outwards."""

from collections.abc import Callable

import numpy as np

from clearance.diagnosis.fit import GOAL, Fit, Model, fit
from clearance.diagnosis.follow import Follower
from clearance.diagnosis.start import STRETCH, Match

ANNEALING = (30.0, 10.0, 3.0, 1.0)  # factors on the noise while a guess is far from a solution
GOOD = 3.0  # robust cost a sample up to which a stretch counts as followed
_OVERLAP = 14  # segments that are fitted once more when new ones join
_LONGEST, _SHORTEST = 12, 2  # segments predicted at once
_STEADY = 0.002  # how far a node may be wrong whose past was followed, against a guess


def _fixed(model: Model, values: np.ndarray) -> Model:
    machine = model.machine(values)
    return Model((), lambda _: machine)


_NOTHING = np.zeros((1, 0))


def step_in(follower: Follower, model: Model, values: np.ndarray, match: Match) -> np.ndarray:
    """Fit the first stretch, then lengthen it while clearance and speed settle.

    Args:
        follower: with an empty path.
        model: whose unknowns are fitted as the stretch grows.
        values: (unknowns,) start.
        match: where to begin.

    Returns:
        (unknowns,) values; the path is followed from ``match.segment`` on for ``settled`` segments.
    """
    first = match.segment
    last = first + STRETCH
    follower.path.nodes[first:last] = match.nodes
    follower.path.inputs[:] = 0.0
    for scale in ANNEALING:
        fit([follower], _fixed(model, values), _NOTHING, 8, 2e-2, 1, first=first, last=last, scale=scale)
    while last < min(first + SETTLED, follower.segments):
        values = fit([follower], model, values[None], 3, 5e-2, 1, goal=GOAL, first=first, last=last).values[0]
        new = min(max(3, (last - first) // 4), follower.segments - last)
        follower.extend(model.machine(values), last - 1, new)
        last += new
    values = fit([follower], model, values[None], 6, 1e-2, 1, first=first, last=last).values[0]
    return values


SETTLED = 80  # segments after which clearance and speed are good enough to follow the rest


def follow_on(
    follower: Follower,
    model: Model,
    values: np.ndarray,
    first: int,
    start: int,
    report: Callable[[int], None] | None = None,
) -> tuple[np.ndarray, list[tuple[int, float]]]:
    """Follow the recording from segment ``start`` to its end; its past is followed from ``first`` on.

    Returns:
        (unknowns,) values, and segments where the simulator could not follow, with the cost a sample there.
    """
    machine, fixed = model.machine(values), _fixed(model, values)
    last, hop, refit = start, _LONGEST, start + (start - first) // 2
    trouble = []
    while last < follower.segments:
        if last >= refit:
            values = fit([follower], model, values[None], 3, 1e-2, 1, first=first, last=last).values[0]
            machine, fixed = model.machine(values), _fixed(model, values)
            refit = last + max((last - first) // 2, 2)
        new = min(hop, follower.segments - last)
        before = follower.path.copy()
        follower.extend(machine, last - 1, new)
        found = _settle(follower, fixed, max(first, last - _OVERLAP), last + new)
        level = found.cost / found.passes[0].samples
        if level > GOOD and new > _SHORTEST:
            follower.path = before
            hop = max(_SHORTEST, new // 2)
            continue
        if level > GOOD:
            for scale in ANNEALING:
                found = _settle(follower, fixed, max(first, last - _OVERLAP), last + new, scale=scale)
            level = found.cost / found.passes[0].samples
            if level > GOOD:
                trouble.append((last, level))
        last += new
        hop = min(_LONGEST, hop + 3)
        if report is not None:
            report(last)
    return values, trouble


def _settle(
    follower: Follower, model: Model, first: int, last: int, scale: float = 1.0, doubt: float = _STEADY
) -> Fit:
    return fit([follower], model, _NOTHING, 4, 5e-2, 1, mending=False, goal=GOAL, first=first, last=last, scale=scale, doubt=doubt)
