"""What sensors did and a recording declares is undone."""

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.recording.correction import corrected
from clearance.recording.recording import Recording
from clearance.recording.sensors import Sensor, SensorChain

RATE, INSIDE = 1e4, slice(400, -400)
PAIR = ("rod_c_transverse", "rod_c_axial")


def truth(channels=PAIR, metadata=None):
    time = np.arange(4000) / RATE
    values = np.stack(
        [np.sin(2 * np.pi * (97 + 310 * i) * time + i) * 40 for i in range(len(channels))], axis=1
    )
    return Recording(values, channels, RATE, 0.0, metadata or {})


def test_declared_bias_gain_delay_and_mounting_are_taken_out():
    declared = {
        "rod_c_transverse": {"gain": 1.05, "bias": 0.7, "mounting_angle": 4.0, "delay": 2.3e-4},
        "rod_c_axial": {"gain": -0.98, "mounting_angle": -3.0, "delay": 2.3e-4},
    }
    chain = SensorChain({name: Sensor(**entry) for name, entry in declared.items()})
    measured = chain.apply(truth(metadata={"sensors": declared}), np.random.default_rng(0))
    assert np.abs(measured.values - truth().values)[INSIDE].max() > 5.0
    found = corrected(measured)
    np.testing.assert_allclose(found.values[INSIDE], truth().values[INSIDE], atol=0.05)


def test_nothing_declared_changes_nothing():
    recording = truth()
    assert corrected(recording) is recording


def test_axes_along_one_direction_are_refused():
    turned = truth(metadata={"sensors": {"rod_c_axial": {"mounting_angle": 90.0}}})
    with pytest.raises(InputError, match=r"mounting_angle = 90 of rod_c_axial and 0 of rod_c_transverse"):
        corrected(turned)


def test_a_mounting_angle_needs_both_axes():
    alone = truth(PAIR[:1], {"sensors": {"rod_c_transverse": {"mounting_angle": 4.0}}})
    with pytest.raises(InputError, match="rod_c_axial is not recorded"):
        corrected(alone)
