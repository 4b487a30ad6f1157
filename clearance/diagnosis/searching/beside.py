"""Hypotheses beside those of an attempt: with which values they begin, and what they must reach."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.following.attempt import POOR, Attempt
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis

NEARLY = 4.0  # misfit up to which a model is worth another look
FAR = 20.0
"""Misfit from which on a linear look beside the path tells little, and what is right leaves far less."""
HALFWAY = 0.3  # of the base's misfit: a sensor's fault that reaches that is worth a path of its own
SHARED = 0.6  # of it: what leaves less may be one of two effects that share what is missing
NEARLY_ALL = 0.05  # of the nominal machine's misfit: what leaves less is built on
MOSTLY = 0.1  # of it: a name that leaves less is there, alone or beside others
BETTER = 0.8  # of the base's misfit: a model that does not reach that beside its path, or with one recording


def enough(base: Attempt, r: int) -> float:
    """Misfit of a recording that an effect beside ``base`` must reach to be fitted to all."""
    return max((HALFWAY if base.misfit > FAR else BETTER) * base.misfits[r], POOR)


def beside(
    base: Attempt, hypotheses: Sequence[Hypothesis], values: np.ndarray
) -> tuple[list[Hypothesis], np.ndarray]:
    """Hypotheses with those of an attempt, and (recordings, unknowns) values to begin with."""
    rows, shared = base.fit.values, base.model.shared
    added = np.repeat(values[None], len(rows), axis=0)
    return [*base.hypotheses, *hypotheses], np.concatenate(
        [rows[:, :shared], added, rows[:, shared:]], axis=1
    )
