"""The search for an explanation: what is small, and what has no name."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following.attempt import EXPLAINED, explained, whole
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.free_form import (
    CLOSEST,
    DAMPING,
    FREE_FORM,
    KNOTS,
    Curve,
    curve_over,
    unnamed,
)
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.hypotheses.missing_force import as_function_of
from clearance.diagnosis.judging.verdict import equivalents, estimates
from clearance.diagnosis.searching.argument import choose_argument
from clearance.diagnosis.searching.beside import FAR, beside
from clearance.diagnosis.searching.elsewhere import begin_inside, begin_plausible
from clearance.diagnosis.searching.everywhere import astray
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.free_search import fit_curve, suggest_curve
from clearance.diagnosis.searching.location import locate_joint
from clearance.diagnosis.searching.screening import Hint, _Column, _range
from clearance.diagnosis.searching.scrutiny import _begun, contest, scrutinise
from clearance.diagnosis.searching.significance import unsettled
from clearance.diagnosis.searching.small_force import begin_small_force
from clearance.diagnosis.searching.torn import rejoin_impacts
from clearance.diagnosis.sensing.measured import Measured
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.film import SqueezeFilm
from clearance.mechanism.friction import Coulomb
from clearance.mechanism.guide import StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.load import LinearSpring
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.recording import Recording
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal
from clearance.simulation.trajectory import simulate_trajectory

CHAIN, SETTING = MeasurementChain(), Setting(SliderCrank(), "C")
RPM, SETTLED, SECONDS, NOISE = 700.0, 0.3, 0.25, 0.01
SPEEDS = (50.0, 150.0)


@cache
def recorded(clearance, **laws):
    """A short recording of a machine with clearance in joint C that has these laws beside."""
    joint = Joint(clearance, **({"contact": laws.pop("contact")} if "contact" in laws else {}))
    return measured(replace(SETTING.machine, joint_c=joint, drive=SpeedControl(RPM, ramp=0.05), **laws))


def measured(machine):
    """A short recording of a machine."""
    channels = tuple(ACCELERATIONS)
    signals = [int(Signal[name.upper()]) for name in channels]
    found = simulate_trajectory(machine, Integrator("runge_kutta_4", 5e-6, 5), SETTLED + SECONDS + 0.02, 2)
    first = round(SETTLED * CHAIN.base_rate)
    values = CHAIN.smooth(found.signals[:, signals])[first :: CHAIN.decimation][: round(SECONDS * CHAIN.rate)]
    values = values + NOISE * values.std(axis=0) * np.random.default_rng(3).normal(size=values.shape)
    return Measured.of(Recording(values, channels, CHAIN.rate), CHAIN, "one")


@cache
def search(clearance, names, **laws):
    """A search after its nominal stage, with its explanation, for a machine that has these laws beside."""
    effects = load_effects(list(names), [])
    found, explanation, _ = locate_joint(
        [recorded(clearance, **laws)], [SETTING], effects, SPEEDS, 1, lambda _: None
    )
    return found, explanation


@cache
def within(clearance, names, **joint):
    """The same for a machine whose joint C has these laws."""
    made = replace(SETTING.machine, joint_c=Joint(clearance, **joint), drive=SpeedControl(RPM, ramp=0.05))
    effects = load_effects(list(names), [])
    found, explanation, _ = locate_joint([measured(made)], [SETTING], effects, SPEEDS, 1, lambda _: None)
    return found, explanation


@pytest.mark.slow
def test_an_unknown_joint_is_found():
    settings = [Setting(SliderCrank(), joint) for joint in "BC"]
    found, explanation, tried = locate_joint([recorded(2e-4)], settings, [], SPEEDS, 1, lambda _: None)
    assert found.setting.joint == "C"
    assert explained(explanation.nominal)
    assert "C" in tried
    assert explanation.nominal.fit.values[0, 0] == pytest.approx(2e-4, rel=5e-3)


STIFF = ("contact_stiffness", "joint_lubrication", "gravity", "sensor_gain")


@pytest.mark.slow
def test_what_explains_is_looked_beside_once_more():
    found, explanation = search(1e-4, STIFF, contact=replace(Joint().contact, stiffness_scale=0.5))
    assert explained(explanation.nominal), "softer contact hides in the clearance"
    found.most = 2
    scrutinise(found, explanation)
    assert [h.name for h in explanation.best.hypotheses] == ["contact_stiffness"]
    clearance, stiffness = estimates(explanation.best)
    assert stiffness.value == pytest.approx(0.5, rel=0.12)
    assert stiffness.high < 0.8
    assert clearance.value == pytest.approx(1e-4, rel=2e-3)


@pytest.mark.slow
def test_what_changes_impacts_alone_shows_where_they_are_torn():
    names = ("restitution", "contact_stiffness", "joint_lubrication", "gravity")
    found, explanation = search(6e-4, names, contact=replace(Joint().contact, restitution=0.6))
    nominal = explanation.nominal
    assert explained(nominal), "one impact is torn, the rest follows"
    assert not whole(nominal)
    best = rejoin_impacts(found, nominal)[0]
    assert best.label == "restitution(restitution)"
    assert best.values[0] == pytest.approx(0.6, abs=0.02)
    found.most = 1
    scrutinise(found, explanation)
    assert explanation.best.label == best.label
    assert estimates(explanation.best)[1].value == pytest.approx(0.6, abs=0.01)


@pytest.mark.slow
def test_a_sensor_that_stops_at_a_limit_is_known_before_the_machine_is():
    whole = recorded(2e-4)
    values, place = whole.recorded.copy(), whole.channels.index("rod_b_axial")
    size = 0.6 * np.abs(values[:, place]).max()
    values[:, place] = np.clip(values[:, place], -size, size)
    clipped = Measured.of(Recording(values, whole.channels, CHAIN.rate), CHAIN, "one")
    assert clipped.clipped[..., place].mean() > 0.1
    effects = load_effects(["sensor_saturation", "gravity"], [])
    _, explanation, _ = locate_joint([clipped], [SETTING], effects, SPEEDS, 1, lambda _: None)
    best = explanation.best
    assert [(h.name, h.channel) for h in best.hypotheses] == [("sensor_saturation", "rod_b_axial")]
    assert explained(best)
    assert best.misfit < 0.8 * explanation.nominal.misfit
    found, limit = estimates(best)
    assert limit.low < size < limit.high < 1.001 * size
    assert found.value == pytest.approx(2e-4, rel=5e-3)


@pytest.mark.slow
def test_where_nothing_is_missing_nothing_small_is_found():
    found, explanation = search(1e-4, STIFF)
    found.most = 2
    scrutinise(found, explanation)
    assert explained(explanation.nominal)
    assert not explanation.attempts


@pytest.mark.slow
def test_a_force_without_a_name_is_found_on_its_body_with_its_argument():
    knots, forces = np.linspace(0.065, 0.175, 12), 8.0 * np.sin(np.linspace(0.0, np.pi, 12)) ** 2
    law = TabulatedForce("slider", "x", "slider_position", knots[0], knots[1] - knots[0], tuple(forces))
    found, explanation = search(1.5e-4, ("gravity",), force=law)
    assert not explained(explanation.nominal)
    suggested, misfit = suggest_curve(found, explanation.nominal)
    assert misfit < 0.5 * explanation.nominal.misfit
    fit_curve(found, explanation, suggested)
    choose_argument(found, explanation)  # the crank's angle can say all of the place
    best = explanation.best
    (hypothesis,) = best.hypotheses
    assert (hypothesis.name, hypothesis.body, hypothesis.direction) == (FREE_FORM, "slider", "x")
    curve = hypothesis.apply(SETTING.machine, best.fit.values[0, 1:-1]).force
    assert isinstance(curve, TabulatedForce)
    assert curve.argument == "slider_position"
    places = curve.start + curve.spacing * np.arange(len(curve.values))
    assert np.corrcoef(curve.values, np.interp(places, knots, forces))[0, 1] > 0.95
    assert best.fit.values[0, 0] == pytest.approx(1.5e-4, rel=5e-3)


@pytest.mark.slow
def test_friction_without_a_name_is_a_line_over_its_joints_force():
    found, explanation = within(3e-4, ("gravity",), friction=Coulomb(0.2))
    explanation = Explanation(explanation.nominal, agreed=explanation.agreed)
    begin_inside(found, explanation, explanation.nominal)
    best = explanation.best
    assert explained(best)
    (hypothesis,) = best.hypotheses
    assert (hypothesis.body, hypothesis.direction) == ("joint_c", "tangential")
    law = hypothesis.apply(SETTING.machine, best.fit.values[0, 1:-1]).force
    assert isinstance(law, TabulatedForce)
    assert law.argument == "force_c"
    assert np.diff(law.values) / law.spacing == pytest.approx([0.2], rel=0.1)


@pytest.mark.slow
def test_little_friction_without_a_name_is_found_beside_a_machine_that_follows():
    found, explanation = within(3e-4, ("gravity",), friction=Coulomb(0.002))
    explanation = Explanation(explanation.nominal)
    assert explained(explanation.nominal)
    assert unsettled(explanation)
    begin_small_force(found, explanation)
    (hypothesis,) = explanation.best.hypotheses
    assert (hypothesis.body, hypothesis.direction) == ("joint_c", "tangential")
    assert not unsettled(explanation)


@pytest.mark.slow
def test_a_named_force_that_is_right_stands_against_a_table():
    found, explanation = search(1.5e-4, ("slider_spring",), spring=LinearSpring(300.0, 0.11))
    nominal = explanation.nominal
    (hypothesis, *_) = found.groups["slider_spring(stiffness, free_position)"]
    values = np.array([300.0, 0.11])
    held, rows = beside(nominal, [hypothesis], values)
    named = found.keep(explanation, held, lambda: found.follow_anew(held, nominal, rows, np.inf))
    assert explained(named)
    contest(found, explanation)
    assert any(unnamed(a.hypotheses) is not None for a in explanation.attempts), "a table was tried"
    assert explanation.best.label == named.label
    assert equivalents(explanation) == [explanation.best]


def test_a_small_effect_begins_where_it_has_hardly_begun():
    effects = load_effects(["contact_stiffness", "torque_ripple"], [])
    groups = gather(effects, SETTING.with_clearance(3e-4), "C", ())
    stiffness, ripple = (next(g[0] for g in groups.values() if g[0].name == e.name) for e in effects)
    assert _begun(Hint((stiffness,), np.array([0.1]), 1.0)) == pytest.approx([0.991])
    begun = _begun(Hint((ripple,), np.array([2.0, 3.0, 0.7]), 1.0))
    np.testing.assert_allclose(begun, [0.02, 3.0, 0.7])


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_force_that_rests_or_jumps_is_a_function_of_what_it_depends_on(noise):
    angle = np.linspace(0.0, 8.5, 150)
    place, velocity = 0.05 * np.cos(angle), -3.0 * np.sin(angle)
    shaken = noise * np.random.default_rng(4).normal(size=len(angle))
    for force, values, argument in (
        (-4.0 * np.sign(velocity), velocity, "slider_velocity"),
        (np.where(place > 0.02, -9.0, 0.0), place, "slider_position"),
        (np.minimum(0.03 - place, 0.0) * 400.0, place, "slider_position"),
    ):
        _, left = as_function_of(force + shaken, values, curve_over(values, "slider", "x", argument))
        assert left < 0.2
    _, left = as_function_of(np.zeros(150), place, curve_over(place, "slider", "x", "slider_position"))
    assert left == 0.0


def test_a_force_is_written_as_a_function_of_what_it_depends_on():
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    velocity, position = -3.0 * np.sin(angle), 0.05 * np.cos(angle)
    drag = -velocity * np.abs(velocity)
    wide = curve_over(1.3 * velocity, "slider", "x", "slider_velocity")
    found, left = as_function_of(drag, velocity, wide)
    inside = np.abs(found.knots) < 3.0
    np.testing.assert_allclose(found.forces[inside], -(found.knots * np.abs(found.knots))[inside], atol=0.5)
    assert left < 0.01
    assert found.forces[0] > found.forces[1] > found.forces[2], "it goes on straight beyond the path"
    assert as_function_of(drag, position, curve_over(position, "slider", "x", "slider_position"))[1] > 0.9


@pytest.mark.slow
def test_a_film_is_found_where_it_makes_the_gap_look_small():
    found, explanation = within(7e-4, ("joint_lubrication",), film=SqueezeFilm(damping=1.0))
    assert explanation.nominal.fit.values[0, 0] < 0.7 * found.profile.best
    begin_inside(found, explanation, explanation.nominal)
    assert explained(explanation.best)
    clearance, damping, _ = explanation.best.fit.values[0]
    assert clearance == pytest.approx(7e-4, rel=0.01)
    assert damping == pytest.approx(1.0, rel=0.05)


@pytest.mark.slow
def test_a_film_is_found_where_the_gap_looks_right_and_the_path_is_near():
    found, explanation = within(1.2e-4, ("joint_lubrication",), film=SqueezeFilm(damping=0.3))
    nominal = explanation.nominal
    assert not astray(nominal.fit.values[0, 0], found.profile.best)
    assert EXPLAINED < nominal.misfit < FAR
    begin_inside(found, explanation, explanation.nominal)
    assert explained(explanation.best)
    clearance, damping, _ = explanation.best.fit.values[0]
    assert clearance == pytest.approx(1.2e-4, rel=0.01)
    assert damping == pytest.approx(0.3, rel=0.05)


@pytest.mark.slow
def test_a_thin_film_is_found_from_a_size_near_its_own():
    found, explanation = within(4e-4, ("joint_lubrication",), film=SqueezeFilm(damping=0.011))
    begin_inside(found, explanation, explanation.nominal)
    assert explained(explanation.best)
    clearance, damping, _ = explanation.best.fit.values[0]
    assert clearance == pytest.approx(4e-4, rel=0.01)
    assert damping == pytest.approx(0.011, rel=0.05)


@pytest.mark.slow
def test_a_film_without_its_name_is_a_table_over_the_journals_closeness():
    found, explanation = within(7e-4, ("restitution",), film=SqueezeFilm(damping=1.0))
    begin_inside(found, explanation, explanation.nominal)
    best = explanation.best
    assert explained(best)
    assert best.hypotheses[0].direction == DAMPING
    assert best.fit.values[0, 0] == pytest.approx(7e-4, rel=0.01)
    assert best.fit.values[0, KNOTS] == pytest.approx(np.exp(1.5 * CLOSEST), rel=0.1)  # where it lies


@pytest.mark.slow
def test_a_film_is_not_tried_where_the_motion_agrees():
    found, explanation = search(3e-4, ("joint_lubrication",))
    begin_inside(found, explanation, explanation.nominal)
    assert explanation.attempts == []


@pytest.mark.slow
def test_what_promises_little_beside_a_bad_path_is_tried_from_a_plausible_size():
    names, friction = ("guide_friction", "restitution"), StribeckGuide(coulomb_force=6.0)
    found, explanation = search(5e-4, names, guide_friction=friction)
    assert explanation.nominal.misfit > FAR
    begin_plausible(found, explanation, explanation.nominal)
    assert explanation.best.label == "guide_friction(coulomb_force)"
    assert explanation.best.fit.values[0, 1] == pytest.approx(6.0, rel=0.01)


@pytest.mark.parametrize("name", ["contact_stiffness", "rod_inertia"])
def test_a_linear_look_begins_what_counts_by_ratios_as_far_down_as_up(name):
    groups = gather(load_effects([name], []), SETTING.with_clearance(1e-4), "C", ())
    one = next(g[0] for g in groups.values() if len(g[0].unknowns) == 1 and g[0].unknowns[0].log)
    low, high = _range(_Column(one, 0, 1.0, None, None))
    assert (one.off[0] + low) * (one.off[0] + high) == pytest.approx(one.off[0] ** 2)
    assert one.unknowns[0].low < 0.5 * (one.off[0] + low)


def test_each_table_is_refined_from_its_own_forces():
    """The second of two curves, after the first was given more knots than it has itself."""
    knots = np.linspace(0.0, 1.0, 12)
    two = [Curve("slider", "x", "time", knots, k * (1.0 + knots), np.ones(12), 1.0, 1.0) for k in (1.0, 2.0)]
    refitted = []

    def keep(explanation, held, make):
        row = [1e-4, *held[0].start, RPM]
        found = SimpleNamespace(fit=SimpleNamespace(values=np.array([row])), followers=[])
        return SimpleNamespace(**vars(found), misfit=5.0, scale=1.0, level=5.0)

    def refit(explanation, held, followers, values, scale, again):
        refitted.append(values[0, 1:-1])
        explanation.best = SimpleNamespace(hypotheses=held, scale=1.0, level=3.0)

    stub = SimpleNamespace(
        setting=SETTING,
        traces=[SimpleNamespace(speed=RPM)],
        report=lambda _: None,
        keep=keep,
        refit=refit,
        late=lambda: False,
    )
    nominal = SimpleNamespace(
        misfit=100.0, scale=10.0, level=1.0, fit=SimpleNamespace(values=np.ones((1, 2)))
    )
    fit_curve(stub, SimpleNamespace(nominal=nominal, best=nominal), two)
    for k, forces in zip((1.0, 1.0, 2.0, 2.0), refitted, strict=True):  # as a spline, then as lines
        np.testing.assert_allclose(forces, k * np.linspace(1.0, 2.0, 23))


def test_each_recording_has_a_misfit_of_its_own():
    _, explanation = search(3e-4, ("joint_lubrication",))
    assert explanation.nominal.misfits == [explanation.nominal.misfit]
