"""Beside what explains the recordings: would a force of free form say more, is something small left?"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.free_form import unnamed
from clearance.diagnosis.searching.beside import beside
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.free_search import reshape
from clearance.diagnosis.searching.misheard import kinds, misheard
from clearance.diagnosis.searching.screening import ONSET, Hint, Screening, screen
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import SURE, margin, unsettled
from clearance.diagnosis.searching.torn import rejoin_impacts
from clearance.diagnosis.searching.wear import WORN
from clearance.diagnosis.sensing.suspicion import disagreement, steady
from clearance.diagnosis.shooting.expectation import wrapped

_UNSEEN = 30.0  # gain that none of five hundred machines with nothing missing promised: 24 was the most
_FITTED = 4  # hypotheses of one screening that are fitted
_RIGHT = 0.98  # misfit of what is surely right: beside it others are not compared
_LESS = 0.5  # of what that has taken: beside it nothing that promises less is tried
_RIVAL = 0.5  # of what lobes promise: others that promise less are not tried
_NEAR = 1.2  # times what the best kind of fault leaves of its channel: one that leaves more is not fitted
_TURNS = 0.5 * np.pi * np.arange(4)  # of lobes' phase from what a linear look says


def scrutinise(search: Search, explanation: Explanation) -> None:
    """Look beside what explains the recordings for what is small but sure, until nothing is.

    Beside the nominal machine what promises more than it does where nothing is missing is fitted, too: a look
    sees little of what acts at strikes alone, and promised 34 of a contact of 0.64 times the stiffness, whose
    fit was worth 300. Where a linear look finds nothing that helps, impacts that are torn are asked. What is
    found beside the nominal machine and says little of what is missing is not built on.

    Args:
        search: with its recordings.
        explanation: added to.
    """
    best = explanation.best
    while explained(best) and len(best.hypotheses) < search.most and unnamed(best.hypotheses) is None:
        if search.late() and explanation.hints:
            return
        found = screen(best, search.others(best), search.workers)
        look_beside_nominal(search, explanation, found if best is explanation.nominal else None)
        enough = _UNSEEN if best is explanation.nominal else SURE
        sure = [hint for hint in found.singles if hint.gain > enough]
        ways = [[replace(hint, values=_begun(hint)), hint] for hint in sure]
        ways = sorted([*ways, *([hint] for hint in misheard(search, best))], key=lambda way: -way[0].gain)
        for begun, *whole in ways[:_FITTED]:
            price = explanation.price(explanation.best)
            _refit(search, explanation, best, [begun])
            if not explanation.price(explanation.best) < price - SURE:
                _refit(search, explanation, best, whole, again=True)  # an impact may hold back what began
        if explanation.best is best:
            _refit(search, explanation, best, rejoin_impacts(search, best))
        if explanation.best is not best:
            compare_kinds(search, explanation)
        _compare_orders(search, explanation, best)
        if explanation.best is best or (best is explanation.nominal and unsettled(explanation)):
            return
        best = explanation.best


def look_beside_nominal(search: Search, explanation: Explanation, found: Screening | None = None) -> None:
    """Note what a look beside the nominal machine promises, unless one was taken: else it is not whole.

    Args:
        search: with its recordings.
        explanation: whose hints may be set.
        found: the look, if it was taken for another purpose.
    """
    nominal = explanation.nominal
    if not explanation.hints:
        found = found or screen(nominal, search.others(nominal), search.workers)
        explanation.hints = found.singles


def contest(search: Search, explanation: Explanation) -> None:
    """Let forces of free form compete with a named one on crank, rod or slider, alone or beside small ones.

    A name is given up only where a table says clearly more: it can imitate what it has no name for.
    """
    best = explanation.best
    if not explained(best) or unnamed(best.hypotheses) is not None or search.late():
        return
    labels = {h.label for h in best.hypotheses}
    alone = [a for a in explanation.attempts if len(a.hypotheses) == 1 and a.label in labels and explained(a)]
    if not alone:
        return
    reshape(search, explanation, min(alone, key=explanation.price))
    table = explanation.best
    if table is not best and explanation.price(table) + margin(explanation) > explanation.price(best):
        for attempt in explanation.attempts:
            attempt.withdrawn |= unnamed(attempt.hypotheses) is not None


def compare_kinds(search: Search, explanation: Explanation) -> None:
    """Fit other kinds of the sensors' faults that explain: what rings as fast as it dies away is only late.

    Args:
        search: with its recordings.
        explanation: added to.
    """
    best, end = explanation.best, 1
    if not explained(best) or unnamed(best.hypotheses) is not None:
        return
    for place, told in enumerate(best.hypotheses):
        start, end = end, end + len(told.unknowns)
        found = kinds(search, best, best.followers, told.channel) if told.channel else []
        for other, values, misfit in found:
            if other.name == told.name or misfit > _NEAR * found[0][2] or search.late():
                continue
            held = [*best.hypotheses[:place], other, *best.hypotheses[place + 1 :]]
            rows = np.tile(values, (len(best.fit.values), 1))
            rows = np.hstack([best.fit.values[:, :start], rows, best.fit.values[:, end:]])
            search.refit(explanation, held, best.followers, rows, best.scale, 20)


def hear(explanation: Explanation) -> None:
    """Withdraw a fault of a sensor beside which another one of it tells better what the sensor has recorded.

    Attempts compare recordings with the fault undone. What comes back through a resonance has other noise
    than what was late, so that two faults of one sensor are compared with the recording as it is.
    """
    while rivals := _rivals(explanation):
        best = explanation.best
        samples = sum(follower.measured.values[..., 0].size for follower in best.followers)
        gains = [samples * (_heard(best, *disputed) - _heard(one, *disputed)) for one, disputed in rivals]
        if max(gains) < SURE:
            return
        best.withdrawn = True


def _rivals(explanation: Explanation) -> list[tuple[Attempt, list[str]]]:
    """What differs from the best attempt by kinds of sensors' faults alone, and these sensors' channels."""

    def places(attempt: Attempt) -> list[str]:
        return sorted(h.channel or h.label for h in attempt.hypotheses)

    def faults(attempt: Attempt) -> set[tuple[str, str]]:
        return {(h.name, h.channel) for h in attempt.hypotheses if h.channel}

    best, rivals = explanation.best, []
    for other in explanation.standing[1:]:
        # the same fault beside other lobes is no rival: both have undone it
        disputed = sorted({channel for _, channel in faults(best) ^ faults(other)})
        if disputed and explained(other) and places(other) == places(best):
            rivals.append((other, disputed))
    return rivals


def _heard(attempt: Attempt, *disputed: str) -> float:
    """Robust mean square of what instruments make of an attempt's signals, beside the recordings.

    Args:
        attempt: with its paths.
        disputed: channels that have no say in which segments are compared.
    """
    total, samples = 0.0, 0
    for follower, row, one in zip(attempt.followers, attempt.fit.values, attempt.fit.passes, strict=True):
        measured = follower.measured
        channels = len(measured.channels)
        told = measured.seen(one.predicted, attempt.model.instrument(row))
        residuals = (told - measured.values) / measured.sigma
        silent = [measured.channels.index(channel) for channel in disputed]
        calm = residuals[steady(residuals, silent)].reshape(-1, channels)
        total += len(calm) * float((disagreement(calm) ** 2).sum())
        samples += len(calm)
    return total / samples


def _compare_orders(search: Search, explanation: Explanation, base: Attempt) -> None:
    """Where a worn bearing is best beside ``base``: lobes of other orders that promise nearly as much.

    Beside a round bearing a linear look may prefer four lobes of a tenth of the size to two, and knows
    little of where these are: where the journal touches changes with the lobes.
    """
    added = explanation.best.hypotheses[len(base.hypotheses) :]
    if len(added) != 1 or added[0].name != WORN or explanation.best.misfit < _RIGHT or search.late():
        return
    worn = [h for group in search.others(base) for h in group if h.name == WORN]
    found = {
        order: screen(base, [[h for h in worn if h.start[1] == order]], search.workers).singles
        for order in sorted({h.start[1] for h in worn})
    }
    most = max((hint.gain for hints in found.values() for hint in hints), default=0.0)
    taken = round(float(explanation.best.fit.values[0, base.model.shared + 1]))
    for order, hints in found.items():
        if order == taken:
            continue
        first = explanation.best
        for hint in hints:
            for turn in _TURNS if hint.gain > max(SURE, _RIVAL * most) else ():
                if explanation.best is first:
                    lobes = replace(hint, values=_turned(hint, turn))
                    _refit(search, explanation, base, [lobes], again=True)


def _turned(lobes: Hint, turn: float) -> np.ndarray:
    """Amplitude, order and phase of lobes, turned; the phase far from its bounds."""
    amplitude, order, phase = lobes.values
    return np.array([amplitude, order, wrapped(phase + turn)])


def _refit(
    search: Search, explanation: Explanation, base: Attempt, hints: Sequence[Hint], again: bool = False
) -> None:
    """Fit on the paths of ``base`` what is small but sure beside it; ``again`` in another shape."""
    for hint in hints[:_FITTED]:
        best = explanation.best
        taken = explanation.price(base) - explanation.price(best)
        if search.late() or (best.misfit < _RIGHT and hint.gain < _LESS * taken):
            return
        search.report(f"  {hint.label}: small but sure, {hint.gain:.4g}")
        held, values = beside(base, hint.hypotheses, hint.values)
        search.refit(explanation, held, base.followers, values, base.scale, 20, again)


def _begun(hint: Hint) -> np.ndarray:
    """A hint's values, drawn back to where its effect has hardly begun."""
    off = np.concatenate([h.off for h in hint.hypotheses])
    shapes = np.concatenate([h.shapes for h in hint.hypotheses])
    near = np.isfinite(off) & ~shapes
    return np.where(near, off + ONSET * (hint.values - np.where(near, off, 0.0)), hint.values)
