"""What is said of the clearance and of play in the guide, followed or shown by the motion alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.judging import play
from clearance.diagnosis.judging.play import clearance_of
from clearance.diagnosis.judging.verdict import (
    Estimate,
    basis_of,
    effects_of,
    place_of,
    probabilities,
    verdict_of,
    withdraw,
)
from clearance.diagnosis.judging.words import sentences
from clearance.diagnosis.searching.explanation import Explanation, Rails
from tests.diagnosis.attempts import attempt, known


@pytest.mark.parametrize(("misfit", "expected"), [(1.0, (3.0, 2.9, 3.1)), (4.0, (3.0, 1.9, 4.1))])
def test_where_nothing_explains_the_clearance_spans_what_comes_near(misfit, expected, monkeypatch):
    places = {"gravity": 3.0, "slider_spring": 2.0, "soft_drive": 4.0, "torque_ripple": 9.0, "": 9.5}
    monkeypatch.setattr(play, "estimates", lambda a: [
        Estimate(c, c - 0.1, c + 0.1) for c in [places["".join(h.name for h in a.hypotheses)]]
    ])  # fmt: skip
    near = [attempt(["slider_spring"], 1.5 * misfit), attempt(["soft_drive"], 1.9 * misfit)]
    far = attempt(["torque_ripple"], 2.1 * misfit)
    found = clearance_of(Explanation(attempt([], 50.0), [attempt(["gravity"], misfit), *near, far]))[0]
    assert (found.value, found.low, found.high) == pytest.approx(expected)


def between_rails():
    """What the motion alone shows: 1 mm of clearance and a gap of 7e-5 m, by 15 and 20 % at most."""
    shown = attempt(["guide_clearance"], 90.0)
    shown.hypotheses[0].body, shown.hypotheses[0].direction = "slider", "y"
    shown.reach = np.outer([1.5e-5, 1.4e-5], [1.0, 1.0])
    shown.fit.values = np.array([[1e-4, 7e-5, 700.0]])
    shown.model.unknowns = [SimpleNamespace(low=0.0, high=1e-2)] * 2
    return shown


@pytest.mark.parametrize(("misfit", "followed"), [(1.0, True), (40.0, False)])
def test_what_the_motion_alone_shows_is_asserted_where_nothing_is_followed(misfit, followed, monkeypatch):
    best = attempt(["gravity"], misfit)
    best.hypotheses[0].body, best.hypotheses[0].direction = "rod", "x"
    explanation = Explanation(attempt([], 50.0), [best], shown=between_rails())
    if followed:
        sure = [Estimate(5e-4, 4.9e-4, 5.1e-4), Estimate(2.0, 1.9, 2.1)]
        known(monkeypatch, lambda _: sure)
    withdraw(explanation)
    held_out = attempt(["guide_clearance"], 80.0)
    assert verdict_of(explanation, held_out) == ("unknown" if followed else "physics")
    if followed:
        assert explanation.best is best
        assert place_of(explanation) == ("rod", "x")
        assert clearance_of(explanation)[0].value == 5e-4
        return
    found, rests_on = clearance_of(explanation)
    assert rests_on == "motion"
    assert place_of(explanation) == ("slider", "y")
    assert (found.value, found.low, found.high) == pytest.approx((1e-4, 0.85e-4, 1.15e-4))
    (effect,) = effects_of(explanation.best, probabilities(explanation), basis_of(explanation))
    assert effect["basis"] == "motion"
    assert effect["probability"] is None
    size = effect["parameters"]["size"]
    assert (size["low"], size["high"]) == pytest.approx((5.6e-5, 8.4e-5))


@pytest.mark.parametrize(
    ("gap", "beside", "followed", "each", "expected", "basis"),
    [
        (7.6e-5, "flexible_base", False, (40.0, 90.0), "physics", "fitted recordings and motion"),
        (7.6e-5, "flexible_base", False, (-3.0, 90.0), "physics", "fitted recordings and motion"),  # late
        (7.6e-5, "flexible_base", False, (1.0, 90.0), "physics", "prediction"),  # half of them is enough
        (7.6e-5, "flexible_base", False, (3.0, 90.0), "unknown", "prediction"),  # one is followed, and badly
        (9.5e-5, "flexible_base", False, (40.0, 90.0), "unknown", "prediction"),  # the motion shows another
        (7.6e-5, "sensor_bias", False, (40.0, 90.0), "unknown", "prediction"),  # which it does not show
        (7.6e-5, "flexible_base", True, (40.0, 90.0), "unknown", "prediction"),  # a recording is no motion
    ],
)
def test_play_that_the_motion_shows_as_well_is_asserted_though_what_is_held_out_is_lost(
    gap, beside, followed, each, expected, basis
):
    best = attempt(["guide_clearance", beside], 1.0)
    best.fit.values = np.array([[1e-4, gap, 54.0, 700.0]])
    frame = attempt(["flexible_base"], 1.0).hypotheses
    rails = Rails(1.1e-4, 7e-5, np.array([1e-5, 7e-6, 0.5]), frame, np.array([54.0]), followed)
    explanation = Explanation(attempt([], 50.0), [best], rails=rails)
    # a negative one: all segments but a few are followed to the noise
    typical = [1.0 if one < 0.0 else one for one in each]
    held_out = attempt(["guide_clearance"], 40.0, each=np.abs(each), typical=typical)
    assert verdict_of(explanation, held_out) == expected
    assert basis_of(explanation, held_out) == basis
    explanation.rails = None
    assert verdict_of(explanation, held_out) == ("physics" if each[0] == 1.0 else "unknown")


def test_play_that_held_out_recordings_are_not_followed_with_is_said_to_be_that(monkeypatch):
    best, nominal = attempt(["guide_clearance"], 1.0), attempt([], 50.0)
    nominal.fit.values, best.fit.values = np.array([[5e-4, 700.0]]), np.array([[1e-4, 7e-5, 700.0]])
    known(monkeypatch, lambda _: [Estimate(1e-4, 0.9e-4, 1.1e-4), Estimate(7e-5, 6e-5, 8e-5)])
    fit = {"held_out": {"before": 9.0, "after": 12.0, "lost": ["a.csv"]}}
    told = sentences("physics", Explanation(nominal, [best]), "C", fit, ["slider_vertical"])
    assert "lost at the slider's strikes (errors 12, floor 1.00)" in told[-1]


@pytest.mark.parametrize(("beside", "works"), [("gravity", True), ("second_clearance", False)])
def test_what_the_motion_alone_shows_is_said_to_be_no_more_than_that(beside, works):
    nominal = attempt([], 50.0)
    nominal.fit.values = np.array([[5e-4, 700.0]])
    forces = tuple(attempt([beside], 1.0).hypotheses)
    rails = Rails(1e-4, 7e-5, np.array([1e-5, 7e-6, 0.5]), forces, np.array([1.0]))
    explanation = Explanation(nominal, rails=rails, shown=between_rails())
    fit = {"held_out": {"before": 9.0, "after": 8.0}}
    told = sentences("physics", explanation, "C", fit, ["slider_vertical"])
    assert "motion alone" in told[0]
    assert "what else may be missing" in told[0]
    assert ("balance of work between them" in told[0]) == works
    assert "errors remain (8, floor 1.00)" in told[1]
    explanation.rails = Rails(1e-4, 7e-5, np.array([1e-7, 1e-7]), followed=True)
    assert basis_of(explanation) == clearance_of(explanation)[1] == "one recording"
    assert "One recording was followed" in sentences("physics", explanation, "C", fit, ["slider_vertical"])[0]
