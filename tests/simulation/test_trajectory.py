"""The start of a run, a turning machine whose journals are centred; and whether it came to its end."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.friction import Coulomb
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import State
from clearance.simulation.trajectory import rest_state, simulate_trajectory, turning_state

PLACES = (State.ROD_ANGLE, State.ROD_X, State.ROD_Y, State.SLIDER_X, State.SLIDER_Y)
RATES = (State.ROD_SPEED, State.ROD_X_RATE, State.ROD_Y_RATE, State.SLIDER_X_RATE, State.SLIDER_Y_RATE)


@pytest.mark.parametrize("angle", [0.0, 0.9, 2.8, 4.4])
def test_rates_are_the_derivatives_of_the_places(angle):
    machine, speed, instant = SliderCrank(guide_offset=0.01), 80.0, 1e-6
    before, after = (turning_state(machine, angle + side * speed * instant, speed) for side in (-1.0, 1.0))
    expected = (after[list(PLACES)] - before[list(PLACES)]) / (2.0 * instant)
    # the steps' own rounding: 1e-16 of 0.3 m over 2e-6 s
    assert turning_state(machine, angle, speed)[list(RATES)] == pytest.approx(expected, rel=1e-7, abs=1e-9)


def test_journals_are_centred():
    machine = SliderCrank(guide_offset=0.01)
    state = turning_state(machine, 2.0, 50.0)
    along = np.array([np.cos(state[State.ROD_ANGLE]), np.sin(state[State.ROD_ANGLE])])
    middle, arm = state[[State.ROD_X, State.ROD_Y]], machine.rod.center_of_mass * machine.rod.length
    pin = machine.crank.length * np.array([np.cos(2.0), np.sin(2.0)])
    end = middle + (machine.rod.length - arm) * along
    assert middle - arm * along == pytest.approx(pin, abs=1e-15)
    assert end == pytest.approx([state[State.SLIDER_X], 0.01], abs=1e-15)


def test_a_machine_at_rest_lies_straight():
    state = rest_state(SliderCrank())
    assert state[State.SLIDER_X] == pytest.approx(SliderCrank().crank.length + SliderCrank().rod.length)
    assert not state[list(RATES)].any()


@pytest.mark.parametrize("rough", ["joint_b", "joint_c"])
def test_friction_in_one_of_two_loose_joints_leaves_the_other_without(rough):
    loose = SliderCrank(joint_b=Joint(1e-4), joint_c=Joint(1e-4), drive=SpeedControl(ramp=0.05))
    runs = {}
    for name, coefficient in (("none", None), ("zero", 0.0), ("some", 0.1)):
        joint = Joint(1e-4) if coefficient is None else Joint(1e-4, friction=Coulomb(coefficient))
        runs[name] = simulate_trajectory(replace(loose, **{rough: joint}), Integrator(), 0.03)
        assert runs[name].finite
    # friction of nothing sums the same forces in another order
    np.testing.assert_allclose(runs["zero"].states, runs["none"].states, atol=1e-6)
    assert np.abs(runs["some"].states - runs["none"].states).max() > 1e-4


@pytest.mark.parametrize("every", [1, 7])
def test_a_run_that_blows_up_is_not_finite(every):
    # a step far beyond the contact's stability limit
    machine = SliderCrank(joint_c=Joint(1e-4), drive=SpeedControl(600.0, 0.05, 2.0))
    with np.errstate(all="ignore"):
        run = simulate_trajectory(machine, Integrator(step=1e-3), 4.0, every)
    assert len(run.time) < round(4.0 / 1e-3 / every)
    assert not run.finite
