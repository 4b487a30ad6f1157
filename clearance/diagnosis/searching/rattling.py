"""Play of the slider in its guide: a shoe that rattles between rails is lost at many strikes.

Where it hangs between them nothing is seen of its height and its tilt, and one strike tells either where it
was or how wide the gap is. So a path is begun on an island where it seems to be right. At each strike the
states that are possible are drawn, clearance and gap with them, and every way on that agrees with what is
measured is followed, the likeliest first, until one agrees with all strikes. A machine that is known is tried
from false islands, too: there a path comes to follow by chance, or its first fit shows that it does not.

References: Russell & Norvig 2010, Artificial Intelligence, sec. 3.4.3 (search in depth); Gordon, Salmond &
Smith 1993, IEE Proc. F 140(2) (draws of what is not seen).
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from clearance.diagnosis.following.attempt import (
    ANNEALING,
    LOOSENESS,
    POOR,
    Attempt,
    explained,
    refine,
    tightened,
)
from clearance.diagnosis.following.growth import (
    BEFORE,
    ISLAND,
    TORN,
    Followed,
    Start,
    grow,
    landed,
    scale_of,
)
from clearance.diagnosis.following.horizon import step
from clearance.diagnosis.following.particles import Found, ways_on
from clearance.diagnosis.following.stretches import SHORT, stretches
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.kinematics.shaking import LIFTED
from clearance.diagnosis.searching.balance import suggest_forces
from clearance.diagnosis.searching.beside import beside
from clearance.diagnosis.searching.everywhere import fit_from
from clearance.diagnosis.searching.explanation import Explanation, Rails
from clearance.diagnosis.searching.geometry import (
    LOOSE_GUIDE,
    RAILED,
    SECOND,
    Dimension,
    Shown,
    measure_rails,
    suggest_guide,
)
from clearance.diagnosis.searching.parts import PART
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.shooting.covariance import deviations
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError

_GAPS = (1.0, 0.95, 1.05, 0.9, 1.1)  # times that which the motion shows
_TRIES = ((1.0, False), (1.0, True), *((gap, False) for gap in _GAPS[1:]), (0.9, True), (1.1, True))
"""These, from islands or, which takes longer, from short stretches."""
_MOTION, _KNOWN = (0.01, 0.05), (0.001, 0.003)
"""Standard deviations of clearance and gap, as shares of them: from the motion, from another recording."""
_GAP = 1  # its place among the unknowns
_ISLANDS = 8  # of a recording that are tried
_LIKELY = 10.0  # doubt up to which an island may be right
_AGREES = 1.5  # cost a sample of a segment that is followed
_SHARE = 0.6  # of the time that is left: rails may be false, and something else is to be tried then
_STRETCHES = 12  # short stretches that are followed on
_BEGUN = 40  # segments that are followed until clearance and gap are known
_FITTED = 8  # of them between two fits
_TOLD = 24  # of them that tell both, where no way leads on
_LOOKS = 24  # times that states are drawn on them
_HOPELESS = 30.0  # misfit of the first fit from a false island
_MUCH, _FORCES = 0.5, 2  # of the imbalance: forces that leave less are tried; how many
_Forces = tuple[tuple[Hypothesis, ...], np.ndarray]
_NOTHING: _Forces = ((), np.zeros(0))
_Ways = list[tuple[int, Iterator[Found | None]]]
"""Segments at which a path was lost, and what is left of the ways on from each."""


def begin_guide(
    search: Search,
    explanation: Explanation,
    shown: Shown | None = None,
    forces: Sequence[Hypothesis] = (),
    sizes: np.ndarray | None = None,
    most: float = RAILED,
) -> bool:
    """Fit play of the slider in its guide, from the gap that the motion shows.

    On four machines that is off by 5 to 22 %, and the clearance beside it by 0.5 to 3 %. Where no sensor on
    the slider feels its height, play in the other joint shows the same motion of the rod: rails are believed
    then only once a path was followed between them. What strikes at rails turns the crank, so that the
    balance of work is asked again between them.

    Args:
        search: after its nominal stage.
        explanation: added to.
        shown: what else the motion shows; if ``None`` nothing.
        forces: that the motion does not show and that are followed with it.
        sizes: (unknowns,) of these; if ``None`` forces are tried that the balance of work suggests.
        most: of the motion's disagreement that rails may leave.

    Returns:
        Whether the motion shows rails, or a gap in the other joint that looked like some explains most; not
        asked where so many effects may not be missing together.
    """
    shown = Shown.nothing(search) if shown is None else shown
    room = search.most - 1 - len(shown.hypotheses)
    if len(forces) > room:
        return False
    try:
        one = suggest_guide(search, shown, most)
        if one is None:
            return False
        if all(LIFTED in recording.channels for recording in search.recordings):
            explanation.rails = measure_rails(search, one, shown)
        elif not (shown.hypotheses or forces) and _other_gap(search, explanation, one.value):
            return True
        explanation.rattles = one.share
    except np.linalg.LinAlgError:
        return False
    if sizes is not None:
        sets = [(tuple(forces), sizes)]
    elif shown.hypotheses or not room:
        sets = [_NOTHING]
    else:
        sets = [some for some in _forces_between(search, one) if len(some[0]) <= room] or [_NOTHING]
        if explanation.rails is not None and len(sets) == 1:  # what is sure stands, though no path is found
            explanation.rails = explanation.rails.with_forces(*sets[0])
    found, until = None, time.monotonic() + _SHARE * (search.deadline - time.monotonic())

    def late() -> bool:
        return time.monotonic() > until or search.late()

    for (factor, shortly), (also, their) in product(_TRIES, sets):
        others, known = (*shown.hypotheses, *also), np.concatenate([shown.sizes, their])
        held, values = beside(
            explanation.nominal, [one.hypothesis, *others], np.append(factor * one.value, known)
        )  # fmt: skip
        values[:, 0] = one.clearance
        model = search.setting.model(held)
        found = _first(search, model, values, shortly, late)
        if found is not None or late():
            break
    if found is not None:
        first, followed = found
        search.keep(explanation, held, lambda: _everywhere(search, held, model, first, followed))
        if not explained(explanation.best):
            explanation.rails = _told(held, model, followed) or explanation.rails
    return True


def _other_gap(search: Search, explanation: Explanation, gap: float) -> bool:
    """Whether play in joint C, as wide as rails would leave the slider, explains most of what is missing.

    By the sensors on the rod it can look like rails: 314 um of it showed as 306 um between these.
    """
    other = next((g[0] for g in search.groups.values() if g[0].name == SECOND), None)
    if other is None or search.setting.joint != "B":
        return False
    nominal, size = explanation.nominal, np.array([gap])
    found = fit_from(search, explanation, nominal, [other], size, search.profile.best, anew=True)
    return found is not None and found.misfit < PART * nominal.misfit


def _forces_between(search: Search, one: Dimension) -> list[_Forces]:
    """What gives much of the torque which the motion between rails needs, and nothing, the likeliest first.

    Each strike leaves torques that no force gives.
    """
    try:
        setting = search.setting.added([one.hypothesis], np.array([one.value]))
        suggested = suggest_forces(search, setting, one.clearance, named=True)
    except (InputError, np.linalg.LinAlgError):
        suggested = None
    if suggested is None:
        return [_NOTHING]
    if suggested.sure is not None:
        return [(suggested.sure.hypotheses, suggested.sure.values)]
    found: dict[str, _Forces] = {}
    for force in suggested.forces:
        if force.cost < _MUCH * suggested.lacking and len(found) < _FORCES:
            found.setdefault(force.hypotheses[0].name, (force.hypotheses, force.values))
    return [*found.values(), _NOTHING]


def between_rails(search: Search, rails: Rails) -> Attempt | None:
    """The machine that was seen between rails, on the paths that the motion shows; nothing is fitted."""
    hypothesis = next(group[0] for group in search.groups.values() if group[0].name == LOOSE_GUIDE)
    held = (hypothesis, *rails.beside)
    model = search.setting.model(held)
    row = np.array([rails.clearance, rails.gap, *rails.sizes])
    known = np.append(row, search.traces[0].speed)
    try:
        traces = _traces(search, model, known)
        values = np.array([np.append(row, trace.speed) for trace in traces])
        followers = tightened([trace.follower(LOOSENESS) for trace in traces])
        found = fit(followers, model, values, 0, 1.0, search.workers, scale=ANNEALING[2])
    except (InputError, np.linalg.LinAlgError):
        return None
    reach = 1.96 * np.repeat(rails.deviations[:, None], 2, axis=1)
    return Attempt(held, model, found, ANNEALING[2], found.level, followers, reach=reach)


def _told(held: Sequence[Hypothesis], model: Model, followed: Followed) -> Rails | None:
    """What one recording tells that was followed, if it was to the end."""
    follower, row, misfit = followed
    alone = refine(held, model, [follower], row[None], scale_of(misfit), 8)
    if not explained(alone):
        return None
    clearance, gap, *sizes = alone.fit.values[0, : model.shared]
    return Rails(clearance, gap, deviations(alone.fit), tuple(held[1:]), np.array(sizes), followed=True)


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
    for factor in _GAPS if model.shared > _GAP else _GAPS[:1]:  # rails elsewhere show other islands
        other = row.copy()
        if model.shared > _GAP:
            other[_GAP] *= factor
        starts = Start.several(trace, model.held(other), LOOSENESS, _ISLANDS)
        for start in starts:
            found = _followed(start, model, row, _KNOWN, until)
            if found is not None or late():
                return found
        every += starts
    for start, own in stretches(trace, model, row, len(_KNOWN), late)[:_STRETCHES]:
        found = _followed(start, model, own, _KNOWN, until, SHORT)
        if found is not None or late():
            return found
    for start in sorted(every, key=lambda start: start.doubt)[: 2 * _ISLANDS]:
        found = _grown(start, model, row, until)
        if found is not None or late():
            return found
    return None


def _first(
    search: Search, model: Model, rows: np.ndarray, shortly: bool, late: Callable[[], bool]
) -> tuple[int, Followed] | None:
    """The recording that is followed first, and how: of islands on all recordings, or of short stretches."""
    starts: list[tuple[float, int, Start, np.ndarray]] = []
    for r, row in enumerate(rows):
        try:
            trace = search.retrace(r, model.machine(row), model.instrument(row))
        except np.linalg.LinAlgError:  # no motion between such rails is near
            continue
        here = np.append(row[:-1], trace.speed)
        if shortly:
            found = stretches(trace, model, here, len(_MOTION), late)
        else:
            islands = Start.several(trace, model.held(here), LOOSENESS, _ISLANDS)
            found = [(start, here) for start in islands]
        starts += [(start.doubt, r, start, own) for start, own in found]
    reach, most = (SHORT, _STRETCHES) if shortly else (ISLAND, None)
    for _, r, start, own in sorted(starts, key=lambda one: one[:2])[:most]:
        followed = _followed(start, model, own, _MOTION, reach=reach)
        if followed is not None:
            gap, misfit = followed[1][1] * 1e6, followed[2]
            search.report(f"  between rails that leave {gap:.4g} um: misfit {misfit:.3g} on one recording")
            return r, followed
        if late():
            return None
    return None


def _grown(start: Start, model: Model, row: np.ndarray, until: float) -> Followed | None:
    try:
        found = grow(start, model, row, _HOPELESS, patient=True, until=until)
    except (InputError, np.linalg.LinAlgError):  # the gap has closed
        return None
    return found if found is not None and found[2] < POOR else None


def _followed(
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


def _everywhere(
    search: Search, held: Sequence[Hypothesis], model: Model, first: int, followed: Followed
) -> Attempt | None:
    """Fit to all recordings what the first one tells."""
    traces = _traces(search, model, followed[1])
    rows = np.repeat(followed[1][None], len(traces), axis=0)
    rows[:, -1] = [trace.speed for trace in traces]
    return fit_rattling(traces, model, rows, search.workers, search.late, held, {first: followed})


def _traces(search: Search, model: Model, row: np.ndarray) -> list[Trace]:
    """The paths of all recordings for a machine and instruments with (unknowns,) values."""
    machine, instrument = model.machine(row), model.instrument(row)
    return [search.retrace(r, machine, instrument) for r in range(len(search.recordings))]
