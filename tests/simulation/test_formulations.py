"""The fast equations against the paper's own formulation, an independent integration, and a golden
trajectory."""

import json
from pathlib import Path

import numpy as np
import pytest

from clearance.mechanism.contact import Flores, HuntCrossley, LankaraniNikravesh
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import Link, SliderCrank
from clearance.simulation import natural_coordinates as paper
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Result, Signal, State
from clearance.simulation.trajectory import rest_state, simulate_trajectory
from tests.simulation import scipy_model

GOLDEN = Path(__file__).parents[1] / "golden" / "slider_crank_joint_c.json"
CLEARANCES = {"none": (0.0, 0.0), "B": (1e-4, 0.0), "C": (0.0, 1e-4), "both": (1e-4, 2e-4)}


def fast_machine(b, c, **changes):
    drive = SpeedControl(600.0, ramp=0.1)
    return SliderCrank(joint_b=Joint(b), joint_c=Joint(c), drive=drive, **changes)


@pytest.mark.parametrize("joints", CLEARANCES)
@pytest.mark.parametrize("awkward", [False, True])
def test_the_papers_formulation_and_the_fast_one_take_the_same_steps(joints, awkward):
    """Same scheme, same step: what differs is rounding, which impacts amplify: sooner with two loose
    joints."""
    duration = 0.012 if joints == "both" else 0.06
    b, c = CLEARANCES[joints]
    speed = 600.0 * np.pi / 30
    slow_changes, fast_changes = {}, {}
    if awkward:
        slow_changes = {"guide_offset": 0.01, "gravity": (1.5, -9.81), "rod_centre": 0.4}
        fast_changes = {
            "guide_offset": 0.01, "gravity": (1.5, -9.81), "rod": Link(0.21, 2.5e-4, 0.12, 0.4),
        }  # fmt: skip
    slow = paper.simulate(
        paper.nominal_parameters(b, c, speed, ramp_time=0.1, **slow_changes), 1e-5, duration
    )
    fast = simulate_trajectory(fast_machine(b, c, **fast_changes), Integrator(), duration)
    np.testing.assert_allclose(fast.states[:, State.CRANK_ANGLE], slow.crank_angle, atol=1e-9)
    np.testing.assert_allclose(fast.signals[:, Signal.SLIDER_POSITION], slow.slider_position, atol=1e-10)
    scale = np.abs(slow.accelerations).max()
    np.testing.assert_allclose(
        fast.signals[:, :10], slow.accelerations, atol=(1e-4 if joints == "both" else 1e-5) * scale
    )
    np.testing.assert_allclose(
        fast.results[:, Result.DRIVE_TORQUE], slow.drive_torque, atol=1e-3 if joints == "both" else 1e-6
    )


@pytest.mark.parametrize("joints", ["none", "B", "C"])
def test_agrees_with_an_independent_integration(joints):
    """Maximal coordinates, multipliers, SciPy's DOP853 from touch to parting: nothing in common but the
    physics."""
    c = max(CLEARANCES[joints])
    times = np.linspace(0.0, 0.04, 401)
    machine = scipy_model.Machine(joints, clearance=c, speed=600.0 * np.pi / 30, ramp=0.1)
    coordinates, velocities, accelerations, _ = scipy_model.integrate(machine, times, 1e-10)
    expected = scipy_model.channels(machine, coordinates, velocities, accelerations)
    scale = expected.std(axis=0).max()

    def error(step):
        scheme = Integrator("runge_kutta_4", step)
        run = simulate_trajectory(fast_machine(*CLEARANCES[joints]), scheme, 0.0401, every=round(1e-4 / step))
        np.testing.assert_allclose(run.states[: len(times), State.CRANK_ANGLE], coordinates[:, 2], atol=1e-7)
        return np.sqrt(np.mean((run.signals[: len(times), :10] - expected) ** 2)) / scale

    if joints == "none":
        assert error(1e-5) < 1e-6
    else:  # a step across a touch would cost the scheme its order: they end there
        coarse, fine = error(5e-6), error(1e-6)
        assert coarse < 0.02
        assert fine < 0.2 * coarse


LAWS = [LankaraniNikravesh, HuntCrossley, Flores]
PUBLISHED = {  # MECHANISM, "One contact parameter, not two": rebound at e = 0.9, 0.72, 0.6
    LankaraniNikravesh: (0.913, 0.805, 0.756),
    HuntCrossley: (0.909, 0.780, 0.712),
    Flores: (0.894, 0.704, 0.577),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("restitution", [0.9, 0.72, 0.6])
def test_a_single_impact_rebounds_as_the_closed_form_says(law, restitution):
    machine = SliderCrank(
        joint_c=Joint(3e-4, contact=law(restitution)), drive=SpeedControl(0.0, 0.0, 0.0, 0.0)
    )
    state = rest_state(machine)
    state[State.SLIDER_X_RATE] = 0.1  # the slider alone moves, along the line of the rod
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-8), 6e-3, every=50, state=state)
    gap_rate = run.states[:, State.ROD_X_RATE] - run.states[:, State.SLIDER_X_RATE]
    touching = run.results[:, Result.PENETRATION_C] > 0
    parted = np.flatnonzero(np.diff(touching.astype(int)) < 0)
    if not parted.size:  # slow rods: let the impact be the whole record
        parted = [len(gap_rate) - 2]
    rebound = gap_rate[parted[0] + 1] / 0.1
    assert rebound == pytest.approx(scipy_model.rebound(law(restitution).hysteresis), abs=2e-3)
    assert rebound == pytest.approx(PUBLISHED[law][(0.9, 0.72, 0.6).index(restitution)], abs=2e-3)


def golden_run():
    """What the golden file holds: the paper's formulation at c = 0.1 mm in joint C, 600 rpm, from rest."""
    run = paper.simulate(
        paper.nominal_parameters(0.0, 1e-4, 600.0 * np.pi / 30, ramp_time=0.1), 1e-5, 0.1, 500
    )
    return {
        "source": "clearance.simulation.natural_coordinates, semi-implicit Euler, h = 1e-5 s, 0.1 mm at C",
        "regenerate": "python -m tests.simulation.test_formulations",
        "crank_angle": run.crank_angle.tolist(),
        "slider_position": run.slider_position.tolist(),
        "slider_horizontal": run.accelerations[:, 9].tolist(),
    }


def test_golden_trajectory():
    golden = json.loads(GOLDEN.read_text())
    run = simulate_trajectory(fast_machine(0.0, 1e-4), Integrator(), 0.1, every=500)
    np.testing.assert_allclose(run.states[:, State.CRANK_ANGLE], golden["crank_angle"], atol=1e-8)
    np.testing.assert_allclose(run.signals[:, Signal.SLIDER_POSITION], golden["slider_position"], atol=1e-9)
    horizontal = run.signals[:, Signal.SLIDER_HORIZONTAL]
    np.testing.assert_allclose(horizontal, golden["slider_horizontal"], atol=1e-2)


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(golden_run(), indent=1) + "\n")
