"""Limits at which sensors stop, with and without a hypothesis that says so."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.clipping import clipped_sensors, unasked
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import gather
from clearance.diagnosis.judging.statement import _of_limits
from clearance.mechanism.slider_crank import SliderCrank

CHANNELS = ("rod_b_axial", "rod_c_axial")
RECORDINGS = [
    SimpleNamespace(channels=CHANNELS, limits=np.array(limits))
    for limits in ([np.inf, 260.0], [np.inf, 250.0])
]


def test_a_limit_that_recordings_show_is_held():
    groups = gather(load_effects(["sensor_saturation"], []), SliderCrank(), "C", CHANNELS)
    (held,) = clipped_sensors(RECORDINGS, groups.values())
    assert (held.name, held.channel) == ("sensor_saturation", "rod_c_axial")
    assert held.start[0] == 250.0
    assert held.unknowns[0].low == pytest.approx(250.0, rel=2e-4)
    assert unasked(RECORDINGS, groups.values()) == {}


def test_a_limit_without_a_hypothesis_is_warned_of():
    groups = gather(load_effects(["gravity"], []), SliderCrank(), "C", CHANNELS)
    assert clipped_sensors(RECORDINGS, groups.values()) == []
    limits = unasked(RECORDINGS, groups.values())
    assert limits == {"rod_c_axial": 250.0}
    (warning,) = _of_limits(limits)
    assert warning.startswith(
        "rod_c_axial stops at 250 m/s², and sensor_saturation is not among the hypotheses"
    )
