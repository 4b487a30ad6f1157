"""How a shoe is followed that rattles between the rails of its guide and is lost at many strikes.

Where it hangs between them nothing is seen of its height and its tilt, and one strike tells either where it
was or how wide the gap is. So a path is begun on an island where it seems to be right. At each strike the
states that are possible are drawn, clearance and gap with them, and every way on that agrees with what is
measured is followed, the likeliest first, until one agrees with all strikes. A machine that is known is tried
from false islands, too: there a path comes to follow by chance, or its first fit shows that it does not.

References: Russell & Norvig 2010, Artificial Intelligence, sec. 3.4.3 (search in depth); Gordon, Salmond &
Smith 1993, IEE Proc. F 140(2) (draws of what is not seen).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from clearance.diagnosis.following.attempt import LOOSENESS, POOR, Attempt, refine, tightened
from clearance.diagnosis.following.growth import (
    BEFORE,
    ISLAND,
    Followed,
    Start,
    grow,
    landed,
    scale_of,
)
from clearance.diagnosis.following.horizon import TORN, step
from clearance.diagnosis.following.particles import Found, ways_on
from clearance.diagnosis.following.stretches import SHORT, stretches
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError

GAPS = (1.0, 0.95, 1.05, 0.9, 1.1)
"""Factors on the gap that the motion shows."""
MOTION, _KNOWN = (0.01, 0.05), (0.001, 0.003)
"""Standard deviations of clearance and gap, as shares of them: from the motion, from another recording."""
ISLANDS = 8
"""Islands of a recording that are tried."""
STRETCHES = 12
"""Short stretches that are followed on."""
_GAP = 1  # its place among the unknowns
_LIKELY = 10.0  # doubt up to which an island may be right
_AGREES = 1.5  # cost a sample of a segment that is followed
_BEGUN = 40  # segments that are followed until clearance and gap are known
_FITTED = 8  # of them between two fits
_TOLD = 24  # of them that tell both, where no way leads on
_LOOKS = 24  # times that states are drawn on them
_HOPELESS = 30.0  # misfit of the first fit from a false island
_Ways = list[tuple[int, Iterator[Found | None]]]
"""Segments at which a path was lost, and what is left of the ways on from each."""


def fit_rattling(
    traces: Sequence[Trace],
    model: Model,
    rows: np.ndarray,
    workers: int,
    late: Callable[[], bool],
    hypotheses: Sequence[Hypothesis],
    known: Mapping[int, Followed],
) -> Attempt | None:
    """Fit a machine to recordings that are each followed from one of their islands, if all are.

    Args:
        traces: of the recordings.
        model: of the machine.
        rows: (recordings, unknowns) to begin with.
        workers: threads.
        late: whether the time is over: no other island is then tried.
        hypotheses: that the model is of.
        known: recordings that were followed before.
    """
    each = dict(known)
    for r, trace in enumerate(traces):
        found = each.get(r) or follow_rattling(trace, model, rows[r], late)
        if found is None:
            return None
        each[r] = found
    order = range(len(traces))
    values, misfit = np.stack([each[r][1] for r in order]), float(np.mean([each[r][2] for r in order]))
    values[:, : model.shared] = values[:, : model.shared].mean(axis=0)
    return refine(hypotheses, model, [each[r][0] for r in order], values, scale_of(misfit), 8, workers)


def follow_rattling(
    trace: Trace, model: Model, row: np.ndarray, late: Callable[[], bool], until: float = np.inf
) -> Followed | None:
    """Follow a recording with a machine that is known, from whichever island that succeeds.

    Args:
        trace: of the recording.
        model: of the machine.
        row: (unknowns,) to begin with.
        late: whether the time is over: no other island is then tried.
        until: as of ``grow``.
    """
    every = []
    for factor in GAPS if model.shared > _GAP else GAPS[:1]:  # rails elsewhere show other islands
        other = row.copy()
        if model.shared > _GAP:
            other[_GAP] *= factor
        starts = Start.several(trace, model.held(other), LOOSENESS, ISLANDS)
        for start in starts:
            found = followed_on(start, model, row, _KNOWN, until)
            if found is not None or late():
                return found
        every += starts
    for start, own in stretches(trace, model, row, len(_KNOWN), late)[:STRETCHES]:
        found = followed_on(start, model, own, _KNOWN, until, SHORT)
        if found is not None or late():
            return found
    for start in sorted(every, key=lambda start: start.doubt)[: 2 * ISLANDS]:
        found = _grown(start, model, row, until)
        if found is not None or late():
            return found
    return None


def _grown(start: Start, model: Model, row: np.ndarray, until: float) -> Followed | None:
    try:
        found = grow(start, model, row, _HOPELESS, patient=True, until=until)
    except (InputError, np.linalg.LinAlgError):  # the gap has closed
        return None
    return found if found is not None and found[2] < POOR else None


def followed_on(
    start: Start,
    model: Model,
    row: np.ndarray,
    shares: Sequence[float],
    until: float = np.inf,
    reach: int = ISLAND,
) -> Followed | None:
    """Follow from an island that may be right; ``shares``: how well clearance and gap are known."""
    try:
        begun = _begun(start, model, row, shares, reach) if start.doubt < _LIKELY else None
    except (InputError, np.linalg.LinAlgError):
        return None
    return None if begun is None else _grown(begun[0], model, begun[1], until)


def _begun(
    start: Start, model: Model, row: np.ndarray, shares: Sequence[float], reach: int = ISLAND
) -> tuple[Start, np.ndarray] | None:
    """Follow some strikes from an island, or from a shorter ``reach`` of segments that is followed already.

    Returns:
        Where to begin from then, and the values found.
    """
    drawn = list(range(min(len(shares), model.shared)))
    part, home = model.only(drawn, row), row[drawn]
    deviations = np.array(shares)[drawn] * home
    follower, first = start.follower, start.island - BEFORE
    if reach == ISLAND:
        follower = landed(follower, model.held(row), start.island)
    else:
        follower = tightened([follower])[0]
    segment, values = start.island + reach, home
    fitted, end = segment, min(first + _BEGUN, follower.segments - 1)
    ways: _Ways = []
    looks = iter(range(_LOOKS))
    while segment < end:
        lost = step(follower, part.held(values), segment, follower.segments, TORN, first)
        segment += 1
        if lost is not None:
            here, told = follower.path.copy(), segment >= first + _TOLD
            ways.append((segment, ways_on(lost, part, values, home, deviations, _AGREES)))
            way = _next(ways, looks, told)
            if way is None and not told:
                return None
            if way is None:  # the rest is for one who knows clearance and gap
                follower.path = here
                break
            segment, found = way
            follower.path, values, fitted = found.path.copy(), found.values, segment
        elif drawn and segment - fitted >= _FITTED:
            fitted = segment
            values = settle(
                [follower], part, values[None], 5, 2e-2, 1, home=home[None], first=first, last=segment
            ).values[0]
    follower.input_sigma = start.follower.input_sigma
    found_row = row.copy()
    found_row[drawn] = values
    return Start(start.trace, follower, start.island, start.doubt), found_row


def _next(ways: _Ways, looks: Iterator[int], alone: bool) -> tuple[int, Found] | None:
    """The next way on from the last place, or, unless that counts ``alone``, from one before it."""
    while ways:
        segment, others = ways[-1]
        for found in others:
            if next(looks, None) is None:
                return None
            if found is not None:
                return segment, found
        ways.pop()
        if alone:
            return None
    return None
