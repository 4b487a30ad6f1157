"""What was counted by the seconds of a recorder's clock that runs fast or slow, by true ones."""

import numpy as np

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.mechanism.slider_crank import SliderCrank


def seconds_of(attempt: Attempt) -> np.ndarray:
    """(shared,) factors from the seconds of an attempt's clock to true ones, of the clearance and effects."""
    powers = [0]
    for hypothesis in attempt.hypotheses:
        effect = None if hypothesis.fault is not None else hypothesis.effect
        powers += [p.seconds for p in effect.free] if effect is not None else [0] * len(hypothesis.unknowns)
    if not any(powers):
        return np.ones(len(powers))
    return _pace(attempt) ** np.array(powers)


def by_true_seconds(attempt: Attempt, speed: float) -> float:
    """A speed that the recordings show by their clock."""
    return speed / _pace(attempt)


def machine_of(attempt: Attempt, setting: Setting, clearance: float) -> SliderCrank:
    """The machine of an attempt by true seconds, with a clearance [m]: for who simulates it.

    A clock at fault sees a stiffer machine that is driven harder. Of sensors' faults a machine knows nothing.
    """
    sizes = attempt.fit.values[0, : attempt.model.shared] * seconds_of(attempt)
    place, own = 1, [np.array([clearance])]
    for hypothesis in attempt.hypotheses:
        count = len(hypothesis.unknowns)
        if hypothesis.fault is None:
            own.append(sizes[place : place + count])
        place += count
    physics = [hypothesis for hypothesis in attempt.hypotheses if hypothesis.fault is None]
    return setting.model(physics).machine(
        np.concatenate([*own, [by_true_seconds(attempt, attempt.fit.values[0, -1])]])
    )


def _pace(attempt: Attempt) -> float:
    """True seconds in one of the clock's."""
    return 1.0 + attempt.model.instrument(attempt.fit.values[0]).timebase
