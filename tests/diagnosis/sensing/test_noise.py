"""What a channel shows of its own sensor."""

import numpy as np
import pytest

from clearance.diagnosis.sensing.noise import still

RATE = 1e4


def signal():
    time = np.arange(10_000) / RATE
    return 100.0 * np.sin(60.0 * time) + np.random.default_rng(1).normal(size=len(time))


def test_a_sensor_that_is_stuck_for_a_while_says_nothing():
    values = signal()
    assert not still("rod_b_axial", values, RATE)
    values[3000:3150] = values[3000]  # 15 ms
    assert not still("rod_b_axial", values, RATE)
    values[3000:3300] = values[3000]
    assert still("rod_b_axial", values, RATE)
    assert not still("crank_angle", values, RATE)  # a crank may stand


def test_a_sensor_at_its_limit_is_not_stuck_and_a_constant_one_is():
    assert not still("rod_b_axial", np.clip(signal(), -50.0, 60.0), RATE)
    assert still("rod_b_axial", np.zeros(1000), RATE)
    assert still("crank_angle", np.ones(1000), RATE)


@pytest.mark.parametrize("step", [0.5, 5.0])
def test_rounded_values_are_not_stuck(step):
    assert not still("rod_b_axial", step * np.round(signal() / step), RATE)
