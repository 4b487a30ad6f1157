"""The simulator beside a recording of its own: innovations as stated, and a way back from nearby."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from clearance.compilation import entry
from clearance.diagnosis.following.attempt import FINE
from clearance.diagnosis.following.growth import BEFORE, ISLAND, landed
from clearance.diagnosis.following.horizon import Patience, advance, islands, step
from clearance.diagnosis.following.particles import ways_on
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.detectability import follower_on_path
from clearance.diagnosis.sensing.measured import NO_FAULT, SAMPLES, Measured
from clearance.diagnosis.shooting.chart import Chart
from clearance.diagnosis.shooting.covariance import covariance
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.follow import EDGE, Follower
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.diagnosis.shooting.normal_equations import assemble, solve_bounded
from clearance.diagnosis.shooting.stretch import INPUTS
from clearance.errors import InputError
from clearance.lanes import WIDTH
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.guide import LooseGuide, StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.recording import Recording
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import STATES, Signal, State
from clearance.simulation.shooting import fold
from clearance.simulation.trajectory import simulate_trajectory

CHAIN = MeasurementChain()
INTEGRATOR = Integrator("runge_kutta_4", 1e-5, 2)
CLEARANCE, RPM = 3e-4, 700.0
SEGMENTS = 60
SENSORS = (
    Signal.CRANK_B_TRANSVERSE, Signal.CRANK_B_AXIAL, Signal.ROD_B_TRANSVERSE, Signal.ROD_B_AXIAL,
    Signal.ROD_C_TRANSVERSE, Signal.ROD_C_AXIAL, Signal.SLIDER_HORIZONTAL, Signal.CRANK_ANGLE,
)  # fmt: skip
NOISE = 0.01  # of a channel's standard deviation
FORCES = np.array([1e-5, 1e-5, 1e-4])  # N m, N m, N: as good as none, which is what the data has
MACHINE = SliderCrank(joint_c=Joint(CLEARANCE), drive=SpeedControl(RPM, ramp=0.05))
SETTING = Setting(MACHINE, "C")
MODEL = SETTING.model()
TRUTH = np.array([[CLEARANCE, RPM]])


@entry
def fold_all(codes, p, states, nodes):
    s = np.zeros((STATES, p.shape[1]))
    for k in range(len(states)):
        s[:, 0] = states[k]
        fold(codes, p, s, 0, nodes[k])


@cache
def run(machine=MACHINE):
    """Filtered signals without noise, and the nodes at the segments' starts."""
    settled = 0.3
    trajectory = simulate_trajectory(machine, INTEGRATOR, settled + SEGMENTS * 1e-3 + 0.02)
    first = round(settled * CHAIN.base_rate)
    signals = trajectory.signals[first - 1000 :]
    values = CHAIN.apply(signals)[100 : 100 + SEGMENTS * SAMPLES]
    points = signals[1000 :: CHAIN.decimation][: len(values)]
    values[:, Signal.CRANK_ANGLE :] = points[:, Signal.CRANK_ANGLE :]
    nodes = np.zeros((SEGMENTS, STATES))
    states = trajectory.states[first :: SAMPLES * CHAIN.decimation][:SEGMENTS].copy()
    p = np.repeat(machine.parameters()[:, None], WIDTH, axis=1)
    fold_all(machine.codes(), p, states, nodes)
    return values, nodes


def follower(seed=0, machine=MACHINE, noise=NOISE, sensors=SENSORS):
    """At the true nodes of a noisy recording, whose noise it knows."""
    values, nodes = run(machine)
    rng = np.random.default_rng(seed)
    sigma = noise * values[:, list(sensors)].std(axis=0)
    if Signal.CRANK_ANGLE in sensors:
        sigma[sensors.index(Signal.CRANK_ANGLE)] = 4e-4
    noisy = values[:, list(sensors)] + sigma * rng.normal(size=(len(values), len(sensors)))
    names = tuple(s.name.lower() for s in sensors)
    measured = Measured.of(Recording(noisy, names, CHAIN.rate), CHAIN, "one")
    order = [sensors.index(Signal(s)) for s in measured.signals]
    one = Follower(replace(measured, sigma=sigma[order]), INTEGRATOR, FORCES.copy())
    one.path.nodes[:] = nodes
    return one


INSIDE = slice(6, -6)  # segments that feel nothing of what lies outside the recording


@pytest.mark.parametrize("looseness", [1.0, 0.1])
@pytest.mark.parametrize("seed", range(3))
def test_innovations_at_the_true_nodes_have_the_stated_spread(seed, looseness):
    found = follower(seed).look(MODEL.machine(TRUTH[0]), looseness=looseness).solve()
    assert found.samples == (SEGMENTS - 2 * EDGE) * SAMPLES * len(SENSORS)
    assert (found.spread >= 1.0).all()
    ratio = (found.innovation / found.spread)[INSIDE]
    # 3840 numbers whose squares have a variance of 2: four standard deviations are 9 %; the process noise,
    # of which the data has none, makes 4 % of difference
    assert (ratio**2).mean() == pytest.approx(1.0, abs=0.1)
    assert abs(ratio.mean()) < 4.0 / np.sqrt(ratio.size)
    # one after the other they have nothing in common
    neighbours = (ratio[1:] * ratio[:-1]).mean()
    assert abs(neighbours) < 4.0 / np.sqrt(ratio.size)
    assert found.local[INSIDE].mean() / (SAMPLES * len(SENSORS)) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_the_right_model_costs_one_a_sample_up_to_the_edges(seed):
    found = follower(seed).look(MODEL.machine(TRUTH[0]))
    assert found.cost / found.samples == pytest.approx(1.0, abs=0.08)  # four standard deviations of 4480


@pytest.mark.parametrize(
    "part",
    [
        INSIDE,
        slice(EDGE, -EDGE),
    ],
)
def test_without_noise_prediction_and_recording_agree(part):
    one = follower(noise=1e-9, sensors=SENSORS[:-1])
    found = one.look(MODEL.machine(TRUTH[0]))
    error = np.abs(found.residual[part]) * 1e-9 / NOISE  # in noise of one per cent
    axial = one.measured.channels.index("crank_b_axial")
    others = [i for i in range(error.shape[2]) if i != axial]
    assert error[..., others].max() < 0.1  # the solver's own share, DIAGNOSIS
    # the mean of this channel is 116 of its standard deviations, and the cut filter's gain off by 2.4e-5
    assert error[..., axial].max() < 0.4


def test_a_pass_is_the_linearisation_of_the_prediction():
    one = follower()
    machine = MODEL.machine(TRUTH[0])
    before = one.look(machine, MODEL.columns(TRUTH[0])[0])
    flow, _, _, own, _, _, jacobian, sensitivity, _ = before.system
    nz = len(before.chart.rows)
    rng = np.random.default_rng(2)
    change = np.zeros((SEGMENTS, nz + len(INPUTS)))
    change[:, :nz] = 1e-3 * rng.normal(size=(SEGMENTS, nz)) * before.chart.reach
    change[:, nz:] = rng.normal(size=(SEGMENTS, len(INPUTS)))
    step = np.array([1.0, -1.0])
    moved = TRUTH[0] + step * [MODEL.step(TRUTH[0], i) for i in range(2)]
    one.move(change, before.chart)
    after = one.look(MODEL.machine(moved))
    expected = np.einsum("krij,kj->kri", jacobian.reshape(SEGMENTS, 3, -1, nz + len(INPUTS)), change)
    predicted = expected[:, 1] + sensitivity @ step
    predicted[1:] += expected[:-1, 2]
    predicted[:-1] += expected[1:, 0]
    seen = (before.residual - after.residual).reshape(SEGMENTS, -1)[EDGE:-EDGE]
    predicted = predicted[EDGE:-EDGE]
    weight = before.used.reshape(SEGMENTS, -1)[EDGE:-EDGE]
    # what is left comes from motion more than a segment away, up to 5 % (see filter_weights' decay)
    assert np.sqrt(((seen * weight - predicted) ** 2).mean()) < 0.05 * np.sqrt((seen**2).mean())
    ends = np.einsum("kij,kj->ki", flow, np.concatenate([change, np.tile(step, (SEGMENTS, 1))], axis=1))[:-1]
    gap = (after.defect - before.defect)[:-1]
    nodes = np.einsum("kij,kj->ki", own[1:], change[1:, :nz])
    assert np.sqrt(((gap - ends + nodes) ** 2).mean()) < 0.02 * np.sqrt((gap**2).mean())


def disturbed(size, seed=0, machine=MACHINE):
    one = follower(seed, machine)
    chart = Chart.of(machine)
    change = np.random.default_rng(seed + 50).normal(size=(SEGMENTS, len(chart.rows)))
    one.path.nodes[:] = chart.moved(one.path.nodes, size * chart.reach * change)
    return one


@pytest.mark.parametrize("seed", range(3))
def test_a_fit_brings_disturbed_nodes_and_values_back(seed):
    one = disturbed(0.03, seed)
    machine = MODEL.machine(TRUTH[0])
    assert one.look(machine).cost > 50.0 * one.segments * SAMPLES * len(SENSORS)
    steps, values = [], TRUTH * [1.01, 1.0005]
    for _ in range(10):
        steps.append(found := fit([one], MODEL, values, 1, 1e-4, 1))
        values = found.values
    assert all(after.cost <= before.cost * (1.0 + 1e-9) for before, after in pairwise(steps))
    assert found.passes[0].local[INSIDE].mean() / (SAMPLES * len(SENSORS)) == pytest.approx(1.0, abs=0.1)
    deviations = known(found)
    assert deviations[0] < 1e-3 * CLEARANCE
    assert (np.abs(found.values[0] - TRUTH[0]) < 4.0 * deviations).all()
    # nodes lie within what the noise allows: the crank angle within a fraction of the encoder's
    assert np.abs(one.path.nodes[INSIDE, 2] - run()[1][INSIDE, 2]).max() < 4e-4
    ratio = (found.passes[0].innovation / found.passes[0].spread)[INSIDE]
    assert (ratio**2).mean() == pytest.approx(1.0, abs=0.1)


def known(found):
    """Standard deviations of all parameters."""
    return np.sqrt(np.diag(covariance(found)))


class Walled(Model):
    """Near the truth the machine exists, but none beside it from which to take derivatives."""

    def columns(self, values):
        if values[0] > 0.998 * CLEARANCE:
            raise InputError("beyond the wall")
        return super().columns(values)


def test_a_step_to_where_no_derivatives_can_be_taken_is_not_taken():
    walled = Walled(MODEL.unknowns, MODEL.machine)
    found = fit([follower()], walled, TRUTH * [0.99, 1.0], 4, 1e-4, 1)
    assert 0.99 * CLEARANCE <= found.values[0, 0] <= 0.998 * CLEARANCE


def test_two_recordings_share_the_clearance_and_have_their_own_speeds():
    faster = replace(MACHINE, drive=SpeedControl(760.0, ramp=0.05))
    both = [disturbed(0.01), disturbed(0.01, 1, faster)]
    start = np.array([[CLEARANCE * 1.005, RPM], [CLEARANCE * 1.005, 760.3]])
    found = fit(both, MODEL, start, 10, 1e-4, 2)
    assert found.values[0, 0] == found.values[1, 0]
    deviations = known(found)
    assert deviations.shape == (3,)
    errors = [found.values[0, 0] - CLEARANCE, found.values[0, 1] - RPM, found.values[1, 1] - 760.0]
    assert (np.abs(errors) < 4.0 * deviations).all()
    alone = fit([disturbed(0.01)], MODEL, start[:1], 10, 1e-4, 1)
    assert deviations[0] < known(alone)[0]


def test_a_wrong_clearance_and_missing_friction_are_felt():
    right = follower().look(MODEL.machine(TRUTH[0])).solve()
    friction = replace(MACHINE, guide_friction=StribeckGuide(coulomb_force=5.0))
    for data, values in ((MACHINE, TRUTH[0] * [1.02, 1.0]), (friction, TRUTH[0])):
        one = follower(machine=data)
        found = one.look(MODEL.machine(values)).solve()
        ratio, known = (((p.innovation / p.spread)[INSIDE] ** 2).mean() for p in (found, right))
        assert ratio > 3.0 * known
        assert found.cost > 3.0 * right.cost


def test_the_column_of_a_gain_is_the_predicted_signal_and_not_its_noise():
    one = follower(noise=0.3)
    channel = one.measured.channels[2]
    step = 1e-4
    found = one.look(MACHINE, [None], NO_FAULT, [NO_FAULT.changed("gain", 1.0 + step, channel)])
    rows = found.system[7].reshape(found.residual.shape)
    expected = step * found.predicted / one.measured.sigma * found.used
    expected[..., [i for i in range(len(one.measured.channels)) if i != 2]] = 0.0
    np.testing.assert_allclose(rows, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("fault", "value", "step"),
    [("resonance", 1500.0, 1.0), ("delay", 6e-5, 1e-7), ("gain", 1.3, 1e-4), ("misalignment", 6.0, 1e-3)],
)
def test_columns_about_a_fault_hold_nothing_of_the_noise(fault, value, step):
    def column(noise):
        one = follower(noise=noise)
        channel = one.measured.channels[2]
        about = NO_FAULT.changed(fault, value, channel)
        seen = about.apply(one.measured.recorded, one.measured.channels, CHAIN.rate)
        one.measured = replace(one.measured, recorded=seen, sigma=np.ones_like(one.measured.sigma))
        found = one.look(MACHINE, [None], about, [about.changed(fault, value + step, channel)])
        weight = one.measured.restored(about)[1] / np.where(found.used > 0.0, found.used, 1.0)
        rows = found.system[7].reshape(found.residual.shape) * weight
        return rows[INSIDE][..., 2]

    quiet, loud = column(1e-6), column(0.1)
    assert (loud - quiet).std() < 0.3 * quiet.std()  # the highest frequency alone is not delayed and back


def test_a_part_of_a_follower_is_its_own():
    one = follower()
    small = one.part(10, 40)
    assert small.segments == 30
    np.testing.assert_array_equal(small.path.nodes, one.path.nodes[10:40])
    small.path.nodes[:] = 0.0
    small.path.inputs[:] = 1.0
    np.testing.assert_array_equal(one.path.nodes, run()[1])
    assert not one.path.inputs.any()


def test_a_node_that_is_known_on_the_far_side_stays():
    one = follower()
    machine = MODEL.machine(TRUTH[0])
    one.look(machine)
    found = one.look(machine, first=20, last=35, inside=True, doubt=1e-3).solve()
    change = found.change(np.zeros(0))
    nz = len(found.chart.rows)
    assert np.abs(change[-1, :nz]).max() < 1e-2
    assert np.abs(change[0, :nz]).max() < 10.0
    assert np.abs(change[5:-5, :nz]).max() > 0.1


@pytest.mark.parametrize("seed", range(5))
def test_bounded_steps_are_the_best_within_their_bounds(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 4))
    information, score = root.T @ root, rng.normal(size=4)
    wide = solve_bounded(information, score, np.full(4, -np.inf), np.full(4, np.inf))
    np.testing.assert_allclose(wide, np.linalg.solve(information, score), rtol=1e-6)
    low, high = wide - 1.0, wide + 1.0
    low[0] = wide[0] + 0.1  # one bound is active
    high[0] = low[0] + 1.0
    found = solve_bounded(information, score, low, high)
    assert (found >= low - 1e-12).all()
    assert (found <= high + 1e-12).all()
    assert found[0] == low[0]
    slope = score - information @ found
    inside = (found > low) & (found < high)
    np.testing.assert_allclose(slope[inside], 0.0, atol=1e-7)


def test_islands_join_where_their_margins_touch():
    mask = np.zeros(30, dtype=bool)
    mask[[0, 10, 14, 29]] = True
    assert islands(mask, 2) == [(0, 3), (8, 17), (27, 30)]
    assert islands(np.zeros(5, dtype=bool), 2) == []


LOST = 3.0  # cost a sample


def misled(place, random):
    """A follower whose path goes elsewhere from a node on, since that node is a little wrong."""
    machine = SliderCrank(joint_c=Joint(8e-4), drive=SpeedControl(RPM, ramp=0.05))
    one, chart = follower(machine=machine), Chart.of(machine)
    node = one.path.nodes[place : place + 1]
    change = random.normal(size=(1, len(chart.rows))) * chart.doubt(node[0])
    change[:, 0] *= 0.01  # the encoder knows the crank's angle better than that
    node[:] = chart.moved(node, change)
    return one, Setting(machine, "C").model().held(np.array([8e-4, RPM]))


def followed(one, fixed, place):
    """Whether the segments before and at a place are followed."""
    found = one.compare(fixed.machine(np.zeros(0)), first=place - 6, last=place + 3)
    return bool((found.each[EDGE:-EDGE] < LOST).all())


def test_a_path_that_was_lost_at_an_impact_is_found_again():
    random, lost, found = np.random.default_rng(0), 0, 0
    for place in range(12, 46, 2):
        one, fixed = misled(place, random)
        before = one.path.copy()
        advance(one, fixed, place, SEGMENTS, Patience(0))
        if followed(one, fixed, place):
            continue
        lost += 1
        one.path = before
        patience = Patience(1, limit=LOST)
        advance(one, fixed, place, SEGMENTS, patience)
        assert patience.left == followed(one, fixed, place)
        found += patience.left
    assert lost >= 5
    assert found >= 0.8 * lost


@pytest.mark.parametrize("seed", range(6))
def test_what_is_hardly_seen_at_the_beginning_does_not_hold_the_parameters(seed):
    clearance, random = 9e-5, np.random.default_rng(seed)
    machine = SliderCrank(joint_c=Joint(clearance), drive=SpeedControl(RPM, ramp=0.05))
    one, chart = follower(seed, machine), Chart.of(machine)
    for place in range(3):
        node = one.path.nodes[place : place + 1]
        node[:] = chart.moved(node, 0.3 * random.normal(size=(1, len(chart.rows))) * chart.doubt(node[0]))
    model = Setting(machine, "C").model()
    found = fit([one], model, np.array([[1.01 * clearance, RPM]]), 20, 1e-5, 1)
    information, score = assemble(found.passes, model, found.values)
    step = np.linalg.solve(information, score) / known(found)
    assert (np.abs(step) < 0.3).all()


@pytest.mark.parametrize("known", [False, True])
def test_a_strike_of_a_shoe_is_found_by_drawing_its_height_and_the_gap_where_that_is_wrong(known):
    clearance, gap, island = 3.4e-4, 3.3e-4, 8
    guide = LooseGuide(gap=gap)
    machine = SliderCrank(joint_c=Joint(clearance), guide=guide, drive=SpeedControl(RPM, ramp=0.05))
    one = follower(machine=machine, sensors=(*SENSORS, Signal.SLIDER_VERTICAL))
    one.path.nodes[island + 12 :] = 0.0  # what comes is not known
    own = Setting(machine, "C").model().only([0], np.array([clearance, RPM]))
    unknowns = (*own.unknowns, Unknown("gap", 1e-9))
    model = Model(
        unknowns, lambda row: replace(own.machine(row[:1]), guide=replace(guide, gap=float(row[1])))
    )
    home = np.array([clearance, gap]) * (1.0 if known else (1.001, 1.01))
    one, lost, segment = landed(one, model.held(home), island), None, island + ISLAND
    while lost is None:
        lost = step(one, model.held(home), segment, SEGMENTS, LOST, island - BEFORE)
        segment += 1
    assert lost.place < island + 12
    deviations = np.array([0.01, 0.05]) * home
    if known:
        model, home, deviations = model.held(home), np.zeros(0), np.zeros(0)
    found = next(filter(None, ways_on(lost, model, home, home, deviations, 1.5)))
    truth = run(machine)[1][lost.place + 1]
    assert found.worst < 1.5
    assert found.path.nodes[lost.place + 1, State.SLIDER_Y] == pytest.approx(truth[State.SLIDER_Y], abs=1e-5)


@pytest.mark.parametrize("rate", [12_800.0, 51_200.0, 200_000.0, 10_000.5])
def test_recordings_of_any_rate_can_be_followed(rate):
    machine = SliderCrank(joint_c=Joint(2e-4))
    factor = max(1, round(1e5 / rate))
    follower = follower_on_path(machine, chain=MeasurementChain(base_rate=rate * factor, decimation=factor))
    follower.integrator = FINE
    seen = follower.compare(machine, NO_FAULT, first=0, last=24)
    assert np.isfinite(seen.cost)
    assert seen.cost / seen.samples < 0.1  # the recording has no noise
