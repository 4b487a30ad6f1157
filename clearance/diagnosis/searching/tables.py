"""A table that explains nearly: with more knots, or with jumps between two levels.

A force of free form is found with few knots (``free_search``, ``balance``). What it leaves where the force
changes fast is told from what another force would explain by trying: on the paths that are known, or, where a
slope in the place of a jump has torn them, on paths of its own.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, ROOM, Attempt, explained
from clearance.diagnosis.hypotheses.free_form import (
    ARGUMENTS,
    Curve,
    curve_of,
    free_form,
    known_force,
    refined,
    unnamed,
)
from clearance.diagnosis.hypotheses.two_levels import levels_of, two_levels
from clearance.diagnosis.searching.clocked import fit_again, retime
from clearance.diagnosis.searching.elsewhere import seek_anew
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.search import Search
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.parameters import TABLE_KNOTS

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
            found, fine = retime(search, explanation, fine, found, table)
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
        if law.argument not in ARGUMENTS or 2 * len(law.values) > TABLE_KNOTS or law.returns is not None:
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
        held, rows = [known_force(two_levels(curve, levels), levels)], coarse.fit.values[:, [0, -1]]
        known = seek_anew(search, explanation, held, rows, coarse, again=True, clearance=float(rows[0, 0]))
        if known is not None or search.late():
            break
    if known is None:
        return False
    known.withdrawn = True  # nothing tells how sure its levels are
    jumping, clearance = partial(two_levels, values=levels), float(coarse.fit.values[0, 0])
    found = fit_again(search, explanation, curve, jumping, levels, known, clearance)
    return found is not None and found is explanation.best
