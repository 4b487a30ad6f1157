"""A look at all hypotheses at once: what sensors may do, within their tolerances, is free there too."""

import numpy as np
import pytest

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import gather
from clearance.diagnosis.searching.screening import screen
from clearance.diagnosis.sensing.tolerances import instrument_of
from clearance.diagnosis.shooting.fit import fit
from tests.diagnosis.shooting.test_calibration import beside, drawn
from tests.diagnosis.shooting.test_follow import MACHINE, MODEL, TRUTH, follower

NAMES = ["gravity", "slider_offset", "sensor_gain", "sensor_misalignment"]


def looked(one):
    found = fit([one], MODEL, TRUTH.copy(), 12, 1e-5, 1)
    attempt = Attempt((), MODEL, found, 1.0, found.level, [one])
    groups = gather(load_effects(NAMES, []), MACHINE, "C", one.measured.channels)
    return {hint.hypotheses[0].label: hint for hint in screen(attempt, list(groups.values()), 1).singles}


@pytest.fixture(scope="module")
def exact():
    return looked(follower(noise=1e-3))


@pytest.fixture(scope="module")
def calibrated():
    what, true, _ = drawn(0, follower().measured.channels)
    return looked(beside(instrument_of(what, true)))


def test_what_a_sensor_may_do_makes_less_visible(exact, calibrated):
    shared = exact.keys() & calibrated.keys()
    assert len(shared) > 10
    ratio = {label: calibrated[label].deviation / exact[label].deviation for label in shared}
    assert min(ratio.values()) > 0.8
    # a gain that is open by two per cent is known no better than that
    assert ratio["sensor_gain(rod_b_axial, gain)"] > 3.0
    assert calibrated["sensor_gain(rod_b_axial, gain)"].deviation > 0.01
    assert exact["sensor_gain(rod_b_axial, gain)"].deviation < 0.003


def test_beside_sensors_that_were_calibrated_nothing_looks_missing(calibrated):
    for label, hint in calibrated.items():
        assert hint.gain < 60.0, label
    assert np.isfinite([hint.deviation for hint in calibrated.values()]).all()
