"""The fast equations of motion against closed forms and conservation laws."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.mechanism.drive import DirectCurrentMotor, Free, SpeedControl, TorqueRipple
from clearance.mechanism.film import SqueezeFilm
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.friction import Coulomb
from clearance.mechanism.guide import LooseGuide, StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.link import FlexibleRod
from clearance.mechanism.load import ConstantProcess, LinearSpring
from clearance.mechanism.slider_crank import Link, SliderCrank
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Result, Signal, State
from clearance.simulation.trajectory import rest_state, simulate_trajectory

FINE = Integrator("runge_kutta_4", 2e-6)
LOOSE = {"B": {"joint_b": Joint(3e-4)}, "C": {"joint_c": Joint(3e-4)}, "none": {}}
LOOSE["both"] = {**LOOSE["B"], **LOOSE["C"]}


def closed_form(machine, angle, speed, acceleration):
    """Ten accelerations of the ideal slider-crank at given crank motion, (samples, 10)."""
    a, length = machine.crank.length, machine.rod.length
    u = lambda t: np.stack([np.cos(t), np.sin(t)], axis=1)  # noqa: E731
    n = lambda t: np.stack([-np.sin(t), np.cos(t)], axis=1)  # noqa: E731
    sine = (machine.guide_offset - a * np.sin(angle)) / length
    rod = np.arcsin(sine)
    rod_speed = -a * np.cos(angle) * speed / (length * np.cos(rod))
    rod_acceleration = (
        -a * np.cos(angle) * acceleration + a * np.sin(angle) * speed**2 + length * np.sin(rod) * rod_speed**2
    ) / (length * np.cos(rod))
    b = a * (acceleration[:, None] * n(angle) - speed[:, None] ** 2 * u(angle))
    c = b + length * (rod_acceleration[:, None] * n(rod) - rod_speed[:, None] ** 2 * u(rod))
    dot = lambda x, y: np.sum(x * y, axis=1)  # noqa: E731
    zero = np.zeros_like(angle)
    crank = [zero, zero, dot(b, n(angle)), dot(b, u(angle))]
    ends = [dot(b, n(rod)), dot(b, u(rod)), dot(c, n(rod)), dot(c, u(rod))]
    return np.stack([*crank, *ends, c[:, 1], c[:, 0]], axis=1)


@pytest.mark.parametrize("offset", [0.0, 0.02])
def test_ideal_joints_follow_the_closed_form(offset):
    machine = SliderCrank(guide_offset=offset, ripple=TorqueRipple(0.3, 3.0, 0.4))
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-4), 0.7)
    crank = run.states[:, State.CRANK_ANGLE]
    expected = closed_form(machine, crank, run.states[:, State.CRANK_SPEED], run.results[:, Result.CRANK])
    np.testing.assert_allclose(run.signals[:, :10], expected, atol=1e-9 * np.abs(expected).max())
    reach = machine.crank.length * np.cos(crank)
    drop = (offset - machine.crank.length * np.sin(crank)) / machine.rod.length
    position = reach + machine.rod.length * np.sqrt(1 - drop**2)
    np.testing.assert_allclose(run.signals[:, Signal.SLIDER_POSITION], position, atol=1e-12)


@pytest.mark.parametrize(
    ("place", "share"),
    # of 0.12 m; beyond a pin straight on by the slope there
    [(0.0, 0.0), (0.03, np.sqrt(0.5)), (0.06, 1.0), (0.12, 0.0), (-0.01, -np.pi / 12), (0.13, -np.pi / 12)],
)
def test_sensors_on_a_bent_rod_feel_how_their_places_move(place, share):
    machine = SliderCrank(
        gravity=(3.0, -9.81), drive=SpeedControl(900.0, ramp=0.05), link=FlexibleRod(400.0, 0.0),
        sensor_positions=(0.0, 0.05, place, place),
    )  # fmt: skip
    step = 5e-6
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", step), 0.1)
    s, turning = run.states, slice(15_000, -1)
    assert np.abs(s[turning, State.ROD_MODE]).max() > 4e-5
    along = s[:, [State.ROD_COSINE, State.ROD_SINE]]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    where = s[:, [State.ROD_X, State.ROD_Y]] + (place - 0.06) * along
    where += share * s[:, [State.ROD_MODE]] * across
    felt = (where[2:] - 2.0 * where[1:-1] + where[:-2]) / step**2 - machine.gravity
    for axis, rows in (
        (along, (Signal.ROD_B_AXIAL, Signal.ROD_C_AXIAL)),
        (across, (Signal.ROD_B_TRANSVERSE, Signal.ROD_C_TRANSVERSE)),
    ):
        expected = (felt * axis[1:-1]).sum(axis=1)[turning]
        for row in rows:
            # differences: a ten-thousandth of the mode's share, and the rounding of places over step^2
            np.testing.assert_allclose(run.signals[1:-1, row][turning], expected, atol=1e-3)


@pytest.mark.parametrize(("scheme", "order"), [("semi_implicit_euler", 1), ("runge_kutta_4", 4)])
def test_order_of_convergence_in_the_smooth_case(scheme, order):
    machine = SliderCrank(drive=SpeedControl(600.0, 0.5, 20.0, 0.0), ripple=TorqueRipple(0.5, 3.0))
    steps = np.array([8e-4, 4e-4, 2e-4]) / (10 if order == 1 else 1)

    def final(scheme, step):
        run = simulate_trajectory(machine, Integrator(scheme, step), 0.1 + step)
        return run.states[-1, State.CRANK_ANGLE]

    exact = final("runge_kutta_4", 1e-5)
    errors = [abs(final(scheme, step) - exact) for step in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.25)


@pytest.mark.parametrize("joints", LOOSE)
def test_zero_clearance_equals_ideal_and_small_clearance_comes_close(joints):
    drive = SpeedControl(600.0)
    ideal = simulate_trajectory(SliderCrank(drive=drive), Integrator(), 0.6, every=100)
    zero = SliderCrank(drive=drive, joint_b=Joint(0.0), joint_c=Joint(0.0))
    same = simulate_trajectory(zero, Integrator(), 0.6, every=100)
    np.testing.assert_array_equal(ideal.states, same.states)
    loose = SliderCrank(drive=drive, **{name: Joint(1e-6) for name in LOOSE[joints]})
    near = simulate_trajectory(loose, Integrator("runge_kutta_4", 1e-6), 0.6, every=1000)
    gap = near.signals[:, Signal.SLIDER_POSITION] - ideal.signals[:, Signal.SLIDER_POSITION]
    assert np.abs(gap).max() < 1e-4


def energy_drift(machine, state=None, duration=0.25, integrator=FINE):
    """Largest violation of the energy balance over the largest energy."""
    run = simulate_trajectory(machine, integrator, duration, state=state)
    assert run.finite
    power = run.drive_power() - run.contact_loss_power()
    step = integrator.step
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * step])
    balance = run.kinetic_energy() + run.stored_energy() - work
    return np.abs(balance - balance[0]).max() / run.kinetic_energy().max()


@pytest.mark.parametrize("joints", LOOSE)
@pytest.mark.parametrize("gravity", [(0.0, 0.0), (3.0, -9.81)])
def test_energy_balance_with_contact_losses_counted(joints, gravity):
    machine = SliderCrank(drive=SpeedControl(700.0, ramp=0.05), gravity=gravity, **LOOSE[joints])
    assert energy_drift(machine) < 2e-4


CONSERVATIVE = {
    "frame": {"frame": FlexibleFrame(60.0, 0.0, 2.0)},
    "loose guide": {"guide": LooseGuide(5e-5, 1e6, 0.0)},
    "spring": {"spring": LinearSpring(2e3, 0.13)},
    "rod": {"link": FlexibleRod(900.0, 0.0)},
    "offset": {"guide_offset": 0.02},
    "rod off centre": {"rod": Link(0.21, 2.5e-4, 0.12, 0.35)},
}


@pytest.mark.parametrize("joints", LOOSE)
@pytest.mark.parametrize("effect", CONSERVATIVE)
def test_conservative_effects_conserve_energy(joints, effect):
    machine = SliderCrank(
        drive=SpeedControl(700.0, ramp=0.05), gravity=(1.0, -9.81), **LOOSE[joints], **CONSERVATIVE[effect]
    )
    run = simulate_trajectory(machine, FINE, 0.2)
    power = run.drive_power() - run.contact_loss_power()
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * FINE.step])
    balance = run.kinetic_energy() + run.stored_energy() - work
    # what is left of the balance for the rod are the terms of second order in its deflection
    tolerance = 5e-3 if effect == "rod" else 5e-4
    assert np.abs(balance - balance[0]).max() < tolerance * run.kinetic_energy().max()


DISSIPATIVE = {
    "joint friction": lambda loose: {k: replace(j, friction=Coulomb(0.1)) for k, j in loose.items()},
    "film": lambda loose: {k: replace(j, film=SqueezeFilm(20.0)) for k, j in loose.items()},
    "guide": lambda loose: {**loose, "guide_friction": StribeckGuide(5.0, 1.0, 2.0, 0.05, 0.05)},
    "damped guide": lambda loose: {**loose, "guide": LooseGuide(5e-5, 1e6, 100.0)},
    "damped frame": lambda loose: {**loose, "frame": FlexibleFrame(60.0, 0.1, 2.0)},
    "damped rod": lambda loose: {**loose, "link": FlexibleRod(900.0, 0.05)},
}


@pytest.mark.parametrize("joints", LOOSE)
@pytest.mark.parametrize("effect", DISSIPATIVE)
def test_dissipative_effects_take_energy_and_never_give_it(joints, effect):
    if joints == "none" and effect in ("joint friction", "film"):
        return  # an ideal joint has no gap to rub in
    start = simulate_trajectory(
        SliderCrank(drive=SpeedControl(700.0, ramp=0.05), **LOOSE[joints]), Integrator(), 0.12, every=100
    )
    machine = SliderCrank(drive=Free(), **DISSIPATIVE[effect](LOOSE[joints]))
    run = simulate_trajectory(machine, FINE, 0.1, state=start.states[-1])
    energy = run.kinetic_energy() + run.stored_energy()
    assert energy[-1] < energy[0]
    given = energy - np.minimum.accumulate(energy)
    assert given.max() < (5e-3 if "rod" in effect else 5e-4) * energy[0]


def test_reactions_of_both_ideal_joints_agree_with_newton():
    machine = SliderCrank(drive=SpeedControl(700.0, ramp=0.05), gravity=(2.0, -9.81))
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-5), 0.2)
    r = run.results
    slider = machine.slider.mass * (r[:, Result.SLIDER_X] - 2.0) + r[:, Result.FORCE_C_X]
    np.testing.assert_allclose(slider, 0.0, atol=1e-9 * np.abs(r[:, Result.FORCE_C_X]).max())
    for row, force_b, force_c, weight in (
        (Result.ROD_X, Result.FORCE_B_X, Result.FORCE_C_X, 2.0),
        (Result.ROD_Y, Result.FORCE_B_Y, Result.FORCE_C_Y, -9.81),
    ):
        rod = machine.rod.mass * (r[:, row] - weight) - r[:, force_c] + r[:, force_b]
        np.testing.assert_allclose(rod, 0.0, atol=1e-9 * np.abs(r[:, force_b]).max())


def test_friction_on_the_guides_reaction_is_consistent_with_that_reaction():
    for joints in LOOSE:
        machine = SliderCrank(
            drive=SpeedControl(700.0, ramp=0.05),
            guide_friction=StribeckGuide(friction_coefficient=0.1),
            **LOOSE[joints],
        )
        run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-5), 0.2)
        speed = run.states[:, State.SLIDER_X_RATE]
        expected = -0.1 * np.abs(run.results[:, Result.GUIDE_REACTION]) * speed / np.hypot(speed, 1e-3)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(run.results[:, Result.GUIDE_FRICTION], expected, atol=1e-3 * scale)


def test_a_tilted_shoe_rubs_on_both_rails():
    guide = LooseGuide(gap=1e-4, stiffness=1e7, damping=0.0, shoe_half_length=7.5e-3)
    machine = SliderCrank(
        guide=guide, guide_friction=StribeckGuide(friction_coefficient=0.2), joint_c=Joint(3e-4)
    )
    state = rest_state(machine)
    state[State.SLIDER_ANGLE] = (guide.gap + 1e-6) / guide.shoe_half_length  # 10 N on each end
    state[State.SLIDER_X_RATE] = 1.0
    result = simulate_trajectory(machine, Integrator(), 1e-5, state=state).results[0]
    assert result[Result.GUIDE_REACTION] == pytest.approx(0.0, abs=1e-9)
    assert result[Result.GUIDE_FRICTION] == pytest.approx(-0.2 * 20.0, rel=1e-2)


def test_a_motor_at_constant_voltage_sags_under_load():
    for force, low, high in ((0.0, 0.93, 1.001), (10.0, 0.5, 0.97)):
        machine = SliderCrank(
            drive=DirectCurrentMotor(2.0, 700.0),
            process=ConstantProcess(force, 0.0, 0.145),
            guide_friction=StribeckGuide(coulomb_force=force / 4),
        )
        run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-4), 2.0)
        mean = run.states[-5000:, State.CRANK_SPEED].mean() * 30 / np.pi
        assert low * 700 < mean < high * 700


@pytest.mark.parametrize("law", ["FlexibleRod", "FlexibleFrame"])
def test_a_stiff_body_moves_like_a_rigid_one(law):
    stiff = {
        "FlexibleRod": {"link": FlexibleRod(4000.0, 0.05)},
        "FlexibleFrame": {"frame": FlexibleFrame(2000.0, 0.1, 50.0)},
    }
    drive = SpeedControl(500.0, ramp=0.05)
    scheme = Integrator("runge_kutta_4", 1e-5)
    rigid = simulate_trajectory(SliderCrank(drive=drive), scheme, 0.2)
    flexible = simulate_trajectory(SliderCrank(drive=drive, **stiff[law]), scheme, 0.2)
    scale = rigid.signals[10000:, Signal.SLIDER_HORIZONTAL].std()
    difference = (
        flexible.signals[10000:, Signal.SLIDER_HORIZONTAL] - rigid.signals[10000:, Signal.SLIDER_HORIZONTAL]
    )
    assert difference.std() < 0.02 * scale


def test_the_bending_mode_rings_at_its_frequency():
    machine = SliderCrank(link=FlexibleRod(500.0, 0.0), drive=Free())
    state = simulate_trajectory(machine, FINE, 1e-5).states[0]
    state[State.ROD_MODE] = 1e-5
    run = simulate_trajectory(
        replace(machine, crank=Link(1e4, 1e4, 0.05), slider=Link(1e4, 1e4, 0.015)), FINE, 0.05, state=state
    )
    mode = run.states[:, State.ROD_MODE]
    crossings = np.flatnonzero(np.diff(np.sign(mode)))
    frequency = (len(crossings) - 1) / 2 / (run.time[crossings[-1]] - run.time[crossings[0]])
    assert frequency == pytest.approx(500.0, rel=0.01)


def test_the_frame_rings_at_its_frequency():
    machine = SliderCrank(frame=FlexibleFrame(40.0, 0.0, 500.0), drive=Free())
    state = simulate_trajectory(machine, FINE, 1e-5).states[0]
    state[State.FRAME_Y] = 1e-4
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-5), 0.2, state=state)
    y = run.states[:, State.FRAME_Y]
    crossings = np.flatnonzero(np.diff(np.sign(y)))
    frequency = (len(crossings) - 1) / 2 / (run.time[crossings[-1]] - run.time[crossings[0]])
    assert frequency == pytest.approx(40.0, rel=0.01)


def test_sensors_feel_gravity_turning_with_their_body():
    machine = SliderCrank(gravity=(0.0, -9.81), drive=SpeedControl(100.0, ramp=0.0))
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-4), 1.0)
    angle = run.states[:, State.CRANK_ANGLE]
    np.testing.assert_allclose(run.signals[:, Signal.CRANK_A_TRANSVERSE], 9.81 * np.cos(angle), atol=1e-9)
    np.testing.assert_allclose(run.signals[:, Signal.CRANK_A_AXIAL], 9.81 * np.sin(angle), atol=1e-9)
    np.testing.assert_allclose(run.signals[:, Signal.SLIDER_VERTICAL], 9.81, atol=1e-9)


def joint_b_forces(machine, crank_speed, rod_speed, drift):
    """Force on the crank at B (normal, tangential) with the journal pressed into the bearing.

    Crank and rod turn about A at their own speeds; ``drift`` is added to the rod's velocity, times its speed.
    """
    theta, phi, direction = 0.3, 0.8, 1.9
    normal = np.array([np.cos(direction), np.sin(direction)])
    journal = machine.crank.length * np.array([np.cos(theta), np.sin(theta)])
    bearing = journal - (machine.joint_b.clearance + 1e-6) * normal
    center = bearing + machine.rod.center_of_mass * machine.rod.length * np.array([np.cos(phi), np.sin(phi)])
    state = simulate_trajectory(machine, Integrator(), 1e-5).states[0]
    state[State.CRANK_ANGLE], state[State.ROD_ANGLE] = theta, phi
    state[State.CRANK_SPEED], state[State.ROD_SPEED] = crank_speed, rod_speed
    state[State.ROD_X], state[State.ROD_Y] = center
    state[State.ROD_X_RATE], state[State.ROD_Y_RATE] = drift * np.array([-center[1], center[0]])
    result = simulate_trajectory(machine, Integrator(), 1e-5, state=state).results[0]
    force = np.array([result[Result.FORCE_B_X], result[Result.FORCE_B_Y]])
    return force @ normal, force @ np.array([-normal[1], normal[0]])


def test_joint_friction_opposes_sliding_at_the_contact_point():
    loose = Joint(3e-4, friction=Coulomb(0.2))
    machine = SliderCrank(joint_b=loose, joint_c=Joint(3e-4))
    # all turning together about A: nothing slides, nothing rubs
    normal, tangential = joint_b_forces(machine, 30.0, 30.0, 30.0)
    assert normal < 0.0
    assert abs(tangential) < 1e-6 * abs(normal)
    # only the crank's journal turns, in its place as seen from the rod: it slides at its radius
    for speed in (5.0, -5.0):
        normal, tangential = joint_b_forces(machine, speed, 0.0, 0.0)
        sliding = speed * (
            loose.journal_radius + machine.crank.length * np.cos(1.9 - 0.3)
        )  # B's own motion along the tangent, and the journal's surface
        expected = -0.2 * abs(normal) * sliding / np.hypot(sliding, 1e-3)
        assert tangential == pytest.approx(expected, rel=1e-6)
