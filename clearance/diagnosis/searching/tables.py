"""A table that explains nearly: with more knots, with its own period, or with jumps between two levels.

A force of free form is found with few knots (``free_search``, ``balance``). What it leaves where the force
changes fast is told from what another force would explain by trying: on the paths that are known, or, where a
slope in the place of a jump has torn them, on paths of its own.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from clearance.diagnosis.following.attempt import ANNEALING, ROOM, Attempt, explained
from clearance.diagnosis.hypotheses.free_form import (
    ARGUMENTS,
    Curve,
    curve_of,
    free_form,
    refined,
    unnamed,
)
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.hypotheses.two_levels import known_levels, levels_of, two_levels
from clearance.diagnosis.searching.elsewhere import seek_anew
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.settle import settle
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.parameters import TABLE_KNOTS

_UNTIMELY, _PERIODS, _TIMED = 3e-3, 8, 2  # share of a period that it may be off; trials; steps of each
_BETWEEN = ("cubic", "linear")  # knots
_HALF = 0.5  # of the nominal misfit: a table that leaves more is not too coarse, but wrong
_JUMPING = 0.75  # of it: slopes tear paths, so that a table of jumps leaves much until they are placed
_MUCH_LESS = 0.7  # of what a coarse table leaves: then a finer one may still be too coarse


def refine_table(search: Search, explanation: Explanation, curve: Curve, coarse: Attempt) -> None:
    """Fit a curve with a knot between each two where its table leaves little: it may be too coarse.

    Again with twice as many, as long as these leave much less.
    """
    if place_jumps(search, explanation, curve, coarse):
        return
    left, room = _HALF * explanation.nominal.misfit, TABLE_KNOTS // 2
    while coarse.misfit < left and coarse.scale <= ANNEALING[3] and len(curve.knots) <= room:
        finer = list[tuple[Attempt, Curve]]()
        for between in _BETWEEN:
            if explained(explanation.best) or search.late():
                return
            finer += _double(search, explanation, curve, coarse, between)
        found, fine = min(finer, key=lambda one: one[0].misfit, default=(coarse, curve))
        if fine.period is not None and not search.late():
            fine = replace(fine, forces=found.fit.values[0, 1:-1])
            table = partial(free_form, joint=search.setting.joint)
            found, fine = _retime(search, explanation, fine, found, table)
        if found.misfit > _MUCH_LESS * coarse.misfit:
            return
        curve, coarse = fine, found


def _double(
    search: Search, explanation: Explanation, curve: Curve, coarse: Attempt, between: str
) -> list[tuple[Attempt, Curve]]:
    """What comes of a curve with a knot between each two, and that curve; nothing where it fails."""
    rows = coarse.fit.values
    fine = refined(replace(curve, forces=rows[0, 1:-1]), between)
    values = np.array([[row[0], *fine.forces, row[-1]] for row in rows])
    search.report(f"  with {len(fine.knots)} instead of {len(curve.knots)} knots, {between} between them")
    held = [free_form(fine, search.setting.joint)]
    found = search.refit(explanation, held, coarse.followers, values, ANNEALING[3], again=True)
    return [] if found is None else [(found, fine)]


def _retime(
    search: Search,
    explanation: Explanation,
    curve: Curve,
    known: Attempt,
    force: Callable[[Curve], Hypothesis],
) -> tuple[Attempt, Curve]:
    """A force over time with the period with which the recordings are followed best, or as it was.

    Where impacts are strong, the balance of work knows the period to a part in a thousand: jumps then come a
    segment too early at one end of a recording and too late at the other. Clocks turn with the period so that
    the middle of each recording stays where it was.

    Args:
        search: that made the attempt.
        explanation: added to.
        curve: with the period.
        known: the attempt.
        force: with a curve's period.

    Returns:
        The attempt, and the curve.
    """
    rows = known.fit.values

    def timed(change: float) -> tuple[Curve, list[Follower]]:
        assert curve.period is not None
        period = curve.period * (1.0 + change)
        own = [follower.part(0, follower.segments) for follower in known.followers]
        for follower in own:
            one = follower.measured
            middle = one.begin + 0.5 * one.segment * follower.segments
            follower.measured = replace(one, clock=one.clock + change * middle, period=period)
        return replace(curve, knots=curve.knots * (1.0 + change), period=period), own

    def left(change: float) -> float:
        other, own = timed(change)
        model = search.setting.model([force(other)])
        return settle(own, model, rows, _TIMED, 3e-2, search.workers, scale=known.scale).level

    found = minimize_scalar(
        left, method="bounded", bounds=(-_UNTIMELY, _UNTIMELY), options={"maxiter": _PERIODS}
    )
    other, own = timed(float(found.x))
    search.report(f"  with a period longer by {float(found.x):.3%}")
    again = search.refit(explanation, [force(other)], own, rows, ANNEALING[3], again=True)
    return (known, curve) if again is None or again.misfit > known.misfit else (again, other)


def sharpen(search: Search, explanation: Explanation) -> None:
    """Put a knot between each two of the best table, where it stands alone, as long as that says more.

    What a table leaves where the force jumps, or changes fast, looks like noise that is a little too strong.
    """
    while explanation.best.misfit > ROOM and len(explanation.best.hypotheses) == 1:
        best = explanation.best
        if unnamed(best.hypotheses) is None:
            return
        law = best.model.machine(best.fit.values[0]).force
        assert isinstance(law, TabulatedForce)
        if law.argument not in ARGUMENTS or 2 * len(law.values) > TABLE_KNOTS:
            return
        if place_jumps(search, explanation, curve_of(law), best):
            return
        for between in _BETWEEN:
            if not search.late():
                _double(search, explanation, curve_of(law), best, between)
        if explanation.best is best:
            return


def place_jumps(search: Search, explanation: Explanation, curve: Curve, coarse: Attempt) -> bool:
    """Follow a force over time that jumps between two levels as such, then fit it; whether that says more.

    Beside a slope in the place of a jump a path is torn, and no finer table mends it: it is sought anew with
    jumps that lie where the slope's impulse tells.

    Args:
        search: that made the attempt.
        explanation: added to.
        curve: the force before it was fitted.
        coarse: the attempt with it.
    """
    near = explained(coarse) or coarse.misfit < _JUMPING * explanation.nominal.misfit
    if curve.period is None or not near or search.late():
        return False
    fitted = levels_of(replace(curve, forces=coarse.fit.values[0, 1:-1]))
    if fitted is None:
        return False
    balanced, known = levels_of(curve), None
    # the balance of work knows less of the mean of a force, and nothing of torn paths
    placed = [] if balanced is None else [np.append(fitted[:2], balanced[2:])]
    placed += [] if placed and np.allclose(placed[0], fitted) else [fitted]
    for levels in placed:
        search.report(f"  as two levels of {levels[0]:.4g} and {levels[1]:.4g} with jumps")
        held, rows = [known_levels(curve, levels)], coarse.fit.values[:, [0, -1]]
        known = seek_anew(search, explanation, held, rows, coarse, again=True, clearance=float(rows[0, 0]))
        if known is not None or search.late():
            break
    if known is None:
        return False
    known.withdrawn = True  # its levels are of the coarse table, and nothing tells how sure they are
    values = np.array([[one[0], *levels, one[-1]] for one in known.fit.values])
    jumping = [two_levels(curve, levels)]
    found = search.refit(explanation, jumping, known.followers, values, ANNEALING[3], again=True)
    if found is not None and found.misfit > ROOM and not search.late():
        first = len(explanation.attempts) - 1
        found, _ = _retime(search, explanation, curve, found, partial(two_levels, values=levels))
        for one in explanation.attempts[first:]:  # of one force with two periods one stands
            one.withdrawn = one is not found
    return found is not None and found is explanation.best
