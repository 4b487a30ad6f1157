"""Follow a recording step by step: from where its path is sure, forward, one segment at a time.

A path that is right over a few milliseconds tells, by simulation, where the machine goes next; a few samples
correct that, and the next millisecond follows. An impact is then met from the right side at nearly the right
moment, where a fit of all segments at once, begun from a smoothed path, would tear it apart and stay in that
local minimum. The parameters are fitted to what has been followed so far, again whenever it has doubled, so
that a clearance wrong by a tenth is right before it can lead astray.

Reference: moving-horizon estimation, Rao, Rawlings & Mayne 2003, IEEE Trans. Autom. Control 48(2), 246-258.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, FOLLOWED, tightened
from clearance.diagnosis.following.horizon import AHEAD, Patience, advance
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.shooting.fit import Fit, fit
from clearance.diagnosis.shooting.follow import EDGE, Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.settle import Settled, settle

ISLAND = 6  # segments that must all be followed well where the path is sure
_EDGES = EDGE + 1  # segments at the ends that cannot be judged
ISLANDS = 4  # that are tried
_PROBED = 14  # steps from each
_LOST = 5.0  # doubt from which on steps without unknown forces have not come to follow
BEFORE, AFTER = 2, 3
"""Segments around them that are followed first."""
_FIRST_FIT = 8  # steps before the parameters are fitted; then whenever their number has doubled
_SETTLING = 48  # steps from which on each recording's own unknowns are fitted as well
_JUDGED = 32  # steps before a model may be given up
_HOPES, _PATIENT = 4, 12  # segments at which a path may be lost, and is looked for, between two fits
_NOTHING = np.zeros((1, 0))
Followed = tuple[Follower, np.ndarray, float]
"""One recording's follower, the (unknowns,) values and the misfit."""


@dataclass
class Start:
    """Where a recording can be followed from.

    Attributes:
        trace: of the recording.
        follower: on the smoothed path, with unknown forces.
        island: first segment of those that are followed best.
        doubt: cost a sample of the steps that follow them.
    """

    trace: Trace
    follower: Follower
    island: int
    doubt: float

    @staticmethod
    def of(
        trace: Trace, model: Model, looseness: float, patience: int = 0, islands: int = ISLANDS
    ) -> "Start":
        """Smooth the path with unknown forces and see where that succeeds best.

        Args:
            trace: of the recording.
            model: without unknowns.
            looseness: unknown forces over the joint's typical one.
            patience: segments at which the path may be lost, and is looked for, where no island is followed
                from.
            islands: that are tried, the surest ones.
        """
        follower, places = _smoothed(trace, model, looseness)
        tried: list[Start] = []
        for island in places[:islands]:
            tried.append(_locked(trace, follower, model, island, Patience(0)))
            if tried[-1].doubt < FOLLOWED:
                break
        hopes = Patience(patience)
        for start in sorted(tried, key=lambda start: start.doubt):
            if not hopes.left or min(one.doubt for one in tried) < FOLLOWED:
                break
            hopes.follow()
            tried.append(_locked(trace, follower, model, start.island, hopes))
        best = min(tried, key=lambda start: start.doubt, default=None)
        if best is None or best.doubt > _LOST:  # physics is missing: better the path with unknown forces
            surest = places[0] if places else _EDGES
            return Start(trace, follower, surest, np.inf if best is None else best.doubt)
        return best

    @staticmethod
    def several(trace: Trace, model: Model, looseness: float, count: int) -> "list[Start]":
        """From each of the ``count`` surest islands, the least doubtful one first; as of ``of``."""
        follower, islands = _smoothed(trace, model, looseness)
        tried = [_locked(trace, follower, model, island, Patience(0)) for island in islands[:count]]
        return sorted(tried, key=lambda start: start.doubt)

    def without(self, channel: str) -> "Start":
        """The same with a channel that says nothing."""
        follower = self.follower.part(0, self.follower.segments)
        follower.measured = follower.measured.without(channel)
        return Start(self.trace, follower, self.island, self.doubt)


def grow(
    start: Start,
    model: Model,
    values: np.ndarray,
    limit: float = np.inf,
    most: int | None = None,
    patient: bool = False,
    until: float = np.inf,
) -> Followed | None:
    """Follow a recording from its island as far as is wanted.

    Args:
        start: of the recording; not changed.
        model: with unknowns or without.
        values: (unknowns,) to begin with.
        limit: misfit above which the model is given up on the way.
        most: segments, at most; as many as the trace wants if ``None``.
        patient: whether the path is looked for however badly it is followed so far; it may be given up at
            the first fit.
        until: when ``time.monotonic`` says that, no lost path is looked for any more.

    Returns:
        The follower of what was followed, the (unknowns,) values found and the misfit; ``None`` where the
        model is given up.

    Raises:
        InputError: a law does not take the values.
    """
    held = model.held(values)
    follower = landed(start.follower, held, start.island)
    first = start.island - BEFORE
    end = min(first + (most or start.trace.length), follower.segments)
    rows = values[None].copy()
    found, steps, due = None, 0, _FIRST_FIT
    hopes = Patience(_PATIENT if patient else _HOPES if start.doubt < FOLLOWED else 0, until)
    segment = start.island + ISLAND + AFTER - AHEAD
    while segment < end:
        advance(follower, held, segment, end, hopes, first)
        segment += 1
        steps += 1
        if steps < due and (segment < end or found is not None):
            continue
        due = 2 * steps
        kept = [i for i, unknown in enumerate(model.unknowns) if steps >= _SETTLING or not unknown.own]
        part = model.only(kept, rows[0])
        found, scale = _fitted(
            follower, part, rows[:, kept], values[None, kept], first, min(segment + 1, end)
        )
        rows[:, kept] = found.values
        held = model.held(rows[0])
        # a path is looked for where a model that is right so far loses it, not where physics is missing
        hopes = Patience(_PATIENT if patient else _HOPES if found.level * scale**2 < FOLLOWED else 0, until)
        if steps >= (_FIRST_FIT if patient else _JUDGED) and found.level * scale**2 > limit:
            return None
    assert found is not None
    return follower.part(first, end), rows[0], found.level * scale**2


def _smoothed(trace: Trace, model: Model, looseness: float) -> tuple[Follower, list[int]]:
    """The smoothed path with unknown forces, and islands on it, the surest first."""
    follower = trace.follower(looseness)
    for scale in (ANNEALING[0], ANNEALING[2]):
        found = settle([follower], model, _NOTHING, 8, 5e-2, 1, tries=2, scale=scale)
    each = found.passes[0].each
    last = max(_EDGES + 1, min(trace.margin, len(each) - ISLAND - _PROBED - _EDGES))
    worst = np.full(last, np.inf)
    for i in range(_EDGES, last):
        worst[i] = each[i : i + ISLAND].max()
    islands: list[int] = []
    while np.isfinite(worst.min()):
        island = int(np.argmin(worst))
        islands.append(island)
        worst[max(island - ISLAND, 0) : island + ISLAND] = np.inf
    return follower, islands


def landed(follower: Follower, model: Model, island: int) -> Follower:
    """A follower without unknown forces that is right on an island, where that is possible."""
    own = tightened([follower])[0]
    for scale in (ANNEALING[2], ANNEALING[3], ANNEALING[4]):
        settle(
            [own], model, _NOTHING, 6, 3e-2, 1, tries=3, first=island - BEFORE,
            last=island + ISLAND + AFTER, scale=scale,
        )  # fmt: skip
    return own


def _locked(trace: Trace, follower: Follower, model: Model, island: int, patience: Patience) -> Start:
    """Where a path from an island has come to follow: within some steps even from a wrong one, or sought."""
    own = landed(follower, model, island)
    first = island + ISLAND + AFTER - AHEAD
    for segment in range(first, min(first + _PROBED, own.segments - AHEAD)):
        advance(own, model, segment, own.segments, patience, island - BEFORE)
    last = min(first + _PROBED + AHEAD, own.segments)
    found = settle([own], model, _NOTHING, 0, first=island - BEFORE, last=last)
    each = found.passes[0].each[: -AHEAD - 1]
    worst = [each[i : i + ISLAND].max() for i in range(BEFORE, len(each) - ISLAND + 1)]
    own.input_sigma = follower.input_sigma
    return Start(trace, own, island + int(np.argmin(worst)), float(min(worst)))


def _fitted(
    follower: Follower, model: Model, values: np.ndarray, home: np.ndarray, first: int, last: int
) -> tuple[Settled, float]:
    """Fit the parameters to a stretch, at ever smaller scales of the noise as long as the model follows."""
    held = settle([follower], model, values, 0, first=first, last=last)
    begin = scale_of(held.level)
    found, reached = None, begin
    calibrated = bool(follower.measured.tolerances.open(follower.measured.channels))
    fitted = fit if calibrated else settle
    for scale in [s for s in ANNEALING if s <= begin]:
        path, measured = follower.path.copy(), follower.measured
        other = fitted([follower], model, values, 5, 2e-2, 1, home=home, first=first, last=last, scale=scale)
        if found is not None and other.level * scale**2 > found.level * reached**2:
            follower.path, follower.measured = path, measured
            break
        found, values, reached = other, other.values, scale
        if other.level > 0.5 * FOLLOWED:
            break
    assert found is not None
    if isinstance(found, Fit):  # what it left open of the sensors counts as noise in the steps that follow
        follower.measured = follower.measured.calibrated(follower.measured.sensors, found.covariance)
    return found, reached


def surest_of(starts: Sequence[Start]) -> int:
    """The recording that is followed with the least doubt."""
    return int(np.argmin([start.doubt for start in starts]))


def scale_of(misfit: float) -> float:
    """The smallest scale of the noise at which a model with a misfit follows."""
    return next((s for s in ANNEALING[::-1] if misfit < FOLLOWED * s**2), ANNEALING[0])
