"""Where nothing is followed: one effect after another with patience, from islands of the motion alone.

A machine that lacks something loses a recording at each impact, and a path that was looked for in vain some
times is given up. With the right effect every loss can be mended, whatever its size was begun at: the first
impacts that are met tell it. So each effect is followed patiently on one recording; wrong ones are given up
within some steps. What is followed best there may be one of two, of which the other is then followed beside
it; forces of free form come between. What follows one recording is fitted to all.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from clearance.diagnosis.following.attempt import (
    ANNEALING,
    FOLLOWED,
    LOOSENESS,
    POOR,
    Attempt,
    explained,
    refine,
)
from clearance.diagnosis.following.growth import Followed, Start, grow, scale_of
from clearance.diagnosis.hypotheses.free_form import Curve, curve_over, free_form, unnamed
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Hypothesis, same
from clearance.diagnosis.hypotheses.missing_force import arguments_along
from clearance.diagnosis.searching.beside import SHARED
from clearance.diagnosis.searching.elsewhere import of_one_size
from clearance.diagnosis.searching.everywhere import astray, misleads
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import FRAME, GEOMETRIC, LOOSE_GUIDE, Dimension
from clearance.diagnosis.searching.nominal import find_nominal
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.tables import refine_table
from clearance.diagnosis.searching.wear import WORN, suggest_wear
from clearance.diagnosis.side_by_side import side_by_side
from clearance.errors import InputError

_ISLANDS, _MORE = 2, 4  # from which a recording is followed; of another one, with what the first tells
_LIKELIER = 3.0  # times the doubt of the surest island: what is right was followed from one that leaves less
_PART, _MOST = 0.2, 100.0  # of the nominal misfit of a recording, and misfit, up to which one is followed on
_LOBED = 0.95  # of the motion's disagreement: lobes that leave more are none
_LOBES = ((1.0, 1.0), (0.88, 1.45))  # times the clearance and the amplitude that it shows beside lobes
_LESS = 0.3  # of what a part leaves: with the other effect less is left
_NEAR = 6.0  # misfit of a recording that is followed: a variant, or a finer table, may explain it
_TOLD = (*GEOMETRIC, LOOSE_GUIDE, FRAME)  # by the motion and by the crank's sensors
_TABLES = (
    ("slider", "x", "slider_velocity"),
    ("slider", "x", "slider_position"),
    ("rod", "moment", "rod_angle"),
)
_FAINT = {"slider": -1.5, "rod": 0.05}  # N, N m at the end of the range of a table that is begun


class _Trial(NamedTuple):
    """Hypotheses with which a recording was followed, and how."""

    held: tuple[Hypothesis, ...]
    found: Followed
    curve: Curve | None = None

    @property
    def misfit(self) -> float:
        return self.found[2]


class _Candidate(NamedTuple):
    """A hypothesis, with the (unknowns,) sizes and the clearance [m] that it is begun from.

    ``curve``: of one of free form.
    """

    hypothesis: Hypothesis
    sizes: np.ndarray
    clearance: float
    curve: Curve | None = None


def begin_patiently(search: Search, explanation: Explanation, dimensions: Sequence[Dimension]) -> None:
    """Follow what the motion shows on each recording, then effects on one; fit what follows it to all.

    Args:
        search: after its nominal stage.
        explanation: added to.
        dimensions: with which the motion agrees better.
    """
    search.report("nothing is followed yet: one effect after another is tried with patience")
    shown = [*_lobes(search), *_displaced(dimensions)]
    surest_first = np.argsort([start.doubt for start in search.starts])
    each = [_OneRecording(search, explanation, int(r)) for r in surest_first]
    for one in each:
        one.search_shown(shown)
        if one.over():
            return
    for one in each:
        one.search_all()
        if one.best is not None or one.over():
            return


def _lobes(search: Search) -> list[_Candidate]:
    """A worn bearing at which the motion points, though a force may be missing for all that the work tells.

    By the rod's four sensors it shows 21 um of 36, in 0.284 mm of 0.223.
    """
    try:
        one = suggest_wear(search, [], np.zeros(0))
    except (InputError, np.linalg.LinAlgError):
        return []
    if one is None or one.share > _LOBED:
        return []
    amplitude, order, phase = one.values
    return [
        _Candidate(one.hypothesis, np.array([larger * amplitude, order, phase]), less * one.clearance)
        for less, larger in _LOBES
    ]


def _displaced(dimensions: Sequence[Dimension]) -> list[_Candidate]:
    """Dimensions at which the motion points, as it shows them."""
    return [
        _Candidate(one.hypothesis, np.array([one.value]), one.clearance)
        for one in dimensions
        if one.hypothesis.fault is None
    ]


class _OneRecording:
    """What is tried on one recording; ``best`` is what it was followed best with, if with anything."""

    def __init__(self, search: Search, explanation: Explanation, r: int) -> None:
        self.search, self.explanation, self.r = search, explanation, r
        self.limit = self._limit(r)
        self.best: _Trial | None = None

    def search_shown(self, shown: Iterable[_Candidate]) -> None:
        """The nominal machine, then effects as the motion shows them."""
        self._find_nominal(self.limit)
        if not self.over():
            self._each(shown, None, self.limit)

    def search_all(self) -> None:
        """Others beside a name; single effects, forces of free form, then others beside the best effect."""
        named, part = self._named(), self.best
        if named is not None and named.misfit > POOR:
            self._each(self._names(named), named, self._least())
        if not self.over():
            single = self._each(self._names(None), None, self._least())
            part = min((one for one in (part, single) if one), key=lambda one: one.misfit, default=None)
        if not self.over():
            self._each(self._tables(), None, self._least())
        while part is not None and part.misfit > POOR and not self.over():
            if len(part.held) >= self.search.most:
                break
            part = self._each(self._names(part), part, max(_LESS * part.misfit, POOR))
        if self.best is not None and self.best.misfit > _NEAR and not self.over():
            self._everywhere(self.best)

    def _least(self) -> float:
        """What a recording may leave to be followed on: no more than the best so far, if that is not near."""
        best = np.inf if self.best is None else self.best.misfit
        return max(min(self.limit, best), POOR)

    def _find_nominal(self, limit: float) -> None:
        """The nominal machine, where it was lost and patience finds it at another clearance."""
        search = self.search
        if search.recordings[self.r].raw is not None:  # ``find_nominal`` does not calibrate sensors anew
            return
        found = self._patiently(self.r, (), np.array([search.clearance]), limit)
        if found is None or found[2] > POOR:
            return
        before = (search.clearance, search.traces, search.starts)
        try:
            search.retrace_all(float(found[1][0]))
            find_nominal(search, self.explanation)
        except np.linalg.LinAlgError:  # on another recording links do not reach that far
            pass
        if not explained(self.explanation.nominal):
            search.clearance, search.traces, search.starts = before

    def _named(self) -> _Trial | None:
        """What the search has found so far, if it is a part with a name, which another effect may need."""
        best, nominal, search = self.explanation.best, self.explanation.nominal, self.search
        share = best.misfits[self.r] / nominal.misfits[self.r]
        if best is nominal or len(best.hypotheses) >= search.most or not share < SHARED:
            return None
        if unnamed(best.hypotheses) is not None or any(one.fault is not None for one in best.hypotheses):
            return None
        found = (best.followers[self.r], best.fit.values[self.r], best.misfits[self.r])
        return _Trial(best.hypotheses, found)

    def _limit(self, r: int) -> float:
        return float(np.clip(_PART * self.explanation.nominal.misfits[r], POOR, _MOST))

    def over(self) -> bool:
        """Whether the recordings are explained, or time is over."""
        return self.search.late() or explained(self.explanation.best)

    def _each(self, candidates: Iterable[_Candidate], part: _Trial | None, limit: float) -> _Trial | None:
        """The hypothesis, beside a part, with which the recording is followed best; fitted to all if well."""
        before = () if part is None else part.held
        best: _Trial | None = None
        for one in candidates:
            held = (*before, one.hypothesis)
            known = np.array([one.clearance]) if part is None else part.found[1][:-1]
            found = self._patiently(self.r, held, np.append(known, one.sizes), limit)
            if found is not None:
                trial = _Trial(held, found, one.curve)
                best = min((one for one in (best, trial) if one is not None), key=lambda one: one.misfit)
                self.best = min((one for one in (self.best, trial) if one), key=lambda one: one.misfit)
                limit = max(min(limit, best.misfit), POOR)
                if found[2] <= _NEAR:
                    self._everywhere(trial)
            if self.over():
                break
        return best

    def _names(self, part: _Trial | None) -> list[_Candidate]:
        """Effects of one size that neither the motion nor the crank's sensors would tell, beside a part."""
        return [
            _Candidate(group[0], group[0].start, self.search.clearance)
            for group in self.search.groups.values()
            if of_one_size(group[0])
            and group[0].fault is None
            and group[0].name not in _TOLD
            and not (part is not None and any(same(group[0], one) for one in part.held))
        ]

    def _tables(self) -> list[_Candidate]:
        """Forces of free form where no sensor of the crank feels them, begun faintly."""
        start, joint = self.search.starts[self.r], self.search.setting.joint
        machine = self.search.setting.with_clearance(self.search.clearance)
        arguments = arguments_along(start.follower.look(machine), machine, joint, start.follower.measured)
        found = []
        for body, direction, argument in _TABLES:
            curve = curve_over(arguments[argument], body, direction, argument)
            forces = np.linspace(-1.0, 1.0, len(curve.knots)) * _FAINT[body]
            curve = replace(curve, forces=forces)
            found.append(_Candidate(free_form(curve, joint), forces, self.search.clearance, curve))
        return found

    def _patiently(
        self, r: int, held: Sequence[Hypothesis], sizes: np.ndarray, limit: float
    ) -> Followed | None:
        """Follow a recording, begun from clearance and (sizes,); nothing where that fails."""
        label = " + ".join(one.label for one in held) or "nominal"
        try:
            found = self.search.finished.followed(
                f"{label} from {sizes} patiently on {r}",
                lambda: self._followed(r, held, sizes, limit, _ISLANDS),
            )
        except (InputError, np.linalg.LinAlgError):
            return None
        if found is not None:
            self.search.report(f"  {label}: misfit {found[2]:.3g} on one recording")
        return found

    def _followed(
        self, r: int, held: Sequence[Hypothesis], sizes: np.ndarray, limit: float, islands: int
    ) -> Followed | None:
        """Follow a recording from the surest of its islands."""
        search, model = self.search, self.search.setting.model(held)
        trace, row = search.traces[r], np.append(sizes, search.traces[r].speed)
        plain = search.setting.with_clearance(SOME_CLEARANCE)
        other = any(one.structural(plain) or misleads(one) or one.name == WORN for one in held)
        if r != self.r or other or astray(row[0], search.clearance):
            trace = search.retrace(r, model.machine(row), model.instrument(row))
            row[-1] = trace.speed

        def one(start: Start) -> Followed | None:
            try:
                return grow(start, model, row, limit, patient=True)
            except (InputError, np.linalg.LinAlgError):  # the gap has closed
                return None

        starts = Start.several(trace, model.held(row), LOOSENESS, islands)
        doubted = _LIKELIER * max(FOLLOWED, min((start.doubt for start in starts), default=0.0))
        starts = [start for start in starts if start.doubt < doubted]
        found = list[Followed]()
        for first in range(0, len(starts), search.workers):
            some = side_by_side(one, starts[first : first + search.workers], search.workers)
            for each in filter(None, some):  # in their order, however many were followed at a time
                if each[2] <= POOR:
                    return min((*found, each), key=lambda one: one[2])
                found.append(each)
            if search.late():
                break
        return min(found, key=lambda each: each[2], default=None)

    def _everywhere(self, told: _Trial) -> None:
        """Fit to all recordings what this one tells."""
        search, model = self.search, self.search.setting.model(told.held)

        def make() -> Attempt | None:
            follower, row, misfit = told.found
            alone = refine(told.held, model, [follower], row[None], scale_of(misfit), 8, search.workers)
            sizes = alone.fit.values[0, :-1]
            each = {self.r: (alone.followers[0], alone.fit.values[0], alone.misfit)}
            for r in range(len(search.recordings)):
                if r != self.r:
                    found = self._followed(r, told.held, sizes, self._limit(r), _MORE)
                    if found is None:
                        return None
                    each[r] = found
            followers, rows, misfits = zip(*(each[r] for r in range(len(each))), strict=True)
            values, scale = np.stack(rows), max(scale_of(float(np.mean(misfits))), ANNEALING[3])
            values[:, : model.shared] = values[int(np.argmin(misfits)), : model.shared]
            return refine(told.held, model, followers, values, scale, 8, search.workers)

        found = search.keep(self.explanation, told.held, make)
        if found is not None and told.curve is not None and not self.over():
            refine_table(search, self.explanation, told.curve, found)
