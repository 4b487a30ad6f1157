"""From attempts to what is asserted: a verdict, effects with intervals, and what cannot be told apart."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import softmax

from clearance.diagnosis.following.attempt import EXPLAINED, Attempt, explained
from clearance.diagnosis.hypotheses.free_form import FREE_FORM, unnamed
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.judging.free_form import direction_of
from clearance.diagnosis.judging.true_seconds import seconds_of
from clearance.diagnosis.searching.beside import HALFWAY
from clearance.diagnosis.searching.everywhere import misleads
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import LOOSE_GUIDE
from clearance.diagnosis.searching.significance import beats, margin, overstated, suspicious, unsettled
from clearance.diagnosis.shooting.covariance import deviations
from clearance.diagnosis.shooting.follow import EDGE
from clearance.diagnosis.shooting.stretch import Comparison

FITTED = "fitted recordings and motion"
"""The basis of play in a guide where recordings that were held out are lost."""
ONE, MOTION = "one recording", "motion"
"""The basis of what was not followed through all recordings: the prediction of one, or the motion alone."""
_WORSE = 1.02  # times the best one's level, below which another is as good
_SHAPELESS = 2.5  # times as unsure beside a table: root mean square of 12 errors of the plant over deviations
_FAR_NEARER = 0.5  # of the best misfit: what leaves less, if of one recording only, says more of the place
_DRIVEN = 0.35  # of the imbalance: a force that leaves less acts where the torque is needed
_WITHIN = 2.0  # standard deviations of what the motion shows
_LOST = 5.0  # misfit above which a path was lost: a model that is a little wrong leaves less


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % interval."""

    value: float
    low: float
    high: float


def estimates(attempt: Attempt) -> list[Estimate]:
    """Shared parameters, the clearance first, with intervals inside the parameters' bounds.

    Of a machine that is not followed through the recordings what it errs by there says nothing. Beside a
    table the others are less sure than they seem: where it cannot follow what acts, they give way. Beside a
    clock at fault they were counted by its seconds, and are given by true ones.
    """
    found, counted = [], seconds_of(attempt)
    unfollowed = attempt.reach is not None and not explained(attempt)
    each = np.zeros(attempt.model.shared) if unfollowed else deviations(attempt.fit)
    if unnamed(attempt.hypotheses) is not None:
        each = _SHAPELESS * each
    for i, sd in enumerate(each):
        unknown, value = attempt.model.unknowns[i], float(attempt.fit.values[0, i])
        below, above = (0.0, 0.0) if attempt.reach is None else attempt.reach[i]
        low, high = value - max(1.96 * sd, below), value + max(1.96 * sd, above)
        bounded = np.array([value, max(low, unknown.low), min(high, unknown.high)]) * counted[i]
        found.append(Estimate(*map(float, bounded)))
    return found


def withdraw(explanation: Explanation) -> None:
    """Withdraw the best attempt until it beats the nominal machine and has no effect that may as well be off.

    Of an effect every size may be. Not of a force of free form: its knots may be sure together though each is
    not; a constant torque, for example, is the drive's.
    """
    while explanation.best.hypotheses and explanation.best is not explanation.shown:
        best = explanation.best
        numbers, place, sure = estimates(best), 1, beats(best, explanation)
        for hypothesis in best.hypotheses:
            sizes = np.flatnonzero(~hypothesis.shapes)
            sure &= hypothesis.name == FREE_FORM or any(
                not _may_be_off(numbers[place + i], hypothesis, int(i)) for i in sizes
            )
            place += len(hypothesis.unknowns)
        if sure:
            return
        best.withdrawn = True


def _may_be_off(number: Estimate, hypothesis: Hypothesis, i: int) -> bool:
    """Whether a parameter may as well be off: where that is at infinity, if it reaches the end of its range.

    Not a sensor's limit, which is read off: where it cuts no slope tells how sure it is.
    """
    off = hypothesis.off[i]
    if off == np.inf:
        return hypothesis.kind == "physics" and number.high >= hypothesis.unknowns[i].high
    return bool(number.low <= off <= number.high)


def equivalents(explanation: Explanation) -> list[Attempt]:
    """Attempts that cannot be told from the best one, itself first; not those that only add to one of them.

    A force of free form can imitate a named one, and is no alternative to it. Of variants of one effect the
    best one stands for all.
    """
    best = explanation.best
    if not explained(best):
        return [best]
    limit = explanation.price(best) + margin(explanation)
    alike = [
        a
        for a in explanation.attempts
        if a is not best
        and not a.withdrawn
        and unnamed(a.hypotheses) is None
        and explained(a)
        and explanation.price(a) < limit
        and a.level < _WORSE * best.level
    ]
    told: list[tuple[frozenset[tuple[str, str | None]], Attempt]] = [(_what(best), best)]
    for one in sorted(alike, key=lambda one: (len(_what(one)), explanation.price(one))):
        if not any(what <= _what(one) for what, _ in told):
            told.append((_what(one), one))
    return [best, *sorted((one for _, one in told[1:]), key=explanation.price)]


def _what(attempt: Attempt) -> frozenset[tuple[str, str | None]]:
    """What is missing by an attempt: names, and channels of faults."""
    return frozenset((hypothesis.name, hypothesis.channel) for hypothesis in attempt.hypotheses)


def rivals(verdict: str, explanation: Explanation) -> list[Attempt]:
    """The best attempt and what it cannot be told from; of what is not asserted nothing is said."""
    told = verdict != "unknown" or unnamed(explanation.best.hypotheses) is not None
    return equivalents(explanation) if told else [explanation.best]


def place_of(explanation: Explanation, held_out: Attempt | None = None) -> tuple[str | None, str | None]:
    """Body and direction of what is missing: of what was found, or else of what comes nearest to it.

    Args:
        explanation: of the fitted recordings.
        held_out: as of ``verdict_of``.
    """
    best = explanation.best
    suspected = explanation.suspected
    if rattling(explanation):
        return "slider", "y"
    if best is not explanation.shown and nearer(explanation):
        assert suspected is not None
        return suspected.body, suspected.direction
    if cushioned(explanation):
        assert explanation.agreed is not None
        return f"joint_{explanation.agreed[0].lower()}", "normal"
    if drives(explanation):
        assert explanation.worked is not None
        return explanation.worked.body, explanation.worked.direction
    if best.hypotheses:
        return best.hypotheses[0].body, direction_of(best.hypotheses[0].direction)
    if verdict_of(explanation, held_out) == "none" or unconfirmed(explanation, held_out):
        return None, None
    if suspected is not None:
        return suspected.body, suspected.direction
    if explanation.hints:
        likeliest = explanation.hints[0].hypotheses[0]
        return likeliest.body, likeliest.direction
    return None, None


def rattling(explanation: Explanation) -> bool:
    """Whether the motion shows rails, and no machine explains: a path is lost at strikes, whatever is tried.

    Where no sensor feels the slider's height, play in the other joint can look like rails, and leaves less
    of the motion's disagreement then.
    """
    open_question = not explained(explanation.best) and explanation.best is not explanation.shown
    return explanation.rattles < explanation.misplaced and open_question


def nearer(explanation: Explanation) -> bool:
    """Whether a force without a name comes far nearer to one recording than what was found does to all."""
    best, suspected = explanation.best, explanation.suspected
    if rattling(explanation):
        return False
    return suspected is not None and not explained(best) and suspected.misfit < _FAR_NEARER * best.misfit


def drives(explanation: Explanation) -> bool:
    """Whether the balance of work says more of the place than the nearest machine, which leaves much.

    The balance needs no path that follows; on one that does not, almost any force takes away a little.
    """
    best, worked = explanation.best, explanation.worked
    far = not explained(best) and best is not explanation.shown
    much = best.misfit > HALFWAY * explanation.nominal.misfit
    return worked is not None and worked.share < _DRIVEN and far and much


def cushioned(explanation: Explanation) -> bool:
    """Whether no machine explains and the nearest one closed a gap that the motion shows to be wide.

    What keeps the journal from striking acts in the joint. Where a wrong clock, a faulty sensor or another
    dimension takes away much, the nominal machine's motion shows another gap, and tells nothing.
    """
    best = explanation.best
    misled = any(map(misleads, best.hypotheses)) and best.misfit < HALFWAY * explanation.nominal.misfit
    open_question = not explained(best) and best is not explanation.shown
    return open_question and not misled and explanation.shut(best)


def lost(held_out: Attempt) -> list[str]:
    """Names of held-out recordings on which the path was lost, though others are followed to their ends."""
    return gone(held_out) if min(held_out.misfits) < EXPLAINED else []


def gone(held_out: Attempt, most: float = _LOST) -> list[str]:
    """Names of held-out recordings on which the path was lost: more than ``most`` is left."""
    each = zip((f.measured.name for f in held_out.followers), held_out.misfits, strict=True)
    return [name for name, misfit in each if misfit > most]


def unconfirmed(explanation: Explanation, held_out: Attempt | None) -> list[str]:
    """Names of held-out recordings whose path was lost, if that alone speaks against a machine as it is."""
    best = explanation.best
    if held_out is None or best.hypotheses or not explained(best) or suspicious(explanation):
        return []
    shares = held_out.shares or (1.0,) * len(held_out.misfits)
    each = list(zip((f.measured.name for f in held_out.followers), held_out.misfits, shares, strict=True))
    astray = any(EXPLAINED <= misfit <= _LOST for _, misfit, _ in each) or min(held_out.misfits) > _LOST
    return [] if astray else [name for name, misfit, share in each if misfit > _LOST or share < 1.0]


def vouched(explanation: Explanation, held_out: Attempt) -> bool:
    """Whether the motion alone shows all that the fitted recordings are followed with, play in a guide first.

    Of a shoe that hangs between its rails nothing is seen, so that held-out recordings may be lost at their
    first strikes, or at a later one. That is no evidence against play which the motion shows as wide, beside
    as much clearance; what is a little off all along is.
    """
    best, rails = explanation.best, explanation.rails
    if rails is None or rails.followed or not explained(best):
        return False
    if [h.name for h in best.hypotheses] != [LOOSE_GUIDE, *(h.name for h in rails.beside)]:
        return False
    away = np.abs(best.fit.values[0, :2] - [rails.clearance, rails.gap])
    each = zip(held_out.misfits, held_out.fit.passes, strict=True)
    typical = EXPLAINED / held_out.scale**2
    astray = any(EXPLAINED <= misfit <= _LOST and _typical(one) >= typical for misfit, one in each)
    return bool((away < _WITHIN * rails.deviations[:2]).all()) and not astray


def _typical(one: Comparison) -> float:
    """Cost a sample at the scale of the fit, of the middle one of all segments."""
    return float(np.median(one.each[EDGE:-EDGE]))


def _confirmed(held_out: Attempt, effects: bool) -> bool:
    """Whether recordings that were held out are explained, or by effects half of them, and the others lost.

    An effect that is wrong follows none of them to its end; one that is right may be lost at an impact. A
    recording of which a part alone was followed was lost for the rest.
    """
    each = held_out.misfits
    shares = held_out.shares or (1.0,) * len(each)
    followed = [misfit < EXPLAINED for misfit in each]
    whole = sum(own and share == 1.0 for own, share in zip(followed, shares, strict=True))
    half = effects and 2 * whole >= len(each) == sum(followed) + len(lost(held_out))
    return (explained(held_out) and whole == len(each)) or half


def borne_out(explanation: Explanation, held_out: Attempt | None) -> bool:
    """Whether held-out recordings, if there are any, are explained as those are that were fitted."""
    if held_out is None or _confirmed(held_out, bool(explanation.best.hypotheses)):
        return True
    return vouched(explanation, held_out)


def verdict_of(explanation: Explanation, held_out: Attempt | None = None) -> str:
    """None, physics, instrument, mixed, ambiguous or unknown.

    What leaves most of something small is not asserted: any effect takes up a little of another one.

    Args:
        explanation: of the fitted recordings.
        held_out: the best attempt beside recordings that it was not fitted to: what does not explain these,
            too, is not asserted, unless it is ``vouched``.
    """
    best = explanation.best
    if best is explanation.shown:
        return "unknown" if unnamed(best.hypotheses) is not None else _kind(best)
    if not (explained(best) and borne_out(explanation, held_out)):
        return "unknown"
    if not best.hypotheses:
        return "unknown" if suspicious(explanation) else "none"
    if unnamed(best.hypotheses) is not None or unsettled(explanation):
        return "unknown"
    if len(equivalents(explanation)) > 1:
        return "ambiguous"
    return _kind(best)


def _kind(best: Attempt) -> str:
    kinds = {h.kind for h in best.hypotheses}
    return "mixed" if len(kinds) > 1 else kinds.pop()


def probabilities(explanation: Explanation) -> dict[int, float]:
    """Of each that may be asserted, by its ``id``: exp(-difference / 2) of prices, as far as these count.

    What was fitted several times, from other paths or sizes, is one explanation, at its smallest price. What
    is equivalent is likely, too.
    """
    falling = sorted(explanation.standing, key=explanation.price, reverse=True)
    cheapest = {one.labels: explanation.price(one) for one in falling}
    prices = np.array([*cheapest.values()]) / overstated(explanation)
    chance = dict(zip(cheapest, softmax(-0.5 * prices), strict=True))
    return {id(one): float(chance[one.labels]) for one in falling}


def basis_of(explanation: Explanation, held_out: Attempt | None = None) -> str:
    """What the best attempt rests on: prediction of all recordings or of one, or ``FITTED``, or motion."""
    best = explanation.best
    if best is not explanation.shown:
        if held_out is None or _confirmed(held_out, bool(best.hypotheses)):
            return "prediction"
        return FITTED if vouched(explanation, held_out) else "prediction"
    return ONE if explanation.rails is not None and explanation.rails.followed else MOTION


def effects_of(attempt: Attempt, chance: dict[int, float], basis: str = "prediction") -> list[dict[str, Any]]:
    """An attempt's hypotheses as the contract writes them.

    Args:
        attempt: to write down.
        chance: probabilities, as of ``probabilities``.
        basis: as of ``basis_of``.
    """
    found, place, numbers = [], 1, estimates(attempt)
    for hypothesis in attempt.hypotheses:
        parameters = {}
        for i, unknown in enumerate(hypothesis.unknowns):
            number = numbers[place + i]
            unit = hypothesis.effect.parameter(unknown.name).unit if hypothesis.effect else ""
            off = float(hypothesis.off[i])
            vanishes = np.isfinite(off) and not hypothesis.shapes[i]  # there; no shape switches an effect off
            parameters[unknown.name] = {
                "value": number.value, "unit": unit, "low": number.low, "high": number.high,
                "off": off if vanishes else None,
            }  # fmt: skip
        place += len(hypothesis.unknowns)
        found.append(
            {
                "name": hypothesis.name, "kind": hypothesis.kind, "body": hypothesis.body,
                **({"channel": hypothesis.channel} if hypothesis.channel else {}),
                "direction": hypothesis.direction, "basis": basis,
                "probability": round(chance[id(attempt)], 4) if id(attempt) in chance else None,
                "parameters": parameters,
            }
        )  # fmt: skip
    return found
