"""Short stretches all along a path that are followed: where to begin where strikes follow each other closely.

An island (``growth``) has several strikes of a shoe that rattles, and one that is put together wrongly spoils
it. A few milliseconds have one or none. Parameters that are not known yet are fitted to each stretch anew.
"""

from collections.abc import Callable

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, LOOSENESS, tightened
from clearance.diagnosis.following.growth import AFTER, BEFORE, Start
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError

SHORT = 2
"""Segments of a stretch, beside those around it."""
_FIRST, _LAST = 4, 24  # segments from either end: behind the last stretch some must be left to follow
_FOLLOWED = 2.0  # cost a sample of a stretch that is followed, at every scale of the noise


def stretches(
    trace: Trace, model: Model, row: np.ndarray, sought: int, late: Callable[[], bool]
) -> list[tuple[Start, np.ndarray]]:
    """Stretches that are followed from the path itself, the one that is followed best first.

    Args:
        trace: of the recording.
        model: of the machine.
        row: (unknowns,) to begin with.
        sought: how many of the shared ones, the first, each stretch fits anew.
        late: whether the time is over: the rest of the path is then left out.

    Returns:
        Where to begin, and the (unknowns,) values found there.
    """
    drawn = list(range(min(sought, model.shared)))
    part, path = model.only(drawn, row), trace.follower(LOOSENESS)
    found = []
    for place in range(_FIRST, path.segments - _LAST):
        if late():
            break
        own, here = tightened([path])[0], row.copy()
        try:
            here[drawn], doubt = _settled(own, part, row[drawn], place)
        except (InputError, np.linalg.LinAlgError):  # a gap has closed
            continue
        if doubt < _FOLLOWED:
            own.input_sigma = path.input_sigma
            found.append((Start(trace, own, place, doubt), here))
    return sorted(found, key=lambda one: one[0].doubt)


def _settled(follower: Follower, part: Model, home: np.ndarray, place: int) -> tuple[np.ndarray, float]:
    """Values and cost a sample of a stretch; given up at the first scale at which it is not followed."""
    values = home[None]
    for scale in ANNEALING[1:]:
        found = settle(
            [follower], part, values, 6, 3e-2, 1, tries=3, home=home[None], scale=scale,
            first=place - BEFORE, last=place + SHORT + AFTER,
        )  # fmt: skip
        values, doubt = found.values, float(found.passes[0].each[BEFORE:-BEFORE].max())
        if doubt > _FOLLOWED:
            break
    return values[0], doubt
