"""In which order explanations are tried: what is likely and cheap first, what is rare and dear last."""

from collections.abc import Callable

from clearance.diagnosis.elsewhere import begin_elsewhere
from clearance.diagnosis.explain import Explanation, Search, penalised
from clearance.diagnosis.free_search import fit_curve, reshape, suggest_curve
from clearance.diagnosis.missing_force import Curve, unnamed
from clearance.diagnosis.screening import Hint
from clearance.diagnosis.search import Attempt, explained
from clearance.diagnosis.simplify import enlarge, prune

_PART = 0.3  # of what was left: an effect that leaves less is a part of the truth, or close to one
_PAIRS = 3  # pairs that are fitted


def find_explanation(
    search: Search, explanation: Explanation, most: int, keep: Callable[[Explanation], None]
) -> None:
    """Find what explains the recordings, with as few effects as it takes.

    Single effects and sensors at fault come first; beside one that explains a good part of the misfit, the
    next one. Then forces of free form on the slider, where no further named effect acts; effects that no
    linear look can judge; pairs of which neither shows without the other; other forces of free form. What
    explains is looked beside for what is small, and pruned.

    Args:
        search: after its nominal stage.
        explanation: with the nominal attempt; added to.
        most: effects that may be missing together.
        keep: called after each step with what was found so far.
    """
    nominal = explanation.nominal
    pairs: list[Hint] = []
    built_on: list[Attempt] = []
    waiting: list[Curve] = []

    def single() -> None:
        pairs.extend(search.widen(explanation, nominal).pairs[:_PAIRS])

    def build_on() -> None:
        before, base = nominal, explanation.best
        while base not in built_on and _in_part(base, before) and len(base.hypotheses) < most:
            built_on.append(base)
            enlarge(search, explanation)
            if not explained(explanation.best):
                reshape(search, explanation)
            if _enough(explanation):
                return
            base = explanation.best
            search.widen(explanation, base)
            if not search.settled(explanation, base):
                begin_elsewhere(search, explanation, base)
            before, base = base, explanation.best

    def curve() -> None:
        found = suggest_curve(search, nominal)
        if found and found[0].body == "slider":
            fit_curve(search, explanation, found)
        else:
            waiting.extend(found)

    def elsewhere() -> None:
        if not built_on:  # they were tried beside a part already, which falls away where it is none
            begin_elsewhere(search, explanation, nominal)

    def pair() -> None:
        for hint in pairs:
            if not explained(explanation.best):
                search.follow(explanation, nominal, hint)

    def other_curve() -> None:
        fit_curve(search, explanation, waiting)

    for step in (single, build_on, curve, elsewhere, build_on, pair, build_on, other_curve):
        if not _enough(explanation):
            step()
            keep(explanation)
    search.scrutinise(explanation, most)
    prune(search, explanation)


def _enough(explanation: Explanation) -> bool:
    """Whether the recordings are explained, or a table leaves so little that its shape alone is missing."""
    best = explanation.best
    table = unnamed(best.hypotheses) is not None
    return explained(best) or (table and best.misfit < _PART * explanation.nominal.misfit)


def _in_part(attempt: Attempt, base: Attempt) -> bool:
    """Whether named effects explain a good part of what ``base`` leaves, and not all."""
    return (
        len(attempt.hypotheses) > len(base.hypotheses)
        and unnamed(attempt.hypotheses) is None
        and not explained(attempt)
        and penalised(attempt) < _PART * penalised(base)
    )
