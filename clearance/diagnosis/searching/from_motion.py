"""Effects at which the motion alone points: forces that its work needs, dimensions, lobes of a bearing."""

from collections.abc import Iterable, Sequence

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.free_form import KNOTS, Curve, unnamed
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting, same
from clearance.diagnosis.searching.balance import Suggested, settle_in, suggest_forces
from clearance.diagnosis.searching.beside import HALFWAY, NEARLY, SHARED
from clearance.diagnosis.searching.elsewhere import begin_again, rhythm_of
from clearance.diagnosis.searching.everywhere import fit_from
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import Dimension, suggest_clock
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.tables import place_jumps, refine_table
from clearance.diagnosis.searching.wear import suggest_wear
from clearance.diagnosis.searching.work import Balanced
from clearance.errors import InputError

_BESIDE = 2  # forces that are tried beside a part
_FITTED, _PAIRS = 3, 5  # of the names that are suggested, of the tables too, and of pairs
_CLEARLY = 0.1  # of what any other leaves of the imbalance: that effect is there, alone or as one of two
_TOGETHER = 0.75  # of the price of any effect alone: two that cost less come before tables
_AS_CHEAP = 1.1  # times the price of the best two: others are tried as well
_NO_LESS = 0.9  # of what a name leaves of the imbalance: a table that leaves more says no more
_DISPLACED = 0.3  # of the disagreement: a dimension with which less is left is looked at before any force
_LARGER = (1.0, 1.2, 1.45, 1.75)  # times the lobes that the motion shows
_LESS_CLEARANCE = (1.0, 0.94, 0.88)  # than the motion shows beside a dimension
_NEARLY_ALL = 0.05  # of the nominal machine's misfit: what leaves less is built on


def begin_balanced(search: Search, explanation: Explanation, most: int) -> list[Balanced]:
    """Fit effects that give the torque which the motion needs, ``most`` together.

    Returns:
        Two effects that give it together, the best first; see ``begin_pairs``.
    """
    nominal = explanation.nominal
    try:
        suggested = suggest_forces(search, search.setting, search.profile.best)
    except np.linalg.LinAlgError:
        return []
    if suggested is None:
        return []
    explanation.balanced = suggested.balanced
    explanation.unpushed = not (suggested.forces or suggested.blind)
    explanation.pushes = [
        (one.hypotheses[0], one.values)
        for one in suggested.forces
        if len(one.hypotheses) == 1 and one.curve is None
    ]
    nearly, pairs, named_cost = False, suggested.pairs, np.inf
    together = _clear_pairs(suggested) if most > 1 else []
    # one variant of each effect, one argument of a force without a name
    known: dict[bool, list[set[str]]] = {True: [], False: []}
    for one in suggested.forces:
        if len(one.hypotheses) > most:
            continue
        names = {h.name for h in one.hypotheses} if one.curve is None else {one.label}
        alike = known[one.curve is None]
        if names in alike or len(alike) == _FITTED:
            continue
        alike.append(names)
        if one.curve is not None and together:
            begin_pairs(
                search,
                explanation,
                [p for p in together if {h.name for h in p.hypotheses} not in known[True]],
            )
            pairs, together = [pair for pair in pairs if not any(pair is tried for tried in together)], []
            best = explanation.best
            if explained(best) or best.misfit < _NEARLY_ALL * nominal.misfit or search.late():
                return pairs
        if one.curve is not None and one.cost > _NO_LESS * named_cost:
            return pairs  # it says no more than a name that leaves little
        found, table = _follow_table(search, explanation, one)
        if found is not None and table is not None and not explained(found):
            if len(table.knots) <= KNOTS:
                refine_table(search, explanation, table, found)
            else:
                place_jumps(search, explanation, table, found)
        if found is not None and one.curve is None and found.misfit < SHARED * nominal.misfit:
            named_cost = min(named_cost, one.cost)
        nearly = found is not None and found.misfit < _NEARLY_ALL * nominal.misfit
        if explained(explanation.best) or nearly or search.late():
            break
        if most > 1 and _clear(one, suggested):
            own = [p for p in pairs if any(same(h, one.hypotheses[0]) for h in p.hypotheses)]
            begin_pairs(search, explanation, own)
            if explanation.best is not nominal or search.late():
                return [p for p in pairs if not any(p is tried for tried in own)]
        best = explanation.best
        named = bool(best.hypotheses) and unnamed(best.hypotheses) is None
        if one.curve is not None and named and best.misfit < SHARED * nominal.misfit:
            return pairs  # no table says more than a name does: it is one of two, or all there is
    if suggested.weak is not None and not (explained(explanation.best) or nearly or search.late()):
        found, table = _follow_table(search, explanation, suggested.weak)
        if found is not None and table is not None and not explained(found):
            refine_table(search, explanation, table, found)
    return pairs


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
        nearly = found is not None and found.misfit < _NEARLY_ALL * nominal.misfit
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
    """Fit a force that the balance of work names beside effects that explain a part and are not near."""
    if base.misfit < NEARLY or any(hypothesis.fault is not None for hypothesis in base.hypotheses):
        return
    sizes = base.fit.values[0, 1 : base.model.shared]
    setting = search.setting.added(base.hypotheses, sizes)
    try:
        suggested = suggest_forces(search, setting, search.profile.best, named=True)
    except (InputError, np.linalg.LinAlgError):
        return
    new = [
        force for force in (suggested.forces if suggested is not None else [])
        if not any(same(one, held) for one in force.hypotheses for held in base.hypotheses)
    ]  # fmt: skip
    for force in new[:_BESIDE]:
        found = _follow(search, explanation, setting, force, base.hypotheses, sizes)
        if (found is not None and found.misfit < HALFWAY * base.misfit) or search.late():
            return


def begin_displaced(
    search: Search, explanation: Explanation, dimensions: Sequence[Dimension], most: int
) -> Dimension | None:
    """Fit a dimension without which the motion hardly agrees, first with what the work then lacks.

    Beside a wrong one the motion shows a clearance that is far off, and the balance of work other forces.

    Args:
        search: after its nominal stage.
        explanation: added to.
        dimensions: of ``suggest_dimensions``.
        most: effects that may be missing together.

    Returns:
        The one that was tried, if one was.
    """
    one = next((one for one in dimensions if one.hypothesis.fault is None), None)
    if one is None or one.share > _DISPLACED:
        return None
    nominal, size = explanation.nominal, np.array([one.value])
    force = _beside_dimension(search, one, most)
    if force is not None:
        sizes = np.append(size, force.values)
        held = [one.hypothesis, *force.hypotheses]
        found = fit_from(search, explanation, nominal, held, sizes, force.clearance, anew=True)
        nearly = found is not None and found.misfit < _NEARLY_ALL * nominal.misfit
        if explained(explanation.best) or nearly or search.late():
            return one
    _fit_dimension(search, explanation, one)
    return one


def _beside_dimension(search: Search, one: Dimension, most: int) -> Balanced | None:
    """What the balance of work lacks in a machine with another dimension, if it can be settled with it.

    No more effects than ``most`` together with the dimension.
    """
    setting = search.setting.added([one.hypothesis], np.array([one.value]))
    try:
        suggested = suggest_forces(search, setting, one.clearance, named=True)
        forces = [] if suggested is None else suggested.forces
        force = next((force for force in forces if len(force.hypotheses) < most), None)
        return None if force is None else settle_in(search, setting, force)
    except (InputError, np.linalg.LinAlgError):
        return None


def _fit_dimension(search: Search, explanation: Explanation, one: Dimension) -> None:
    """Fit a dimension alone, with less clearance where it is not followed with what the motion shows.

    By the rod's sensors and 5 % noise that was 14 % too much (a guide line 6.4 mm off).
    """
    nominal = explanation.nominal
    for less in _LESS_CLEARANCE if one.hypothesis.fault is None else _LESS_CLEARANCE[:1]:
        size, clearance = np.array([one.value]), less * one.clearance
        found = fit_from(search, explanation, nominal, [one.hypothesis], size, clearance, anew=False)
        if (found is not None and found.misfit < HALFWAY * nominal.misfit) or search.late():
            return


def begin_clock(search: Search, explanation: Explanation) -> None:
    """Fit a recorder's clock that the motion surely accuses, on paths sought anew by the right one."""
    one = suggest_clock(search)
    if one is not None:
        size = np.array([one.value])
        fit_from(search, explanation, explanation.nominal, [one.hypothesis], size, one.clearance, anew=True)


def begin_dimensions(
    search: Search,
    explanation: Explanation,
    dimensions: Sequence[Dimension],
    tried: Dimension | None,
    most: int,
) -> None:
    """Fit dimensions and faults with which the motion alone agrees better, on paths that are sought anew.

    Beside a dimension that does not explain all, with the best of what was found before, or with a force that
    the balance of work then names.

    Args:
        search: after its nominal stage.
        explanation: added to.
        dimensions: of ``suggest_dimensions``.
        tried: one of them, of ``begin_displaced``: it is fitted beside what was found since, and no more.
        most: effects that may be missing together.
    """
    nominal, part = explanation.nominal, explanation.best
    for one in dimensions:
        size = np.array([one.value])
        if one is not tried:
            _fit_dimension(search, explanation, one)
        if explained(explanation.best) or search.late():
            return
        if one.hypothesis.fault is not None:
            continue
        new = part.hypotheses and all(not same(one.hypothesis, held) for held in part.hypotheses)
        if new and part.misfit < HALFWAY * nominal.misfit and len(part.hypotheses) < most:
            more, clearance, rhythm = part.hypotheses, one.clearance, rhythm_of(part)
            values = part.fit.values[0, 1 : part.model.shared]
        else:
            force = None if one is tried else _beside_dimension(search, one, most)
            if force is None:
                continue
            more, values, clearance = force.hypotheses, force.values, force.clearance
            rhythm = force.rhythm
        sizes = np.append(size, values)
        with search.timed(rhythm):
            fit_from(search, explanation, nominal, [one.hypothesis, *more], sizes, clearance, anew=True)
        if explained(explanation.best) or search.late():
            return


def begin_wear(search: Search, explanation: Explanation, base: Attempt) -> None:
    """Fit a worn bearing beside ``base``, from the lobes that the motion shows, on paths sought anew.

    How much better the motion agrees says little: beside a missing force lobes do, too (a tenth was seen).
    By 5 % noise it shows them too small (49 um of 83, at a phase 0.3 off), and the gap with them.
    """
    try:
        one = suggest_wear(search, base)
    except (InputError, np.linalg.LinAlgError):
        return
    if one is None:
        return
    shown = ", ".join(f"{value:.3g}" for value in one.values)
    search.report(
        f"  the motion agrees best with {one.hypothesis.label} = {shown} and a clearance of "
        f"{one.clearance * 1e3:.3f} mm: {one.share:.0%} of the disagreement are left"
    )
    amplitude, order, phase = one.values
    for larger in _LARGER:
        size = np.array([larger * amplitude, order, phase])
        gap = one.clearance + (larger - 1.0) * amplitude  # what is seen of it is beside the lobes
        fit_from(search, explanation, base, [one.hypothesis], size, gap, anew=True)
        if explained(explanation.best) or search.late():
            return


def _follow_table(
    search: Search, explanation: Explanation, one: Balanced
) -> tuple[Attempt | None, Curve | None]:
    """Follow what the balance suggests, a table that fails with fewer knots; and with which curve.

    What a few sensors hear of strong impacts is not enough for each of many knots.
    """
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
) -> Attempt | None:
    """Fit what the balance of work suggests beside the nominal machine, once clearance and path go with it.

    Args:
        search: after its nominal stage.
        explanation: added to.
        setting: the machine that the balance was asked of.
        one: of its suggestions.
        held: effects that are in that machine, and fitted too.
        sizes: of these.
    """
    try:
        settled = settle_in(search, setting, one)
    except (InputError, np.linalg.LinAlgError):
        return None
    shown = ", ".join(f"{value:.4g}" for value in settled.values)
    search.report(f"  {one.label} = {shown} goes with a clearance of {settled.clearance * 1e3:.3f} mm")
    # a moment is known least where it is largest, since it does no work there
    insist = 2 if one.curve is not None and one.curve.body == "rod" else 1
    with search.timed(one.rhythm):
        return fit_from(
            search, explanation, explanation.nominal, [*held, *one.hypotheses],
            np.append(sizes, settled.values), settled.clearance, anew=True, insist=insist,
        )  # fmt: skip
