"""Where something is missing: the body and the direction."""

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
from clearance.diagnosis.judging.free_form import free_form_of
from clearance.diagnosis.judging.play import clearance_of
from clearance.diagnosis.judging.verdict import (
    Estimate,
    place_of,
    rattling,
    verdict_of,
)
from clearance.diagnosis.judging.words import sentences
from clearance.diagnosis.searching.explanation import Explanation, Suspected, Worked
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.attempts import attempt, known


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
