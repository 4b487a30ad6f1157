"""How often a machine with nothing missing looks as suspicious as this one, and what is as good as another.

A hypothesis that is wrong lowers the robust sum of squares all the same, by more than a likelihood ratio
would allow: neighbouring errors hang together, impacts are met late, and the simulator's own error counts.
How much more is measured: on machines with nothing missing, simulated by another program, each refitted, the
largest fall that any hypothesis promises. ``experiment=trial_nulls`` makes the list again.

Reference: Davison & Hinkley 1997, Bootstrap Methods and their Application, section 4.2 (Monte Carlo tests).
"""

import json
from functools import cache
from importlib.resources import files

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.free_form import unnamed
from clearance.diagnosis.searching.explanation import Explanation

SURE = 60.0
"""Fall of the sum of squares that neither chance nor another integrator brings (24 in five hundred)."""
CALM = 1.2
"""Misfit that nothing missing does not bring either."""
_NULLS = "nulls.json"
ENOUGH = 19
"""Simulations of a machine that support a p-value of 0.05."""
_UNUSUAL = 0.05  # p-value above which nothing is asserted
_FLOOR = 1.05  # misfit that a right model may leave
_RIGHT = 1.15  # misfit above which one that explains lacks something: right ones left 1.12 at most
_SMALL = 0.5  # of the nominal machine's misfit above 1: what is small and right leaves less
_ALIKE = 12.0  # difference of prices below which two explanations are equivalent, as far as it counts
_INDEPENDENT = 100.0  # samples of which a difference counts in full


@cache
def null_scores() -> np.ndarray:
    """(N,) falls in the sum of squares that the best of all hypotheses promised where nothing is missing."""
    text = files("clearance.diagnosis.searching").joinpath(_NULLS).read_text(encoding="utf-8")
    return np.sort(np.array(json.loads(text)["null_scores"], dtype=float))


def p_value(fall: float, simulated: np.ndarray | None = None) -> float:
    """Share of machines with nothing missing on which some hypothesis promises such a fall.

    Never below 1 / (N + 1). All hypotheses were compared there as here: their number is allowed for.

    Args:
        fall: of the sum of squares.
        simulated: (N,) falls beside simulations of the machine itself; those of the stored list if there
            are none.
    """
    scores = null_scores() if simulated is None or not len(simulated) else simulated
    return float((1 + np.count_nonzero(scores >= fall)) / (len(scores) + 1))


def margin(explanation: Explanation) -> float:
    """Difference of prices below which another explanation is equivalent."""
    return _ALIKE * overstated(explanation)


def overstated(explanation: Explanation) -> float:
    """By how much differences of prices say too much: neighbouring errors hang together."""
    return float((explanation.samples / _INDEPENDENT) ** 0.5)


def separating(explanation: Explanation, fall: float, samples: float) -> float:
    """How many further recordings make the ``margin``, which grows with the root of all samples.

    It is N in N fall = 12 sqrt((S + N samples) / 100).

    Args:
        explanation: of S samples.
        fall: that each adds to a difference of prices; infinitely many where it is 0.
        samples: of each.
    """
    with np.errstate(divide="ignore", over="ignore"):
        share = np.float64(_ALIKE / fall) ** 2 / _INDEPENDENT
    half = 0.5 * share * samples
    return float(half + np.sqrt(half**2 + share * explanation.samples))


def beats(attempt: Attempt, explanation: Explanation) -> bool:
    """Whether an attempt explains more than a nominal machine that explains, too, by more than chance brings.

    On other stretches of the recordings what these differ by is allowed for.
    """
    nominal = explanation.nominal
    if not explained(nominal):
        return True
    chance = SURE if _stretches(attempt) == _stretches(nominal) else margin(explanation)
    return explanation.price(attempt) + chance < explanation.price(nominal)


def _stretches(attempt: Attempt) -> list[tuple[str, int, int]]:
    return [(f.measured.name, f.measured.first, f.segments) for f in attempt.followers]


def suspicious(explanation: Explanation) -> bool:
    """Whether the nominal machine is further off than any on which nothing is missing, though it follows."""
    score = explanation.hints[0].gain if explanation.hints else 0.0
    sure = score > SURE and not usual(explanation)
    return sure or explanation.shaken is not None or explanation.nominal.misfit > CALM


def usual(explanation: Explanation) -> bool:
    """Whether simulations of the machine itself, lacking nothing, look as suspicious as the recordings."""
    if explanation.simulated is None or len(explanation.simulated) < ENOUGH or not explanation.hints:
        return False
    return p_value(explanation.hints[0].gain, explanation.simulated) > _UNUSUAL


def incomplete(attempt: Attempt) -> bool:
    """Whether named effects explain, and yet leave more than right ones do."""
    named = bool(attempt.hypotheses) and unnamed(attempt.hypotheses) is None
    return named and explained(attempt) and attempt.misfit > _RIGHT


def cushioned(explanation: Explanation, attempt: Attempt) -> bool:
    """Whether an attempt is a nominal machine that explains with a gap closed which the motion shows wide.

    By 5 % of noise a film of 90 um is nearly the same as a joint without play, but for what such a machine
    never leaves.
    """
    nominal = attempt is explanation.nominal
    return nominal and explained(attempt) and attempt.misfit > CALM and explanation.shut(attempt)


def unsettled(explanation: Explanation) -> bool:
    """Whether a machine that seems right but for something small is not, and nothing small explains it.

    What shakes its frame is no small force: it is not felt from segment to segment, and leaves no less.
    """
    nominal, best = explanation.nominal, explanation.best
    if best is explanation.shown:
        return False
    left = best.misfit > _FLOOR and best.misfit - 1.0 > _SMALL * (nominal.misfit - 1.0)
    return explained(nominal) and suspicious(explanation) and (best is nominal or left)
