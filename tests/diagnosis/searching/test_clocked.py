"""Forces by a clock of their own: how clocks are set, and when paths are sought anew by them."""

from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM, Curve, free_form
from clearance.diagnosis.hypotheses.two_levels import two_levels
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.searching import clocked
from clearance.diagnosis.searching.explanation import Explanation
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.layout import STATES, State
from tests.diagnosis.attempts import attempt
from tests.diagnosis.searching.test_tables import sampled, tabulated, with_force

VALUES = np.array([20.0, -8.0, 0.1, 0.45, 0.02])


@dataclass(frozen=True)
class Heard:
    """What a table over time needs of a recording: its clock, and where its middle is."""

    segment: float = 1e-3
    clock: float = 0.1
    period: float = 0.04

    @property
    def begin(self):
        return self.clock


def follower(segments):
    """One whose path is where its clock says."""
    nodes = np.zeros((segments, STATES))
    nodes[:, State.TIME] = 0.1 + 1e-3 * np.arange(segments)
    one = SimpleNamespace(measured=Heard(), segments=segments, path=SimpleNamespace(nodes=nodes))
    one.part = lambda *_: follower(segments)
    return one


def times(one):
    return one.path.nodes[:, State.TIME]


@pytest.mark.parametrize("right", [0.99, 1.002])
def test_a_period_is_fitted_where_the_middle_of_a_recording_stays_in_its_place(monkeypatch, right):
    known = with_force([FREE_FORM], 9.0, tabulated("time", 4))
    known.followers, known.scale = [follower(600)], 3.16
    curve = Curve("slider", "x", "time", 0.01 * np.arange(4), np.ones(4), np.zeros(4), 0.0, 0.0, period=0.04)
    heard = []

    def settle(own, model, rows, *_, **__):
        return SimpleNamespace(level=(own[0].measured.period / 0.04 - right) ** 2)

    def refit(explanation, held, own, *_, **__):
        heard.append((own[0].measured, held[0].apply(SliderCrank(), np.ones(4)).force))
        np.testing.assert_allclose(times(own[0]), own[0].measured.begin + 1e-3 * np.arange(600))
        return with_force([FREE_FORM], 3.0, tabulated("time", 4))

    monkeypatch.setattr(clocked, "settle", settle)
    setting = SimpleNamespace(joint="C", model=lambda held: None)
    search = SimpleNamespace(report=lambda _: None, refit=refit, setting=setting, workers=1)
    table = partial(free_form, joint="C")
    found, other = clocked.retime(search, Explanation(known), curve, known, table)
    ((measured, law),) = heard
    expected = 0.04 * max(right, 0.997)  # no further than the balance of work may be wrong
    assert law.period == measured.period == other.period == pytest.approx(expected, rel=2e-4)
    assert found.misfit == 3.0
    middle = 0.1 + 0.3
    assert (measured.clock + 0.3) / measured.period == pytest.approx(middle / 0.04, abs=1e-6)


@pytest.mark.parametrize(("left", "stands"), [(1.05, True), (1.2, False)])
def test_the_rest_of_a_recording_tells_how_long_a_period_is(monkeypatch, left, stands):
    found = with_force([FREE_FORM], 1.0, tabulated("time", 4))
    found.fit.values = np.array([[3e-4, 1.0, 2.0, 3.0, 4.0, 700.0]])
    found.followers = [follower(110)]
    curve = Curve("slider", "x", "time", 0.01 * np.arange(4), np.ones(4), np.zeros(4), 0.0, 0.0, period=0.04)
    again, heard = attempt([FREE_FORM], left), []

    def settle_clocks(search, setting, one, force, known_at):
        assert (one.clearance, list(one.values)) == (3e-4, [1.0, 2.0, 3.0, 4.0])
        assert known_at == [pytest.approx(0.1 + 0.055)]
        assert force(0.041).apply(SliderCrank(), one.values).force.period == 0.041
        return replace(one, rhythm=Rhythm(0.0404, (0.102,)))

    def refit(explanation, held, own, *_, **__):
        heard.append((own[0].measured.clock, held[0].apply(SliderCrank(), np.ones(4)).force.period))
        np.testing.assert_allclose(times(own[0]), own[0].measured.begin + 1e-3 * np.arange(110))
        return again

    @contextmanager
    def by(rhythm):
        yield

    monkeypatch.setattr(clocked, "rhythm_of", lambda one: Rhythm(0.04, (0.1,)))
    monkeypatch.setattr(clocked, "settle_clocks", settle_clocks)
    search = SimpleNamespace(report=lambda _: None, refit=refit, timed=by, setting=None)
    table = partial(free_form, joint="C")
    assert clocked._lasting_on(search, Explanation(found), curve, found, table) is (
        again if stands else found
    )
    assert heard == [(pytest.approx(0.102), 0.0404)]


def followed_again(monkeypatch, lost, fitted):
    """Periods and levels by which paths are sought anew, where fits leave ``fitted``, and ``lost`` fails."""
    curve = sampled(lambda t: np.where(t < 0.07, 20.0, -8.0), 24)[0]
    explanation, sought, left = Explanation(attempt([], 400.0), []), [], list(fitted)

    def made(misfit, values=()):
        one = attempt([FREE_FORM], misfit)
        one.fit.values = np.array([[1e-4, *values, 700.0]])
        explanation.attempts.append(one)
        return one

    def retime(search, explanation, curve, known, force):
        later = force(replace(curve, period=curve.period + 0.01)).apply(SliderCrank(), VALUES).force
        return known, replace(curve, period=later.period)

    def from_(search, explanation, base, held, values, clearance, anew):
        assert (base, len(values), clearance, anew) == (explanation.nominal, 0, 3e-4, True)
        law = held[0].apply(SliderCrank(), values).force
        sought.append((round(law.period, 3), law.values[-1]))
        return None if len(sought) == lost else made(100.0)

    def refit(explanation, held, followers, values, scale, again):
        return made(left.pop(0), values[0, 1:-1] + [1.0, 0.0, 0.0, 0.0, 0.0]) if left else None

    @contextmanager
    def by(rhythm):
        yield

    monkeypatch.setattr(clocked, "retime", retime)
    monkeypatch.setattr(clocked, "rhythm_of", lambda one: None)
    monkeypatch.setattr(clocked, "fit_from", from_)
    monkeypatch.setattr(clocked, "_lasting_on", lambda search, explanation, curve, found, force: found)
    search = SimpleNamespace(late=lambda: False, timed=by, refit=refit)
    known, force = made(200.0), partial(two_levels, values=VALUES)
    known.withdrawn = True
    found = clocked.fit_again(search, explanation, curve, force, VALUES, known, 3e-4)
    stand = [one for one in explanation.attempts if not one.withdrawn]
    assert stand == ([] if found is None else [found])
    return sought, None if found is None else found.misfit


@pytest.mark.parametrize(
    ("lost", "fitted", "sought", "best"),
    [
        (None, [90.0, 30.0, 1.0], [(0.22, 21.0), (0.24, 22.0)], 1.0),  # three looks
        (None, [90.0, 1.9], [(0.22, 21.0)], 1.9),  # paths are not torn any more
        (1, [90.0], [(0.22, 21.0)], 90.0),
        (None, [90.0, 80.0], [(0.22, 21.0)], 90.0),  # that helps little
        (None, [], [], None),
    ],
)
def test_torn_paths_are_sought_anew_by_the_clocks_and_the_values_of_the_last_ones(
    monkeypatch, lost, fitted, sought, best
):
    assert followed_again(monkeypatch, lost, fitted) == (sought, best)
