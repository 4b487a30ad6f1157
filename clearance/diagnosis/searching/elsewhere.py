"""Effects that no look beside a nominal path can judge: they add coordinates, or change much at once."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from clearance.diagnosis.following.attempt import EXPLAINED, POOR, Attempt, explained
from clearance.diagnosis.following.growth import Followed, grow, surest_of
from clearance.diagnosis.hypotheses.free_form import free_form, resisting, rubbing, unnamed
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Hypothesis
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.searching.beside import FAR, beside, enough
from clearance.diagnosis.searching.edges import EDGED
from clearance.diagnosis.searching.everywhere import astray, between, fit_everywhere, start_with
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import FRAME, GEOMETRIC, LOOSE_GUIDE
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import SURE, cushioned, incomplete, unsettled
from clearance.diagnosis.searching.work import DRIVE
from clearance.errors import InputError
from clearance.mechanism.applied_force import TabulatedForce

_FITTED = 2  # of them that are fitted to all recordings
_LEFT = 0.3  # of what a base that explains leaves: what is right leaves less
_SOME = 0.6  # of it: so much from a plausible size is worth a fit
_TRIALS = 3  # plausible shapes or sizes of an effect that are tried
_AGAIN = (1.0, 3.0, 5.0)  # times the plausible damping with which a flexible part is followed again
_BETTER = 0.7  # of the misfit before: less is worth following again from there
_SUREST = 3  # effects that a linear look is sure of
_ELSEWHERE = (DRIVE, "second_clearance", "rod_flexibility", FRAME, LOOSE_GUIDE)
"""Effects that no linear look beside a nominal path can judge, cheap and frequent ones first."""
WORKLESS = ("second_clearance", "rod_flexibility")
"""Those of them that take or give next to no work, so that the balance of it does not see them."""
_OUTSIDE = ("crank", "rod", "slider")  # what acts there does work
_FILM, _FRICTION = "joint_lubrication", "joint_friction"
_INSIDE = (_FRICTION, "contact_stiffness", "restitution")
_RESISTING = (1.0, 0.2, 5.0, 0.03)  # N s/m in the middle of the gap, from which a table of resistance begins
_RUBBING = (0.1, 0.25, 0.03)  # coefficients from which a table of friction begins


def begin_elsewhere(
    search: Search,
    explanation: Explanation,
    base: Attempt,
    clearance: float | None = None,
    names: Sequence[str] = _ELSEWHERE,
) -> None:
    """Fit effects that add coordinates or change much at once, from plausible sizes, beside ``base``.

    No linear look at a path without them can judge them. They are tried on one recording; the best are
    fitted to all.

    Args:
        search: after its nominal stage.
        explanation: added to.
        base: attempt beside which they are fitted.
        clearance: from which they are tried [m]; that of ``base`` if ``None``.
        names: of them that are tried.
    """
    tried = (DRIVE,) if base is explanation.nominal and base.misfit > FAR else ()  # in ``begin_plausible``
    groups = [
        g for g in _judged_elsewhere(search.others(base)) if g[0].name in names and g[0].name not in tried
    ]
    _try_out(search, explanation, base, groups, clearance)


def begin_displaced_paths(search: Search, explanation: Explanation) -> None:
    """Fit what acts inside the joint from the motion's clearance, what no look can judge from one between.

    Beside the nominal machine, which what is missing has led to another clearance.
    """
    nominal, shown = explanation.nominal, search.profile.best
    middle = between(shown, nominal.fit.values[0, 0])
    if middle is None:
        return
    if middle != shown:  # else it was begun from there
        begin_inside(search, explanation, nominal, shown)
    if not (explained(explanation.best) or search.late()):
        begin_elsewhere(search, explanation, nominal, middle)


def begin_sure(search: Search, explanation: Explanation) -> None:
    """Fit what a linear look is sure of on paths of its own, as large as it promises, until all is settled.

    The states around each impact were fitted to the nominal contact: beside them a contact ten times softer
    shows a slope and no way there.
    """
    nominal = explanation.nominal
    sure = [hint for hint in explanation.hints if hint.gain > SURE and hint.hypotheses[0].fault is None]
    for hint in sure[:_SUREST]:
        if search.late() or not unsettled(explanation):
            return
        held, values = beside(nominal, hint.hypotheses, hint.values)
        search.keep(
            explanation, held, lambda h=held, v=values: search.grown(h, v), again=True  # type: ignore[misc]
        )  # fmt: skip


def begin_again(search: Search, explanation: Explanation, though_explained: bool = False) -> None:
    """Fit the best explanation so far on paths that are sought anew with it.

    The paths that it was found on are of a machine that lacks it: that led them, and their clearance, astray.
    Nothing is done where it explains, unless ``though_explained``.
    """
    best = explanation.best
    seek_anew(search, explanation, best.hypotheses, best.fit.values, best, though_explained)


def seek_anew(
    search: Search,
    explanation: Explanation,
    held: Sequence[Hypothesis],
    values: np.ndarray,
    base: Attempt,
    again: bool,
    clearance: float | None = None,
) -> Attempt | None:
    """Fit hypotheses on paths that are sought with them from the first look on.

    Args:
        search: that made the attempt.
        explanation: added to.
        held: hypotheses.
        values: (recordings, unknowns) to begin with.
        base: attempt by whose clocks, if a force of its has some.
        again: whether they are fitted where something explains already.
        clearance: as of ``fit_everywhere`` [m].
    """
    surest = surest_of(search.starts)
    row = values[surest].copy()
    with search.timed(rhythm_of(base)):
        return search.keep(
            explanation, held,
            lambda: fit_everywhere(search, held, row, surest, base, anew=True, clearance=clearance), again,
        )  # fmt: skip


def rhythm_of(attempt: Attempt) -> Rhythm | None:
    """Period and clocks of an attempt's force that repeats by a clock of its own, if it has one."""
    if unnamed(attempt.hypotheses) is None:
        return None
    law = attempt.model.machine(attempt.fit.values[0]).force
    assert isinstance(law, TabulatedForce)
    if law.period is None:
        return None
    return Rhythm(law.period, tuple(follower.measured.clock for follower in attempt.followers))


def begin_plausible(search: Search, explanation: Explanation, base: Attempt) -> None:
    """Fit every effect of one size from a plausible one, where the path is far from right.

    A linear look beside such a path may promise nothing of an effect that, once there, follows the recording.
    What acts inside the joint has been tried by then (``begin_inside``). Where the work is balanced, nothing
    that acts on the links from outside is.
    """
    if base.misfit < FAR:
        return
    known = {attempt.label for attempt in explanation.attempts}
    groups = [
        [group[0]]
        for group in search.others(base)
        if of_one_size(group[0])
        and group[0].fault is None
        and group[0].name not in (*_ELSEWHERE, *GEOMETRIC, *_INSIDE, _FILM, EDGED)  # at one place of many
        and group[0].label not in known
        and not (explanation.balanced and group[0].body in _OUTSIDE)
    ]
    drives = [group for group in _judged_elsewhere(search.others(base)) if group[0].name == DRIVE]
    _try_out(search, explanation, base, [*groups, *([] if explanation.balanced else drives)], None)


def begin_inside(
    search: Search,
    explanation: Explanation,
    base: Attempt,
    clearance: float | None = None,
    anew: bool = False,
) -> None:
    """Fit what acts inside the joint from plausible sizes beside ``base``, where that lacks something.

    Beside a path that is not right yet a linear look at impacts tells little of these: a film shows as a gap
    that is too small, and friction of 0.09 as one of 0.016, from where no way leads on. Where films or
    friction are not among the hypotheses, a resistance of free form is tried in the place of the nominal
    machine.

    Args:
        search: after its nominal stage.
        explanation: added to.
        base: attempt beside which they are fitted.
        clearance: from which they are tried [m]; that of ``base`` if ``None``, or of the motion where they
            mean two paths.
        anew: whether paths are sought with them: those of the nominal machine lack what ``base`` has.
    """
    shown, joint, alone = search.profile.best, search.setting.joint, base is explanation.nominal
    if explained(base) and not incomplete(base) and not cushioned(explanation, base):
        return
    if clearance is None and alone and astray(base.fit.values[0, 0], shown):
        clearance = shown
    others = search.others(base)
    groups = [[g[0]] for g in others if g[0].name in _INSIDE and of_one_size(g[0])]
    films = [g for g in others if g[0].name == _FILM]
    tables = []
    if alone and not films:
        tables.append([free_form(resisting(joint, size), joint) for size in _RESISTING])
    if alone and all(g[0].name != _FRICTION for g in others):
        tables.append([free_form(rubbing(joint, size), joint) for size in _RUBBING])
    _try_out(search, explanation, base, [*films, *tables, *groups], clearance, len(_RESISTING), anew)


def _try_out(
    search: Search,
    explanation: Explanation,
    base: Attempt,
    groups: Sequence[Sequence[Hypothesis]],
    clearance: float | None,
    most: int = _TRIALS,
    anew: bool = False,
) -> None:
    """Try hypotheses on one recording, fit the best to all; from a clearance [m], or that of ``base``.

    Of each group ``most`` plausible shapes or sizes are tried, ``anew`` on paths that are sought with them.
    """
    surest = surest_of(search.starts)
    limit, good = max(base.misfits[surest], POOR), enough(base, surest)
    little = min(EXPLAINED, 1.0 + _LEFT * (base.misfits[surest] - 1.0)) if explained(base) else EXPLAINED
    tried: list[_Tried] = []

    def everywhere(one: _Tried) -> bool:
        before = explanation.best
        other = anew or _structural(search, one.held[-1])  # on whichever recording its path is met first
        search.keep(
            explanation, one.held, lambda: fit_everywhere(search, one.held, one.row, surest, base, other)
        )  # fmt: skip
        best, enough = explanation.best, little if explained(base) else EXPLAINED
        return best is not before and explained(best) and best.misfit < enough

    for group in groups:
        own: list[_Tried] = []
        for hypothesis in _of_other_sizes(group)[:most]:
            if search.late():
                return
            held, values = beside(base, [hypothesis], hypothesis.start)
            row = values[surest]
            row[0] = row[0] if clearance is None else clearance
            label = f"{base.label} + {hypothesis.label}"
            own += _on_one(search, held, row, surest, limit, label, anew)
            if own and own[-1].misfit < little:
                break
        if not own:
            continue
        one = min(own, key=lambda one: one.misfit)
        if one.misfit >= little:
            one = _again(search, one, surest, limit, base.label, anew)
        if one.misfit >= little:
            tried.append(one)
        elif everywhere(one):  # of the others, too? one recording at one speed shows little of a motor
            return
    some = 1.0 + _SOME * (base.misfits[surest] - 1.0)
    for one in sorted(tried, key=lambda one: one.misfit)[:_FITTED]:
        if one.misfit > (some if explained(base) else good) or search.late() or everywhere(one):
            return


class _Tried(NamedTuple):
    """What one recording says of hypotheses: the misfit, and the (unknowns,) values of their model."""

    misfit: float
    held: list[Hypothesis]
    row: np.ndarray


def _on_one(
    search: Search,
    held: list[Hypothesis],
    row: np.ndarray,
    surest: int,
    limit: float,
    label: str,
    anew: bool = False,
) -> list[_Tried]:
    """Follow the surest recording with the last hypothesis, from values; nothing where that fails."""
    model, hypothesis = search.setting.model(held), held[-1]

    def make() -> Followed | None:
        if not anew:
            return grow(start_with(search, hypothesis, model, row, surest), model, row, limit)
        start = search.sought(surest, model, row)
        return grow(start, model, np.append(row[:-1], start.trace.speed), limit)

    try:
        found = search.finished.followed(f"{label} from {row}, one recording", make)
    except (InputError, np.linalg.LinAlgError):
        return []
    if found is None:
        return []
    search.report(f"  {hypothesis.label}: misfit {found[2]:.3g} on one recording")
    return [_Tried(found[2], held, found[1])]


def _again(search: Search, one: _Tried, surest: int, limit: float, label: str, anew: bool = False) -> _Tried:
    """Where it is followed badly: again from what was found, a flexible part with other dampings, too.

    A table or the frequency at which a part rings shows soon; the path that was begun with another one stays
    torn.
    """
    hypothesis = one.held[-1]
    damped = np.array([unknown.name == "damping_ratio" for unknown in hypothesis.unknowns])
    label = f"{label} + {hypothesis.label} again"
    if not (_structural(search, hypothesis) and damped.any()):
        while one.misfit >= EXPLAINED and not search.late():
            again = _on_one(search, one.held, one.row, surest, _BETTER * one.misfit, label, anew)
            if not again or again[0].misfit > _BETTER * one.misfit:
                break
            one = again[0]
        return one
    for times in _AGAIN:
        if one.misfit < EXPLAINED or search.late():
            break
        row = one.row.copy()
        row[-1 - len(damped) : -1][damped] = times * hypothesis.start[damped]
        again = _on_one(search, one.held, row, surest, limit, label)
        one = min([one, *again], key=lambda one: one.misfit)
    return one


def _structural(search: Search, hypothesis: Hypothesis) -> bool:
    return hypothesis.structural(search.setting.with_clearance(SOME_CLEARANCE))


def _of_other_sizes(group: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Trials of one effect, other sizes before other shapes: a mode at 1.7 kHz is not found from 300 Hz."""
    seen: dict[tuple[float, ...], int] = {}
    order = []
    for hypothesis in group:
        size = tuple(hypothesis.start[~hypothesis.shapes])
        seen[size] = seen.get(size, 0) + 1
        order.append(seen[size])
    return [group[i] for i in np.argsort(order, kind="stable")]


def _single(hypothesis: Hypothesis) -> bool:
    """Whether it has one size beside shapes: the simplest variant of its effect; a drive has two gains."""
    return of_one_size(hypothesis) or hypothesis.name == DRIVE


def of_one_size(hypothesis: Hypothesis) -> bool:
    """Whether it has one size, beside shapes."""
    return int((~hypothesis.shapes).sum()) == 1


def _judged_elsewhere(groups: Sequence[Sequence[Hypothesis]]) -> list[Sequence[Hypothesis]]:
    """The simplest variants of the effects in ``_ELSEWHERE``, in that order; both kinds of drive."""
    single = [g for g in groups if g[0].name in _ELSEWHERE and _single(g[0])]
    fewest: dict[str, int] = {}
    for group in single:
        count = len(group[0].unknowns)
        fewest[group[0].name] = min(count, fewest.get(group[0].name, count))
    chosen = [g for g in single if g[0].name == DRIVE or len(g[0].unknowns) == fewest[g[0].name]]
    return sorted(chosen, key=lambda g: _ELSEWHERE.index(g[0].name))
