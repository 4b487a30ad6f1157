"""Sensors that are a little off are found together with the clearance, and make it less sure."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import gather
from clearance.diagnosis.sensing.measured import NO_FAULT, Measured
from clearance.diagnosis.sensing.tolerances import HALF, Tolerances, instrument_of, values_of
from clearance.diagnosis.shooting.calibration import Calibration
from clearance.diagnosis.shooting.covariance import deviations
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.normal_equations import assemble
from clearance.diagnosis.shooting.settle import settle
from clearance.recording.recording import Recording
from tests.diagnosis.shooting.test_follow import (
    CHAIN,
    CLEARANCE,
    MACHINE,
    MODEL,
    SENSORS,
    SETTING,
    TRUTH,
    follower,
    run,
)

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
    assert 0.9 < found.level < 1.2
    # what is left is what a look at the calibrated recording leaves
    assert found.cost == pytest.approx(settle([one], MODEL, found.values, 0).cost, rel=1e-6)
    assert one.measured.widened < 1.1
    deviation = deviations(found)[0]
    assert abs(found.values[0, 0] - CLEARANCE) < 4.0 * deviation
    assert deviation > 1.05 * deviations(exact)[0]  # who must find the sensors too knows less
    information = np.sqrt(np.diag(np.linalg.inv(found.information)))[0]
    assert deviation < 1.5 * information  # how segments scatter says no other: the noise is white
    off = np.array(values_of(what, one.measured.sensors)) - [each.neutral for each in what]
    assert found.bent == pytest.approx(((off / size) ** 2).sum(), rel=1e-9)
    error = (np.array(values_of(what, one.measured.sensors)) - true) / size
    doubts = np.sqrt(np.diag(found.covariance))
    assert np.abs(error / np.maximum(doubts / size, 1e-2)).max() < 5.0
    assert (doubts <= 1.001 * size).all()  # and never less than the data sheet says
    assert (doubts < 0.1 * size).sum() > len(what) / 2


def test_exact_sensors_are_not_calibrated():
    one = follower()
    found = fit([one], MODEL, TRUTH.copy(), 2, 1e-3, 1)
    assert found.covariance is None
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
    found, covariance, _ = calibration.known(information)
    whole = np.linalg.inv(information + np.diag([0.0, 1e4, 1e4, 0.0]))
    np.testing.assert_allclose(np.linalg.inv(found), whole[np.ix_([0, 3], [0, 3])], rtol=1e-8)
    np.testing.assert_allclose(covariance, whole[1:3, 1:3], rtol=1e-8)


def test_scores_scatter_as_the_information_says_though_a_sensor_does_nearly_the_same():
    """White scores of two recordings: their covariance is the information of all parameters."""
    what = Tolerances(gain=0.02).open(("rod_b_axial", "rod_c_axial"))
    calibration = Calibration(MODEL, what)
    rng = np.random.default_rng(3)
    values = calibration.beside(np.repeat(TRUTH, 2, axis=0), NO_FAULT)
    steps = np.array([calibration.model.step(values[0], i) for i in range(4)])
    mixed = np.array(
        [[1.0, 0.95, 0.0, 0.1], [0.0, 0.2, 0.0, 0.0], [0.0, 0.0, 1.0, 0.2], [0.0, 0.0, 0.0, 1.0]]
    )
    parts = [300.0 * rng.normal(size=(20_000, 4)) @ mixed * steps for _ in range(2)]
    passes = [
        SimpleNamespace(parts=one, gram=np.pad(one.T @ one, ((0, 1), (0, 1)))) for one in parts
    ]  # fmt: skip
    information, _ = assemble(passes, calibration.model, values)
    known, _, followed = calibration.known(information)
    scores = calibration.scores(passes, values, followed)
    plain = [
        SimpleNamespace(parts=one, gram=np.pad(one.T @ one, ((0, 1), (0, 1)))) for one in scores
    ]  # fmt: skip
    scatter, _ = assemble(plain, MODEL, calibration.without(values))
    unit = np.sqrt(np.outer(np.diag(known), np.diag(known)))
    np.testing.assert_allclose(scatter / unit, known / unit, atol=0.05)
    assert known[0, 0] < 0.3 * information[0, 0]


def test_where_a_segment_does_not_run_no_more_is_known_than_before():
    what = TOLERANCES.open(follower().measured.channels)
    calibration = Calibration(MODEL, what)
    information = np.full((2 + len(what),) * 2, np.nan)
    found, covariance, followed = calibration.known(information)
    assert (followed == 0.0).all()
    assert np.isnan(found).all()
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [HALF * one.tolerance for one in what])


def test_a_fault_beyond_its_tolerance_is_found_beside_sensors_that_are_off():
    names = follower().measured.channels
    what, true, _ = drawn(0, names)
    sensors = instrument_of(what, true)
    effect = next(e for e in load_effects(["sensor_gain"], []) if e.kind == "instrument")
    groups = gather([effect], MACHINE, "C", names)
    (hypothesis,) = groups["sensor_gain(rod_b_axial, gain)"]
    model = SETTING.model([hypothesis])
    one = beside(sensors.beside(NO_FAULT.changed("gain", 0.8, "rod_b_axial")))
    begun = np.array([[CLEARANCE, 0.85, TRUTH[0, 1]]])
    found = fit([one], model, begun, 20, 1e-5, 1)
    assert 0.9 < found.level < 1.2  # its partner, into which it is mixed, included
    assert found.values[0, 1] == pytest.approx(0.8, abs=0.03)  # but for what the tolerance leaves open


def test_a_turned_sensor_and_its_zero_cost_nothing_together():
    """A crank sensor feels the centripetal acceleration alike: its angle and its bias are one unknown."""
    one = follower().measured.within(Tolerances(misalignment=2.0, bias=40.0))
    what = one.tolerances.open(one.channels)
    place = one.channels.index("crank_b_transverse")
    i, j = (
        next(k for k, each in enumerate(what) if (each.fault, each.channel) == (fault, "crank_b_transverse"))
        for fault in ("misalignment", "bias")
    )
    level = one.as_recorded().recorded[:, one.channels.index("crank_b_axial")].mean()
    change = np.zeros(len(what))
    change[i], change[j] = 1.0, np.radians(1.0) * level  # turned by a degree, and back by its zero
    turned = instrument_of(what, change).apply(one.as_recorded().recorded, one.channels, CHAIN.rate)
    felt = (turned - one.as_recorded().recorded)[:, place].std()
    sure = one.calibrated(NO_FAULT, np.outer(change, change))
    raw = one.as_recorded().sigma[place]
    assert np.sqrt(sure.sigma[place] ** 2 - raw**2) == pytest.approx(felt, rel=0.2)


def test_a_channel_that_says_nothing_stays_silent_through_a_calibration():
    one = beside(NO_FAULT)
    one.measured = one.measured.without("rod_b_axial")
    place = one.measured.channels.index("rod_b_axial")
    after = one.measured.calibrated(NO_FAULT.changed("gain", 1.01, "rod_c_axial"))
    for measured in (one.measured.as_recorded(), after):
        assert measured.sigma[place] > 1e3 * follower(noise=1e-3).measured.sigma.max()
