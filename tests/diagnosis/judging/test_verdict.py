"""Which verdict follows from attempts with known numbers, how sure, and what is equivalent."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import (
    FREE_FORM,
)
from clearance.diagnosis.judging.verdict import (
    Estimate,
    effects_of,
    equivalents,
    lost,
    place_of,
    probabilities,
    verdict_of,
)
from clearance.diagnosis.judging.words import sentences
from clearance.diagnosis.searching.explanation import Explanation
from tests.diagnosis.attempts import attempt, known


@pytest.mark.parametrize(
    ("nominal", "others", "expected"),
    [
        (1.0, [], "none"),
        (50.0, [], "unknown"),
        (50.0, [attempt(["gravity"], 1.0)], "physics"),
        (50.0, [attempt(["gravity"], 20.0)], "unknown"),
        (50.0, [attempt(["gravity"], 1.0), attempt(["guide_friction"], 1.0005)], "ambiguous"),
        (50.0, [attempt(["gravity"], 1.0), attempt([FREE_FORM], 1.0005)], "physics"),
        (50.0, [attempt(["gravity"], 1.1), attempt([FREE_FORM], 1.0)], "unknown"),
        (50.0, [attempt(["sensor_gain"], 1.0, "instrument")], "instrument"),
    ],
)
def test_the_verdict_follows_from_what_explains(nominal, others, expected):
    assert verdict_of(Explanation(attempt([], nominal), others)) == expected


def test_no_shape_switches_an_effect_off(monkeypatch):
    bending = attempt(["rod_flexibility"], 1.0)
    (hypothesis,) = bending.hypotheses
    hypothesis.unknowns = tuple(
        SimpleNamespace(name=name) for name in ("frequency", "damping_ratio", "scale")
    )
    hypothesis.off, hypothesis.shapes = np.array([np.inf, 0.01, 1.0]), np.array([False, True, False])
    hypothesis.body, hypothesis.direction = "rod", "transverse"
    known(monkeypatch, lambda _: [Estimate(1.0, 1.0, 1.0)] * 4)
    (effect,) = effects_of(bending, {})
    told = {name: parameter["off"] for name, parameter in effect["parameters"].items()}
    assert told == {"frequency": None, "damping_ratio": None, "scale": 1.0}


@pytest.mark.parametrize(("held_out", "expected"), [(1.3, "physics"), (1.4, "unknown"), (60.0, "unknown")])
def test_what_does_not_explain_held_out_recordings_is_not_asserted(held_out, expected):
    explanation = Explanation(attempt([], 50.0), [attempt(["gravity"], 1.0)])
    assert verdict_of(explanation, attempt(["gravity"], held_out)) == expected


@pytest.mark.parametrize(
    ("each", "shares", "expected", "told"),
    [
        ([1.02, 196.0], (), "physics", ["1.csv"]),
        ([1.02, 2.0], (), "unknown", []),  # a little wrong, not lost
        ([1.02, 196.0, 7.0], (), "unknown", ["1.csv", "2.csv"]),
        ([60.0, 196.0], (), "unknown", []),
        ([1.02, 1.1], (0.6, 1.0), "physics", []),  # lost for a part
        ([1.02, 1.1], (0.6, 0.7), "unknown", []),
        ([1.02, 196.0], (0.6, 1.0), "unknown", ["1.csv"]),
    ],
)
def test_an_effect_is_asserted_though_half_of_what_was_held_out_is_lost(each, shares, expected, told):
    held_out = attempt([], float(np.mean(each)), each=each)  # of the machine, whatever it was made of
    held_out.shares = shares
    assert verdict_of(Explanation(attempt([], 50.0), [attempt(["gravity"], 1.0)]), held_out) == expected
    assert lost(held_out) == told
    assert verdict_of(Explanation(attempt([], 1.0)), attempt([], 98.0, each=each)) == "unknown"


def test_an_effect_that_was_fitted_twice_is_as_sure_as_once():
    twice = [attempt(["gravity", "rod_inertia"], 1.0), attempt(["rod_inertia", "gravity"], 1.0001)]
    rival = attempt(["guide_friction", "restitution"], 1.0001)
    chance = probabilities(Explanation(attempt([], 50.0), [*twice, rival]))
    assert chance[id(twice[0])] == chance[id(twice[1])]
    assert chance[id(twice[0])] + chance[id(rival)] == pytest.approx(1.0)
    # 10 000 samples differ by 1, of which a tenth counts
    assert chance[id(twice[0])] / chance[id(rival)] == pytest.approx(np.exp(0.05), rel=1e-2)


def test_an_explanation_for_which_sensors_bend_costs_what_their_tolerances_say():
    plain, bending = attempt(["gravity"], 1.0), attempt(["guide_friction"], 0.995)  # 50 less by what is left
    explanation = Explanation(attempt([], 50.0), [plain, bending])
    assert explanation.best is bending
    bending.fit.bent = 60.0
    assert explanation.best is plain


def test_what_cannot_be_told_from_another_is_not_certain():
    """The margin of equivalence is 120 for 10 000 samples; a difference of 50 is well within it."""
    one, other = attempt(["gravity"], 1.0), attempt(["guide_friction"], 1.005)
    explanation = Explanation(attempt([], 50.0), [one, other])
    assert len(equivalents(explanation)) == 2
    assert 0.9 < probabilities(explanation)[id(one)] < 0.95


def test_of_equivalent_explanations_variants_and_what_only_adds_to_one_are_left_out():
    best, alike = attempt(["gravity"], 1.0), attempt(["guide_friction"], 1.0003)
    variant = attempt(["guide_friction"], 1.0005)
    variant.labels = frozenset(["guide_friction(coulomb_force, viscous_damping)"])
    more = attempt(["guide_friction", "restitution"], 1.0001)
    other, same = (attempt(["sensor_gain"], 1.0004, "instrument") for _ in range(2))
    other.hypotheses[0].channel, same.hypotheses[0].channel = "rod_b_axial", "rod_c_axial"
    found = equivalents(Explanation(attempt([], 50.0), [variant, more, best, alike, other, same]))
    assert found == [best, alike, other, same]


@pytest.mark.parametrize(
    ("each", "shares", "hints", "lost_of"),
    [
        ([1.0, 98.0], (), [], ["1.csv"]),
        ([1.0, 1.0], (1.0, 0.6), [], ["1.csv"]),
        ([1.0, 2.0], (), [], []),  # off all along
        ([70.0, 98.0], (), [], []),  # nowhere right
        ([1.0, 98.0], (), [SimpleNamespace(gain=1e4)], []),  # the fitted recordings say so, too
    ],
)
def test_a_path_that_was_lost_alone_does_not_say_that_something_is_missing(
    monkeypatch, each, shares, hints, lost_of
):
    known(monkeypatch, lambda _: [Estimate(3e-4, 3e-4, 3e-4)])
    for hint in hints:
        hint.hypotheses = [SimpleNamespace(body="slider", direction="x")]
    nominal, held_out = attempt([], 1.0), attempt([], 30.0, each=each)
    nominal.fit.values, held_out.shares = np.array([[3e-4, 700.0]]), shares
    explanation = Explanation(nominal, hints=hints)
    fit = {"held_out": {"before": 30.0, "after": 30.0}}
    told = sentences(verdict_of(explanation, held_out), explanation, "C", fit, [], held_out)
    assert verdict_of(explanation, held_out) == "unknown"
    if lost_of:
        assert f"held out of {' and '.join(lost_of)} was lost" in told[0]
        assert place_of(explanation, held_out) == (None, None)
    else:
        assert told[0].startswith("Something is missing")
        assert "shows most in ." not in " ".join(told)


@pytest.mark.parametrize(("left", "expected"), [(1.18, "unknown"), (1.02, "physics")])
def test_what_leaves_most_of_something_small_is_not_asserted(left, expected):
    small = [SimpleNamespace(gain=200.0)]
    explanation = Explanation(attempt([], 1.19), [attempt(["rod_inertia"], left)], small)
    assert verdict_of(explanation) == expected


def test_an_explanation_that_was_fitted_twice_is_one_rival():
    best = attempt(["gravity"], 1.0)
    once, again = attempt(["guide_friction"], 1.0006), attempt(["guide_friction"], 1.0005)
    assert equivalents(Explanation(attempt([], 50.0), [best, once, again])) == [best, again]


@pytest.mark.parametrize(
    ("kinds", "expected"), [(["physics"], "physics"), (["physics", "instrument"], "mixed")]
)
def test_what_the_motion_shows_is_of_the_kinds_that_it_is_made_of(kinds, expected):
    shown = attempt(["guide_clearance", "timebase"][: len(kinds)], 90.0)
    for hypothesis, kind in zip(shown.hypotheses, kinds, strict=True):
        hypothesis.kind = kind
    assert verdict_of(Explanation(attempt([], 50.0), shown=shown)) == expected


def test_an_explanation_that_only_adds_to_the_best_one_is_no_rival():
    best, longer = attempt(["slider_spring"], 1.0), attempt(["torque_ripple", "slider_spring"], 1.0)
    found = equivalents(Explanation(attempt([], 50.0), [best, longer]))
    assert found == [best]


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        ({"after": 1.02}, "held-out error falls from 9 to 1.02"),
        ({"after": 7e5}, "does not help on held-out"),
        ({"after": 7e5, "followed": 1.01}, "could be followed, errors are 1.01 with it"),
    ],
)
def test_an_error_that_does_not_fall_is_not_said_to_fall(monkeypatch, after, expected):
    known(monkeypatch, lambda _: [Estimate(3e-4, 3e-4, 3e-4)] * 2)
    nominal, table = attempt([], 50.0), attempt(["gravity"], 1.0)
    for one in (nominal, table):
        one.fit.values = np.array([[5e-4, 1.0, 700.0]])
    fit = {"held_out": {"before": 9.0, **after}}
    told = sentences("physics", Explanation(nominal, [table]), "C", fit, ["slider_vertical"])
    assert expected in told[-1]


def test_nothing_is_missing_only_where_the_held_out_recordings_say_so_too():
    hint = SimpleNamespace(gain=5.0, hypotheses=[SimpleNamespace(body="frame", direction="x")])
    explanation = Explanation(attempt([], 1.0), [], [hint])
    assert verdict_of(explanation, attempt([], 1.1)) == "none"
    assert place_of(explanation, attempt([], 1.1)) == (None, None)
    assert verdict_of(explanation, attempt([], 1.8)) == "unknown"
    assert place_of(explanation, attempt([], 1.8)) == ("frame", "x")
