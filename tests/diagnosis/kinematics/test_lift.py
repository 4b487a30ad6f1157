"""A slider between rails: against a bounce in closed form, and against the simulator's own states."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.kinematics.agreement import profile
from clearance.diagnosis.kinematics.lift import Across, gaps, lift, measure_gap, suggest_gap
from clearance.diagnosis.kinematics.reconstruction import reconstruct
from clearance.mechanism.guide import LooseGuide
from clearance.simulation.layout import Signal, State
from tests.diagnosis.kinematics import test_reconstruction as own

GAP, STIFFNESS, MASS, PERIOD = 8e-5, 1e7, 0.15, 1e-4
FLIGHT, HALF_STRIKE = 40, 2  # samples


def bounce(gap, count):
    """Height, rate and acceleration of a slider that flies at one speed and turns around at the rails."""
    acceleration, side, speed = np.zeros(count), 1.0, 2.0 * gap / (FLIGHT * PERIOD)
    shape = np.hanning(2 * HALF_STRIKE + 1)
    shape *= 2.0 * speed / (shape.sum() * PERIOD)
    for at in range(FLIGHT // 2, count - HALF_STRIKE, FLIGHT):
        acceleration[at - HALF_STRIKE : at + HALF_STRIKE + 1] -= side * shape
        side = -side
    rate = speed + np.concatenate([[0.0], np.cumsum(acceleration[1:] + acceleration[:-1])]) * PERIOD / 2.0
    height = np.concatenate([[0.0], np.cumsum(rate[1:] + rate[:-1])]) * PERIOD / 2.0
    return height - 0.5 * (height.max() + height.min()), rate, acceleration


def seen(acceleration, noise=0.01):
    sigma = noise * acceleration.std()
    values = acceleration + sigma * np.random.default_rng(3).normal(size=acceleration.shape)
    return Across.own(values, MASS * values, sigma)


def test_a_bounce_between_rails_is_followed():
    height, rate, acceleration = bounce(GAP, 2000)
    reach = np.abs(height).max()
    found = lift(seen(acceleration), reach, STIFFNESS, PERIOD)
    inside = slice(50, -50)
    assert np.median(np.abs(found.height - height)[inside]) < 0.2 * reach
    assert np.median(np.abs(found.rate - rate)[inside]) < 0.05 * np.abs(rate).max()
    assert found.beyond < 0.01
    assert found.astray < 0.02


@pytest.mark.parametrize("gap", [2e-5, 8e-5, 3e-4])
def test_the_gap_is_told_by_the_slider_s_acceleration(gap):
    height, _, acceleration = bounce(gap, 6000)
    reach = np.abs(height).max()
    assert suggest_gap(seen(acceleration), STIFFNESS, PERIOD) == pytest.approx(reach, rel=0.15)


@pytest.mark.parametrize("noise", [0.01, 0.05])
@pytest.mark.parametrize("start", [0.7, 1.4])
def test_the_gap_is_measured_by_what_lies_between_the_rails(noise, start):
    height, _, acceleration = bounce(GAP, 3000)
    gap, deviation = measure_gap(seen(acceleration, noise), start * GAP, PERIOD)
    assert gap == pytest.approx(np.abs(height).max(), abs=min(2.0 * deviation, 0.1 * gap))
    assert deviation < 0.2 * gap


def test_a_slider_that_swings_with_its_frame_shows_no_rails():
    # a spring holds it: the force is opposite to the height, as with rails, but grows with it; turn the sign
    time = PERIOD * np.arange(2000)
    acceleration = 30.0 * np.sin(2.0 * np.pi * 40.0 * time)
    swings = seen(acceleration)
    assert suggest_gap(replace(swings, push=-swings.push), STIFFNESS, PERIOD) is None


def test_a_motion_that_is_lost_somewhere_does_not_speak_against_rails_which_another_one_shows():
    _, _, acceleration = bounce(GAP, 6000)
    sound, time = seen(acceleration), PERIOD * np.arange(6000)
    lost = acceleration.copy()
    lost[3000:3060] += 0.05 * acceleration.max()
    lost = replace(sound, acceleration=seen(lost).acceleration)
    swings = seen(30.0 * np.sin(2.0 * np.pi * 40.0 * time))
    swings = replace(swings, push=-swings.push)
    gap = suggest_gap(sound, STIFFNESS, PERIOD)
    assert gaps([lost, sound], STIFFNESS, PERIOD) == [gap]
    assert gaps([lost], STIFFNESS, PERIOD) == []
    assert gaps([sound, swings], STIFFNESS, PERIOD) == []


def test_a_slider_is_followed_by_a_sensor_that_moves_against_it():
    """What is aside of it is known but for some stretches, over which it flies on."""
    height, _, acceleration = bounce(GAP, 2000)
    reach, time = np.abs(height).max(), PERIOD * np.arange(2000)
    swing = 2.0 * np.pi * 35.0
    aside = 2e-4 * np.stack(
        [np.sin(swing * time), swing * np.cos(swing * time), -(swing**2) * np.sin(swing * time)]
    )
    told = np.arange(2000) % 100 > 10
    own = seen(acceleration)
    across = Across(own.acceleration + aside[2], own.push, own.doubt, np.where(told, aside, 0.0), told)
    across.aside[2] = aside[2]
    found = lift(across, reach, STIFFNESS, PERIOD)
    inside = slice(50, -50)
    assert np.median(np.abs(found.height - height)[inside]) < 0.2 * reach
    assert np.abs(found.height).max() < 1.2 * reach
    assert found.astray < 0.02
    gap, deviation = measure_gap(across, 1.3 * GAP, PERIOD)
    assert gap == pytest.approx(reach, abs=min(2.0 * deviation, 0.1 * gap))


@pytest.mark.parametrize("gap", [3e-5, pytest.param(7e-5, marks=pytest.mark.slow)])
def test_the_motion_tells_the_clearance_though_the_slider_leaves_its_line(monkeypatch, gap):
    monkeypatch.setattr(own, "SENSORS", (*own.SENSORS, Signal.SLIDER_VERTICAL))
    guide = LooseGuide(gap=gap)
    made = own.machine("C", 1e-4, guide=guide)
    measured, states = own.recorded(made)
    known = own.aligned(states)
    found = reconstruct(measured, made.parameters(), ("C",), known.speed, known.angle)
    miss = np.abs(found.nodes[:, State.SLIDER_Y] - states[:: own.SAMPLES, State.SLIDER_Y])[5:-5]
    assert np.median(miss) < 0.15 * gap
    with_guide = profile([measured], [known], lambda c: own.machine("C", c, guide=guide), 2)
    without = profile([measured], [known], lambda c: own.machine("C", c), 2)
    assert with_guide.best == pytest.approx(1e-4, rel=0.05)
    assert without.best > 1.2e-4
    assert with_guide.misfit.min() < 0.6 * without.misfit.min()


def test_a_gap_that_no_sensor_feels_is_not_looked_for(monkeypatch):
    monkeypatch.setattr(own, "SENSORS", (Signal.CRANK_B_TRANSVERSE, Signal.CRANK_B_AXIAL, Signal.ROD_B_AXIAL))
    made = replace(own.machine("C", 2e-4), guide=LooseGuide(gap=2e-5))
    measured, states = own.recorded(made)
    known = own.aligned(states)
    found = reconstruct(measured, made.parameters(), ("C",), known.speed, known.angle)
    assert found.across is None
    assert found.carried is None


def test_where_c_is_ideal_the_rod_s_sensors_feel_how_the_slider_moves_across_its_guide(monkeypatch):
    made = own.machine("B", 1e-4, guide=LooseGuide(gap=7e-5))
    across = {}
    for sensors in (own.SENSORS, (*own.SENSORS, Signal.SLIDER_VERTICAL)):
        monkeypatch.setattr(own, "SENSORS", sensors)
        measured, states = own.recorded(made)
        known = own.aligned(states)
        across[len(sensors)] = reconstruct(
            measured, made.parameters(), ("B",), known.speed, known.angle
        ).across.slider[50:-50]
    without, own_sensor = across.values()
    assert np.corrcoef(without, own_sensor)[0, 1] > 0.95
    assert without.std() == pytest.approx(own_sensor.std(), rel=0.1)


def test_a_motion_that_no_linkage_makes_is_refused():
    _, _, acceleration = bounce(GAP, 200)
    acceleration[100] = np.nan
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        lift(Across.own(acceleration, acceleration, 1.0), GAP, STIFFNESS, PERIOD)


def test_a_guide_without_free_travel_leaves_the_slider_on_its_line(monkeypatch):
    monkeypatch.setattr(own, "SENSORS", (*own.SENSORS, Signal.SLIDER_VERTICAL))
    made = own.machine("C", 1e-4, guide=LooseGuide(gap=0.0))
    measured, states = own.recorded(made)
    known = own.aligned(states)
    found = reconstruct(measured, made.parameters(), ("C",), known.speed, known.angle, 600)
    assert np.isfinite(found.nodes).all()
    assert np.abs(found.nodes[:, State.SLIDER_Y]).max() < 2e-5
