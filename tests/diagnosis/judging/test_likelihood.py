"""Intervals go as far as the likelihood does, and a better fit beyond a ripple is taken."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.judging import likelihood
from clearance.diagnosis.judging.likelihood import ask_likelihood
from clearance.diagnosis.judging.verdict import estimates
from clearance.diagnosis.shooting.covariance import deviations
from clearance.diagnosis.shooting.fit import fit
from tests.diagnosis.shooting.test_follow import MODEL, TRUTH, follower


def fitted(values, iterations):
    one = [follower()]
    found = fit(one, MODEL, values, iterations, 1e-9, 1)
    return Attempt((), MODEL, found, 1.0, found.level, one)


@pytest.fixture(scope="module")
def settled():
    return fitted(TRUTH, 20)


def test_a_curvature_that_is_too_steep_does_not_make_an_interval_too_narrow(settled, monkeypatch):
    true = 1.96 * deviations(settled.fit)[0]
    monkeypatch.setattr(likelihood, "deviations", lambda of: 0.2 * deviations(of))
    ask_likelihood(settled, 1)
    below, above = settled.reach[0]
    assert 0.6 * true < below < 1.7 * true
    assert 0.6 * true < above < 1.7 * true


def test_an_interval_goes_to_a_bound_that_the_likelihood_does_not_exclude(settled, monkeypatch):
    value, true = settled.fit.values[0, 0], 1.96 * deviations(settled.fit)[0]
    bounded = replace(MODEL.unknowns[0], low=value - 0.5 * true)
    one = replace(settled, model=replace(MODEL, unknowns=(bounded, *MODEL.unknowns[1:])))
    monkeypatch.setattr(likelihood, "deviations", lambda of: 0.3 * deviations(of))
    ask_likelihood(one, 1)
    assert one.reach[0, 0] == pytest.approx(0.5 * true)
    assert one.reach[0, 1] > 0.6 * true


def test_an_interval_of_the_right_width_stays_about_as_wide(settled):
    ask_likelihood(settled, 1)
    value = settled.fit.values[0, 0]
    low, high = estimates(settled)[0].low, estimates(settled)[0].high
    sd = deviations(settled.fit)[0]
    assert 1.95 * sd < value - low < 3.0 * sd
    assert 1.95 * sd < high - value < 3.0 * sd


def test_a_fit_that_stopped_beside_its_minimum_is_moved_there(settled, monkeypatch):
    sd = deviations(settled.fit)[0]
    stopped = fitted(settled.fit.values + np.array([3.0 * sd, 0.0]), 0)
    monkeypatch.setattr(likelihood, "fit", Once(stopped.fit))
    ask_likelihood(stopped, 1)
    assert abs(stopped.fit.values[0, 0] - settled.fit.values[0, 0]) < 0.3 * sd
    assert stopped.fit.cost < settled.fit.cost + 1.0


def test_a_fit_that_has_moved_often_enough_is_told_how_far_the_likelihood_goes_about_it(settled, monkeypatch):
    sd = deviations(settled.fit)[0]
    stopped = fitted(settled.fit.values + np.array([3.0 * sd, 0.0]), 0)
    monkeypatch.setattr(likelihood, "fit", Once(stopped.fit))
    monkeypatch.setattr(likelihood, "_MOVES", 0)
    ask_likelihood(stopped, 1)
    assert stopped.fit.values[0, 0] == pytest.approx(settled.fit.values[0, 0] + 3.0 * sd)
    assert stopped.reach[0, 0] > 3.0 * sd  # beyond the better fit


class Once:
    """The first fit does not move, as if a ripple held it."""

    def __init__(self, first):
        self.first = first

    def __call__(self, *arguments, **options):
        first, self.first = self.first, None
        return fit(*arguments, **options) if first is None else first
