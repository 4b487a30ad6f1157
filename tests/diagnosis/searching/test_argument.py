"""Of what a force without a name is a function."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM, curve_over
from clearance.diagnosis.searching import argument
from clearance.diagnosis.searching.argument import choose_argument, predicted
from clearance.diagnosis.searching.explanation import Explanation
from clearance.mechanism.applied_force import TabulatedForce
from tests.diagnosis.attempts import attempt


def table(misfit, over, taken, body="slider", direction="x", names=(FREE_FORM,)):
    """An attempt with a table; ``taken`` of what its parameters have fitted of the noise."""
    found, spacing = attempt(list(names), misfit), None if over == "crank_angle" else 0.1
    law = TabulatedForce(body, direction, over, 0.0, spacing, (1.0, 2.0))
    found.model.machine = lambda _: SimpleNamespace(force=law)
    found.fit.values, found.fit.taken = np.zeros((1, 4)), taken
    return found


@pytest.fixture
def tried(monkeypatch):
    """Tables over the crank's angle and the velocity say the same; what was fitted."""
    fitted = []
    monkeypatch.setattr(argument, "optimism", lambda fit: fit.taken)
    others = [curve_over(np.arange(9.0), "slider", "x", one) for one in ("slider_velocity", "crank_angle")]
    monkeypatch.setattr(argument, "_said_otherwise", lambda *_: others)

    def refit(explanation, held, followers, values, scale, again):
        assert again  # though one in this place explains
        fitted.append(len(held[0].unknowns))
        explanation.attempts.append(made[len(fitted) - 1])

    made = [table(1.5, "slider_velocity", 5.0), table(1.009, "crank_angle", 100.0)]
    setting = SimpleNamespace(joint="C")
    search = SimpleNamespace(late=lambda: False, report=lambda _: None, setting=setting, refit=refit)
    return SimpleNamespace(search=search, made=made, fitted=fitted)


@pytest.mark.parametrize(("taken", "better"), [(100.0, "crank_angle"), (300.0, "slider_position")])
def test_the_table_that_predicts_what_it_was_not_fitted_to_stands(tried, taken, better):
    first = table(1.02, "slider_position", 100.0)
    tried.made[1].fit.taken = taken  # the angle fits better than the place, and may have fitted the noise
    explanation = Explanation(attempt([], 40.0), [first])
    choose_argument(tried.search, explanation)
    assert tried.fitted == [12, 12]
    law = explanation.best.model.machine(None).force
    assert law.argument == better
    left = predicted(explanation)
    assert left == pytest.approx({"slider_position": 1.03, "crank_angle": 1.009 + taken / 1e4})
    assert min(left, key=left.get) == better
    assert [one.withdrawn for one in explanation.attempts].count(False) == 2  # and what explains nothing


def test_a_name_that_a_table_has_beaten_does_not_come_back_with_another_table(tried):
    first, name = table(1.02, "slider_position", 300.0), attempt(["guide_friction"], 1.025)
    tried.made[1] = table(1.04, "crank_angle", 1.0)  # would predict better, and costs more than the name
    explanation = Explanation(attempt([], 40.0), [name, first])
    assert explanation.price(first) < explanation.price(name) < explanation.price(tried.made[1])
    choose_argument(tried.search, explanation)
    assert explanation.best is first


@pytest.mark.parametrize(
    "best",
    [
        table(1.02, "time", 1.0),  # a clock
        table(1.02, "closeness_c", 1.0, body="joint_c", direction="damping"),
        table(5.0, "slider_position", 1.0),  # explains nothing
        table(1.02, "slider_position", 1.0, names=(FREE_FORM, "gravity")),
        attempt(["gravity"], 1.0),
    ],
    ids=["clock", "joint", "unexplained", "beside", "name"],
)
def test_other_tables_are_not_asked(tried, best):
    explanation = Explanation(attempt([], 40.0), [best])
    choose_argument(tried.search, explanation)
    assert not tried.fitted
    assert explanation.best is best


def test_arguments_that_cannot_say_the_force_are_not_tried(monkeypatch):
    turn = np.linspace(0.0, 2.0 * np.pi, 500, endpoint=False)
    known = {
        "crank_angle": turn, "slider_position": 0.1 * np.cos(turn), "slider_velocity": -8.0 * np.sin(turn),
        "contact_force": 50.0 + 30.0 * np.sin(3.0 * turn), "time": turn,
    }  # fmt: skip
    monkeypatch.setattr(argument, "arguments_along", lambda *_: known)
    best = table(1.02, "slider_position", 1.0)
    best.fit.passes = [None]
    best.followers = [SimpleNamespace(measured=None)]
    curve = curve_over(known["slider_position"], "slider", "x", "slider_position")
    place = replace(curve, forces=20.0 * np.sin(15.0 * curve.knots))
    search = SimpleNamespace(setting=SimpleNamespace(joint="C"))
    (said,) = argument._said_otherwise(search, best, place)
    assert said.argument == "crank_angle"
    np.testing.assert_allclose(said.shares(turn) @ said.forces, 20.0 * np.sin(1.5 * np.cos(turn)), atol=2.0)
