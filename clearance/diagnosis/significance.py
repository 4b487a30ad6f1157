"""How often a machine with nothing missing looks as suspicious as this one.

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

SURE = 60.0
"""Fall of the sum of squares that neither chance nor another integrator brings (14 in ``nulls.json``).

Two machines there have more, since the path of one of their recordings was lost.
"""
CALM = 1.2
"""Misfit that nothing missing does not bring either."""
_NULLS = "nulls.json"


@cache
def null_scores() -> np.ndarray:
    """(N,) falls in the sum of squares that the best of all hypotheses promised where nothing is missing."""
    text = files("clearance.diagnosis").joinpath(_NULLS).read_text(encoding="utf-8")
    return np.sort(np.array(json.loads(text)["null_scores"], dtype=float))


def p_value(fall: float) -> float:
    """Share of machines with nothing missing on which some hypothesis promises such a fall.

    Never below 1 / (N + 1). All hypotheses were compared there as here: their number is allowed for.
    """
    scores = null_scores()
    return float((1 + np.count_nonzero(scores >= fall)) / (len(scores) + 1))
