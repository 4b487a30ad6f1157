"""Which effects are withdrawn: those that may as well be off."""

import numpy as np

from clearance.diagnosis.judging import verdict
from clearance.diagnosis.judging.verdict import (
    Estimate,
    verdict_of,
    withdraw,
)
from clearance.diagnosis.searching.explanation import Explanation
from tests.diagnosis.attempts import attempt


def test_an_effect_that_may_as_well_be_off_is_withdrawn(monkeypatch):
    doubtful = attempt(["gravity"], 0.99)
    monkeypatch.setattr(
        verdict, "estimates", lambda _: [Estimate(3e-4, 3e-4, 3e-4), Estimate(0.1, -0.1, 0.3)]
    )
    explanation = Explanation(attempt([], 1.0), [doubtful])
    doubtful.misfit = doubtful.level = 0.9
    assert explanation.best is doubtful
    withdraw(explanation)
    assert doubtful.withdrawn
    assert verdict_of(explanation) == "none"


def test_a_limit_that_was_read_off_stays_though_no_slope_tells_how_sure_it_is(monkeypatch):
    limit = attempt(["sensor_saturation"], 0.9, "instrument", off=np.inf)
    monkeypatch.setattr(
        verdict, "estimates", lambda _: [Estimate(3e-4, 3e-4, 3e-4), Estimate(100.0, 1.0, 1e6)]
    )
    withdraw(Explanation(attempt([], 1.0), [limit]))
    assert not limit.withdrawn


def test_a_frame_that_may_as_well_be_rigid_is_withdrawn(monkeypatch):
    for high, withdrawn in ((1e6, True), (2e3, False)):
        frame = attempt(["flexible_base"], 0.9, off=np.inf)
        numbers = [Estimate(3e-4, 3e-4, 3e-4), Estimate(1e3, 500.0, high)]
        monkeypatch.setattr(verdict, "estimates", lambda _, known=numbers: known)
        withdraw(Explanation(attempt([], 1.0), [frame]))
        assert frame.withdrawn == withdrawn


def test_an_effect_whose_interval_excludes_off_stays(monkeypatch):
    sure = attempt(["gravity"], 0.9)
    monkeypatch.setattr(verdict, "estimates", lambda _: [Estimate(3e-4, 3e-4, 3e-4), Estimate(0.2, 0.1, 0.3)])
    explanation = Explanation(attempt([], 1.0), [sure])
    withdraw(explanation)
    assert explanation.best is sure


def test_a_table_of_which_each_knot_may_be_off_is_not_withdrawn(monkeypatch):
    table = attempt(["free_form"], 1.0)
    monkeypatch.setattr(
        verdict, "estimates", lambda _: [Estimate(3e-4, 3e-4, 3e-4), Estimate(5.0, -9e3, 9e3)]
    )
    explanation = Explanation(attempt([], 50.0), [table])
    withdraw(explanation)
    assert explanation.best is table
