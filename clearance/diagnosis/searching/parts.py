"""Which attempt is built on: named effects that explain a part of what is missing; and when one is enough."""

from collections.abc import Iterator
from contextlib import contextmanager

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.free_form import unnamed
from clearance.diagnosis.searching.beside import MOSTLY, NEARLY
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import GEOMETRIC, LOOSE_GUIDE

PART = 0.3  # of what was left: an effect that leaves less is a part of the truth, or close to one
_HARDLY = 1.1  # times what a table leaves: where fewer knots leave no more, it is no matter of its shape
_SEEN = 0.5  # likewise of a dimension, which the motion vouches for whatever the forces


def named(explanation: Explanation) -> Attempt:
    """The best attempt; where it has a table that leaves much all the same, the best without one.

    So it is where a finer table does not explain either and a name leaves little of what is missing: the
    table may do what several things do together, and the name is one of them.
    """
    best = explanation.best
    without = min((a for a in explanation.standing if unnamed(a.hypotheses) is None), key=explanation.price)
    little = explanation.price(best) < PART * explanation.price(without)
    nearly = without.misfit < MOSTLY * explanation.nominal.misfit
    several = nearly and not explained(best) and _refined(explanation, best)
    return best if unnamed(best.hypotheses) is not None and little and not several else without


def unfinished(explanation: Explanation, most: float) -> Attempt:
    """As ``named``; where that has as many effects as may be missing, the best one with fewer.

    A second effect beside a right first one may take away some of what another one does, and not be there.
    """
    best = named(explanation)
    if len(best.hypotheses) < most or unnamed(best.hypotheses) is not None:
        return best
    without = (a for a in explanation.standing if unnamed(a.hypotheses) is None)
    return min((a for a in without if len(a.hypotheses) < most), key=explanation.price)


@contextmanager
def set_aside(explanation: Explanation, most: float) -> Iterator[None]:
    """Within it no effects stand that are as many as may be missing and do not explain: others are sought."""
    aside = [a for a in explanation.standing if len(a.hypotheses) >= most and not explained(a)]
    for one in aside:
        one.withdrawn = True
    try:
        yield
    finally:
        for one in aside:
            one.withdrawn = False


def in_part(explanation: Explanation, attempt: Attempt, base: Attempt, part: float) -> bool:
    """Whether named effects leave less than a part of what ``base`` leaves beyond noise, but something."""

    def beyond_noise(one: Attempt) -> float:
        return explanation.price(one) - explanation.samples

    geometric = bool(attempt.hypotheses) and attempt.hypotheses[-1].name in GEOMETRIC
    return (
        len(attempt.hypotheses) > len(base.hypotheses)
        and unnamed(attempt.hypotheses) is None
        and not explained(attempt)
        and beyond_noise(attempt) < (max(_SEEN, part) if geometric else part) * beyond_noise(base)
    )


def enough(explanation: Explanation) -> bool:
    """Whether the recordings are explained, or a table leaves so little that its shape alone is missing.

    It is not that where a finer table leaves no less. Without the play that its motion shows no machine is
    followed.
    """
    best = explanation.best
    table = unnamed(best.hypotheses) is not None and not _refined(explanation, best)
    if explanation.rails is not None and not any(_loose(a) for a in explanation.attempts):
        return True
    return explained(best) or (table and best.misfit < min(PART * explanation.nominal.misfit, NEARLY))


def _refined(explanation: Explanation, best: Attempt) -> bool:
    """Whether a table with more knots was fitted in its place, or it has more and leaves hardly less."""
    knots, others = best.model.shared, [a for a in explanation.attempts if a.label == best.label]
    more = any(a.model.shared > knots for a in others)
    return more or any(a.model.shared < knots and a.misfit < _HARDLY * best.misfit for a in others)


def _loose(attempt: Attempt) -> bool:
    return any(hypothesis.name == LOOSE_GUIDE for hypothesis in attempt.hypotheses)
