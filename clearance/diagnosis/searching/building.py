"""What else is missing beside an effect that explains a part, and beside both, and so on."""

from collections.abc import Sequence
from itertools import takewhile

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.hypotheses.free_form import unnamed
from clearance.diagnosis.searching.beside import FAR, NEARLY
from clearance.diagnosis.searching.elsewhere import begin_again, begin_elsewhere, begin_inside
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.free_search import reshape, reshape_anew
from clearance.diagnosis.searching.from_motion import begin_wear
from clearance.diagnosis.searching.from_work import begin_beside
from clearance.diagnosis.searching.geometry import GEOMETRIC
from clearance.diagnosis.searching.parts import enough, in_part, set_aside, unfinished
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.simplify import enlarge
from clearance.diagnosis.searching.wear import WORN
from clearance.diagnosis.searching.widen import look, settled, widen


def build_on(
    search: Search, explanation: Explanation, before: Attempt, built_on: list[Attempt], part: float
) -> None:
    """Try what may be missing beside the best attempt, as long as each explains a part of what was left.

    Args:
        search: the recordings, the effects that are allowed, and the time that is left.
        explanation: what was found so far, to which attempts are added.
        before: the attempt of which the best one must explain a part.
        built_on: attempts beside which others were looked for; those that are now are added.
        part: of what was left: an effect that leaves more is not built on.
    """
    with set_aside(explanation, search.most):
        base = unfinished(explanation, search.most)
        while (
            base not in built_on
            and in_part(explanation, base, before, part)
            and len(base.hypotheses) < search.most
        ):
            built_on.append(base)
            if base is explanation.best:
                enlarge(search, explanation)
                if explanation.best is not base and not _over(search, explanation):
                    begin_again(search, explanation)  # the smaller variant may have torn paths
            if _over(search, explanation):
                return
            beside = _try_beside(search, explanation, built_on)
            if beside is None:
                return
            before, base = beside, unfinished(explanation, search.most)


def _try_beside(search: Search, explanation: Explanation, built_on: list[Attempt]) -> Attempt | None:
    """Try what may be missing beside the best attempt, or a better one that a table in its place led to.

    Either is added to those that were built on.

    Returns:
        The attempt beside which it was tried; ``None`` where that is enough.
    """
    base = unfinished(explanation, search.most)
    _add(built_on, base)
    beside, tables = look(search, explanation, base), list[Attempt]()
    if base is explanation.best and not beside.obvious:  # else something is there beside the name
        for hint in beside.plain:  # no force in the name's place is a dimension, or a sensor's fault
            if hint.hypotheses[0].name in GEOMETRIC or hint.hypotheses[0].fault is not None:
                search.follow(explanation, base, hint)
            if settled(search, explanation, base):
                return None
        tables = reshape(search, explanation, base)
        if _over(search, explanation):
            return None
        if base is not unfinished(explanation, search.most):
            base = unfinished(explanation, search.most)
            _add(built_on, base)
            beside = look(search, explanation, base)
    begin_beside(search, explanation, base)
    if settled(search, explanation, base):
        return None
    _widen_beside(search, explanation, base, beside.promising)
    further = explanation.best is not base and unnamed(explanation.best.hypotheses) is None
    if further and not settled(search, explanation, base):
        begin_again(search, explanation)
    if beside.obvious and base is explanation.best and not settled(search, explanation, base):
        tables = reshape(search, explanation, base)
    if not settled(search, explanation, base):
        reshape_anew(search, explanation, base, tables)
    if base.misfit > FAR and not settled(search, explanation, base):
        begin_inside(search, explanation, base)
    if not settled(search, explanation, base):
        begin_elsewhere(search, explanation, base)
    if NEARLY < base.misfit <= FAR and not settled(search, explanation, base):
        begin_inside(search, explanation, base, anew=True)  # its own paths have bent to what is missing
    return base


def _widen_beside(search: Search, explanation: Explanation, base: Attempt, hopeful: Sequence[Hint]) -> None:
    """Try what promises something beside an attempt, and lobes before what promises less than they do.

    Lobes take up much of what promises more. The motion tells them where the path is far, a look where it
    is near.
    """
    near = base.misfit < NEARLY
    first = list(takewhile(lambda hint: hint.hypotheses[0].name != WORN, hopeful))
    rest = hopeful[len(first) :]
    widen(search, explanation, base, first)
    if rest and not (near or settled(search, explanation, base)):
        begin_wear(search, explanation, base)
    widen(search, explanation, base, rest)
    if rest and near and not settled(search, explanation, base):
        begin_wear(search, explanation, base)


def _add(built_on: list[Attempt], base: Attempt) -> None:
    if base not in built_on:
        built_on.append(base)


def _over(search: Search, explanation: Explanation) -> bool:
    return enough(explanation) or search.late()
