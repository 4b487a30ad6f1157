"""Of what a force without a name is a function: what predicts best what it was not fitted to.

A table over the crank's angle can say much of what one over the slider's place says, and explain. Which of
them is right shows where a part of the recordings is predicted by what the others tell.
"""

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, Attempt, explained
from clearance.diagnosis.hypotheses.free_form import (
    KNOTS,
    Curve,
    along,
    arguments_of,
    curve_of,
    curve_over,
    free_form,
    refined,
    unnamed,
)
from clearance.diagnosis.hypotheses.missing_force import arguments_along, as_function_of
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.shooting.covariance import optimism
from clearance.mechanism.applied_force import TabulatedForce

_BODIES = ("crank", "rod", "slider")  # on which a force may be a function of more than one thing
_SAID = 0.2  # of a force's robust square that another argument may leave, to be tried


def choose_argument(search: Search, explanation: Explanation) -> None:
    """Let tables over other arguments compete with one that explains, by what they leave of parts left out.

    Each begins as the force that was found, on its paths. Those that leave more are withdrawn. A force over
    time is left: no other argument goes on from one recording to the next as a clock does.

    Args:
        search: after its last step but this.
        explanation: added to.
    """
    best = explanation.best
    if len(best.hypotheses) != 1 or unnamed(best.hypotheses) is None or not explained(best):
        return
    law = best.model.machine(best.fit.values[0]).force
    assert isinstance(law, TabulatedForce)
    curve = curve_of(law)
    if curve.argument == "time" or law.body not in _BODIES:
        return
    for other in _said_otherwise(search, best, curve):
        if search.late():
            break
        search.report(f"  the same as a function of {other.argument}")
        values = np.array([[row[0], *other.forces, row[-1]] for row in best.fit.values])
        held = [free_form(other, search.setting.joint)]
        search.refit(explanation, held, best.followers, values, ANNEALING[2], again=True)
    tables = [a for a in explanation.standing[1:] if a.label == best.label and explained(a)]
    limit = min(explanation.price(a) for a in explanation.standing if a not in tables)
    rivals = [a for a in tables if explanation.price(a) < limit]  # a name that this table beat stays beaten
    least = min(_left(explanation, one) for one in rivals)
    for one in rivals:
        one.withdrawn = _left(explanation, one) > least


def predicted(explanation: Explanation) -> dict[str, float]:
    """What the tables that explain leave a sample of parts left out, by argument; empty without a table."""
    best, found = explanation.best, dict[str, float]()
    if len(best.hypotheses) == 1 and unnamed(best.hypotheses) is not None and explained(best):
        for one in explanation.attempts:
            if one.label == best.label and explained(one):
                law = one.model.machine(one.fit.values[0]).force
                assert isinstance(law, TabulatedForce)
                left, argument = _left(explanation, one) / explanation.samples, curve_of(law).argument
                found[argument] = min(left, found.get(argument, left))
    return found


def _said_otherwise(search: Search, best: Attempt, curve: Curve) -> list[Curve]:
    """The force of a table as functions of other arguments, as finely; of those that can say it."""
    joint, machine = search.setting.joint, best.model.machine(best.fit.values[0])
    each = [
        arguments_along(one, machine, joint, follower.measured)
        for one, follower in zip(best.fit.passes, best.followers, strict=True)
    ]
    known = {name: np.concatenate([one[name] for one in each]) for name in each[0]}
    force, found = along(curve, known[curve.argument]), list[Curve]()
    for argument in arguments_of(curve.body):
        if argument not in (curve.argument, "time"):
            other = curve_over(known[argument], curve.body, curve.direction, argument)
            said, left = as_function_of(force, known[argument], other)
            if left < _SAID:
                found.append(refined(said, "cubic") if len(curve.knots) > KNOTS else said)
    return found


def _left(explanation: Explanation, attempt: Attempt) -> float:
    """What an attempt would leave of parts of the recordings that it was not fitted to."""
    return explanation.samples * attempt.misfit + optimism(attempt.fit)
