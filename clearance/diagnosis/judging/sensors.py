"""What accelerometers were found to do within their tolerances, for the JSON and for other recordings."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.sensing.instrument import OTHER_AXIS
from clearance.diagnosis.sensing.measured import Measured
from clearance.diagnosis.sensing.tolerances import NOTHING_LEFT_OPEN, values_of

_QUIET = 5e-3  # of the signal: noise below which errors of gain and mount stand out
_QUANTILE = 1.96  # standard deviations of a 95 % interval
_UNITS = {"gain": "", "misalignment": "deg", "delay": "s", "bias": "m/s^2"}
_KEYS = {"gain": "gain", "misalignment": "mounting_angle", "delay": "delay", "bias": "bias"}


def calibrated_sensors(attempt: Attempt) -> dict[str, dict[str, dict[str, Any]]]:
    """By channel and key of ``recording.sensors.Sensor``: value, interval, unit; empty where all are exact.

    Delays are counted from the crank's angle, or from the accelerometer that has none here.
    """
    measured, covariance = attempt.followers[0].measured, attempt.fit.covariance
    if covariance is None:
        return {}
    what = measured.tolerances.open(measured.channels)
    values, doubts = values_of(what, attempt.sensors), np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for one, value, doubt in zip(what, values, doubts, strict=True):
        found.setdefault(one.channel, {})[_KEYS[one.fault]] = {
            "value": float(value),
            "low": float(value - _QUANTILE * doubt),
            "high": float(value + _QUANTILE * doubt),
            "unit": _UNITS[one.fault],
            "tolerance": getattr(measured.tolerances, one.fault),
        }
    return found


def advice(recordings: Sequence[Measured]) -> list[str]:
    """What to try where nothing explains recordings of little noise, whose sensors were taken for exact."""
    quiet = [np.median(one.sigma[: one.filtered] / one.size[: one.filtered]) < _QUIET for one in recordings]
    if not all(quiet) or recordings[0].tolerances != NOTHING_LEFT_OPEN:
        return []
    return [
        "The accelerometers were taken for exact, and their noise is low. Real ones are all off by a per "
        "cent or two and a degree or two: say how far, as in tolerances={gain: 0.02, misalignment: 2, "
        "delay: 4.0e-5, bias: 4}."
    ]


def declared(calibration: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, float]]:
    """Likewise the values alone; an angle is left out that its other axis was not recorded to undo."""
    return {
        name: {
            key: found["value"]
            for key, found in own.items()
            if key != "mounting_angle" or OTHER_AXIS[name][0] in calibration
        }
        for name, own in calibration.items()
    }


def largest(calibration: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """In words: how far the accelerometers are off."""
    gains = {name: abs(own["gain"]["value"] - 1.0) for name, own in calibration.items() if "gain" in own}
    angles = {
        name: abs(own["mounting_angle"]["value"])
        for name, own in calibration.items()
        if "mounting_angle" in own
    }
    parts = []
    if gains:
        worst = max(gains, key=lambda name: gains[name])
        parts.append(f"gains are off by up to {gains[worst]:.2%} ({worst})")
    if angles:
        worst = max(angles, key=lambda name: angles[name])
        parts.append(f"axes are turned by up to {angles[worst]:.2g} deg ({worst})")
    shown = f": {' and '.join(parts)}" if parts else ""
    return (
        "The accelerometers were calibrated on the way, none off by more than 1.5 times its "
        f"tolerance{shown}."
    )
