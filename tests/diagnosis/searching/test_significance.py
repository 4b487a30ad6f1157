"""p-values: a Monte Carlo test against machines with nothing missing."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.judging.verdict import place_of, verdict_of, withdraw
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.kinematics.shaking import Shaking
from clearance.diagnosis.searching import significance
from clearance.diagnosis.searching.explanation import Explanation, Suspected
from clearance.diagnosis.searching.significance import (
    margin,
    null_scores,
    p_value,
    separating,
    suspicious,
    unsettled,
    usual,
)
from tests.diagnosis.attempts import attempt


def test_the_share_of_nulls_that_score_as_high(monkeypatch):
    monkeypatch.setattr(significance, "null_scores", lambda: np.array([1.0, 2.0, 3.0, 4.0]))
    assert p_value(3.0) == pytest.approx(3 / 5)
    assert p_value(0.5) == 1.0
    assert p_value(1e9) == pytest.approx(1 / 5), "no smaller than the simulation supports"


@pytest.mark.parametrize(
    ("simulated", "expected"),
    [
        (None, False),
        (np.linspace(1.0, 100.0, 19), True),  # a tenth of them look as suspicious
        (np.linspace(1.0, 89.0, 19), False),
        (np.full(18, 100.0), False),  # too few to say so
    ],
)
def test_what_simulations_show_as_often_is_usual(simulated, expected):
    hints = [SimpleNamespace(gain=90.0)]
    explanation = Explanation(attempt([], 1.0), hints=hints, simulated=simulated)
    assert usual(explanation) == expected
    assert suspicious(explanation) != expected


SHAKING = Shaking(Rhythm(0.06, (0.0, 0.01)), "x", np.array([40.0, -40.0]), 0.99, 0.5)


def test_a_force_that_the_balance_on_the_frame_shows_is_not_nothing():
    """From segment to segment a frame that is pushed looks free: the nominal machine explains."""
    nominal = attempt([], 1.1)
    for shaken, expected in ((None, "none"), (SHAKING, "unknown")):
        suspected = Suspected("frame", "x", 1.1) if shaken else None
        explanation = Explanation(nominal, shaken=shaken, suspected=suspected)
        assert suspicious(explanation) == (shaken is not None)
        assert verdict_of(explanation) == expected
        assert place_of(explanation) == (("frame", "x") if shaken else (None, None))


def test_a_measured_force_on_the_frame_stands_where_one_step_errors_say_nothing_of_it():
    nominal, pushed = attempt([], 1.10), attempt([FREE_FORM], 1.11)
    explanation = Explanation(nominal, [pushed], shaken=SHAKING, shown=pushed)
    withdraw(explanation)
    assert explanation.best is pushed
    assert not unsettled(explanation), "nothing small is looked for beside it"
    assert verdict_of(explanation) == "unknown"
    better = attempt(["gravity"], 0.9)
    explanation.attempts.append(better)
    assert explanation.best is better
    explanation.shaken = None  # without it the nominal machine would do
    explanation.attempts.remove(better)
    assert explanation.best is nominal


@pytest.mark.parametrize(("fall", "samples"), [(24.0, 20_000), (300.0, 20_000), (24.0, 100)])
def test_further_recordings_make_the_margin_that_grows_with_them(fall, samples):
    explanation = SimpleNamespace(samples=40_000)
    needed = separating(explanation, fall, samples)
    grown = SimpleNamespace(samples=explanation.samples + needed * samples)
    assert needed * fall == pytest.approx(margin(grown))


def test_the_scores_were_measured():
    scores = null_scores()
    assert len(scores) >= 100
    assert np.all(np.diff(scores) >= 0.0)
    assert 1.0 < np.median(scores) < 60.0


def test_what_is_followed_for_longer_is_not_dearer():
    timed, wrong = attempt([FREE_FORM], 1.05), attempt(["slider_spring"], 1.9)
    timed.fit.passes[0].samples = 24_000  # for a period
    explanation = Explanation(attempt([], 30.0), [wrong, timed])
    assert explanation.best is timed
    assert explanation.price(timed) < 12_000


@pytest.mark.parametrize(
    ("nominal", "gain", "small", "expected"),
    [
        (1.02, 10.0, [], False),  # nothing is missing
        (1.02, 200.0, [], True),
        (1.19, 200.0, [1.18], True),  # a second clearance was taken for a heavier rod
        (1.19, 200.0, [1.01], False),
        (1.06, 200.0, [1.04], False),  # what a right model may leave
        (50.0, 200.0, [], False),
    ],
)
def test_something_small_that_leaves_most_does_not_end_the_search(nominal, gain, small, expected):
    attempts = [attempt(["rod_inertia"], misfit) for misfit in small]
    explanation = Explanation(attempt([], nominal), attempts, [SimpleNamespace(gain=gain)])
    assert unsettled(explanation) == expected
