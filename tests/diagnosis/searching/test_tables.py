"""Forces of free form as tables: the same curve with other knots, and when more of them are tried."""

from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import (
    FREE_FORM,
    Curve,
    along,
    curve_of,
    curve_over,
    free_form,
    halved,
    refined,
)
from clearance.diagnosis.hypotheses.two_levels import levels_of, two_levels
from clearance.diagnosis.searching import clocked, tables
from clearance.diagnosis.searching.explanation import Explanation
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.parameters import TABLE_KNOTS
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.attempts import attempt


def test_a_table_over_a_contacts_force_is_a_line_that_goes_on():
    curve = curve_over(np.linspace(0.0, 200.0, 50), "joint_c", "tangential", "contact_force")
    straight = replace(curve, forces=0.2 * curve.knots)
    np.testing.assert_allclose(along(straight, np.array([0.0, 90.0, 5000.0])), [0.2, 18.0, 1000.0], atol=0.3)
    fine = refined(straight, "cubic")
    np.testing.assert_allclose(along(fine, np.array([90.0, 5000.0])), [18.0, 1000.0], atol=0.3)


@pytest.mark.parametrize("argument", ["crank_angle", "slider_velocity"])
def test_a_table_with_more_knots_is_the_same_curve(argument):
    low, high = (0.0, 2.0 * np.pi) if argument == "crank_angle" else (-2.0, 3.0)
    knots = np.linspace(low, high, 12, endpoint=argument != "crank_angle")
    curve = Curve("slider", "x", argument, knots, np.sin(knots) + knots % 2.0, np.ones(12), 1.0, 1.0)
    fine, places = refined(curve, "linear"), np.random.default_rng(1).uniform(low, high, 200)
    assert len(fine.knots) > 20
    np.testing.assert_allclose(along(fine, places), along(curve, places), atol=1e-12)
    smooth = refined(curve, "cubic")
    np.testing.assert_allclose(along(smooth, curve.knots), curve.forces, atol=1e-12)
    assert np.abs(along(smooth, places) - along(curve, places)).max() > 0.01


@pytest.mark.parametrize("argument", ["crank_angle", "slider_velocity"])
def test_a_table_with_half_as_many_knots_covers_the_same_range(argument):
    turning = argument == "crank_angle"
    low, high = (0.0, 2.0 * np.pi) if turning else (-2.0, 3.0)
    knots = np.linspace(low, high, 12, endpoint=not turning)
    curve = Curve("slider", "x", argument, knots, np.cos(knots), np.ones(12), 1.0, 1.0)
    fewer, places = halved(curve), np.linspace(low, high, 100)
    assert (len(fewer.knots), fewer.interpolation) == (6, "cubic")
    np.testing.assert_allclose(along(fewer, places), np.cos(places), atol=0.1)


def sampled(shape, knots):
    """The table of ``knots`` that says most of a force of period 0.2, with a little noise, and all of it."""
    curve = Curve(
        "slider", "x", "time", 0.2 * np.arange(knots) / knots, np.ones(knots), np.zeros(knots), 0.0, 0.0,
        period=0.2,
    )  # fmt: skip
    time = np.linspace(0.0, 0.2, 2000, endpoint=False)
    true = shape(time)
    forces = np.linalg.lstsq(curve.shares(time), true, rcond=None)[0]
    return replace(curve, forces=forces + 0.3 * np.random.default_rng(knots).normal(size=knots)), time, true


@pytest.mark.parametrize("part", [0.5, 0.3])
@pytest.mark.parametrize("start", [0.003, 0.05, 0.1234])
def test_a_wave_of_two_levels_jumps_where_the_slopes_of_its_table_have_their_impulse(start, part):
    curve, time, true = sampled(lambda t: np.where((t - start) % 0.2 < 0.2 * part, 20.0, -8.0), 24)
    spoilt = curve.forces.copy()
    spoilt[round((start + 0.1 * part) / 0.2 * 24) % 24] = -90.0  # a knot of which nothing is known
    values = levels_of(replace(curve, forces=spoilt))
    assert values[4] == 1.0 / TABLE_KNOTS
    sharp = curve_of(two_levels(curve, values).apply(SliderCrank(), values).force)
    assert sharp.period == 0.2
    left, before = along(sharp, time) - true, along(curve, time) - true
    assert left.std() < 1.05 * before.std()  # a shape that was fitted, and one that was placed
    wrong = np.abs(left) > 3.0
    assert wrong.mean() < 2.5 / TABLE_KNOTS < (np.abs(before) > 3.0).mean()


@pytest.mark.parametrize(
    "shape",
    [
        lambda t: 20.0 * np.sin(10.0 * np.pi * t),
        lambda t: 200.0 * (t % 0.2) - 20.0,
        lambda t: 20.0 * np.sign(np.sin(20.0 * np.pi * t)),  # four jumps
        lambda t: np.where(t < 0.012, 20.0, 0.0),  # between two knots
    ],
    ids=["sine", "saw", "twice", "pulse"],
)
def test_what_is_of_no_two_levels_has_no_jumps(shape):
    assert levels_of(sampled(shape, 24)[0]) is None


@pytest.mark.parametrize(
    ("argument", "period"), [("slider_position", None), ("crank_angle", None), ("time", 0.05), ("time", None)]
)
@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_machines_table_is_the_curve_that_it_was_made_from(argument, period, interpolation):
    high = 2.0 * np.pi if argument == "crank_angle" else 0.05
    knots = np.linspace(0.0, high, 12, endpoint=period is None and argument != "crank_angle")
    curve = Curve(
        "slider", "x", argument, knots, np.sin(knots), np.zeros(12), 0.0, 0.0, interpolation, period
    )  # fmt: skip
    found = curve_of(free_form(curve, "C").apply(SliderCrank(), curve.forces).force)
    for name in ("body", "direction", "argument", "interpolation", "period"):
        assert getattr(found, name) == getattr(curve, name)
    np.testing.assert_allclose(found.knots, knots, atol=1e-12)
    np.testing.assert_array_equal(found.forces, curve.forces)


def tabulated(argument, knots):
    return TabulatedForce("slider", "x", argument, 0.0, 0.01, (1.0,) * knots)


def with_force(names, misfit, force):
    found = attempt(names, misfit)
    found.model.machine, found.fit.values = (
        lambda row: SimpleNamespace(force=force), np.zeros((1, len(force.values) + 2))
    )  # fmt: skip
    return found


def sharpened(best, better=()):
    """Knots, and what lies between them, of each table tried in the place of ``best``."""
    explanation, tried, better = Explanation(attempt([], 40.0), [best]), [], list(better)

    def refit(explanation, held, followers, values, scale, again):
        law = held[0].apply(SliderCrank(), values[0, 1:-1]).force
        tried.append((len(law.values), law.interpolation))
        if better and better[0].misfit < explanation.best.misfit:
            explanation.attempts.append(better.pop(0))

    setting = SimpleNamespace(joint="C")
    search = SimpleNamespace(late=lambda: False, report=lambda _: None, refit=refit, setting=setting)
    tables.sharpen(search, explanation)
    return tried


@pytest.mark.parametrize(
    ("names", "argument", "knots", "expected"),
    [
        ([FREE_FORM], "slider_position", 24, [(47, "cubic"), (47, "linear")]),
        ([FREE_FORM], "slider_position", 25, []),  # the simulator has no room for twice as many
        ([FREE_FORM], "force_c", 2, []),  # nothing holds the bends of more
        (["gravity"], "slider_position", 24, []),
        ([FREE_FORM, "gravity"], "slider_position", 24, []),
    ],
)
def test_a_table_that_leaves_a_little_too_much_gets_more_knots(names, argument, knots, expected):
    assert sharpened(with_force(names, 1.15, tabulated(argument, knots))) == expected


def test_a_table_gets_more_knots_until_they_say_nothing_more_or_nothing_is_left():
    coarse = with_force([FREE_FORM], 1.3, tabulated("slider_position", 12))
    finer = [with_force([FREE_FORM], left, tabulated("slider_position", 23)) for left in (1.2, 1.02)]
    assert [count for count, _ in sharpened(coarse, finer[:1])] == [23, 23, 45, 45]
    assert [count for count, _ in sharpened(coarse, finer)] == [23, 23]  # 1.02 leaves no room


@pytest.mark.parametrize(
    ("better", "ahead", "lost", "rises"),
    [
        (True, 0, 0, 0.0),
        (False, 0, 0, 0.0),
        (True, 6, 0, 0.25),  # where the balance of work has them
        (True, 6, 1, 0.0),  # where the table that was fitted has them, if these are not followed
    ],
)
def test_jumps_are_followed_as_such(monkeypatch, better, ahead, lost, rises):
    curve = sampled(lambda t: np.where(t < 0.07, 20.0, -8.0), 24)[0]
    coarse = with_force([FREE_FORM], 3.0, TabulatedForce("slider", "x", "time", values=(0.0,), period=0.2))
    coarse.fit.values = np.array([[1e-4, *curve.forces, 700.0], [1e-4, *curve.forces, 900.0]])
    coarse.followers = [SimpleNamespace(measured=SimpleNamespace(clock=clock)) for clock in (0.0, 0.05)]
    explanation, clocks = Explanation(attempt([], 40.0), [coarse]), []
    known = attempt([FREE_FORM], 1.5)
    known.fit.values = np.array([[1.1e-4, 701.0], [1.1e-4, 901.0]])
    fitted, tried = [], []

    @contextmanager
    def timed(rhythm):
        clocks.append(rhythm)
        yield

    def keep(explanation, held, make, again):
        make()
        tried.append(held)
        if len(tried) <= lost:
            return None
        explanation.attempts.append(known)
        return known

    def everywhere(search, held, row, surest, base, anew, clearance):
        assert held[0].unknowns == ()
        assert (surest, row[0], row[1], clearance, anew) == (1, 1e-4, 900.0, 1e-4, True)

    def refit(explanation, held, followers, values, scale, again):
        (force,) = held
        assert len(force.unknowns) == 5
        np.testing.assert_array_equal(values[:, [0, -1]], known.fit.values)
        np.testing.assert_allclose(values[0, 1:3], [20.0, -8.0], atol=0.5)
        assert np.abs((values[0, 3] - rises + 0.5) % 1.0 - 0.5) < 0.01
        explanation.attempts.append(attempt([FREE_FORM], 1.2 if better else 5.0))
        fitted.append(explanation.attempts[-1])
        fitted[-1].fit.values = values
        return fitted[0]

    monkeypatch.setattr("clearance.diagnosis.searching.elsewhere.fit_everywhere", everywhere)
    later = attempt([FREE_FORM], 5.1)

    def retime(search, explanation, curve, known, force):
        values = np.array([20.0, -8.0, 0.0, 0.35, 0.02])
        again = force(replace(curve, period=0.201)).apply(SliderCrank(), values)
        assert again.force.period == 0.201
        explanation.attempts.append(later)
        return known, curve

    monkeypatch.setattr(clocked, "retime", retime)
    monkeypatch.setattr(clocked, "rhythm_of", lambda one: None)
    monkeypatch.setattr(clocked, "fit_from", lambda *_, **__: None)  # what is torn stays lost
    monkeypatch.setattr(clocked, "_lasting_on", lambda search, explanation, curve, found, force: found)
    search = SimpleNamespace(
        late=lambda: False, report=lambda _: None, timed=timed, keep=keep, refit=refit,
        starts=[SimpleNamespace(doubt=2.0), SimpleNamespace(doubt=1.0)],
    )  # fmt: skip
    balanced = replace(curve, forces=np.roll(curve.forces, ahead) - 1.0)  # which knows no mean
    assert tables.place_jumps(search, explanation, balanced, coarse) is better
    assert len(tried) == 1 + lost
    assert (clocks[0].period, clocks[0].clocks) == (0.2, (0.0, 0.05))
    assert known.withdrawn
    assert later.withdrawn
    assert not fitted[0].withdrawn


@pytest.mark.parametrize("moved", [0, 1, 2, 3, 4])
def test_levels_and_jumps_move_the_force_where_they_are(moved):
    curve, time, _ = sampled(lambda t: np.where(t < 0.07, 20.0, -8.0), 24)
    values, step = np.array([20.0, -8.0, 0.1, 0.45, 0.02]), np.array([1.0, 1.0, 0.005, 0.005, 0.02])[moved]
    further = values + step * (np.arange(5) == moved)
    before, after = (
        along(curve_of(two_levels(curve, values).apply(SliderCrank(), row).force), time)
        for row in (values, further)
    )
    turns = time / 0.2
    one = (turns > 0.1 + 1 / 48) & (turns < 0.45 - 2 / 48)
    other = (turns < 0.1 - 1 / 48) | (turns > 0.45 + 2 / 48)
    expected = {0: (1.0, 0.0), 1: (0.0, 1.0), 2: (0.0, 0.0), 3: (0.0, 0.0), 4: (0.0, 0.0)}[moved]
    np.testing.assert_allclose((after - before)[one], expected[0], atol=1e-9)
    np.testing.assert_allclose((after - before)[other], expected[1], atol=1e-9)
    gained = {0: 0.35, 1: 0.65, 2: -0.14, 3: 0.14, 4: 0.0}[
        moved
    ]  # the mean: 28 N for half a hundredth of a turn
    assert np.mean(after - before) == pytest.approx(gained, abs=2e-3)
