"""The lobes of a worn bearing, from the motion: a journal that carries load rests on the bore.

The path that the accelerations show (``kinematics.reconstruction``) must keep to the bore. Lobes of each
order are tried at some phases; the best ones are then fitted, with the clearance, to the motion of all
recordings.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.kinematics.agreement import COMPARED, agreement, profile
from clearance.diagnosis.searching.search import Search
from clearance.errors import InputError

WORN = "worn_bearing"
_PHASES = 0.25 * np.pi * np.arange(8)
# of the clearance: amplitudes with which phases are compared; twice the true one agrees no better than none
_TRIED = (0.02, 0.08, 0.16)
_STEP, _MOST = 0.05, 40  # of the clearance: of the first simplex; machines that are compared


@dataclass(frozen=True)
class Wear:
    """Lobes with which the motion agrees better.

    Attributes:
        hypothesis: that the bearing is worn.
        values: (3,) amplitude [m], order, phase [rad].
        clearance: beside them [m].
        share: of the disagreement that is left.
    """

    hypothesis: Hypothesis
    values: np.ndarray
    clearance: float
    share: float


def suggest_wear(search: Search, held: Sequence[Hypothesis], sizes: np.ndarray) -> Wear | None:
    """The lobes with which the motion of all recordings agrees best; ``None`` if nobody asks for them.

    Args:
        search: after its nominal stage.
        held: effects and faults that are known; a guide line that lies elsewhere, or a force that presses the
            journal elsewhere, would hide the lobes.
        sizes: (unknowns,) of these.

    Raises:
        InputError: a law that does not take them.
        LinAlgError: links that reach at no clearance.
    """
    worn = [h for group in search.groups.values() for h in group if h.name == WORN]
    known = {int(h.start[1]): h for h in worn}  # one of each order, which is not fitted
    if not known:
        return None
    alignments, workers = search.alignments, search.workers
    recordings, setting, shown = search.recordings, search.setting, search.profile
    if held:
        model = setting.model(held)
        values = np.array([search.clearance, *sizes, search.traces[0].speed])
        setting = replace(setting, machine=model.machine(values))
        recordings = [one.undone(model.instrument(values)) for one in recordings]
        shown = profile(recordings, alignments, setting.with_clearance, workers)
    clearance = shown.best

    def left(clearance: float, shapes: np.ndarray) -> np.ndarray:
        """(shapes,) disagreement with (shapes, 3) amplitude, order and phase."""
        nominal = setting.with_clearance(clearance)
        machines = [known[int(shape[1])].apply(nominal, shape) for shape in shapes]
        return agreement(recordings, alignments, machines, COMPARED, workers)

    shapes = np.array(
        [[share * clearance, k, phase] for share in _TRIED for k in sorted(known) for phase in _PHASES]
    )
    best = shapes[int(np.argmin(left(clearance, shapes)))]

    def shape_of(x: np.ndarray) -> tuple[float, np.ndarray]:
        gap = clearance * float(np.exp(x[0]))
        return gap, np.array([gap * np.hypot(x[1], x[2]), best[1], np.arctan2(x[2], x[1])])

    def cost(x: np.ndarray) -> float:
        gap, shape = shape_of(x)
        try:
            return float(left(gap, shape[None])[0])
        except InputError:  # lobes larger than any that are made
            return float("inf")

    start = np.array([0.0, *(best[0] / clearance * np.array([np.cos(best[2]), np.sin(best[2])]))])
    simplex = start + np.vstack([np.zeros(3), _STEP * np.eye(3)])
    found = minimize(
        cost, start, method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": _MOST}
    )  # fmt: skip
    gap, shape = shape_of(found.x)
    return Wear(known[int(best[1])], shape, gap, float(found.fun / shown.misfit.min()))
