"""Run on by one segment and correct what came before; put a torn stretch together anew.

Reference: moving-horizon estimation, Rao, Rawlings & Mayne 2003, IEEE Trans. Autom. Control 48(2), 246-258.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from clearance.diagnosis.following.particles import DOUBT, FRESH, Lost, rejoin
from clearance.diagnosis.shooting.follow import EDGE, Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.settle import settle

AHEAD = 2  # segments that are predicted beyond a new one
_HORIZON = 12  # segments that are corrected with a new one
_CORRECTIONS = 3  # iterations of that
_ENOUGH = 1.05  # cost a sample at which a step is good
_GOAL = 1.2  # cost a sample of a stretch that is followed
_KNOWN = 1e-3  # factor on the doubt of a node that stays where it is
TORN = 3.0  # cost a sample of a segment that is not followed
_NOTHING = np.zeros((1, 0))


@dataclass
class Patience:
    """How long a lost path is looked for.

    Where it was not found, a segment more seldom tells where it went (3 of 150 looks that followed another
    did): after each look in vain more than twice as many segments go by before the next. Looks are near and
    wide in turn.

    Attributes:
        lost: segments at which the path may be lost, until it is not looked for any more.
        until: when ``time.monotonic`` says that, it is not looked for either.
        limit: cost a sample of a segment from which on a path is lost.
    """

    lost: int
    until: float = np.inf
    limit: float = TORN
    _vain: int = field(default=0, init=False)
    _pause: int = field(default=0, init=False)

    @property
    def left(self) -> bool:
        """Whether a path is looked for at all."""
        return self.lost > 0 and time.monotonic() < self.until

    def follow(self) -> None:
        """Nothing is lost at a segment."""
        self._vain = self._pause = 0

    def look(self) -> bool:
        """The path is lost at a segment; whether it is worth a look."""
        self.lost -= 1
        if self._pause > 0:
            self._pause -= 1
            return False
        self._vain += 1
        self._pause = 2**self._vain - 2
        return True

    @property
    def wide(self) -> bool:
        """Whether the present look is a wide one."""
        return self._vain % 2 == 0

    def find(self) -> None:
        """A look led to the path again."""
        self.lost += 1
        self.follow()


def advance(
    follower: Follower, fixed: Model, segment: int, end: int, patience: Patience, begin: int = 0
) -> None:
    """Run on from a segment that is known, and correct it and those before it by what it should show.

    Args:
        follower: whose path after the segment is replaced.
        fixed: model without unknowns.
        segment: that is known, up to what the next samples correct.
        end: segment up to which the path is known; the arrival at it may be written into its node.
        patience: with which a path that is lost is looked for.
        begin: first segment that is followed: what lies before is not looked for.
    """
    limit = patience.limit if patience.left else np.inf
    lost = _step(follower, fixed, segment, end, limit, max(segment - _HORIZON, 0), begin, DOUBT)
    if lost is None:
        patience.follow()
    elif patience.look() and rejoin(lost, fixed, limit, patience.wide):
        patience.find()


def step(follower: Follower, fixed: Model, segment: int, end: int, limit: float, begin: int) -> Lost | None:
    """As ``advance``, where nothing is known before ``begin``; says what is lost and does not look for it."""
    first = max(segment - _HORIZON, begin)
    return _step(follower, fixed, segment, end, limit, first, begin, FRESH if first == begin else DOUBT)


def _step(
    follower: Follower,
    fixed: Model,
    segment: int,
    end: int,
    limit: float,
    first: int,
    begin: int,
    doubt: float,
) -> Lost | None:
    machine = fixed.machine(_NOTHING[0])
    last = min(segment + 1 + AHEAD, end)
    for place in range(segment, min(last, follower.segments - 1)):
        follower.path.nodes[place + 1] = follower.arrival(machine, place)
    found = settle(
        [follower], fixed, _NOTHING, _CORRECTIONS, 1e-1, 1, goal=_ENOUGH, first=first, last=last, doubt=doubt
    )
    own = max(first, begin)
    lost = found.passes[0].each[own - first :][EDGE:-EDGE] > limit
    return Lost(follower, own, last, own + EDGE + int(np.argmax(lost)), own == begin) if lost.any() else None


def mend(follower: Follower, fixed: Model, first: int, last: int, limit: float = np.inf) -> None:
    """Put a short stretch together anew between what is known on both sides; kept where that is better.

    Args:
        follower: with a path; changed from ``first`` to ``last``.
        fixed: model without unknowns.
        first: first segment.
        last: one beyond the last.
        limit: cost a sample of a segment from which on the path is looked for, until that fails.
    """
    first, last = max(first, 0), min(last, follower.segments)
    inside = last < follower.segments
    before = follower.path.copy()

    def joined(scales: Sequence[float]) -> float:
        for scale in scales:
            found = settle(
                [follower], fixed, _NOTHING, 4, 5e-2, 1, goal=_GOAL if scale == 1.0 else 0.0,
                first=first, last=last, scale=scale, doubt=_KNOWN, inside=inside,
            )  # fmt: skip
        return found.cost / max(found.passes[0].samples, 1)

    cost = joined((10.0, 3.0, 1.0))
    if cost < _GOAL:
        return
    best, follower.path = follower.path, before.copy()
    patience = Patience(2, limit=limit)
    for segment in range(first, last - 1):
        advance(follower, fixed, segment, last, patience)
    follower.path.nodes[:first] = before.nodes[:first]  # what came before is no part of the comparison
    if inside:
        follower.path.nodes[last - 1 :] = before.nodes[last - 1 :]
    if not joined((3.0, 1.0)) < cost:
        follower.path = best


def islands(mask: np.ndarray, margin: int) -> list[tuple[int, int]]:
    """Ranges around what is set, joined where they touch."""
    wide = np.convolve(mask, np.ones(2 * margin + 1), "same") > 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wide, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
