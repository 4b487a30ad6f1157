"""Following step by step: from a wrong clearance, with few sensors, and where physics is missing."""

import time
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from clearance.diagnosis.following import growth
from clearance.diagnosis.following.attempt import ANNEALING, EXPLAINED, FOLLOWED, explained, refine
from clearance.diagnosis.following.growth import Start, grow, scale_of
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.hypotheses.free_form import Curve, free_form
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.kinematics.agreement import aligned
from clearance.diagnosis.sensing.measured import Measured
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.guide import StribeckGuide
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.recording import Recording
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal, State
from clearance.simulation.trajectory import simulate_trajectory

CHAIN, SETTING = MeasurementChain(), Setting(SliderCrank(), "C")
ROD = (Signal.ROD_B_TRANSVERSE, Signal.ROD_B_AXIAL, Signal.ROD_C_TRANSVERSE, Signal.ROD_C_AXIAL)
PLACE = ("slider", "x", "slider_position")
CLEARANCE, RPM, SETTLED, SECONDS, NOISE = 3e-4, 880.0, 0.3, 0.2, 0.01


@cache
def recorded(setting, clearance, **laws):
    """A noisy recording of the four channels on the rod."""
    machine = replace(setting.with_clearance(clearance), drive=SpeedControl(RPM, ramp=0.05), **laws)
    found = simulate_trajectory(machine, Integrator("runge_kutta_4", 5e-6, 5), SETTLED + SECONDS + 0.02, 2)
    first = round(SETTLED * CHAIN.base_rate)
    values = CHAIN.smooth(found.signals[:, list(ROD)])[first :: CHAIN.decimation]
    values = values[: round(SECONDS * CHAIN.rate)]
    values = values + NOISE * values.std(axis=0) * np.random.default_rng(1).normal(size=values.shape)
    names = tuple(s.name.lower() for s in ROD)
    return Measured.of(Recording(values, names, CHAIN.rate), CHAIN, "one")


@cache
def begun(setting, guess, **laws):
    """Where to begin with a clearance that may be wrong, the model and the values to begin with."""
    measured = recorded(setting, CLEARANCE, **laws)
    machine = setting.with_clearance(guess)
    trace = Trace.of(measured, aligned(measured, machine, (50.0, 150.0)), machine)
    model, values = setting.model(), np.array([guess, trace.speed])
    return Start.of(trace, model.held(values), 0.15), model, values


def test_islands_are_apart_and_the_least_doubtful_comes_first():
    start, model, values = begun(SETTING, CLEARANCE)
    _, places = growth._smoothed(start.trace, model.held(values), 0.15)
    assert len(places) > 3
    assert min(np.diff(sorted(places))) >= growth.ISLAND
    doubts = [one.doubt for one in Start.several(start.trace, model.held(values), 0.15, 3)]
    assert doubts == sorted(doubts)
    assert doubts[0] < FOLLOWED


def test_one_who_is_patient_gives_up_a_false_island_at_the_first_fit(monkeypatch):
    monkeypatch.setattr("clearance.diagnosis.following.horizon.rejoin", lambda *_: False)
    fits = []
    fitted = growth._fitted
    monkeypatch.setattr(growth, "_fitted", lambda *of: fits.append(1) or fitted(*of))
    start, model, values = begun(SETTING, CLEARANCE)
    false = Start(start.trace, start.trace.follower(0.15), start.island, start.doubt)
    false.follower.path.nodes[:, State.CRANK_ANGLE] += 0.2
    assert grow(false, model.only([1], values), values[1:], 1.0, patient=True) is None
    assert len(fits) == 1


@pytest.mark.parametrize("seconds", [0.0, np.inf])
def test_a_lost_path_is_looked_for_while_there_is_time(monkeypatch, seconds):
    looked = []
    monkeypatch.setattr("clearance.diagnosis.following.horizon.rejoin", lambda *_: bool(looked.append(1)))
    start, model, values = begun(SETTING, CLEARANCE)
    grow(start, model, 1.2 * values, patient=True, most=40, until=time.monotonic() + seconds)
    assert bool(looked) == (seconds > 0.0)


def test_a_clearance_that_is_wrong_by_four_per_cent_is_right_at_the_end():
    start, model, values = begun(SETTING, 0.96 * CLEARANCE)
    follower, found, misfit = grow(start, model, values)
    assert follower.segments >= 60
    fitted = refine((), model, [follower], found[None], scale_of(misfit), 8, 1)
    assert explained(fitted)  # but for one impact of many, which rounding may tear
    assert fitted.fit.values[0, 0] == pytest.approx(CLEARANCE, rel=1e-3)


def test_a_model_that_follows_no_better_than_it_must_is_given_up():
    start, model, values = begun(SETTING, CLEARANCE, guide_friction=StribeckGuide(coulomb_force=8.0))
    assert grow(start, model, values, limit=2.0) is None


def test_a_glance_ends_where_it_should_and_leaves_the_start_alone():
    start, model, values = begun(SETTING, 0.96 * CLEARANCE)
    before = start.follower.path.nodes.copy()
    follower, _, _ = grow(start, model, values, most=30)
    assert follower.segments == 30
    np.testing.assert_array_equal(start.follower.path.nodes, before)


@pytest.mark.parametrize(("misfit", "scale"), [(1.0, 1.0), (FOLLOWED * 10.0, 10.0), (1e9, ANNEALING[0])])
def test_the_scale_is_the_smallest_at_which_a_misfit_is_followed(misfit, scale):
    assert scale_of(misfit) == scale


@pytest.mark.slow
def test_a_table_is_found_from_a_poor_guess_and_stays_where_nothing_shows_it():
    knots, forces = np.linspace(0.04, 0.2, 9), 1.0 + 3.0 * np.sin(np.linspace(0.0, np.pi, 9))
    law = TabulatedForce(*PLACE, knots[0], knots[1] - knots[0], tuple(forces))
    start, _, nominal = begun(SETTING, CLEARANCE, force=law)
    model = SETTING.model([free_form(Curve(*PLACE, knots, forces, 0.0 * forces, 1.0, 1.0), "C")])
    right = np.concatenate([nominal[:1], forces, nominal[1:]])
    guess = np.concatenate([nominal[:1], 0.8 * forces, nominal[1:]])
    _, found, misfit = grow(Start.of(start.trace, model.held(right), 0.15), model, guess)
    assert misfit < EXPLAINED
    np.testing.assert_allclose(found[3:8], forces[2:7], atol=0.1)
    # the slider moves between 0.07 and 0.17 m: it never feels the ends of the table
    np.testing.assert_allclose(found[[1, 9]], guess[[1, 9]], atol=1e-6)


def test_without_an_island_it_is_followed_from_where_it_can_be(monkeypatch):
    start, model, values = begun(SETTING, CLEARANCE)
    monkeypatch.setattr(growth, "_smoothed", lambda *_: (start.follower, []))
    other = Start.of(start.trace, model.held(values), 0.15)
    _, _, misfit = grow(other, model, values, most=12)
    assert misfit < EXPLAINED
