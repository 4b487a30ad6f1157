"""Fit a model's parameters to recordings, and say how well they are known."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from clearance.diagnosis.shooting.calibration import Calibration, calibration_of
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.looks import observe, solve
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.normal_equations import assemble
from clearance.diagnosis.shooting.settle import Settled, settle
from clearance.diagnosis.shooting.stretch import Pass

_CLOSER = np.sqrt(10.0)  # times as large is the scale of the noise before
_ALIKE = 0.1  # of such a step: scales that differ by less are one
_COARSELY = 1e-2  # share of the cost whose fall ends a coarse fit
_SETTLING = ("goal", "tries", "home")  # what only ``settle`` wants to know


@dataclass
class Fit(Settled):
    """Parameters found, and how well they are known.

    Attributes:
        passes: the linearisation of each recording.
        information: (P, P) of all parameters: shared ones, then each recording's own [1/unit^2].
        covariance: of what the accelerometers were found to do, as ``Tolerances.open`` lists it; ``None``
            where they are exact.
        bent: sum of squares of how far they are off, in what is expected of them; no part of ``cost``.
    """

    passes: Sequence[Pass]
    information: np.ndarray
    covariance: np.ndarray | None = None
    bent: float = 0.0


def fit(
    followers: Sequence[Follower],
    model: Model,
    values: np.ndarray,
    iterations: int = 10,
    tolerance: float = 1e-3,
    workers: int = 2,
    **options: Any,
) -> Fit:
    """Settle, and say how well the parameters are known; arguments as of ``settle``.

    What accelerometers may do within their tolerances is found as well, and undone in the recordings.
    """
    calibration = calibration_of(followers, model)
    if calibration is not None:
        return _calibrated(followers, calibration, values, iterations, tolerance, workers, options)
    found = settle(followers, model, values, iterations, tolerance, workers, **options)
    passes = _look(followers, model, found.values, workers, options)
    information = assemble(passes, model, found.values)[0]
    return Fit(model, found.values, found.cost, passes, information)


def _calibrated(
    followers: Sequence[Follower],
    calibration: Calibration,
    values: np.ndarray,
    iterations: int,
    tolerance: float,
    workers: int,
    options: dict[str, Any],
) -> Fit:
    """Fit what accelerometers do as well, from noise down in which it does not show."""
    kept, model = [one.measured for one in followers], calibration.model
    sensors, scale = kept[0].sensors, float(options.get("scale", 1.0))
    begun, home = calibration.beside(values, sensors), options.get("home")
    if home is not None:
        options = options | {"home": calibration.beside(home, sensors)}
    try:
        for follower in followers:
            follower.measured = follower.measured.as_recorded().around()
        for coarse in _scales(scale, scale * max(one.widened for one in kept)):
            coarsely = options | {"scale": coarse}
            begun = settle(followers, model, begun, iterations, _COARSELY, workers, **coarsely).values
        found = settle(followers, model, begun, iterations, tolerance, workers, **options)
        passes = _look(followers, model, found.values, workers, options)
        information, covariance, followed = calibration.known(assemble(passes, model, found.values)[0])
        scores = calibration.scores(passes, found.values, followed)
    finally:
        for follower, measured in zip(followers, kept, strict=True):
            follower.measured = measured
    bent = calibration.bent(found.values[0])
    sensors, values = calibration.sensors(found.values[0]), calibration.without(found.values)
    for follower, measured in zip(followers, kept, strict=True):
        follower.measured = measured.calibrated(sensors)
    passes = _look(followers, calibration.plain, values, workers, options)
    for one, parts in zip(passes, scores, strict=True):
        one.parts = parts
    cost = sum(one.cost for one in passes)
    return Fit(calibration.plain, values, cost, passes, information, covariance, bent)


def _look(
    followers: Sequence[Follower], model: Model, values: np.ndarray, workers: int, options: dict[str, Any]
) -> list[Pass]:
    """Linearise all recordings and eliminate their states, undamped."""
    about = {key: value for key, value in options.items() if key not in _SETTLING}
    passes = observe(followers, model, values, workers, **about)
    solve(passes, [0.0] * len(passes), workers)
    return passes


def _scales(finest: float, coarsest: float) -> list[float]:
    """Factors on the noise from a coarse one down to, but not including, the finest."""
    steps = int(np.ceil(np.log(max(coarsest / finest, 1.0)) / np.log(_CLOSER) - _ALIKE))
    return [finest * _CLOSER**step for step in range(steps, 0, -1)]
