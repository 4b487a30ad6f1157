"""What explains is followed once more, on paths of its own.

The paths on which an effect was found began as those of a machine without it. Impacts that were met from the
wrong side there hold its sizes in a shallow minimum: a lobe of 78 um was found as one of 75 um, sure to
0.3 um, and followed anew from there it leaves a tenth less.
"""

from clearance.diagnosis.following.attempt import ANNEALING, Attempt, explained
from clearance.diagnosis.hypotheses.free_form import unnamed
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE
from clearance.diagnosis.searching.elsewhere import begin_again
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import LOOSE_GUIDE
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import incomplete, margin

_ROUNDS, _RIVALS = 3, 3  # at most
_LESS = 0.99  # of the misfit before: what leaves more has ended in its minimum


def confirm(search: Search, explanation: Explanation, at_last: bool = False) -> None:
    """Follow named effects that explain anew with what they are known to be, as long as that leaves less.

    What explains as well is fitted on those paths too, so that none is asserted for its better path. Where
    the nominal machine explains, its paths are right but for little; its impacts are not where something acts
    inside the joint: beside them a contact of 0.34 times the stiffness was found as one of 0.70. A slider
    that is loose in its guide is lost at its strikes by what follows others.

    Args:
        search: after its nominal stage.
        explanation: added to.
        at_last: whether what leaves more than right effects do is followed, too: nothing was found beside it.
    """
    for _ in range(_ROUNDS):
        best = explanation.best
        if search.late() or not _followed(explanation, best, at_last):
            return
        rivals = _rivals(search, explanation, best)[:_RIVALS]
        begin_again(search, explanation, though_explained=True)
        found = explanation.best
        if found is best:
            return
        for rival in rivals:
            if not search.late():
                search.refit(
                    explanation, rival.hypotheses, found.followers, rival.fit.values, ANNEALING[2], again=True
                )
        if found.misfit > _LESS * best.misfit:
            return


def _followed(explanation: Explanation, best: Attempt, at_last: bool) -> bool:
    """Whether an attempt is of named effects, explains, and was led there by a machine that does not."""
    names = {hypothesis.name for hypothesis in best.hypotheses}
    named = bool(names) and unnamed(best.hypotheses) is None and LOOSE_GUIDE not in names
    right = explained(best) and (at_last or not incomplete(best))
    astray = not explained(explanation.nominal) or any(h.body.startswith("joint") for h in best.hypotheses)
    return named and right and best is not explanation.shown and astray


def _rivals(search: Search, explanation: Explanation, best: Attempt) -> list[Attempt]:
    """Names that explain as well as ``best`` does by a machine of the same coordinates, each at its best."""
    machine = search.setting.with_clearance(SOME_CLEARANCE)
    limit = explanation.price(best) + margin(explanation)
    found: dict[str, Attempt] = {}
    for one in sorted(explanation.standing[1:], key=explanation.price):
        alike = explained(one) and explanation.price(one) < limit and one.label != best.label
        if (
            alike
            and unnamed(one.hypotheses) is None
            and not any(h.structural(machine) for h in (*one.hypotheses, *best.hypotheses))
        ):
            found.setdefault(one.label, one)
    return list(found.values())
