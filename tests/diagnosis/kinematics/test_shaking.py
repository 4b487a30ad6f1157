"""A frame that moves: what is felt against it, and on what it stands."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.kinematics import shaking
from clearance.diagnosis.kinematics.agreement import profile
from clearance.diagnosis.kinematics.reconstruction import _steadied
from clearance.diagnosis.kinematics.shaking import find_shaking, measure_frame, shakes
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.guide import LooseGuide
from clearance.simulation.layout import Result, Signal, State
from tests.diagnosis.kinematics.test_reconstruction import CHAIN, SENSORS, aligned, machine, recorded, run

SOFT = FlexibleFrame(25.0, 0.03, 15.0)
AT_A = (Signal.CRANK_A_TRANSVERSE, Signal.CRANK_A_AXIAL)


@pytest.mark.parametrize(("shaking", "gravity", "bias"), [(0.0, 9.81, 5.0), (2.0, 0.0, 0.0)])
def test_gravity_and_bias_do_not_shake_the_frame(shaking, gravity, bias):
    rng, rate, speed, sigma = np.random.default_rng(4), 1e4, 80.0, 0.1
    turned = 0.3 + speed * np.arange(4000) / rate
    x = shaking * np.sin(2.0 * np.pi * 25.0 * np.arange(4000) / rate)
    axial = (x * np.cos(turned) + gravity * np.sin(turned)) + bias
    across = (-x * np.sin(turned) + gravity * np.cos(turned)) - bias
    values = np.stack([axial, across], axis=1) + sigma * rng.normal(size=(4000, 2))
    measured = SimpleNamespace(
        channels=("crank_a_axial", "crank_a_transverse"), values=values.reshape(-1, 10, 2),
        sigma=np.full(2, sigma), chain=SimpleNamespace(rate=rate),
    )  # fmt: skip
    assert shakes(measured, 0.3, speed) == (shaking > 0.0)


def test_what_sensors_feel_against_a_frame_that_moves():
    made = machine("C", 3e-4, frame=SOFT)
    found, channels = run(made), list(Signal)[: Signal.CRANK_ANGLE]
    part = slice(round(0.35 * CHAIN.base_rate), round(0.4 * CHAIN.base_rate))
    states, results, signals = found.states[part], found.results[part], found.signals[part][:, channels]
    measured = SimpleNamespace(signals=channels, filtered=10)
    felt = SimpleNamespace(rod_angle=states[:, State.ROD_ANGLE])
    steady = _steadied(measured, signals, felt, states[:, [State.CRANK_ANGLE, State.CRANK_SPEED]], True, None)
    shaking = np.abs(signals[:, Signal.CRANK_A_AXIAL]).max()
    assert shaking > 3.0
    np.testing.assert_allclose(steady[:, list(AT_A)], 0.0, atol=1e-12 * shaking)
    radius, speed = made.crank.length, states[:, State.CRANK_SPEED]
    np.testing.assert_allclose(steady[:, Signal.CRANK_B_AXIAL], -radius * speed**2, atol=1e-9 * shaking)
    np.testing.assert_allclose(
        steady[:, Signal.CRANK_B_TRANSVERSE], radius * results[:, Result.CRANK], atol=1e-9 * shaking
    )
    sliding = np.gradient(states[:, State.SLIDER_X_RATE] - states[:, State.FRAME_X_RATE]) * CHAIN.base_rate
    wrong = np.abs(steady[:, Signal.SLIDER_HORIZONTAL] - sliding)[1:-1]
    assert np.median(wrong) < 1e-3 * shaking  # not around impacts, where half a step counts


def test_a_clearance_shows_on_a_frame_that_moves_where_the_sensors_at_a_feel_it():
    made = machine("B", 2e-4, frame=SOFT)
    found = []
    for sensors in (SENSORS, (*AT_A, *SENSORS)):
        measured, states = recorded(made, sensors=sensors)
        beside = profile([measured], [aligned(states)], lambda c: machine("B", c), 1)
        found.append((float(beside.misfit.min()), beside.best))
    assert found[1][0] < 0.3 * found[0][0]
    assert found[1][1] == pytest.approx(2e-4, rel=0.1)


@pytest.mark.parametrize("joint", ["B", "C"])
def test_frequency_damping_and_mass_of_a_frame_are_measured_whatever_the_joint_does(joint):
    measured, states = recorded(machine(joint, 4e-4, frame=SOFT), sensors=(*AT_A, *SENSORS))
    known = aligned(states)
    found = measure_frame([measured], [(known.angle, known.speed)], machine(joint, 1e-4))
    assert found == pytest.approx([25.0, 0.03, 15.0], rel=0.03, abs=3e-3)


def test_a_slider_that_strikes_its_guide_alters_nothing_of_what_is_measured():
    loose = machine("B", 2e-4, frame=SOFT, guide=LooseGuide(gap=7e-5))
    measured, states = recorded(loose, sensors=(*AT_A, *SENSORS, Signal.SLIDER_VERTICAL))
    known = aligned(states)
    found = measure_frame([measured], [(known.angle, known.speed)], machine("B", 1e-4))
    assert found == pytest.approx([25.0, 0.03, 15.0], rel=0.03, abs=3e-3)


def test_nothing_is_measured_where_a_link_has_no_sensors():
    measured, states = recorded(machine("C", 4e-4, frame=SOFT), sensors=(*AT_A, *SENSORS[:-1]))
    known = aligned(states)
    assert measure_frame([measured], [(known.angle, known.speed)], machine("C", 1e-4)) is None


@pytest.mark.parametrize("gravity", [(0.0, 0.0), (-9.81, 0.0)])  # of the weight a constant is left
def test_a_force_that_shakes_a_known_frame_is_read_off_the_balance(gravity):
    wave = tuple(40.0 * np.sin(2.0 * np.pi * np.arange(12) / 12))
    force = TabulatedForce("frame", "x", "time", 0.0, None, wave, "cubic", 0.06)
    found = []
    for acting in ({}, {"force": force}):
        made = machine("C", 3e-4, frame=SOFT, gravity=gravity, **acting)
        measured, states = recorded(made, sensors=(*AT_A, *SENSORS))
        known = aligned(states)
        nominal = machine("C", 1e-4, frame=SOFT, gravity=gravity)
        found.append(find_shaking([measured], [(known.angle, known.speed)], nominal))
    nothing, shaking = found
    assert nothing is None
    assert shaking.share > 0.9
    assert shaking.direction == "x"
    assert shaking.rhythm.period == pytest.approx(0.06, rel=0.01)
    assert np.ptp(shaking.forces) == pytest.approx(80.0, rel=0.1)
    assert shaking.interpolation == "cubic"
    on_the_ground = machine("C", 1e-4)
    assert find_shaking([measured], [(known.angle, known.speed)], on_the_ground) is None


def test_where_nothing_shakes_a_known_frame_no_rhythm_is_sought(monkeypatch):
    asked = []
    monkeypatch.setattr(shaking, "find_rhythm", lambda *_: asked.append(1))
    for acting in (0.0, 40.0):
        wave = tuple(acting * np.sin(2.0 * np.pi * np.arange(12) / 12))
        force = TabulatedForce("frame", "x", "time", 0.0, None, wave, "cubic", 0.06)
        measured, states = recorded(machine("C", 3e-4, frame=SOFT, force=force), sensors=(*AT_A, *SENSORS))
        known = aligned(states)
        find_shaking([measured], [(known.angle, known.speed)], machine("C", 1e-4, frame=SOFT))
        assert len(asked) == (acting > 0.0)  # in x alone


def test_jumps_of_a_force_tell_its_period_and_two_recordings_how_sure_it_is():
    square = np.repeat([40.0, -40.0], 24)
    parts = []
    for ahead in (0, 12):
        wave = tuple(np.roll(square, -ahead))
        force = TabulatedForce("frame", "x", "time", 0.0, None, wave, "linear", 0.06)
        parts.append(recorded(machine("C", 3e-4, frame=SOFT, force=force), sensors=(*AT_A, *SENSORS)))
    known = [aligned(states) for _, states in parts]
    turns = [(one.angle, one.speed) for one in known]
    found = find_shaking([measured for measured, _ in parts], turns, machine("C", 1e-4, frame=SOFT))
    assert found.rhythm.period == pytest.approx(0.06, rel=3e-4)
    assert found.rhythm.clocks[1] == pytest.approx(0.015, abs=2e-4)
    assert found.share > 0.97
    assert found.interpolation == "linear"
    assert 0.0 < found.deviation < 2.0
    level = np.abs(found.forces[np.abs(np.gradient(found.forces)) < 5.0])  # not where it jumps
    assert len(level) > 30
    assert np.abs(level - 40.0).max() < 6.0
