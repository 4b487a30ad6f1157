"""What is asserted, withdrawn and called equivalent, from attempts with known numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import (
    CLOSEST,
    DAMPING,
    FREE_FORM,
    KNOTS,
    free_form,
    resisting,
)
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging import play, verdict, words
from clearance.diagnosis.judging.free_form import free_form_of
from clearance.diagnosis.judging.play import clearance_of
from clearance.diagnosis.judging.verdict import (
    Estimate,
    basis_of,
    effects_of,
    equivalents,
    lost,
    place_of,
    probabilities,
    rattling,
    verdict_of,
    withdraw,
)
from clearance.diagnosis.judging.words import sentences
from clearance.diagnosis.searching.explanation import Explanation, Rails, Suspected, Worked
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank


def attempt(names, misfit, kind="physics", off=0.0, each=(), typical=()):
    hypotheses = tuple(
        SimpleNamespace(
            name=n,
            kind=kind,
            unknowns=(SimpleNamespace(name="size", low=-1e6, high=1e6),),
            off=np.array([off]),
            shapes=np.array([False]),
            effect=None,
            fault=None,
            channel=None,
        )
        for n in names
    )
    each = list(each) or [misfit]
    scale = 1.0 if misfit < 2 else 10.0
    passes = [
        SimpleNamespace(samples=10_000 // len(each), each=np.full(100, one / scale**2))
        for one in typical or each
    ]
    recorded = [SimpleNamespace(name=f"{r}.csv", first=0) for r in range(len(each))]
    followers = [SimpleNamespace(measured=one, segments=100) for one in recorded]
    return SimpleNamespace(
        hypotheses=hypotheses, label=" + ".join(names) or "nominal", labels=frozenset(names),
        misfit=misfit, level=misfit, scale=scale,
        withdrawn=False, reach=None, followers=followers, misfits=each, shares=(),
        fit=SimpleNamespace(passes=passes, cost=10_000 * misfit, bent=0.0),
        model=SimpleNamespace(shared=1 + len(names)),
    )  # fmt: skip


def known(monkeypatch, numbers):
    """Let every attempt's numbers be known."""
    for module in (verdict, words, play):
        monkeypatch.setattr(module, "estimates", numbers)


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


@pytest.mark.parametrize(
    ("fitted", "before", "cushioned"),
    [
        (1e-5, 7.0, True),
        (4e-4, 7.0, False),
        (1e-5, 5000.0, False),  # by the sensor that was at fault the motion showed another gap
    ],
)
def test_a_gap_that_no_machine_keeps_open_is_the_joint_s(fitted, before, cushioned, monkeypatch):
    known(monkeypatch, lambda a: [Estimate(fitted, 0.9 * fitted, 1.1 * fitted)] * 2)
    nearest = attempt(["sensor_gain"], 6.0)
    nearest.hypotheses[0].body, nearest.hypotheses[0].direction = "instrument", "x"
    nearest.hypotheses[0].fault = "gain"
    for one in (nominal := attempt([], before), nearest):
        one.fit.values = np.array([[fitted, 700.0]])
    explanation = Explanation(nominal, [nearest], agreed=("B", 5.5e-4))
    assert place_of(explanation) == (("joint_b", "normal") if cushioned else ("instrument", "x"))
    found, rests_on = clearance_of(explanation)
    assert (found.low < 6.3e-4 < found.high) == cushioned
    assert rests_on == ("motion" if cushioned else "nearest models")
    told = " ".join(
        sentences("unknown", explanation, "B", {"held_out": {"before": 2.0, "after": 1.9}}, ["rod_b_axial"])
    )
    assert ("0.550 mm of clearance in joint B" in told) == cushioned


@pytest.mark.parametrize(
    ("misfit", "share", "expected"),
    [
        (25.0, 0.29, ("slider", "x")),
        (25.0, 0.5, ("crank", "moment")),  # impacts leave as much
        (10.0, 0.29, ("crank", "moment")),  # the nearest machine takes away much
        (1.0, 0.29, ("crank", "moment")),
    ],
)
def test_where_no_machine_is_near_the_balance_of_work_says_where_it_acts(
    misfit, share, expected, monkeypatch
):
    known(monkeypatch, lambda a: [Estimate(3e-4, 3e-4, 3e-4)] * 2)
    nearest, nominal = attempt(["torque_ripple"], misfit), attempt([], 60.0)
    nearest.hypotheses[0].body, nearest.hypotheses[0].direction = "crank", "moment"
    for one in (nominal, nearest):
        one.fit.values = np.array([[3e-4, 700.0]])
    explanation = Explanation(nominal, [nearest], worked=Worked("slider", "x", share))
    assert place_of(explanation) == expected
    held = {"held_out": {"before": 2.0, "after": 1.9}}
    told = " ".join(sentences(verdict_of(explanation), explanation, "C", held, ["rod_b_axial"]))
    assert ("all but 29%" in told) == (expected == ("slider", "x"))


def test_what_fills_a_gap_is_told_as_a_resistance_along_the_contracts_direction(monkeypatch):
    hypothesis = free_form(resisting("C", 0.2), "C")
    best, nominal = attempt([FREE_FORM], 1.0), attempt([], 50.0)
    best.hypotheses, best.model.shared = (hypothesis,), 1 + KNOTS
    sizes = 0.3 * np.exp(1.5 * np.linspace(0.0, CLOSEST, KNOTS))
    nominal.fit.values, best.fit.values = np.array([[5e-4, 700.0]]), np.array([[4e-4, *sizes, 700.0]])
    nominal.model.machine = lambda values: SliderCrank(joint_c=Joint(values[0]))
    known(monkeypatch, lambda _: [Estimate(3e-4, 3e-4, 3e-4)] * (1 + KNOTS))
    unsure = np.where(np.arange(KNOTS) < 5, 1e9, 0.1)  # the journal comes no nearer to the middle
    monkeypatch.setattr("clearance.diagnosis.judging.free_form.deviations", lambda fit, combined: unsure)
    explanation = Explanation(nominal, [best])
    assert verdict_of(explanation) == "unknown"
    assert place_of(explanation) == ("joint_c", "normal")
    told = free_form_of(best, Setting(SliderCrank(), "C"))
    assert (told["body"], told["direction"], told["argument"]) == ("joint_c", "normal", "closeness")
    assert (told["unit"], told["argument_unit"]) == ("N s/m", "-")
    np.testing.assert_allclose(np.array(told["table"])[:, 1], sizes)
    assert told["low"][:5] == told["high"][:5] == [None] * 5
    np.testing.assert_allclose(np.array(told["high"][5:]) - told["low"][5:], 3.92 * 0.1)
    fit = {"held_out": {"before": 9.0, "after": 1.0}}
    said = sentences("unknown", explanation, "C", fit, ["rod_c_axial"])
    assert "resistance to the journal's motion in joint C" in said[0]
    law = hypothesis.apply(SliderCrank(joint_c=Joint(4e-4)), sizes).force
    assert (law.direction, law.argument) == (DAMPING, "closeness_c")
    assert all(u.low == 0.0 and u.log for u in hypothesis.unknowns)  # it never pushes


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


@pytest.mark.parametrize(("misfit", "expected"), [(1.6, ("slider", "x")), (3.0, ("joint_b", "normal"))])
def test_a_force_that_nearly_explains_one_recording_says_more_of_the_place_than_a_name_that_does_not(
    misfit, expected
):
    film = attempt(["joint_lubrication"], 5.0)
    film.hypotheses[0].body, film.hypotheses[0].direction = "joint_b", "normal"
    explanation = Explanation(attempt([], 8.0), [film], suspected=Suspected("slider", "x", misfit))
    assert place_of(explanation) == expected
    explanation.attempts.append(attempt(["gravity"], 1.0))
    explanation.attempts[1].hypotheses[0].body, explanation.attempts[1].hypotheses[0].direction = "all", "x"
    assert place_of(explanation) == ("all", "x")


def test_rails_that_the_motion_shows_tell_the_place_until_a_machine_explains():
    film, table = attempt(["joint_lubrication"], 5.0), Suspected("rod", "moment", 1.6)
    film.hypotheses[0].body, film.hypotheses[0].direction = "joint_b", "normal"
    explanation = Explanation(attempt([], 8.0), [film], suspected=table, rattles=0.4, misplaced=0.3)
    assert not rattling(explanation)
    assert place_of(explanation) == ("rod", "moment")
    explanation.misplaced = 0.6
    assert rattling(explanation)
    assert place_of(explanation) == ("slider", "y")
    explanation.attempts.append(attempt(["gravity"], 1.0))
    explanation.attempts[1].hypotheses[0].body, explanation.attempts[1].hypotheses[0].direction = "all", "x"
    assert not rattling(explanation)
    assert place_of(explanation) == ("all", "x")


def test_nothing_is_missing_only_where_the_held_out_recordings_say_so_too():
    hint = SimpleNamespace(gain=5.0, hypotheses=[SimpleNamespace(body="frame", direction="x")])
    explanation = Explanation(attempt([], 1.0), [], [hint])
    assert verdict_of(explanation, attempt([], 1.1)) == "none"
    assert place_of(explanation, attempt([], 1.1)) == (None, None)
    assert verdict_of(explanation, attempt([], 1.8)) == "unknown"
    assert place_of(explanation, attempt([], 1.8)) == ("frame", "x")
