"""What is said of accelerometers that are a little off, or were taken for exact."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.judging.sensors import advice, calibrated_sensors, declared, largest
from clearance.diagnosis.sensing.tolerances import Tolerances, instrument_of
from tests.diagnosis.sensing.test_tolerances import CHANNELS, TOLERANCES, measured


def attempt(seed=0):
    what = TOLERANCES.open(CHANNELS)
    values = np.array([one.neutral + 0.3 * one.tolerance for one in what])
    one = measured(seed).within(TOLERANCES).calibrated(instrument_of(what, values))
    return SimpleNamespace(
        followers=[SimpleNamespace(measured=one)],
        sensors=one.sensors,
        fit=SimpleNamespace(covariance=np.diag([(0.01 * one.tolerance) ** 2 for one in what])),
    )


def test_every_sensor_has_its_values_with_intervals():
    found = calibrated_sensors(attempt())
    assert list(found) == list(CHANNELS[:3])  # whose delays are counted from the crank's angle
    gain = found["rod_b_axial"]["gain"]
    assert gain["value"] == pytest.approx(1.006)
    assert gain["high"] - gain["low"] == pytest.approx(2 * 1.96 * 0.01 * 0.02)
    assert found["rod_b_axial"]["delay"]["value"] == pytest.approx(1.2e-5)
    assert declared(found)["slider_horizontal"].keys() == {"gain", "delay", "bias"}
    assert "0.60% (rod_b_transverse)" in largest(found)
    assert "0.6 deg (rod_b_transverse)" in largest(found)


def test_exact_sensors_have_none():
    one = SimpleNamespace(
        followers=[SimpleNamespace(measured=measured())], fit=SimpleNamespace(covariance=None)
    )
    assert calibrated_sensors(one) == {}


def test_advice_is_given_where_noise_is_low_and_sensors_were_taken_for_exact():
    one = measured()
    quiet = replace(one, sigma=1e-4 * one.size)
    assert "tolerances={gain: 0.02" in advice([quiet])[0]
    assert advice([replace(one, sigma=0.01 * one.size)]) == []
    assert advice([replace(quiet, tolerances=Tolerances(gain=0.02))]) == []
