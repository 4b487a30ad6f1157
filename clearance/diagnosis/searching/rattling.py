"""Play of the slider in its guide, which the motion shows, and what is followed with it between its rails."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from clearance.diagnosis.following.attempt import (
    ANNEALING,
    LOOSENESS,
    Attempt,
    explained,
    refine,
    tightened,
)
from clearance.diagnosis.following.growth import (
    ISLAND,
    Followed,
    Start,
    scale_of,
)
from clearance.diagnosis.following.rattling import (
    GAPS,
    ISLANDS,
    MOTION,
    STRETCHES,
    fit_rattling,
    followed_on,
)
from clearance.diagnosis.following.stretches import SHORT, stretches
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting
from clearance.diagnosis.kinematics.shaking import LIFTED
from clearance.diagnosis.searching.balance import settle_in, suggest_forces
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
from clearance.diagnosis.searching.work import Balanced
from clearance.diagnosis.shooting.covariance import deviations
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.model import Model
from clearance.errors import InputError

_TRIES = ((1.0, False), (1.0, True), *((gap, False) for gap in GAPS[1:]), (0.9, True), (1.1, True))
"""Factors on the gap that the motion shows, from islands or, which takes longer, from short stretches."""
_ROUNDS = 3  # times that all are followed, from what one tells that has been torn somewhere
_SHARE = 0.6  # of the time that is left, until rounds begin: rails may be false, and others are tried then
_MUCH, _FORCES = 0.7, 2  # of the imbalance: forces that leave less are tried (0.54 was right); how many


class _Beside(NamedTuple):
    """Forces between rails, and the clearance that goes with them [m]."""

    hypotheses: tuple[Hypothesis, ...]
    sizes: np.ndarray
    clearance: float


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
    nothing = _Beside((), np.zeros(0), one.clearance)
    if sizes is not None:
        sets = [_Beside(tuple(forces), sizes, one.clearance)]
    elif shown.hypotheses or not room:
        sets = [nothing]
    else:
        sets = [some for some in _forces_between(search, one) if len(some.hypotheses) <= room] or [nothing]
        if explanation.rails is not None and len(sets) == 1:  # what is sure stands, though no path is found
            explanation.rails = explanation.rails.with_forces(*sets[0])
    found, until = None, time.monotonic() + _SHARE * (search.deadline - time.monotonic())

    def late() -> bool:
        return time.monotonic() > until or search.late()

    for (factor, shortly), also in product(_TRIES, sets):
        others, known = (*shown.hypotheses, *also.hypotheses), np.concatenate([shown.sizes, also.sizes])
        held, values = beside(
            explanation.nominal, [one.hypothesis, *others], np.append(factor * one.value, known)
        )  # fmt: skip
        values[:, 0] = also.clearance
        model = search.setting.model(held)
        found = _first(search, model, values, shortly, late)
        if found is not None or late():
            break
    for left in reversed(range(_ROUNDS)):
        if found is None:
            break
        first, followed = found
        search.keep(explanation, held, partial(_everywhere, search, held, model, first, followed))
        told = None if explained(explanation.best) else _told(held, model, followed)
        explanation.rails = told or explanation.rails
        if told is not None or explained(explanation.best) or not left or late():
            break
        values[:, : model.shared] = followed[1][: model.shared]  # nearer than what the motion shows
        found = _first(search, model, values, False, late)
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


def _forces_between(search: Search, one: Dimension) -> list[_Beside]:
    """What gives much of the torque which the motion between rails needs, and nothing, the likeliest first.

    Each strike leaves torques that no force gives. With each one the clearance is sought anew: beside a load
    on the slider 0.069 mm showed as 0.072 mm, and no path is followed from a clearance so far off.
    """
    nothing = _Beside((), np.zeros(0), one.clearance)
    found: dict[str, _Beside] = {}
    try:
        setting = search.setting.added([one.hypothesis], np.array([one.value]))
        suggested = suggest_forces(search, setting, one.clearance, named=True)
        if suggested is None:
            return [nothing]
        if suggested.sure is not None:
            return [_settled(search, setting, suggested.sure)]
        for force in suggested.forces:
            name = force.hypotheses[0].name
            if force.cost < _MUCH * suggested.lacking and name not in found and len(found) < _FORCES:
                found[name] = _settled(search, setting, force)
    except (InputError, np.linalg.LinAlgError):
        pass
    return [*found.values(), nothing]


def _settled(search: Search, setting: Setting, force: Balanced) -> _Beside:
    settled = settle_in(search, setting, force)
    return _Beside(settled.hypotheses, settled.values, settled.clearance)


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
            found = stretches(trace, model, here, len(MOTION), late)
        else:
            islands = Start.several(trace, model.held(here), LOOSENESS, ISLANDS)
            found = [(start, here) for start in islands]
        starts += [(start.doubt, r, start, own) for start, own in found]
    reach, most = (SHORT, STRETCHES) if shortly else (ISLAND, None)
    for _, r, start, own in sorted(starts, key=lambda one: one[:2])[:most]:
        followed = followed_on(start, model, own, MOTION, reach=reach)
        if followed is not None:
            gap, misfit = followed[1][1] * 1e6, followed[2]
            search.report(f"  between rails that leave {gap:.4g} um: misfit {misfit:.3g} on one recording")
            return r, followed
        if late():
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
