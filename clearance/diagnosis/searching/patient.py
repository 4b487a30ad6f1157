"""Where nothing is followed: one effect after another with patience, from islands of the motion alone.

A machine that lacks something loses a recording at each impact, and a path that was looked for in vain some
times is given up. With the right effect every loss can be mended, whatever its size was begun at: the first
impacts that are met tell it. So each effect is followed patiently on one recording; wrong ones are given up
within some steps. What is followed best there is fitted to all. A part may stand for a force that is like it
on its body, and for the other of two.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from clearance.diagnosis.following.attempt import LOOSENESS, POOR, Attempt, explained, refine
from clearance.diagnosis.following.growth import Followed, Start, grow, scale_of
from clearance.diagnosis.hypotheses.free_form import Curve, free_form
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Hypothesis, same
from clearance.diagnosis.hypotheses.missing_force import PLACES, effect_as_curves
from clearance.diagnosis.searching.beside import NEARLY
from clearance.diagnosis.searching.elsewhere import of_one_size
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import FRAME, GEOMETRIC, LOOSE_GUIDE
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.tables import refine_table
from clearance.errors import InputError

_ISLANDS = 2  # of a recording, from which an effect is followed
_MORE = 4  # of another one, with what the first tells
_PART, _MOST = 0.2, 100.0  # of the nominal misfit of a recording, and misfit, up to which one is followed on
_LESS = 0.3  # of what a part leaves: with the other effect, or another force in its place, less is left
_TABLES = 2  # arguments of a force in the place of a part
_TOLD = (*GEOMETRIC, LOOSE_GUIDE, FRAME)  # by the motion and by the crank's sensors


class _Followed(NamedTuple):
    """Hypotheses with which a recording was followed, and how."""

    held: tuple[Hypothesis, ...]
    found: Followed

    @property
    def misfit(self) -> float:
        return self.found[2]


def begin_patiently(search: Search, explanation: Explanation) -> None:
    """Follow effects patiently on one recording after another, and fit what follows to all.

    Args:
        search: after its nominal stage.
        explanation: added to.
    """
    search.report("nothing is followed yet: one effect after another is tried with patience")
    for r in np.argsort([start.doubt for start in search.starts]):
        limit = float(np.clip(_PART * explanation.nominal.misfits[r], POOR, _MOST))
        part = _best(search, explanation, int(r), None, limit)
        while part is not None and not _over(search, explanation) and part.misfit > POOR:
            limit = max(_LESS * part.misfit, POOR)
            _in_its_place(search, explanation, int(r), part, limit)
            if _over(search, explanation) or len(part.held) >= search.most:
                break
            part = _best(search, explanation, int(r), part, limit)
        if _over(search, explanation):
            return


def _over(search: Search, explanation: Explanation) -> bool:
    return search.late() or explained(explanation.best)


def _best(
    search: Search, explanation: Explanation, r: int, part: _Followed | None, limit: float
) -> _Followed | None:
    """The single effect, beside a part, with which a recording is followed best; fitted to all."""
    before = () if part is None else part.held
    sizes = np.array([search.clearance]) if part is None else part.found[1][:-1]
    tried: list[_Followed] = []
    for hypothesis in _candidates(search, before):
        if search.late():
            break
        held = (*before, hypothesis)
        found = _patiently(search, r, held, np.append(sizes, hypothesis.start), limit, _ISLANDS)
        if found is not None:
            tried.append(_Followed(held, found))
            if found[2] <= POOR and _everywhere(search, explanation, r, tried[-1]):
                return tried[-1]
    best = min(tried, key=lambda one: one.misfit, default=None)
    if best is not None and best.misfit > POOR and not search.late():
        _everywhere(search, explanation, r, best)
    return best


def _candidates(search: Search, before: Sequence[Hypothesis]) -> list[Hypothesis]:
    return [
        group[0]
        for group in search.groups.values()
        if of_one_size(group[0])
        and group[0].fault is None
        and group[0].name not in _TOLD
        and not any(same(group[0], one) for one in before)
    ]


def _patiently(
    search: Search, r: int, held: Sequence[Hypothesis], sizes: np.ndarray, limit: float, islands: int
) -> Followed | None:
    """Follow a recording from its surest islands; ``sizes``: clearance and what hypotheses begin with."""
    model = search.setting.model(held)
    label = " + ".join(one.label for one in held)

    def make() -> Followed | None:
        row = np.append(sizes, search.traces[r].speed)
        trace = search.traces[r]
        if islands > _ISLANDS or any(
            h.structural(search.setting.with_clearance(SOME_CLEARANCE)) for h in held
        ):
            trace = search.retrace(r, model.machine(row), model.instrument(row))
            row[-1] = trace.speed

        def one(start: Start) -> Followed | None:
            try:
                return grow(start, model, row, limit, patient=True)
            except (InputError, np.linalg.LinAlgError):  # the gap has closed
                return None

        starts = Start.several(trace, model.held(row), LOOSENESS, islands)
        found = list[Followed]()
        for first in range(0, len(starts), search.workers):
            with ThreadPoolExecutor(search.workers) as pool:
                some = pool.map(one, starts[first : first + search.workers])
                found += [each for each in some if each is not None]
            if search.late() or any(each[2] <= POOR for each in found):
                break
        return min(found, key=lambda each: each[2], default=None)

    try:
        found = search.finished.followed(f"{label} from {sizes} patiently on {r}", make)
    except (InputError, np.linalg.LinAlgError):
        return None
    if found is not None:
        search.report(f"  {label}: misfit {found[2]:.3g} on one recording")
    return found


def _everywhere(search: Search, explanation: Explanation, r: int, told: _Followed) -> bool:
    """Fit to all recordings what one tells; whether it explains them."""
    model = search.setting.model(told.held)

    def make() -> Attempt | None:
        each = {r: told.found}
        for other in range(len(search.recordings)):
            if other != r:
                sizes, limit = told.found[1][:-1], max(told.misfit / _LESS, POOR)
                found = _patiently(search, other, told.held, sizes, limit, _MORE)
                if found is None:
                    return None
                each[other] = found
        order = range(len(each))
        values, misfit = np.stack([each[o][1] for o in order]), float(np.mean([each[o][2] for o in order]))
        surest = min(order, key=lambda o: each[o][2])
        values[:, : model.shared] = values[surest, : model.shared]
        followers = [each[o][0] for o in order]
        return refine(told.held, model, followers, values, scale_of(misfit), 8, search.workers)

    found = search.keep(explanation, told.held, make)
    return found is not None and explained(found)


def _in_its_place(search: Search, explanation: Explanation, r: int, part: _Followed, limit: float) -> None:
    """Follow with a force of free form that acts as the last effect of a part does, on the same body."""
    hypothesis, joint = part.held[-1], search.setting.joint
    place = (hypothesis.body, hypothesis.direction)
    if place not in PLACES or len(part.held) > 1:
        return
    model, (follower, row, _) = search.setting.model(part.held), part.found
    machine = model.machine(row)
    seen = follower.look(search.setting.model().machine(row[[0, -1]]), [machine])
    tried: list[tuple[_Followed, Curve]] = []
    for curve in effect_as_curves([seen], [follower], machine, place, joint)[:_TABLES]:
        if search.late():
            return
        held = (free_form(curve, joint),)
        search.report(f"  in its place, a function of {curve.argument}")
        found = _patiently(search, r, held, np.append(row[0], curve.forces), limit, _ISLANDS)
        if found is not None:
            tried.append((_Followed(held, found), curve))
    if not tried:
        return
    best, curve = min(tried, key=lambda one: one[0].misfit)
    before = len(explanation.attempts)
    if not _everywhere(search, explanation, r, best) and len(explanation.attempts) > before:
        table = explanation.attempts[-1]
        if table.misfit < NEARLY:
            refine_table(search, explanation, curve, table)
