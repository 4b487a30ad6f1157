"""Sensors that are a little off are found together with the clearance, and make it less sure."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.sensing.measured import NO_FAULT, Measured
from clearance.diagnosis.sensing.tolerances import HALF, Tolerances, instrument_of, values_of
from clearance.diagnosis.shooting.calibration import Calibration
from clearance.diagnosis.shooting.fit import fit
from clearance.recording.recording import Recording
from tests.diagnosis.shooting.test_follow import CHAIN, CLEARANCE, MODEL, SENSORS, TRUTH, follower, run

TOLERANCES = Tolerances(gain=0.02, misalignment=2.0, bias=4.0)


def beside(sensors, noise=1e-3):
    """A follower at the true nodes of a recording by such sensors, of which the tolerances are known."""
    one = follower(noise=noise)
    measured = one.measured
    values = run()[0][:, list(SENSORS)]
    names = tuple(signal.name.lower() for signal in SENSORS)
    order = [names.index(name) for name in measured.channels]
    noisy = sensors.apply(values[:, order], measured.channels, CHAIN.rate)
    noisy = noisy + measured.sigma * np.random.default_rng(1).normal(size=noisy.shape)
    made = Measured.of(Recording(noisy, measured.channels, CHAIN.rate), CHAIN, "one")
    one.measured = replace(made, sigma=measured.sigma).within(TOLERANCES)
    return one


def drawn(seed, channels):
    what = TOLERANCES.open(channels)
    rng = np.random.default_rng(seed)
    size = np.array([HALF * one.tolerance for one in what])
    return what, np.array([one.neutral for one in what]) + size * rng.uniform(-1.5, 1.5, size=len(what)), size


@pytest.mark.parametrize("seed", range(2))
def test_sensors_within_their_tolerances_do_not_hide_the_clearance(seed):
    what, true, size = drawn(seed, follower().measured.channels)
    one = beside(instrument_of(what, true))
    found = fit([one], MODEL, TRUTH * [1.01, 1.0], 12, 1e-5, 1)
    exact = fit([follower(noise=1e-3)], MODEL, TRUTH * [1.01, 1.0], 12, 1e-5, 1)
    assert found.level < 1.2
    deviation = found.deviations()[0]
    assert abs(found.values[0, 0] - CLEARANCE) < 4.0 * deviation
    assert deviation > 1.05 * exact.deviations()[0]  # who must find the sensors too knows less
    error = (np.array(values_of(what, one.measured.sensors)) - true) / size
    assert np.abs(error / np.maximum(found.doubts / size, 1e-2)).max() < 5.0
    assert (found.doubts <= 1.001 * size).all()  # and never less than the data sheet says
    assert (found.doubts < 0.1 * size).sum() > len(what) / 2


def test_exact_sensors_are_not_calibrated():
    one = follower()
    found = fit([one], MODEL, TRUTH.copy(), 2, 1e-3, 1)
    assert found.doubts is None
    assert one.measured.sensors == NO_FAULT


def test_a_row_with_sensors_is_the_models_row_without():
    what = TOLERANCES.open(follower().measured.channels)
    calibration = Calibration(MODEL, what)
    rows = calibration.beside(TRUTH, NO_FAULT)
    assert rows.shape == (1, 2 + len(what))
    np.testing.assert_array_equal(calibration.without(rows), TRUTH)
    assert calibration.model.machine(rows[0]) == MODEL.machine(TRUTH[0])
    names = [unknown.name for unknown in calibration.model.unknowns]
    assert names[0] == "clearance"
    assert names[-1] == "speed"


def test_what_is_known_of_the_rest_is_what_is_left_when_sensors_are_found_too():
    what = Tolerances(gain=0.02).open(("rod_b_axial", "rod_c_axial"))
    calibration = Calibration(MODEL, what)
    rng = np.random.default_rng(0)
    root = rng.normal(size=(8, 4))
    scale = np.array([1e6, 1e2, 1e3, 1e-2])  # of clearance, two gains and a speed
    information = (root.T @ root) * np.outer(scale, scale)
    found, covariance = calibration.known(information)
    whole = np.linalg.inv(information + np.diag([0.0, 1e4, 1e4, 0.0]))
    np.testing.assert_allclose(np.linalg.inv(found), whole[np.ix_([0, 3], [0, 3])], rtol=1e-8)
    np.testing.assert_allclose(covariance, whole[1:3, 1:3], rtol=1e-8)


def test_where_a_segment_does_not_run_no_more_is_known_than_before():
    what = TOLERANCES.open(follower().measured.channels)
    calibration = Calibration(MODEL, what)
    information = np.full((2 + len(what),) * 2, np.nan)
    found, covariance = calibration.known(information)
    assert np.isnan(found).all()
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [HALF * one.tolerance for one in what])
