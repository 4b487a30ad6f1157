"""The table of a force without a name, as the contract writes it, and how sure it is."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.hypotheses.free_form import Curve, free_form, known_force
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.hypotheses.two_levels import two_levels
from clearance.diagnosis.judging.free_form import free_form_of
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.kinematics.shaking import Shaking
from clearance.diagnosis.shooting.fit import Fit
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.mechanism.slider_crank import SliderCrank

WAVE = np.array([1.0, 0.0, -1.0, 0.0])


def torque_table(between):
    """What is said of a torque of unknown level, each difference known to 0.1 sqrt(0.75)."""
    angle = 0.5 * np.pi * np.arange(4)
    curve = Curve("crank", "torque", "crank_angle", angle, WAVE, WAVE, 0.0, 0.0, between)
    hypothesis = free_form(curve, "C")
    unknowns = (Unknown("clearance", 1.0), *hypothesis.unknowns, Unknown("speed", 1.0, own=True))
    contrasts = np.eye(4) - 0.25  # the recordings tell differences alone
    information = np.zeros((6, 6))
    information[0, 0] = information[5, 5] = 1.0
    information[1:5, 1:5] = 100.0 * contrasts
    values = np.array([[3e-4, *(WAVE - 700.0), 700.0]])
    one = SimpleNamespace(parts=np.zeros((5, 6)))
    fit = Fit(Model(unknowns, lambda _: None), values, 0.0, [one], information)
    attempt = Attempt((hypothesis,), fit.model, fit, 1.0, 1.0, [])
    return free_form_of(attempt, Setting(SliderCrank(), "C"))


@pytest.mark.parametrize(("deviation", "band"), [(0.5, 0.98), (np.inf, None)])
def test_a_measured_force_is_as_sure_as_the_recordings_agree_on_it(deviation, band):
    wave = 40.0 * WAVE
    curve = Curve("frame", "x", "time", np.zeros(1), wave, wave, 0.0, 0.0, "linear", 0.06)
    follower = SimpleNamespace(measured=SimpleNamespace(clock=0.02))
    fit = SimpleNamespace(values=np.array([[3e-4, 700.0]]))
    pushed = Attempt(
        (known_force(free_form(curve, "C"), wave),), SimpleNamespace(shared=1), fit, 1.0, 1.0, [follower]
    )
    shaken = Shaking(Rhythm(0.06, (0.02,)), "x", wave, 0.99, deviation)
    found = free_form_of(pushed, Setting(SliderCrank(), "C"), shaken)
    np.testing.assert_allclose(found["table"], np.column_stack([0.015 * np.arange(4), wave]))
    assert (found["body"], found["argument"], found["period"]) == ("frame", "time", 0.06)
    assert found["clocks"] == [0.02]
    expected = [None] * 4 if band is None else pytest.approx(wave - band)
    assert found["low"] == expected


def test_between_two_jumps_a_force_is_as_sure_as_its_level_and_at_a_jump_as_its_time():
    knots = 0.05 * np.arange(4)
    curve = Curve("slider", "x", "time", knots, WAVE, WAVE, 0.0, 0.0, "linear", 0.2)
    values = np.array([20.0, -8.0, 0.1, 0.6, 1 / 48])
    hypothesis = two_levels(curve, values)
    unknowns = (Unknown("clearance", 1.0), *hypothesis.unknowns, Unknown("speed", 1.0, own=True))
    information = np.diag(1.0 / np.array([1.0, 0.1, 0.2, 1e-3, 2e-3, 1e-6, 1.0]) ** 2)
    fit = Fit(
        Model(unknowns, lambda _: None), np.array([[3e-4, *values, 700.0]]), 0.0,
        [SimpleNamespace(parts=np.zeros((5, 7)))], information,
    )  # fmt: skip
    follower = SimpleNamespace(measured=SimpleNamespace(clock=0.02))
    jumping = Attempt((hypothesis,), fit.model, fit, 1.0, 1.0, [follower])
    found = free_form_of(jumping, Setting(SliderCrank(), "C"))
    (time, force), low, high = np.array(found["table"]).T, np.array(found["low"]), np.array(found["high"])
    turns = time / 0.2
    one, other = (turns > 0.12) & (turns < 0.58), (turns > 0.62) & (turns < 1.08)
    assert (one.sum(), other.sum()) == (2, 2)
    assert np.ptp(turns) == pytest.approx(1.0)
    assert force[one] == pytest.approx(20.0)
    assert force[other] == pytest.approx(-8.0)
    assert (high - force)[one] == pytest.approx(1.96 * 0.1, rel=1e-3)
    assert (force - low)[other] == pytest.approx(1.96 * 0.2, rel=1e-3)
    steep = 1.96 * 28.0 * 48 * 1.5  # and of unsure time, half way up a cosine's flank
    assert (high - force)[np.abs(turns - 0.1) < 0.03].max() == pytest.approx(steep * 1e-3, rel=0.05)
    assert (high - force)[np.abs(turns - 0.6) < 0.03].max() == pytest.approx(steep * 2e-3, rel=0.1)


def test_of_a_torque_without_a_name_only_what_varies_is_given():
    found = torque_table("linear")
    np.testing.assert_allclose([force for _, force in found["table"]], WAVE, atol=1e-9)
    np.testing.assert_allclose(np.array(found["high"]) - WAVE, 1.96 * 0.1 * np.sqrt(0.75), rtol=1e-3)


def test_a_spline_is_given_so_closely_that_lines_join_its_points():
    found = torque_table("cubic")
    angle, force = np.array(found["table"]).T
    np.testing.assert_allclose(angle, np.pi / 8.0 * np.arange(16))
    np.testing.assert_allclose(force, np.cos(angle), atol=0.02)
    band = np.array(found["high"]) - force
    np.testing.assert_allclose(band[::4], 1.96 * 0.1 * np.sqrt(0.75), rtol=1e-3)
    assert (band > 0.0).all()


def test_a_torque_that_is_on_and_off_has_no_mean_over_time():
    curve = Curve("crank", "torque", "time", 0.05 * np.arange(4), WAVE, WAVE, 0.0, 0.0, "linear", 0.2)
    values = np.array([20.0, -8.0, 0.1, 0.4, 1 / 48])
    pushed = known_force(two_levels(curve, values), values)
    follower = SimpleNamespace(measured=SimpleNamespace(clock=0.02))
    fit = SimpleNamespace(values=np.array([[3e-4, 700.0]]))
    attempt = Attempt((pushed,), SimpleNamespace(shared=1), fit, 1.0, 1.0, [follower])
    forces = [force for _, force in free_form_of(attempt, Setting(SliderCrank(), "C"))["table"]]
    assert max(forces) == pytest.approx(28.0 * 0.7, abs=0.05)  # on for three tenths of the time
    assert min(forces) == pytest.approx(-28.0 * 0.3, abs=0.05)
