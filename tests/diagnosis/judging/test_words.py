"""A diagnosis in plain words."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.hypotheses.hypothesis import gather
from clearance.diagnosis.judging import words
from clearance.diagnosis.judging.verdict import Estimate
from clearance.diagnosis.judging.words import sentences
from clearance.diagnosis.searching.explanation import Explanation, Suspected, Worked
from clearance.mechanism.guide import StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.attempts import attempt, known


@pytest.mark.parametrize(
    ("gain", "misfit", "after", "headline", "reason"),
    [
        (5.0, 0.97, 1.0, "The recordings are explained to within", "shows a push that the model lacks"),
        (73.0, 0.97, 0.97, "The recordings are explained to within", "gravity(gravity_y) promises more (73)"),
        (5.0, 1.25, 1.0, "The recordings are explained to within", "what is left (1.25) is more"),
        (73.0, 0.97, 3.0, "Something is missing", "(errors 3, floor 1.00)"),
        (74.0, 1.25, 1.0, "The recordings are explained to within", "what is left (1.25) is more"),
    ],
)
def test_what_is_small_and_has_no_name_is_not_called_a_model_that_fails(
    monkeypatch, gain, misfit, after, headline, reason
):
    known(monkeypatch, lambda _: [Estimate(3e-4, 3e-4, 3e-4)])
    nominal = attempt([], misfit)
    nominal.fit.values = np.array([[3e-4, 700.0]])
    effect = SimpleNamespace(body="rod", direction="y")
    hint = SimpleNamespace(label="gravity(gravity_y)", gain=gain, hypotheses=[effect])
    fit = {"held_out": {"before": after, "after": after}}
    explanation = Explanation(nominal, hints=[hint], shaken=SimpleNamespace())
    if gain == 74.0:  # as on its own simulations
        explanation.simulated = np.full(19, 100.0)
    told = sentences("unknown", explanation, "C", fit, ["rod_c_axial"])
    assert told[0].startswith(headline)
    assert reason in told[0]
    assert "What comes nearest is a force on the rod, along y." in told[1]


@pytest.mark.parametrize(
    ("effect", "parameter", "value", "expected"),
    [
        ("slider_offset", "offset", (-6.353e-3, -6.36e-3, -6.346e-3), "-6.353 (-6.360 to -6.346) mm"),
        ("second_clearance", "clearance", (8.3e-5, 8.2e-5, 8.4e-5), "83 (82 to 84) µm"),
        ("timebase", "rate_error", (0.04678, 0.0467, 0.0469), "4.68 (4.67 to 4.69) %"),
        ("worn_bearing", "order", (3.0, 3.0, 3.0), "3"),
        ("rod_inertia", "inertia_ratio", (1.00861, 1.00736, 1.00987), "1.009 (1.007 to 1.010)"),
        ("rod_inertia", "mass_ratio", (1.05, 1.0499996, 1.0500004), "1.0500000 (1.0499996 to 1.0500004)"),
        ("restitution", "restitution", (0.696, 0.05, 0.798), "0.7 (0.05 to 0.8)"),
        ("gravity", "gravity_y", (0.01, -0.4, 0.4), "0.01 (-0.4 to 0.4) m/s^2"),
        ("flexible_base", "mass", (1556.0, 0.5, 3280.0), "1556 (0.5 to 3280) kg"),
        ("contact_stiffness", "stiffness_scale", (2e5, 1e5, 4e5), "2e+05 (1e+05 to 4e+05)"),
        ("joint_lubrication", "damping", (1.0, 0.5, np.inf), "1 (0.5 to inf) N s/m"),
        ("sensor_misalignment", "angle", (5.7, 5.5, 5.9), "5.7° (5.5 to 5.9)"),
    ],
)
def test_a_number_has_its_unit_once(effect, parameter, value, expected):
    (one,) = load_effects([effect], [])
    assert one.parameter(parameter).text(*value) == expected


@pytest.mark.parametrize(("misfit", "told"), [(25.0, True), (1.0, False)])
def test_beside_a_table_that_explains_little_the_balance_says_where_it_acts(monkeypatch, misfit, told):
    table, nominal = attempt([FREE_FORM], misfit), attempt([], 60.0)
    for one in (nominal, table):
        one.fit.values = np.array([[3e-4, 700.0]])
    monkeypatch.setattr(words, "_free_force", lambda *_: "A table.")
    known(monkeypatch, lambda a: [Estimate(3e-4, 3e-4, 3e-4)] * 2)
    explanation = Explanation(nominal, [table], worked=Worked("slider", "x", 0.29))
    held = {"held_out": {"before": 2.0, "after": 1.9}}
    said = sentences("unknown", explanation, "C", held, ["rod_b_axial"])
    assert said[0] == "A table."
    assert ("all but 29%" in " ".join(said)) == told


@pytest.mark.parametrize(
    ("misfit", "held_out", "expected"),
    [
        (54.0, None, "explains a part of the recordings"),
        (12.0, None, "explains most of the recordings"),
        (1.0, 1.0, "explains the recordings"),
        (1.0, 20.0, "explains the recordings that were fitted, not those that were held out"),
    ],
)
def test_of_a_table_it_is_said_how_much_it_explains(monkeypatch, misfit, held_out, expected):
    table, nominal = attempt([FREE_FORM], misfit), attempt([], 60.0)
    nominal.model.machine = lambda _: None
    for one in (nominal, table):
        one.fit.values = np.array([[3e-4, 700.0]])
    (curve,) = table.hypotheses
    curve.body, curve.direction, curve.start = "crank", "torque", None
    curve.apply = lambda *_: SimpleNamespace(force=None)
    known(monkeypatch, lambda a: [Estimate(3e-4, 3e-4, 3e-4)] * 2)
    explanation = Explanation(nominal, [table], suspected=Suspected("slider", "x", 3.0))
    held = {"held_out": {"before": 2.0, "after": 1.9}}
    beside = None if held_out is None else attempt([FREE_FORM], held_out)
    said = sentences("unknown", explanation, "C", held, ["rod_b_axial"], beside)
    assert expected in said[0]
    assert ("a force on the slider, along x comes nearer" in " ".join(said)) == (misfit > 1.35)


@pytest.mark.parametrize("rattles", [0.4, np.inf])
def test_rails_between_which_no_machine_is_followed_are_told(monkeypatch, rattles):
    nominal = attempt([], 60.0)
    nominal.fit.values = np.array([[3e-4, 700.0]])
    known(monkeypatch, lambda a: [Estimate(3e-4, 3e-4, 3e-4)])
    explanation = Explanation(nominal, suspected=Suspected("rod", "moment", 3.0), rattles=rattles)
    held = {"held_out": {"before": 2.0, "after": 1.9}}
    said = " ".join(sentences("unknown", explanation, "C", held, ["rod_b_axial"], None))
    assert ("as if between rails" in said) == ("a force on the slider, along y" in said) == (rattles < 1.0)
    assert ("a moment on the rod" in said) == (rattles > 1.0)


def test_what_shows_in_the_fitted_recordings_alone_is_told_by_their_errors(monkeypatch):
    nominal = attempt([], 50.0)
    nominal.fit.values = np.array([[3e-4, 700.0]])
    known(monkeypatch, lambda _: [Estimate(3e-4, 3e-4, 3e-4)])
    fit = {"held_out": {"before": 1.0, "after": 1.0}}
    told = sentences("unknown", Explanation(nominal), "C", fit, ["rod_c_axial"])
    assert "errors are 7.07 times those of a perfect one, where it was fitted." in told[0]


@pytest.mark.parametrize(
    ("after", "gain", "told"),
    [
        (1.0, 247.0, "impacts included, those recordings are likelier with it (log-likelihood +247)"),
        (1.0, 2.0, "It does not help on held-out recordings"),
        (1.3, 247.0, "It does not help on held-out recordings"),
    ],
)
def test_what_shows_in_impacts_alone_is_told_as_that(monkeypatch, after, gain, told):
    best, nominal = attempt(["contact_stiffness"], 0.98), attempt([], 1.0)
    for one in (nominal, best):
        one.fit.values = np.array([[3e-4, 700.0]])
    known(monkeypatch, lambda a: [Estimate(3e-4, 3e-4, 3e-4)] * 2)
    held = {"held_out": {"before": 1.0, "after": after, "log_likelihood_gain": gain}}
    said = sentences("physics", Explanation(nominal, [best]), "C", held, ["rod_b_axial"])
    assert told in said[-1]


def test_of_a_law_that_the_model_has_its_own_number_is_told(monkeypatch):
    def told(**laws):
        machine = SliderCrank(joint_c=Joint(3e-4), **laws)
        (group,) = [
            held
            for held in gather(load_effects("guide_friction"), machine, "C", ()).values()
            if [unknown.name for unknown in held[0].unknowns] == ["coulomb_force"]
        ]
        one = attempt(["guide_friction"], 1.0)
        one.hypotheses = (group[0],)
        known(monkeypatch, lambda _: [Estimate(3e-4, 3e-4, 3e-4), Estimate(1.0, 0.9, 1.1)])
        (line,) = words._effects(Explanation(attempt([], 9.0), [one]), "C")
        return line

    assert told().endswith("1.0 (0.9 to 1.1) N of Coulomb friction.")
    own = told(guide_friction=StribeckGuide(coulomb_force=3.0))
    assert own.endswith("This is in the place of the model's own: 3 N (coulomb_force).")
