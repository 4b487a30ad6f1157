"""The path from accelerations alone: against the simulator's own states, with and without missing physics."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from clearance.diagnosis.kinematics import pieces
from clearance.diagnosis.kinematics.agreement import Alignment, agreement, profile
from clearance.diagnosis.kinematics.lift import Lift
from clearance.diagnosis.kinematics.pieces import reconstruct_whole
from clearance.diagnosis.kinematics.reconstruction import reconstruct
from clearance.diagnosis.kinematics.rigid_motion import feel, slopes
from clearance.diagnosis.kinematics.smoother import smooth
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.guide import LooseGuide, StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.load import LinearSpring
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.recording import Recording
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Result, Signal, State
from clearance.simulation.trajectory import simulate_trajectory

CHAIN = MeasurementChain()
SENSORS = (
    Signal.CRANK_B_TRANSVERSE, Signal.CRANK_B_AXIAL, Signal.ROD_B_TRANSVERSE, Signal.ROD_B_AXIAL,
    Signal.ROD_C_TRANSVERSE, Signal.ROD_C_AXIAL, Signal.SLIDER_HORIZONTAL,
)  # fmt: skip
RPM, SETTLED, SECONDS = 700.0, 0.3, 0.2


def machine(joint, clearance, **laws):
    made = SliderCrank(drive=SpeedControl(RPM, ramp=0.05), **laws)
    return replace(made, **{f"joint_{joint.lower()}": Joint(clearance)})


@cache
def run(made):
    return simulate_trajectory(made, Integrator("runge_kutta_4", 5e-6, 5), SETTLED + SECONDS + 0.02, 2)


def recorded(made, noise=0.01, sensors=None):
    """A noisy recording, and the states at its samples."""
    sensors = sensors or SENSORS
    found = run(made)
    first = round(SETTLED * CHAIN.base_rate)
    values = CHAIN.smooth(found.signals[:, list(sensors)])[first :: CHAIN.decimation]
    values = values[: round(SECONDS * CHAIN.rate)]
    generator = np.random.default_rng(1)
    values = values + noise * values.std(axis=0) * generator.normal(size=values.shape)
    names = tuple(s.name.lower() for s in sensors)
    measured = Measured.of(Recording(values, names, CHAIN.rate), CHAIN, "one")
    states = found.states[first :: CHAIN.decimation][: len(values)]
    return measured, states


def aligned(states):
    time = np.arange(len(states)) / CHAIN.rate
    speed, angle = np.polyfit(time, states[:, State.CRANK_ANGLE], 1)
    return Alignment(float(speed), float(angle), 1.0)


def eccentricities(made, states, joint):
    """(samples, 2) journal minus bearing [m]."""
    length = made.rod.length / 2.0
    along = np.stack([np.cos(states[:, State.ROD_ANGLE]), np.sin(states[:, State.ROD_ANGLE])], axis=1)
    rod = states[:, [State.ROD_X, State.ROD_Y]]
    if joint == "C":
        return rod + length * along - states[:, [State.SLIDER_X, State.SLIDER_Y]]
    angle = states[:, State.CRANK_ANGLE]
    crank = made.crank.length * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return crank - rod + length * along


def in_nodes(nodes, joint, clearance):
    rows = [State.ROD_X, State.ROD_Y] if joint == "B" else [State.SLIDER_X, State.ROD_ANGLE]
    return nodes[:, rows] * clearance


@pytest.mark.parametrize("joint", ["B", "C"])
def test_signals_and_forces_of_a_motion_are_the_simulators(joint):
    made = machine(joint, 3e-4)
    found = run(made)
    part = slice(round(0.35 * CHAIN.base_rate), round(0.4 * CHAIN.base_rate))
    states, results = found.states[part], found.results[part]
    place = eccentricities(made, states, joint)
    near = found.states[part.start - 1 : part.stop + 1]
    around = eccentricities(made, near, joint)
    quiet = np.flatnonzero(
        np.abs(np.diff(results[:, Result.SLIDER_X], prepend=results[0, Result.SLIDER_X])) < 0.5
    )
    quiet = quiet[(quiet > 2) & (quiet < len(states) - 2)]
    rate = (around[2:] - around[:-2]) * CHAIN.base_rate / 2.0
    bend = (around[2:] - 2.0 * place + around[:-2]) * CHAIN.base_rate**2
    torque = results[:, Result.DRIVE_TORQUE]
    zero = np.zeros(len(states))
    state = np.stack(
        [
            states[:, State.CRANK_ANGLE], states[:, State.CRANK_SPEED], torque, zero, zero, place[:, 0],
            rate[:, 0], place[:, 1], rate[:, 1],
        ], axis=1,
    )  # fmt: skip
    inputs = np.column_stack([results[:, Result.CRANK], bend])
    felt = feel(made.parameters(), (joint,), SENSORS, state[quiet], inputs[quiet])
    signals = found.signals[part][quiet][:, list(SENSORS)]
    assert np.median(np.abs(felt.signals - signals), axis=0).max() < 1e-2 * signals.std()
    force = results[quiet][:, [Result.FORCE_C_X, Result.FORCE_C_Y]]
    assert np.median(np.abs(felt.force_c - force)) < 1e-2 * np.abs(force).max()
    assert np.median(np.abs(felt.imbalance)) < 1e-2 * np.abs(torque).max() + 1e-3


def test_a_table_over_time_pushes_where_its_clock_is_known():
    table = TabulatedForce("slider", "x", "time", 0.0, 0.001, (-6.0, 6.0), period=0.05, returns=0.026)
    p = replace(SliderCrank(force=table), joint_c=Joint(3e-4)).parameters()
    state, inputs, clock = np.zeros((2, 9)), np.zeros((2, 3)), np.array([0.01, 0.04])
    state[:, :2] = 0.7, 70.0
    without, pushed = (feel(p, ("C",), SENSORS, state, inputs, None, one) for one in (None, clock))
    np.testing.assert_allclose((pushed.force_c - without.force_c)[:, 0], [6.0, -6.0], atol=1e-9)
    np.testing.assert_allclose(pushed.signals, without.signals)


@pytest.mark.parametrize("joints", [("B",), ("C",), ("B", "C")])
def test_derivatives_are_those_of_what_is_felt(joints):
    loads = {"spring": LinearSpring(300.0, 0.1), "guide_friction": StribeckGuide(coulomb_force=5.0)}
    table = TabulatedForce("slider", "x", "crank_angle", 0.0, None, (3.0, -2.0, 4.0), "cubic")
    p = replace(SliderCrank(**loads, force=table), **{f"joint_{j.lower()}": Joint(3e-4) for j in joints})
    p, generator = p.parameters(), np.random.default_rng(4)
    states = 5 + 4 * len(joints)
    state = np.zeros((7, states))
    state[:, 0], state[:, 1] = np.linspace(0.0, 6.0, 7), 70.0
    state[:, 5:] = np.tile([1e-4, 0.02], 2 * len(joints)) * generator.normal(size=(7, states - 5))
    inputs = 100.0 * generator.normal(size=(7, 1 + 2 * len(joints)))
    lifted = Lift(1e-5 * np.ones(7), 1e-2 * np.ones(7), 5.0 * np.ones(7), 0.0, 0.0)
    signals = [*SENSORS, Signal.SLIDER_VERTICAL, Signal.CRANK_ANGLE, Signal.SLIDER_VELOCITY]
    found = slopes(p, joints, signals, state, inputs, lifted)

    def rows(state, inputs):
        felt = feel(p, joints, signals, state, inputs, lifted)
        return np.column_stack([felt.signals, felt.imbalance])

    sizes = np.array([1e-6, 1e-3, 1e-3, 1e-2, 1e-2, *[1e-7, 1e-4] * (2 * len(joints))])
    for i in range(states + inputs.shape[1]):
        step = sizes[i] if i < states else 1.0
        change = np.zeros(states + inputs.shape[1])
        change[i] = step
        more = rows(state + change[:states], inputs + change[states:])
        less = rows(state - change[:states], inputs - change[states:])
        expected = (more - less) / (2.0 * step)
        rounded = 2e-7 / step  # of a metre over the square of the moments between which rates are taken
        near = 2e-3 * np.abs(expected).max(axis=0) + rounded
        assert (np.abs(found[:, :, i] - expected) <= near).all(), i


@pytest.mark.parametrize("joints", [1, 2])
def test_the_smoother_solves_the_whole_motion_at_once(joints):
    """Against least squares over the first state and all that drives the motion."""
    count, rows, period = 9, 3, 1e-2
    states, inputs = 5 + 4 * joints, 1 + 2 * joints
    total, generator = states + inputs, np.random.default_rng(joints)
    start, variance = generator.normal(size=states), generator.uniform(0.5, 2.0, states)
    drift, torque = generator.uniform(0.5, 2.0, inputs), 0.3
    slope = generator.normal(size=(count, rows, total))
    seen, noise = generator.normal(size=(count, rows)), generator.uniform(0.1, 1.0, (count, rows))
    sight = generator.normal(size=(count, 2 * joints, 2))
    target = generator.normal(size=(count, 2 * joints))
    doubt = generator.uniform(0.1, 1.0, (count, 2 * joints))
    doubt[generator.random(doubt.shape) < 0.3] = np.inf
    found = smooth(
        period, start, variance, drift, torque, slope, seen, noise, sight, target, doubt
    )  # fmt: skip
    # every state is linear in the first one, in the accelerations at the samples and in the torque's steps
    cause = states + count * (inputs + 1)
    motion, at = np.zeros((count, total, cause)), np.zeros((states, cause))
    before = np.zeros((inputs, cause))
    at[:, :states] = np.eye(states)
    for t in range(count):
        push = np.zeros((inputs, cause))
        push[:, states + t * (inputs + 1) : states + t * (inputs + 1) + inputs] = np.eye(inputs)
        if t:
            for i in range(inputs):
                place = 0 if i == 0 else 5 + 2 * (i - 1)
                at[place] += period * at[place + 1] + period**2 * (before[i] / 3.0 + push[i] / 6.0)
                at[place + 1] += 0.5 * period * (before[i] + push[i])
            at[2, states + t * (inputs + 1) + inputs] += 1.0
        motion[t], before = np.concatenate([at, push]), push
    matrix, right = [np.eye(cause)], [np.concatenate([start, np.zeros(cause - states)])]
    weight = [1.0 / np.concatenate([variance, np.tile([*drift, torque], count)])]
    for t in range(count):
        matrix.append(slope[t] @ motion[t])
        right.append(seen[t])
        weight.append(1.0 / noise[t])
        for k in np.flatnonzero(np.isfinite(doubt[t])):
            place = 5 + 4 * (k // 2)
            matrix.append((sight[t, k] @ motion[t][[place, place + 2]])[None])
            right.append(target[t, k : k + 1])
            weight.append(1.0 / doubt[t, k : k + 1])
    root = np.sqrt(np.concatenate(weight))
    causes = np.linalg.lstsq(
        np.concatenate(matrix) * root[:, None], np.concatenate(right) * root, rcond=None
    )[0]
    np.testing.assert_allclose(found, motion @ causes, rtol=1e-8, atol=1e-8)


def test_a_path_that_no_linkage_takes_is_refused():
    made = machine("C", 3e-4)
    measured, states = recorded(made)
    known = aligned(states)
    short = made.parameters()
    short[[Parameter.ROD_TO_B, Parameter.ROD_TO_C]] *= 0.3
    with pytest.raises(np.linalg.LinAlgError, match="do not reach"):
        reconstruct(measured, short, ("C",), known.speed, known.angle)


@pytest.mark.parametrize(("joint", "clearance"), [("C", 1e-4), ("C", 5e-4), ("B", 3e-4)])
def test_the_path_is_the_simulators_own(joint, clearance):
    made = machine(joint, clearance)
    measured, states = recorded(made)
    known = aligned(states)
    found = reconstruct(measured, made.parameters(), (joint,), known.speed, known.angle)
    truth = eccentricities(made, states, joint)[::SAMPLES]
    miss = np.hypot(*(in_nodes(found.nodes, joint, clearance) - truth).T) / clearance
    assert np.median(miss[5:-5]) < 0.05
    assert found.speed == pytest.approx(RPM * np.pi / 30.0, rel=1e-3)


def test_missing_friction_does_not_spoil_the_path():
    made = machine("C", 3e-4, guide_friction=StribeckGuide(coulomb_force=5.0))
    measured, states = recorded(made)
    known = aligned(states)
    nominal = machine("C", 3e-4)
    found = reconstruct(measured, nominal.parameters(), ("C",), known.speed, known.angle)
    truth = eccentricities(made, states, "C")[::SAMPLES]
    miss = np.hypot(*(in_nodes(found.nodes, "C", 3e-4) - truth).T) / 3e-4
    assert np.median(miss[5:-5]) < 0.1


@pytest.mark.parametrize(
    ("clearance", "laws"),
    [(1e-4, {}), (5e-4, {}), (3e-4, {"guide_friction": StribeckGuide(coulomb_force=5.0)})],
)
def test_the_motion_agrees_best_with_the_true_clearance(clearance, laws):
    measured, states = recorded(machine("C", clearance, **laws))
    found = profile([measured], [aligned(states)], lambda c: machine("C", c), 2)
    assert found.best == pytest.approx(clearance, rel=0.1)


@pytest.mark.parametrize("gap", [1e-5, 2e-5])
def test_a_slider_that_is_loose_in_its_guide_lies_where_it_is_pressed(monkeypatch, gap):
    told = tuple(s for s in SENSORS if s is not Signal.ROD_B_TRANSVERSE)  # nothing tells how it moves
    monkeypatch.setitem(globals(), "SENSORS", told)
    made = machine("C", 2e-4, guide=LooseGuide(gap=gap), guide_offset=1e-3)
    measured, states = recorded(made)
    known = aligned(states)
    nodes = reconstruct(measured, made.parameters(), ("C",), known.speed, known.angle).nodes
    found = nodes[:, State.SLIDER_Y]
    lift, true = found - 1e-3, states[::SAMPLES, State.SLIDER_Y][: len(found)] - 1e-3
    pressed = np.abs(true) > gap
    assert pressed.mean() > 0.25
    assert (np.sign(lift) == np.sign(true))[pressed].mean() > 0.9
    assert np.median(np.abs(lift - true)[pressed]) < 2e-6


def test_a_guide_line_out_of_reach_disagrees_without_end():
    made = machine("C", 3e-4)
    measured, states = recorded(made)
    known = aligned(states)
    within, beyond = (replace(made, guide_offset=offset) for offset in (0.065, 0.0699))
    near, far = agreement([measured], [known], [within, beyond], 130, 1)
    assert np.isfinite(near)
    assert far == np.inf


def test_a_machine_that_reaches_at_no_clearance_is_refused():
    measured, states = recorded(machine("C", 3e-4))
    with pytest.raises(np.linalg.LinAlgError, match="no clearance"):
        profile([measured], [aligned(states)], lambda c: replace(machine("C", c), guide_offset=0.0699), 1)


def test_a_long_recording_is_put_together_from_pieces(monkeypatch):
    measured, states = recorded(machine("C", 3e-4))
    known, made = aligned(states), machine("C", 3e-4).parameters()
    whole = reconstruct_whole(measured, made, ("C",), known.speed, known.angle)
    most, longest = -(-len(measured.values) // 3), []
    monkeypatch.setattr(pieces, "_LONGEST", most)
    reconstruct = pieces.reconstruct
    monkeypatch.setattr(
        pieces, "reconstruct", lambda one, *rest: longest.append(len(one.values)) or reconstruct(one, *rest)
    )
    found = reconstruct_whole(measured, made, ("C",), known.speed, known.angle)
    assert len(longest) == 3
    assert max(longest) <= most + 8
    assert found.nodes.shape == whole.nodes.shape
    apart = found.nodes[:, State.CRANK_ANGLE] - whole.nodes[:, State.CRANK_ANGLE]
    assert np.abs(apart).max() < 5e-3
    assert found.speed == pytest.approx(whole.speed, rel=5e-3)
    assert found.force == pytest.approx(whole.force, rel=0.1)


def test_a_path_that_leads_out_of_reach_is_put_together_from_pieces():
    """By a clock that is wrong the crank's phase gathers what accelerations and angle disagree in."""
    measured, states = recorded(machine("C", 1e-4))
    known = aligned(states)
    fast = measured.undone(Instrument(timebase=0.1))
    made = machine("C", 1e-4).parameters()
    with pytest.raises(np.linalg.LinAlgError):
        reconstruct(fast, made, ("C",), known.speed, known.angle)
    found = reconstruct_whole(fast, made, ("C",), known.speed, known.angle)
    assert found.nodes.shape[0] == len(fast.values)
    assert found.turning.shape == (4, SAMPLES * len(fast.values))
    assert np.isfinite(found.nodes).all()
    turned = found.nodes[-1, State.CRANK_ANGLE] - found.nodes[0, State.CRANK_ANGLE]
    assert turned == pytest.approx(known.speed * fast.seconds, rel=0.1)
