"""Runs from nodes: nodes and states are the same thing, and each run is the one that it claims to be."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.compilation import entry
from clearance.lanes import WIDTH
from clearance.mechanism.applied_force import CONSTANTS, DIRECTIONS, TabulatedForce
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.guide import LooseGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.link import FlexibleRod
from clearance.mechanism.parameters import PARAMETERS, Family, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import aligned
from clearance.simulation.integrator import Integrator
from clearance.simulation.kinematics import project
from clearance.simulation.layout import SIGNALS, STATES, Result, Signal, State
from clearance.simulation.shooting import (
    ECCENTRICITY_B,
    ECCENTRICITY_C,
    WORK_ROWS,
    coast,
    fold,
    shoot,
    unfold,
)
from clearance.simulation.trajectory import simulate_trajectory

B = SliderCrank(joint_b=Joint(2e-4), drive=SpeedControl(700.0, ramp=0.0))
C = SliderCrank(joint_c=Joint(3e-4), drive=SpeedControl(700.0, ramp=0.0))
BOTH = replace(C, joint_b=Joint(2e-4))
SHAKING = {"frame": FlexibleFrame(), "link": FlexibleRod(), "guide": LooseGuide()}
MACHINES = {
    "ideal": replace(C, joint_c=Joint()),
    "B": replace(B, guide_offset=0.004),
    "C": replace(C, guide_offset=-0.004),
    "both": BOTH,
    "B, loose guide": replace(B, guide=LooseGuide()),
    "C, flexible frame": replace(C, frame=FlexibleFrame()),
    "C, flexible rod": replace(C, link=FlexibleRod()),
    "both, everything": replace(BOTH, **SHAKING),
}
RUNGE_KUTTA = Integrator("runge_kutta_4", 1e-5, 2)
SAMPLES, PERIODS = 10, 100  # of a segment
POINTS = np.arange(Signal.CRANK_ANGLE, SIGNALS)
FILTERED = np.arange(Signal.CRANK_ANGLE)
WEIGHTS = np.random.default_rng(1).normal(size=(3 * SAMPLES, PERIODS))


@entry
def fold_lane(codes, p, s, node):
    fold(codes, p, s, 3, node)


@entry
def unfold_lane(codes, p, node, s):
    unfold(codes, p, node, s, 3)
    project(codes, p, s)


def parameters_of(machine):
    p = aligned(PARAMETERS)
    p[:] = machine.parameters()[:, None]
    return p


def to_node(machine, state):
    s, node = aligned(STATES), np.zeros(STATES)
    s[:] = state[:, None]
    fold_lane(machine.codes(), parameters_of(machine), s, node)
    return node


def to_state(machine, node):
    s = aligned(STATES)
    s[State.CRANK_COSINE] = s[State.ROD_COSINE] = 1.0  # lanes that are not looked at
    unfold_lane(machine.codes(), parameters_of(machine), node, s)
    return s[:, 3].copy()


def motion(machine, duration=0.03, start=0.05, integrator=RUNGE_KUTTA):
    """A trajectory that has left its start behind."""
    settled = simulate_trajectory(machine, integrator, start).states[-1]
    return simulate_trajectory(machine, integrator, duration, state=settled)


class Shot:
    """What ``shoot`` writes for runs of a machine from nodes."""

    def __init__(self, machine, nodes, machines=(), varied=(), rows=(), inputs=None, codes=None):
        n, runs = len(nodes), 1 + len(machines) + len(varied)
        p = np.repeat(machine.parameters()[:, None], runs, axis=1)
        for run, changed in enumerate(machines, 1):
            p[:, run] = changed.parameters()
        before = p.copy()
        row, change = np.full(runs, -1), np.zeros(runs)
        for run, (which, amount) in enumerate(varied, 1 + len(machines)):
            row[run], change[run] = which, amount
        self.ends, self.signals = np.zeros((n, runs, STATES)), np.zeros((n, PERIODS, SIGNALS))
        self.contacts = np.zeros((n, SAMPLES, 4))
        self.blocks = np.full((n, 3 * SAMPLES, len(FILTERED), runs), np.nan)
        self.samples = np.zeros((n, SAMPLES, len(POINTS), runs))
        inputs = np.zeros((n, len(rows))) if inputs is None else np.asarray(inputs, dtype=float)
        codes = machine.codes() if codes is None else codes
        shoot(
            codes, p, np.array(nodes), row, change, np.array(rows, dtype=np.int64), inputs, RUNGE_KUTTA.code,
            1e-5, 1, 2, PERIODS, FILTERED, POINTS, WEIGHTS, aligned(WORK_ROWS), self.ends, self.signals,
            self.contacts, self.blocks, self.samples,
        )  # fmt: skip
        np.testing.assert_array_equal(p, before)


def size_of(columns):
    """Typical size of each column, at least a millionth of the largest."""
    size = np.sqrt((columns**2).mean(axis=0))
    return np.maximum(size, 1e-6 * size.max())


def differing(found, expected, rows=slice(None)):
    """Largest difference, each column measured by its own size."""
    return (np.abs(found - expected) / size_of(expected))[..., rows].max()


def random_nodes(machine, count=20):
    """Nodes of any kind, made from the coordinates that are free."""
    rng = np.random.default_rng(0)
    codes = machine.codes()
    nodes = np.zeros((count, STATES))

    def fill(rows, sizes):
        nodes[:, rows] = rng.normal(size=(count, len(rows))) * sizes

    fill([State.CRANK_ANGLE, State.CRANK_SPEED], [3.0, 70.0])
    fill([State.DRIVE_INTEGRAL, State.TIME], [1e-2, 1.0])
    for family, (i, j), memory in (
        (Family.JOINT_B, ECCENTRICITY_B, State.MEMORY_B),
        (Family.JOINT_C, ECCENTRICITY_C, State.MEMORY_C),
    ):
        if codes[family]:
            fill([i, j, i + 10, j + 10, memory], [0.6, 0.6, 1e3, 1e3, 0.1])
    if codes[Family.GUIDE]:
        fill([State.SLIDER_Y, State.SLIDER_Y_RATE], [1e-4, 1e-2])
        fill([State.SLIDER_ANGLE, State.SLIDER_SPEED], [1e-3, 1.0])
    if codes[Family.FRAME]:
        fill([State.FRAME_X, State.FRAME_Y], [1e-3, 1e-3])
        fill([State.FRAME_X_RATE, State.FRAME_Y_RATE], [0.1, 0.1])
    if codes[Family.LINK]:
        fill([State.ROD_MODE, State.ROD_MODE_RATE], [1e-5, 0.1])
    return nodes


@pytest.mark.parametrize("name", MACHINES)
def test_folding_undoes_unfolding(name):
    machine = MACHINES[name]
    held = machine.codes()[Family.GUIDE] == 0
    for node in random_nodes(machine):
        if held:  # the slider follows the frame; its rows in a node say nothing
            node[State.SLIDER_Y] = node[State.FRAME_Y] + machine.guide_offset
            node[State.SLIDER_Y_RATE] = node[State.FRAME_Y_RATE]
        found = to_node(machine, to_state(machine, node))
        # rounding of places of 0.2 m and rates of 10 m/s over a clearance of 2e-4 m
        places, rates = slice(0, 10), slice(10, 20)
        np.testing.assert_allclose(found[places], node[places], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(found[rates], node[rates], rtol=0.0, atol=1e-10)
        np.testing.assert_array_equal(found[20 : State.TIME + 1], node[20 : State.TIME + 1])


@pytest.mark.parametrize("name", MACHINES)
def test_unfolding_undoes_folding_along_a_run(name):
    machine = MACHINES[name]
    states = motion(machine).states[::50]
    found = np.array([to_state(machine, to_node(machine, state)) for state in states])
    np.testing.assert_allclose(found, states, rtol=1e-13, atol=1e-13)


def test_eccentricities_of_a_node_are_penetrations_over_clearance():
    run = motion(BOTH)
    for state, result in zip(run.states[::40], run.results[::40], strict=True):
        node = to_node(BOTH, state)
        for pair, joint, row in (
            (ECCENTRICITY_B, BOTH.joint_b, Result.PENETRATION_B),
            (ECCENTRICITY_C, BOTH.joint_c, Result.PENETRATION_C),
        ):
            distance = np.hypot(*node[list(pair)]) - 1.0
            assert distance * joint.clearance == pytest.approx(result[row], abs=1e-15)


@pytest.mark.parametrize("name", MACHINES)
def test_segments_one_after_the_other_are_the_run(name):
    machine, segments = MACHINES[name], 6
    run = motion(machine, (segments * PERIODS + 1) * 1e-5)
    node = to_node(machine, run.states[0])
    signals, ends, contacts = [], [], []
    for _ in range(segments):
        shot = Shot(machine, [node])
        node = shot.ends[0, 0]
        signals.append(shot.signals[0])
        contacts.append(shot.contacts[0])
        ends.append(to_state(machine, node))
    whole = slice(None, segments * PERIODS)
    # a node's rounding of 1e-17 m against penetrations of 1e-7 m is 1e-10 of the force; chaos makes it more
    assert differing(np.concatenate(signals), run.signals[whole]) < 1e-6
    expected = run.states[PERIODS::PERIODS]
    assert differing(np.array(ends), expected, slice(0, State.DRIVE_INTEGRAL)) < 1e-8
    np.testing.assert_allclose(np.array(ends)[:, State.TIME], expected[:, State.TIME])
    rows = [Result.PENETRATION_B, Result.NORMAL_FORCE_B, Result.PENETRATION_C, Result.NORMAL_FORCE_C]
    seen = run.results[whole][:: PERIODS // SAMPLES, rows]
    np.testing.assert_allclose(np.concatenate(contacts), seen, rtol=1e-6, atol=1e-6 * np.abs(seen).max())


def test_segments_from_their_own_nodes_do_not_depend_on_each_other():
    run = motion(C)
    nodes = [to_node(C, state) for state in run.states[::PERIODS]]
    together, alone = Shot(C, nodes, [C, C]), Shot(C, nodes[7:8], [C, C])
    for part in ("ends", "signals", "contacts", "blocks", "samples"):
        np.testing.assert_array_equal(getattr(together, part)[7:8], getattr(alone, part))
    np.testing.assert_array_equal(together.ends, together.ends[:, :1].repeat(3, axis=1))
    assert differing(together.ends[:-1, 0], np.array(nodes[1:]), slice(0, State.TIME)) < 1e-6


def test_blocks_are_the_weighted_signals_and_samples_every_tenth():
    nodes = [to_node(C, state) for state in motion(C).states[::PERIODS]]
    shot = Shot(C, nodes, [C] * WIDTH)
    expected = WEIGHTS @ shot.signals[:, :, FILTERED]
    scale = np.abs(expected).max(axis=(0, 1)) + 1e-9
    for run in (0, 1, WIDTH):
        assert (np.abs(shot.blocks[..., run] - expected) / scale).max() < 1e-12
        points = shot.signals[:, :: PERIODS // SAMPLES, Signal.CRANK_ANGLE :]
        np.testing.assert_array_equal(shot.samples[..., run], points)


CHANGES = {
    "clearance": {"joint_c": Joint(3.3e-4)},
    "offset": {"guide_offset": 1e-3},
    "gravity": {"gravity": (1.0, -9.81)},
    "speed": {"drive": SpeedControl(720.0, ramp=0.0)},
    "masses": {"slider": replace(C.slider, mass=0.2)},
}


@pytest.mark.parametrize("start", [0.051, 0.062])
def test_a_run_with_changed_parameters_is_one_of_the_changed_machine(start):
    machines = [replace(C, **change) for change in CHANGES.values()]
    node = to_node(C, motion(C, 1e-5, start).states[0])
    shot = Shot(C, [node], machines)
    assert differing(shot.ends[0, 0], Shot(C, [node]).ends[0, 0]) == 0.0
    for place, machine in enumerate(machines, 1):
        run = simulate_trajectory(machine, RUNGE_KUTTA, (PERIODS + 1) * 1e-5, state=to_state(machine, node))
        check_run(shot, place, machine, run)
        assert np.abs(shot.ends[0, place] - shot.ends[0, 0]).max() > 1e-9


def check_run(shot, place, machine, run):
    end = to_state(machine, shot.ends[0, place])
    np.testing.assert_allclose(end[: State.TIME], run.states[-1, : State.TIME], rtol=1e-8, atol=1e-9)
    expected = WEIGHTS @ run.signals[:PERIODS, FILTERED]
    scale = np.abs(expected).max(axis=0) + 1e-6 * np.abs(expected).max()
    assert (np.abs(shot.blocks[0, ..., place] - expected) / scale).max() < 1e-6
    points = run.signals[: PERIODS : PERIODS // SAMPLES, Signal.CRANK_ANGLE :]
    np.testing.assert_allclose(shot.samples[0, ..., place], points, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", ["both", "both, everything"])
def test_a_run_with_a_changed_coordinate_is_one_from_the_changed_node(name):
    machine = MACHINES[name]
    node = to_node(machine, motion(machine, 1e-5).states[0])
    rows = [State.CRANK_ANGLE, State.CRANK_SPEED, *ECCENTRICITY_B, ECCENTRICITY_C[0] + 10]
    varied = [(row, 1e-3 * max(abs(node[row]), 1e-3)) for row in rows]
    shot = Shot(machine, [node], varied=varied)
    for place, (row, amount) in enumerate(varied, 1):
        changed = node.copy()
        changed[row] += amount
        run = simulate_trajectory(
            machine, RUNGE_KUTTA, (PERIODS + 1) * 1e-5, state=to_state(machine, changed)
        )
        check_run(shot, place, machine, run)


FORCES = {
    ("crank", "torque"): 0.5,
    ("rod", "moment"): 0.2,
    ("slider", "x"): 4.0,
    ("rod", "y"): 3.0,
    ("joint_c", "normal"): -2.0,
}


@pytest.mark.parametrize(("place", "force"), FORCES.items(), ids=map("_".join, FORCES))
def test_an_input_is_a_constant_applied_force(place, force):
    row = Parameter.FORCE_CRANK_TORQUE + DIRECTIONS.index(place)
    forced = replace(C, force=TabulatedForce(*place, values=(force,)))
    node = to_node(C, motion(C, 1e-5).states[0])
    codes = forced.codes()
    shot = Shot(C, [node, node, node], rows=[row], inputs=[[force], [0.0], [2.0 * force]], codes=codes)
    run = simulate_trajectory(forced, RUNGE_KUTTA, (PERIODS + 1) * 1e-5, state=to_state(C, node))
    check_run(shot, 0, forced, run)
    free = Shot(C, [node])
    np.testing.assert_allclose(shot.ends[1], free.ends[0], rtol=1e-9, atol=1e-9)
    assert np.abs(shot.ends[0] - free.ends[0]).max() > 1e-9


@pytest.mark.parametrize("name", MACHINES)
def test_segments_side_by_side_are_those_with_derivatives(name):
    machine, row = MACHINES[name], Parameter.FORCE_SLIDER_X
    nodes = np.array([to_node(machine, state) for state in motion(machine).states[::PERIODS]])[:21]
    assert len(nodes) % WIDTH
    forces = np.linspace(-5.0, 5.0, len(nodes))[:, None]
    codes = machine.codes()
    codes[Family.FORCE] = CONSTANTS
    shot = Shot(machine, nodes, [machine, machine], rows=[row], inputs=forces, codes=codes)
    ends, signals = np.zeros((len(nodes), STATES)), np.zeros((len(nodes), PERIODS, SIGNALS))
    contacts, p = np.zeros((len(nodes), SAMPLES, 4)), machine.parameters()
    coast(
        codes, p, nodes, np.array([row]), forces, RUNGE_KUTTA.code, 1e-5, 1, 2, PERIODS // SAMPLES,
        aligned(WORK_ROWS), ends, signals, contacts,
    )  # fmt: skip
    np.testing.assert_array_equal(ends, shot.ends[:, 0])
    np.testing.assert_array_equal(signals, shot.signals)
    np.testing.assert_array_equal(contacts, shot.contacts)
    np.testing.assert_array_equal(p, machine.parameters())


def test_constants_act_without_a_table():
    row, node = Parameter.FORCE_SLIDER_X, to_node(C, motion(C, 1e-5).states[0])
    with_table = replace(C, force=TabulatedForce(values=(0.0,))).codes()
    without = with_table.copy()
    without[Family.FORCE] = CONSTANTS
    ends = [Shot(C, [node], rows=[row], inputs=[[4.0]], codes=codes).ends for codes in (with_table, without)]
    np.testing.assert_array_equal(*ends)
    assert np.abs(ends[0] - Shot(C, [node]).ends).max() > 1e-9


def test_inputs_add_to_what_a_run_already_has():
    row = Parameter.FORCE_SLIDER_X
    node = to_node(C, motion(C, 1e-5).states[0])
    codes = replace(C, force=TabulatedForce(values=(1.0,))).codes()
    p = np.repeat(C.parameters()[:, None], 2, axis=1)
    p[row, 1] = 1.5
    machine = replace(C, force=TabulatedForce(values=(4.0,)))
    ends = np.zeros((1, 2, STATES))
    shoot(
        codes, p, node[None], np.full(2, -1), np.zeros(2), np.array([row]), np.array([[2.5]]),
        RUNGE_KUTTA.code, 1e-5, 1, 2, PERIODS, FILTERED, POINTS, WEIGHTS, aligned(WORK_ROWS), ends,
        np.zeros((1, PERIODS, SIGNALS)), np.zeros((1, SAMPLES, 4)),
        np.zeros((1, 3 * SAMPLES, len(FILTERED), 2)), np.zeros((1, SAMPLES, len(POINTS), 2)),
    )  # fmt: skip
    run = simulate_trajectory(machine, RUNGE_KUTTA, (PERIODS + 1) * 1e-5, state=to_state(C, node))
    end = to_state(C, ends[0, 1])
    np.testing.assert_allclose(end[: State.TIME], run.states[-1, : State.TIME], rtol=1e-8, atol=1e-9)
