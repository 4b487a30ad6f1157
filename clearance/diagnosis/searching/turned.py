"""A sensor that shows too little, or is turned: beside an axis that feels nothing the two are the same."""

from collections.abc import Callable

import numpy as np

from clearance.diagnosis.following.attempt import explained
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.sensing.instrument import OTHER_AXIS
from clearance.diagnosis.sensing.restoration import STILL

_TWINS: dict[str, tuple[str, Callable[[float], float]]] = {
    "sensor_gain": ("sensor_misalignment", lambda gain: float(np.degrees(np.arccos(min(gain, 1.0))))),
    "sensor_misalignment": ("sensor_gain", lambda angle: float(np.cos(np.radians(angle)))),
}


def fit_twins(search: Search, explanation: Explanation) -> None:
    """Fit an angle in the place of a gain of one sensor, or the other way round, where its cosine is all.

    No look promises such an angle, which has no slope at zero. Where the other axis moves after all, the fit
    tells them apart.

    Args:
        search: with its hypotheses.
        explanation: added to; nothing where it does not explain.
    """
    best, place = explanation.best, 1
    if not explained(best):
        return
    for index, hypothesis in enumerate(best.hypotheses):
        beside, _ = OTHER_AXIS.get(hypothesis.channel or "", ("", 0.0))
        if hypothesis.name in _TWINS and beside in STILL:
            name, size = _TWINS[hypothesis.name]
            value = size(float(best.fit.values[0, place]))
            for twin, *_ in search.groups.values():
                if (twin.name, twin.channel) != (name, hypothesis.channel):
                    continue
                if value not in (0.0, 1.0) and twin.unknowns[0].low < value < twin.unknowns[0].high:
                    held, values = list(best.hypotheses), best.fit.values.copy()
                    held[index], values[:, place] = twin, value
                    search.refit(explanation, held, best.followers, values, best.scale)
        place += len(hypothesis.unknowns)
