"""A force of free form does the work that it must, in every direction, with every kind of joint."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.lanes import WIDTH
from clearance.mechanism.applied_force import DIRECTIONS, Argument, TabulatedForce
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.film import SqueezeFilm
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.guide import LooseGuide, StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.link import FlexibleRod
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import Sampling, run_batch
from clearance.simulation.decimation import Decimation
from clearance.simulation.eccentricity import eccentricity_b, eccentricity_c
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import COORDINATES, RESULTS, SIGNALS, STATES, Result, State
from clearance.simulation.lockstep import trace
from clearance.simulation.trajectory import Trajectory, rest_state, simulate_trajectory

JOINTS = {
    "none": {},
    "B": {"joint_b": Joint(3e-4)},
    "C": {"joint_c": Joint(3e-4)},
    "both": {"joint_b": Joint(3e-4), "joint_c": Joint(2e-4)},
}
BODIES = {
    "rigid": {},
    "loose guide": {"guide": LooseGuide(5e-5, 1e6, 0.0)},
    "frame": {"frame": FlexibleFrame(60.0, 0.0, 2.0)},
    "rod": {"link": FlexibleRod(900.0, 0.0)},
    "all": {
        "guide": LooseGuide(5e-5, 1e6, 0.0),
        "frame": FlexibleFrame(60.0, 0.0, 2.0),
        "link": FlexibleRod(900.0, 0.0),
    },
}


def evaluated(machine, state, change=None):
    """State (projected), results and signals at one instant; ``change`` alters the parameter vector."""
    p = machine.parameters()
    for place, value in (change or {}).items():
        p[place] = value
    states, results, signals = np.zeros((1, STATES)), np.zeros((1, RESULTS)), np.zeros((1, SIGNALS))
    trace(machine.codes(), p, state.copy(), 1, 1e-9, 1, 1, states, results, signals)
    return states[0], results[0], signals[0]


def random_state(machine, generator):
    """Anywhere in the turn, about a tenth of a millimetre from where ideal joints would put the bodies."""
    state = rest_state(machine)
    angle = generator.uniform(0.0, 6.0)
    rod = np.arcsin(-machine.crank.length * np.sin(angle) / machine.rod.length)
    b = machine.crank.length * np.array([np.cos(angle), np.sin(angle)])
    along = np.array([np.cos(rod), np.sin(rod)])
    state[State.CRANK_ANGLE], state[State.ROD_ANGLE] = angle, rod
    state[State.ROD_X : State.ROD_Y + 1] = b + 0.06 * along
    state[State.SLIDER_X : State.SLIDER_Y + 1] = b + 0.12 * along
    state[:COORDINATES] += 1e-4 * generator.normal(size=COORDINATES)
    state[COORDINATES : 2 * COORDINATES] = generator.normal(size=COORDINATES)
    free = {
        State.ROD_MODE: machine.link.code,
        State.FRAME_X: machine.frame.code,
        State.FRAME_Y: machine.frame.code,
    }
    for row, code in free.items():
        if not code:
            state[[row, COORDINATES + row]] = 0.0
    return state


def rate_of_direction(machine, s, body, direction):
    """Rate of the coordinate that a direction is conjugate to."""
    simple = {
        ("crank", "torque"): State.CRANK_SPEED,
        ("rod", "x"): State.ROD_X_RATE,
        ("rod", "y"): State.ROD_Y_RATE,
        ("rod", "moment"): State.ROD_SPEED,
        ("slider", "x"): State.SLIDER_X_RATE,
        ("slider", "y"): State.SLIDER_Y_RATE,
        ("slider", "moment"): State.SLIDER_SPEED,
        ("frame", "x"): State.FRAME_X_RATE,
        ("frame", "y"): State.FRAME_Y_RATE,
    }
    if (body, direction) in simple:
        return s[simple[body, direction]]
    if not getattr(machine, body).loose:
        return 0.0
    unit = lambda t: np.array([np.cos(t), np.sin(t)])  # noqa: E731
    turn = lambda t, w: w * np.array([-np.sin(t), np.cos(t)])  # noqa: E731
    rod, w = s[State.ROD_ANGLE], s[State.ROD_SPEED]
    center, drift = s[State.ROD_X : State.ROD_Y + 1], s[State.ROD_X_RATE : State.ROD_Y_RATE + 1]
    if body == "joint_b":
        pivot, pivot_rate = (
            s[State.FRAME_X : State.FRAME_Y + 1],
            s[State.FRAME_X_RATE : State.FRAME_Y_RATE + 1],
        )
        e = pivot + 0.05 * unit(s[State.CRANK_ANGLE]) - center + 0.06 * unit(rod)
        v = pivot_rate + 0.05 * turn(s[State.CRANK_ANGLE], s[State.CRANK_SPEED]) - drift + 0.06 * turn(rod, w)
        spins = s[State.CRANK_SPEED], w
    else:
        e = center + 0.06 * unit(rod) - s[State.SLIDER_X : State.SLIDER_Y + 1]
        v = drift + 0.06 * turn(rod, w) - s[State.SLIDER_X_RATE : State.SLIDER_Y_RATE + 1]
        spins = w, s[State.SLIDER_SPEED]
    normal = e / np.hypot(*e)
    if direction == "damping":  # the bearing's body feels it where the journal's centre is
        return -v @ (v - spins[1] * np.array([-e[1], e[0]]))
    if direction == "normal":
        return v @ normal
    # both sides feel it where the surfaces meet, a radius beyond the journal's centre, against the sliding
    journal, bearing = spins
    radius = getattr(machine, body).journal_radius
    across = v @ np.array([-normal[1], normal[0]])
    sliding = across + radius * journal - (np.hypot(*e) + radius) * bearing
    return -sliding * sliding / np.hypot(sliding, 1e-3)


def nearness(s, eccentricity, clearance):
    """-ln(1 - eps²) up to 0.99 of the clearance."""
    gap = np.hypot(*eccentricity(SliderCrank().parameters(), s)) / clearance
    return -np.log(max(1.0 - gap**2, 1.0 - 0.99**2))


def kinetic_power(machine, state, change):
    """Rate of kinetic energy that a change of the accelerations brings: a bilinear form of two energies."""
    both = np.array([state, state])
    both[:, COORDINATES : 2 * COORDINATES] += np.array([1.0, -1.0])[:, None] * change
    energy = Trajectory(machine, both, np.zeros((2, RESULTS)), np.zeros((2, SIGNALS)), True).kinetic_energy()
    return 0.5 * (energy[0] - energy[1])


@pytest.mark.parametrize("bodies", BODIES)
@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize(("body", "direction"), DIRECTIONS)
def test_a_force_changes_the_accelerations_as_virtual_work_demands(body, direction, joints, bodies):
    # at many velocities the power of the change is the force's: so it is in every admissible direction
    machine = SliderCrank(**JOINTS[joints], **BODIES[bodies])
    forced = replace(machine, force=TabulatedForce(body, direction, values=(7.0,)))
    constant = Parameter(Parameter.FORCE_CRANK_TORQUE + DIRECTIONS.index((body, direction)))
    generator = np.random.default_rng(1)
    for _ in range(12):
        state = random_state(machine, generator)
        at, before, _ = evaluated(machine, state)
        _, after, _ = evaluated(forced, state)
        _, twice, _ = evaluated(forced, state, {constant: 7.0})
        change = after[:COORDINATES] - before[:COORDINATES]
        power = kinetic_power(machine, at, change)
        expected = 7.0 * rate_of_direction(machine, at, body, direction)
        scale = 7.0 * (1.0 + np.abs(at[COORDINATES : 2 * COORDINATES]).max())
        # contact forces up to 1e5 N share the sums with these 7 N
        assert power == pytest.approx(expected, abs=2e-8 * scale)
        np.testing.assert_allclose(
            twice[:COORDINATES] - before[:COORDINATES], 2.0 * change, rtol=1e-6, atol=1e-5
        )


@pytest.mark.parametrize("joints", JOINTS)
def test_a_force_across_an_ideal_guide_is_carried_by_it(joints):
    machine = SliderCrank(**JOINTS[joints], guide_friction=StribeckGuide(friction_coefficient=0.2))
    forced = replace(machine, force=TabulatedForce("slider", "y", values=(50.0,)))
    run = simulate_trajectory(replace(forced, drive=SpeedControl(700.0, ramp=0.05)), Integrator(), 0.2)
    r, s = run.results, run.states
    np.testing.assert_allclose(
        r[:, Result.GUIDE_REACTION],
        r[:, Result.FORCE_C_Y] - 50.0,
        atol=1e-9 * np.abs(r[:, Result.FORCE_C_Y]).max(),
    )
    speed = s[:, State.SLIDER_X_RATE]
    expected = -0.2 * np.abs(r[:, Result.GUIDE_REACTION]) * speed / np.hypot(speed, 1e-3)
    np.testing.assert_allclose(r[:, Result.GUIDE_FRICTION], expected, atol=2e-3 * np.abs(expected).max())


def test_a_table_over_closeness_follows_a_film_over_all_its_thicknesses():
    machine = SliderCrank(joint_c=Joint(3e-4), guide=LooseGuide(5e-5, 1e6, 0.0))
    thick = np.linspace(0.0, -np.log(1.0 - 0.99**2), 24)
    table = TabulatedForce(
        "joint_c", "damping", "closeness_c", 0.0, thick[1], tuple(0.2 * np.exp(1.5 * thick)), "cubic"
    )
    filmed = replace(machine, joint_c=Joint(3e-4, film=SqueezeFilm(0.2)))
    generator = np.random.default_rng(3)
    for _ in range(40):
        state = random_state(machine, generator)
        e = generator.uniform(-1.1, 1.1) * 3e-4 * np.array([0.6, 0.8])
        state[State.SLIDER_X : State.SLIDER_Y + 1] += (
            np.array(eccentricity_c(machine.parameters(), evaluated(machine, state)[0])) - e
        )
        _, none, _ = evaluated(machine, state)
        _, film, _ = evaluated(filmed, state)
        _, like, _ = evaluated(replace(machine, force=table), state)
        change = (film - none)[:COORDINATES]
        np.testing.assert_allclose((like - none)[:COORDINATES], change, atol=0.01 * np.abs(change).max())


ARGUED = [
    ("crank", "torque", "crank_angle", None, (0.3, -0.2, 0.1)),
    ("slider", "x", "slider_velocity", 1.0, (2.0, 2.0, -2.0)),
    ("rod", "y", "rod_angle", 0.2, (1.0, -3.0)),
    ("rod", "moment", "rod_speed", 20.0, (0.1, -0.1)),
    ("slider", "x", "slider_position", 0.02, (3.0, 1.0, -2.0, 4.0)),
    ("joint_c", "tangential", "force_c", 100.0, (0.0, 5.0)),
    ("joint_c", "normal", "time", 0.05, (0.0, 2.0)),
    ("joint_c", "damping", "closeness_c", 1.0, (0.1, 0.3, 2.0)),
]


def test_lanes_of_different_forces_move_as_each_does_alone():
    machines = [
        SliderCrank(
            drive=SpeedControl(500.0 + 20.0 * k, ramp=0.02),
            joint_c=Joint(1e-4),
            force=TabulatedForce(body, direction, argument, 0.0, spacing, values),
        )
        for k, (body, direction, argument, spacing, values) in enumerate(ARGUED * 2)
    ]
    assert len(machines) == WIDTH
    scheme = Integrator("runge_kutta_4", 1e-5)
    together = {}
    sampling = Sampling(1e5, Decimation.none(), 0.0, 0.05)
    run_batch(machines, scheme, sampling, lambda i, out: together.update({i: out.copy()}), 1)
    for i, machine in enumerate(machines):
        alone = simulate_trajectory(machine, scheme, 0.05)
        scale = np.abs(alone.signals).max(axis=0)
        # rounding, as it grows over 5000 steps in contact
        assert (np.abs(together[i] - alone.signals) <= 1e-6 * scale + 1e-9).all(), ARGUED[i % len(ARGUED)]
        plain = simulate_trajectory(replace(machine, force=SliderCrank().force), scheme, 0.05)
        assert np.abs(alone.signals - plain.signals).max() > 1e-3


@pytest.mark.parametrize("argument", Argument, ids=lambda one: one.name)
def test_each_argument_is_the_machines_own(argument):
    machine = SliderCrank(**JOINTS["both"], frame=FlexibleFrame(60.0, 0.0, 2.0))
    state = random_state(machine, np.random.default_rng(5))
    state[State.TIME] = 0.7
    at, result, _ = evaluated(machine, state)
    expected = {
        Argument.CRANK_ANGLE: at[State.CRANK_ANGLE],
        Argument.CRANK_SPEED: at[State.CRANK_SPEED],
        Argument.ROD_ANGLE: at[State.ROD_ANGLE],
        Argument.ROD_SPEED: at[State.ROD_SPEED],
        Argument.SLIDER_POSITION: at[State.SLIDER_X] - at[State.FRAME_X],
        Argument.SLIDER_VELOCITY: at[State.SLIDER_X_RATE] - at[State.FRAME_X_RATE],
        Argument.FRAME_X: at[State.FRAME_X],
        Argument.FRAME_X_RATE: at[State.FRAME_X_RATE],
        Argument.FORCE_B: result[Result.NORMAL_FORCE_B],
        Argument.FORCE_C: result[Result.NORMAL_FORCE_C],
        Argument.TIME: 0.7,
        Argument.CLOSENESS_B: nearness(at, eccentricity_b, machine.joint_b.clearance),
        Argument.CLOSENESS_C: nearness(at, eccentricity_c, machine.joint_c.clearance),
    }[argument]
    # a table of slope one around the expected argument gives back the distance from its start
    name = argument.name.lower()
    span = max(1.0, abs(expected))
    table = {"spacing": 2.0 * span, "values": (0.0, 2.0 * span), "start": expected - span}
    if name == "crank_angle":
        table = {"values": (0.0, np.pi), "start": expected - 0.5}
        span = 0.5
    forced = replace(machine, force=TabulatedForce("slider", "x", name, **table))
    _, after, _ = evaluated(forced, state)
    push = machine.slider.mass * (after[Result.SLIDER_X] - result[Result.SLIDER_X])
    assert push == pytest.approx(span, rel=1e-6)
