"""Effects that give the torque which the motion needs: forces with a name, two of them, tables."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.free_form import KNOTS, Curve, unnamed
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting, same
from clearance.diagnosis.hypotheses.two_levels import levels_of
from clearance.diagnosis.kinematics.agreement import profile
from clearance.diagnosis.searching.balance import Suggested, settle_in, suggest_forces
from clearance.diagnosis.searching.beside import FAR, HALFWAY, MOSTLY, NEARLY, NEARLY_ALL, SHARED, beside
from clearance.diagnosis.searching.clocked import follow_jumps, keep_time
from clearance.diagnosis.searching.elsewhere import WORKLESS, begin_again, begin_elsewhere, begin_inside
from clearance.diagnosis.searching.everywhere import between, fit_from
from clearance.diagnosis.searching.explanation import Explanation, Worked
from clearance.diagnosis.searching.from_motion import begin_wear
from clearance.diagnosis.searching.geometry import Dimension, Shown
from clearance.diagnosis.searching.rattling import begin_guide
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.tables import place_jumps, refine_table
from clearance.diagnosis.searching.work import Balanced
from clearance.diagnosis.sensing.measured import Measured
from clearance.errors import InputError

_BESIDE = 2  # forces that are tried beside a part
_FITTED, _PAIRS = 3, 5  # of the names that are suggested, of the tables too, and of pairs
_CLEARLY = 0.1  # of what any other leaves of the imbalance: that effect is there, alone or as one of two
_TOGETHER = 0.75  # of the price of any effect alone: two that cost less come before tables
_AS_CHEAP = 1.1  # times the price of the best two: others are tried as well
_WORN = 0.85  # of the motion's disagreement: beside such a name lobes that leave less may be why
_NO_LESS = 0.9  # of what a name leaves of the imbalance: a table that leaves more says no more


def begin_balanced(search: Search, explanation: Explanation) -> list[Balanced]:
    """Fit effects that give the torque that the motion needs, up to ``search.most`` together.

    Returns:
        Two effects that give it together and were not tried, the best first; see ``begin_pairs``.
    """
    try:
        suggested = suggest_forces(search, search.setting, search.profile.best)
    except np.linalg.LinAlgError:
        return []
    if suggested is None:
        return []
    explanation.balanced = suggested.balanced
    if suggested.forces:
        best = min(suggested.forces, key=lambda force: force.cost)
        first, share = best.hypotheses[0], best.cost / suggested.lacking
        explanation.worked = Worked(first.body, first.direction, share)
    explanation.unpushed = not (suggested.forces or suggested.blind)
    explanation.pushes = [
        (one.hypotheses[0], one.values)
        for one in suggested.forces
        if len(one.hypotheses) == 1 and one.curve is None
    ]
    balancing = _Balancing(search, explanation, suggested)
    balancing.run()
    return balancing.pairs


class _Balancing:
    """The forces that the balance of work suggests, one after another.

    Attributes:
        pairs: two effects that were not tried yet.
    """

    def __init__(self, search: Search, explanation: Explanation, suggested: Suggested) -> None:
        self.search, self.explanation, self.suggested = search, explanation, suggested
        self.pairs = suggested.pairs
        self._together = _clear_pairs(suggested) if search.most > 1 else []
        self._names: list[set[str]] = []  # that were tried
        self._sure = suggested.sure if search.most > 1 else None  # beside which the motion was not asked yet
        self._named_cost = np.inf  # what the best name that explains a share leaves of the imbalance

    def run(self) -> None:
        """Until one is enough, or says that the others say no more."""
        for one in self._different():
            if one.curve is not None and (self._try_together() or one.cost > _NO_LESS * self._named_cost):
                return
            nearly = self._fit(one)
            if explained(self.explanation.best) or nearly or self.search.late() or self._one_of_two(one):
                return
            if one.curve is not None and self._named():
                return
        if self.suggested.weak is not None and not (explained(self.explanation.best) or self.search.late()):
            found, table = _follow_table(self.search, self.explanation, self.suggested.weak)
            if found is not None and table is not None and not explained(found):
                refine_table(self.search, self.explanation, table, found)

    def _different(self) -> Iterator[Balanced]:
        """One variant of each effect, one argument of a force without a name; not many of each."""
        tables: list[str] = []
        for one in self.suggested.forces:
            if len(one.hypotheses) > self.search.most:
                continue
            names = {hypothesis.name for hypothesis in one.hypotheses}
            if one.curve is None and names not in self._names and len(self._names) < _FITTED:
                self._names.append(names)
                yield one
            elif one.curve is not None and one.label not in tables and len(tables) < _FITTED:
                tables.append(one.label)
                yield one

    def _try_together(self) -> bool:
        """Fit pairs that come before any table, once; whether that is enough."""
        if not self._together:
            return False
        new = [p for p in self._together if {h.name for h in p.hypotheses} not in self._names]
        begin_pairs(self.search, self.explanation, new)
        self.pairs, self._together = _without(self.pairs, self._together), []
        best = self.explanation.best
        near = best.misfit < NEARLY_ALL * self.explanation.nominal.misfit
        return explained(best) or near or self.search.late()

    def _fit(self, one: Balanced) -> bool:
        """Fit one force, a table then with more knots or with jumps; whether it is there beyond doubt."""
        found, table = _follow_table(self.search, self.explanation, one)
        left = self.explanation.nominal.misfit
        near = max(NEARLY_ALL * left, min(MOSTLY * left, FAR))  # then others are looked for on its path
        if found is None or not (explained(found) or found.misfit < near):
            self._ask_beside(one)
        if found is None:
            return False
        if table is not None and not explained(found):
            if len(table.knots) <= KNOTS:
                refine_table(self.search, self.explanation, table, found)
            else:
                place_jumps(self.search, self.explanation, table, found)
        if one.rhythm is not None:
            keep_time(self.search, self.explanation)
        nominal = self.explanation.nominal
        if one.curve is None and self._shares(found):
            self._named_cost = min(self._named_cost, one.cost)
        return found.misfit < (MOSTLY if one.curve is None else NEARLY_ALL) * nominal.misfit

    def _shares(self, found: Attempt) -> bool:
        return found.misfit < SHARED * self.explanation.nominal.misfit

    def _ask_beside(self, one: Balanced) -> None:
        """Fit beside a sure name rails, lobes, what acts inside the joint, another gap, or a rod that bends.

        They do no work, so that the balance knows the name as well without them; a path that lacks them leads
        its values astray.
        """
        if one is not self._sure or len(one.hypotheses) == self.search.most or self.search.late():
            return
        self._sure, search, explanation = None, self.search, self.explanation
        try:
            one = settle_in(search, search.setting, one)
        except (InputError, np.linalg.LinAlgError):
            return
        if explanation.rails is not None or begin_guide(search, explanation) or search.late():
            return  # without the play that the motion shows nothing is followed
        begin_wear(search, explanation, explanation.nominal, one.hypotheses, one.values, _WORN)
        if not (explained(explanation.best) or search.late()):
            base = _with(explanation.nominal, search.setting, one)
            begin_inside(search, explanation, base, one.clearance, anew=True)
            if not (explained(explanation.best) or search.late()):
                begin_elsewhere(search, explanation, base, one.clearance, WORKLESS)

    def _one_of_two(self, one: Balanced) -> bool:
        """Whether beside an effect that is surely there, alone or as one of two, a second one helps."""
        if self.search.most < 2 or not _clear(one, self.suggested):
            return False
        own = [p for p in self.pairs if any(same(h, one.hypotheses[0]) for h in p.hypotheses)]
        begin_pairs(self.search, self.explanation, own)
        if self.explanation.best is self.explanation.nominal and not self.search.late():
            return False
        self.pairs = _without(self.pairs, own)
        return True

    def _named(self) -> bool:
        """Whether no table says more than a name that explains a share: it is one of two, or all there is."""
        best = self.explanation.best
        named = bool(best.hypotheses) and unnamed(best.hypotheses) is None
        return named and best.misfit < SHARED * self.explanation.nominal.misfit


def _with(nominal: Attempt, setting: Setting, one: Balanced) -> Attempt:
    """The nominal attempt with effects of values that no fit has touched, from which others are begun."""
    _, values = beside(nominal, one.hypotheses, one.values)
    return replace(
        nominal, hypotheses=one.hypotheses, model=setting.model(one.hypotheses),
        fit=replace(nominal.fit, values=values),
    )  # fmt: skip


def _without(pairs: Sequence[Balanced], tried: Sequence[Balanced]) -> list[Balanced]:
    return [pair for pair in pairs if not any(pair is one for one in tried)]


def _clear_pairs(suggested: Suggested) -> list[Balanced]:
    """Two effects that give what is needed clearly better than any alone, and better than a table does."""

    def cheapest(some: Iterable[Balanced]) -> float:
        return min((one.price for one in some), default=np.inf)

    alone = cheapest(o for o in suggested.forces if len(o.hypotheses) == 1 and o.curve is None)
    table = cheapest(o for o in suggested.forces if o.curve is not None)
    best = cheapest(suggested.pairs)
    clocked = bool(suggested.forces) and suggested.forces[0].rhythm is not None
    if clocked or not best < min(_TOGETHER * alone, table):
        return []
    return [pair for pair in suggested.pairs if pair.price < _AS_CHEAP * best]


def _clear(one: Balanced, suggested: Suggested) -> bool:
    """Whether one effect gives nearly all that is needed, and no other one or table comes anywhere near."""
    name = one.hypotheses[0].name
    others = [o.cost for o in suggested.forces if all(h.name != name for h in o.hypotheses)]
    return one.curve is None and one.cost < _CLEARLY * min([*others, suggested.lacking])


def begin_pairs(search: Search, explanation: Explanation, pairs: Sequence[Balanced]) -> None:
    """Fit two effects that give the torque together, where none alone is near or costs about as little.

    Around impacts the motion leaves torques that nothing gives: what is right takes away little more than
    what is not, but then it follows.

    Args:
        search: after its nominal stage.
        explanation: added to.
        pairs: that the balance of work suggests, the best first.
    """
    nominal, tried = explanation.nominal, list[set[str]]()
    for pair in pairs:
        names = {hypothesis.name for hypothesis in pair.hypotheses}
        if names in tried:
            continue
        tried.append(names)
        found = _follow(search, explanation, search.setting, pair)
        if found is not None and not explained(found) and found.misfit < HALFWAY * nominal.misfit:
            found = _other_variants(search, explanation, found)
        nearly = found is not None and found.misfit < NEARLY_ALL * nominal.misfit
        if explained(explanation.best) or nearly or search.late() or len(tried) == _PAIRS:
            return


def _other_variants(search: Search, explanation: Explanation, found: Attempt) -> Attempt:
    """The best of effects that follow nearly with one in another variant, on their path, then on its own.

    The work tells that there is friction, and hardly whether it goes with the speed.
    """
    best, place = found, 1
    for i, hypothesis in enumerate(found.hypotheses):
        after = place + len(hypothesis.unknowns)
        for group in search.groups.values():
            other = group[0]
            if not same(other, hypothesis) or other.label == hypothesis.label or len(other.unknowns) > 1:
                continue
            held = [*found.hypotheses[:i], other, *found.hypotheses[i + 1 :]]
            rows = np.array([[*row[:place], *other.start, *row[after:]] for row in found.fit.values])
            one = search.refit(explanation, held, found.followers, rows, found.scale)
            best = best if one is None or one.misfit > best.misfit else one
        place = after
    if explanation.best is best and not (explained(best) or search.late()):
        begin_again(search, explanation)
    names = [h.name for h in found.hypotheses]
    every = [a for a in explanation.attempts if [h.name for h in a.hypotheses] == names]
    return min([best, *every], key=lambda one: one.misfit)


def begin_beside(search: Search, explanation: Explanation, base: Attempt) -> None:
    """Fit a force that the balance of work names beside effects that explain a part and are not near.

    What a sensor at fault says is not asked: how much it is off by is fitted on a path that lacks the force.
    """
    faults = [hypothesis for hypothesis in base.hypotheses if hypothesis.fault is not None]
    deaf = [fault.channel for fault in faults if fault.channel is not None]
    if base.misfit < NEARLY or len(deaf) < len(faults):  # a clock that is wrong is every channel's
        return
    heard, sizes = search.recordings, base.fit.values[0, 1 : base.model.shared]
    for channel in deaf:
        heard = [one.without(channel) for one in heard]
    _follow_beside(search, explanation, base.hypotheses, sizes, heard, HALFWAY * base.misfit)


def begin_misheard(search: Search, explanation: Explanation, fault: Dimension) -> None:
    """Fit a sensor's fault that the motion shows with a force that the balance of work names beside it.

    Without that force no path is followed on which the fault's size could be told.

    Args:
        search: after its nominal stage.
        explanation: added to.
        fault: of one channel; what is balanced is what it shows with the fault undone.
    """
    held, size = (fault.hypothesis,), np.array([fault.value])
    heard = Shown(held, size, np.zeros(1), search.profile).undone(search)
    _follow_beside(search, explanation, held, size, heard, HALFWAY * explanation.nominal.misfit)


def _follow_beside(
    search: Search,
    explanation: Explanation,
    held: Sequence[Hypothesis],
    sizes: np.ndarray,
    heard: Sequence[Measured],
    near: float,
) -> None:
    """Follow what the balance of work names in a machine with some effects, by what is heard, until near."""
    setting, clearance = search.setting.added(held, sizes), search.profile.best
    try:
        if heard is not search.recordings:
            clearance = profile(heard, search.alignments, setting.with_clearance, search.workers).best
        with search.hearing(heard):
            suggested = suggest_forces(search, setting, clearance, named=True)
    except (InputError, np.linalg.LinAlgError):
        return
    new = [
        force for force in (suggested.forces if suggested is not None else [])
        if len(force.hypotheses) + len(held) <= search.most
        and not any(same(one, other) for one in force.hypotheses for other in held)
    ]  # fmt: skip
    for force in new[:_BESIDE]:
        found = _follow(search, explanation, setting, force, held, sizes, heard)
        if (found is not None and found.misfit < near) or search.late():
            return


def _follow_table(
    search: Search, explanation: Explanation, one: Balanced
) -> tuple[Attempt | None, Curve | None]:
    """Follow what the balance suggests, a table that fails with fewer knots; and with which curve.

    What a few sensors hear of strong impacts is not enough for each of many knots.
    """
    levels = None if one.curve is None or one.rhythm is None else levels_of(one.curve)
    if one.curve is not None and levels is not None:
        found = follow_jumps(search, explanation, one, one.curve, levels)
        if found is not None or search.late():
            return found, None
    found = _follow(search, explanation, search.setting, one)
    if found is None and one.fewer is not None and not search.late():
        return _follow(search, explanation, search.setting, one.fewer), one.fewer.curve
    return found, one.curve


def _follow(
    search: Search,
    explanation: Explanation,
    setting: Setting,
    one: Balanced,
    held: Sequence[Hypothesis] = (),
    sizes: Sequence[float] | np.ndarray = (),
    heard: Sequence[Measured] | None = None,
) -> Attempt | None:
    """Fit what the balance of work suggests beside the nominal machine, once clearance and path go with it.

    Args:
        search: after its nominal stage.
        explanation: added to.
        setting: the machine that the balance was asked of.
        one: of its suggestions.
        held: effects that are in that machine, and fitted too.
        sizes: of these.
        heard: recordings that the balance was asked of, where they are others.
    """
    try:
        with nullcontext() if heard is None else search.hearing(heard):
            # a table by its own clock is too coarse to be settled beside
            settled = one if one.rhythm is not None else settle_in(search, setting, one)
    except (InputError, np.linalg.LinAlgError):
        return None
    shown = ", ".join(f"{value:.4g}" for value in settled.values)
    search.report(f"  {one.label} = {shown} goes with a clearance of {settled.clearance * 1e3:.3f} mm")
    # a moment is known least where it is largest, since it does no work there
    insist = 2 if one.curve is not None and one.curve.body == "rod" else 1
    nominal, found = explanation.nominal, None
    middle = between(settled.clearance, nominal.fit.values[0, 0])
    for clearance in dict.fromkeys([settled.clearance, middle or settled.clearance]):
        with search.timed(one.rhythm):
            again = fit_from(
                search, explanation, nominal, [*held, *one.hypotheses], np.append(sizes, settled.values),
                clearance, anew=True, insist=insist,
            )  # fmt: skip
        found = again if found is None or (again is not None and again.misfit < found.misfit) else found
        if search.late() or (found is not None and found.misfit < HALFWAY * nominal.misfit):
            break
    return found
