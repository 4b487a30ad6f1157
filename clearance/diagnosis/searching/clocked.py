"""A force by a clock of its own: its period, and how one that jumps between two levels is followed.

The balance of work finds period, clocks and shape of such a force beside a motion that lacks it. Beside it
the motion shows another clearance, and with that another shape and other clocks; by these the recordings are
followed with the force as it is, so that no fit leads it astray on a path that is not right yet.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from clearance.diagnosis.following.attempt import ANNEALING, ROOM, Attempt
from clearance.diagnosis.hypotheses.free_form import Curve, curve_of, free_form, known_force, lasting
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.hypotheses.two_levels import two_levels
from clearance.diagnosis.searching.balance import settle_clocks, settle_in
from clearance.diagnosis.searching.elsewhere import rhythm_of
from clearance.diagnosis.searching.everywhere import fit_from
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.work import Balanced
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError
from clearance.mechanism.applied_force import TabulatedForce
from clearance.simulation.layout import State

_UNTIMELY, _PERIODS, _TIMED = 3e-3, 8, 2  # share of a period that it may be off; trials; steps of each
_SETTLED = 2  # times that clearance, clocks and shape are settled, each beside the others
_LOOKS = 3  # for paths by clocks that were set by others
_TORN, _LOST = 2.0, 10.0  # misfit above which paths are sought anew; or with which no period is told
_AS_WELL = 1.1  # times what is left: a period is as good beside a stretch
_MUCH_LESS = 0.7  # of what is left: paths that are sought anew are better


def follow_jumps(
    search: Search, explanation: Explanation, one: Balanced, curve: Curve, levels: np.ndarray
) -> Attempt | None:
    """Fit a force that jumps between two levels, once clearance, clocks and shape go together.

    Args:
        search: after its nominal stage.
        explanation: added to.
        one: of the suggestions of the balance of work, with a rhythm.
        curve: its table.
        levels: of that, as of ``levels_of``.
    """
    force = partial(two_levels, values=levels)
    settled = replace(one, hypotheses=(force(curve),), values=levels, curve=None)
    try:
        for _ in range(_SETTLED):
            with search.timed(settled.rhythm):
                settled = settle_in(search, search.setting, settled)
                settled = settle_clocks(search, search.setting, settled, lambda p: force(lasting(curve, p)))
        with search.timed(settled.rhythm):
            settled = settle_in(search, search.setting, settled)
    except (InputError, np.linalg.LinAlgError):
        return None
    assert settled.rhythm is not None
    curve, levels = lasting(curve, settled.rhythm.period), settled.values
    shown = ", ".join(f"{value:.4g}" for value in levels)
    gap = f"{settled.clearance * 1e3:.3f} mm"
    search.report(f"  levels and jumps {shown} every {curve.period:.5g} s go with a clearance of {gap}")
    held = known_force(force(curve), levels)
    with search.timed(settled.rhythm):
        known = fit_from(
            search, explanation, explanation.nominal, [held], np.zeros(0), settled.clearance, anew=True
        )
    if known is None:
        return None
    known.withdrawn = True  # nothing tells how sure its levels are
    return fit_again(search, explanation, curve, force, levels, known, settled.clearance)


def fit_again(
    search: Search,
    explanation: Explanation,
    curve: Curve,
    force: Callable[[Curve], Hypothesis],
    values: np.ndarray,
    known: Attempt,
    clearance: float,
) -> Attempt | None:
    """Fit a force over time on paths that were followed with what is known of it.

    The period is set by the paths, the values are fitted, and paths sought anew with these, as long as they
    are torn and that helps: a jump that comes a segment too early loses a recording, or tears it where it is
    not lost.

    Args:
        search: that made the attempt.
        explanation: added to.
        curve: with the period.
        force: with a curve's period.
        values: (unknowns,) of it that are known.
        known: the attempt.
        clearance: with which the motion agrees [m]; that of a torn path is astray.
    """
    first, nominal, found = len(explanation.attempts), explanation.nominal, None
    for look in range(_LOOKS):
        if known.misfit > ROOM and not search.late():
            known, curve = retime(search, explanation, curve, known, _held(force, values))
        rows = np.array([[one[0], *values, one[-1]] for one in known.fit.values])
        scale = max(known.scale, ANNEALING[3])
        again = search.refit(explanation, [force(curve)], known.followers, rows, scale, again=True)
        if again is not None and again.misfit > ROOM and not search.late():
            again, curve = retime(search, explanation, curve, again, force)
        if again is None or (found is not None and not again.misfit < _MUCH_LESS * found.misfit):
            break
        found = again
        if not found.misfit > _TORN or look == _LOOKS - 1 or search.late():
            break
        values = found.fit.values[0, 1:-1]
        held = known_force(force(curve), values)
        with search.timed(rhythm_of(found)):
            anew = fit_from(search, explanation, nominal, [held], np.zeros(0), clearance, anew=True)
        if anew is None:
            break
        known = anew
    if found is not None and not found.misfit > _LOST and not search.late():
        found = _lasting_on(search, explanation, curve, found, force)
    for one in explanation.attempts[first:]:  # of one force with two periods one stands
        one.withdrawn = one is not found
    return found


def _held(force: Callable[[Curve], Hypothesis], values: np.ndarray) -> Callable[[Curve], Hypothesis]:
    """The force of which nothing is fitted, with a curve's period."""
    return lambda curve: known_force(force(curve), values)


def retime(
    search: Search,
    explanation: Explanation,
    curve: Curve,
    known: Attempt,
    force: Callable[[Curve], Hypothesis],
) -> tuple[Attempt, Curve]:
    """A force over time with the period with which the recordings are followed best, or as it was.

    Where impacts are strong, the balance of work knows the period to a part in a thousand: jumps then come a
    segment too early at one end of a recording and too late at the other. Clocks turn with the period so that
    the middle of each stretch stays where it was.

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
    known_at = _middles(known)

    def timed(change: float) -> tuple[Curve, list[Follower]]:
        assert curve.period is not None
        return _by(curve, known, curve.period * (1.0 + change), change * np.array(known_at))

    def left(change: float) -> float:
        other, own = timed(change)
        model = search.setting.model([force(other)])
        return settle(own, model, rows, _TIMED, 3e-2, search.workers, scale=known.scale).level

    bounds = (-_UNTIMELY, _UNTIMELY)
    change = minimize_scalar(left, method="bounded", bounds=bounds, options={"maxiter": _PERIODS}).x
    other, own = timed(float(change))
    search.report(f"  with a period longer by {change:.3%}")
    again = search.refit(explanation, [force(other)], own, rows, ANNEALING[3], again=True)
    return (known, curve) if again is None or again.misfit > known.misfit else (again, other)


def keep_time(search: Search, explanation: Explanation) -> None:
    """Give the best table by a clock of its own, if it stands alone, the period that recordings show."""
    best = explanation.best
    if len(best.hypotheses) > 1 or rhythm_of(best) is None or best.misfit > _LOST or search.late():
        return
    law = best.model.machine(best.fit.values[0]).force
    assert isinstance(law, TabulatedForce)
    if law.returns is None:  # of jumps it is known by now
        table = partial(free_form, joint=search.setting.joint)
        best.withdrawn = _lasting_on(search, explanation, curve_of(law), best, table) is not best


def _lasting_on(
    search: Search,
    explanation: Explanation,
    curve: Curve,
    found: Attempt,
    force: Callable[[Curve], Hypothesis],
) -> Attempt:
    """An attempt with the period that suits the rest of the recordings, by the balance of work beside it.

    A stretch of few periods is followed with any that is nearly right, and what is held out is not.
    """
    rhythm = rhythm_of(found)
    assert rhythm is not None
    clearance, *values, _ = found.fit.values[0]
    one = Balanced((force(curve),), np.array(values), np.inf, float(clearance), rhythm=rhythm)
    known_at = _middles(found)
    try:
        with search.timed(rhythm):
            settled = settle_clocks(search, search.setting, one, lambda p: force(lasting(curve, p)), known_at)
    except (InputError, np.linalg.LinAlgError):
        return found
    assert settled.rhythm is not None
    change = settled.rhythm.period / rhythm.period - 1.0
    search.report(f"  with a period longer by {change:.3%}, as the balance of work has it")
    ahead = np.array(settled.rhythm.clocks) - np.array(rhythm.clocks)
    other, own = _by(curve, found, settled.rhythm.period, ahead)
    rows = found.fit.values
    again = search.refit(explanation, [force(other)], own, rows, ANNEALING[3], again=True)
    return found if again is None or again.misfit > _AS_WELL * found.misfit else again


def _middles(attempt: Attempt) -> list[float]:
    """What each recording's clock shows in the middle of the stretch that is followed [s]."""
    return [one.measured.begin + 0.5 * one.measured.segment * one.segments for one in attempt.followers]


def _by(
    curve: Curve, known: Attempt, period: float, ahead: Sequence[float] | np.ndarray
) -> tuple[Curve, list[Follower]]:
    """A curve and followers with another period [s] and with clocks that are ahead [s] of those they have."""
    own = [follower.part(0, follower.segments) for follower in known.followers]
    for follower, shift in zip(own, ahead, strict=True):
        one = follower.measured
        follower.measured = replace(one, clock=one.clock + float(shift), period=period)
        follower.path.nodes[:, State.TIME] += float(shift)  # by which the machine's table is read
    return lasting(curve, period), own
