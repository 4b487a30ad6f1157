"""Sensors that stop at a limit: what was recorded there shows it, before any simulation."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.sensing.measured import Measured

_SATURATION = "sensor_saturation"
_EXACT = 1e-4  # of a limit: how well one that was recorded is known


def unasked(recordings: Sequence[Measured], groups: Iterable[Sequence[Hypothesis]]) -> dict[str, float]:
    """Limits that channels show and no hypothesis has; arguments as of ``clipped_sensors``."""
    limits = np.min([one.limits for one in recordings], axis=0)
    asked = {group[0].channel for group in groups if group[0].name == _SATURATION}
    each = zip(recordings[0].channels, limits, strict=True)
    return {name: float(limit) for name, limit in each if np.isfinite(limit) and name not in asked}


def clipped_sensors(
    recordings: Sequence[Measured], groups: Iterable[Sequence[Hypothesis]]
) -> list[Hypothesis]:
    """Of the hypotheses those that say of a sensor what some recording shows, with the limit that it shows.

    Args:
        recordings: of the same channels.
        groups: variants of hypotheses.
    """
    limits = np.min([one.limits for one in recordings], axis=0)
    known = {group[0].channel: group[0] for group in groups if group[0].name == _SATURATION}
    held = []
    for channel, limit in zip(recordings[0].channels, limits, strict=True):
        if np.isfinite(limit) and channel in known:
            one = known[channel]
            bounded = replace(one.unknowns[0], low=limit * (1.0 - _EXACT), high=limit * (1.0 + _EXACT))
            held.append(replace(one, unknowns=(bounded,), start=np.array([limit])))
    return held
