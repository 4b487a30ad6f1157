"""Many runs in lockstep: the same numbers as one run alone, whatever the grouping; filtered as SciPy
filters."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.lanes import WIDTH
from clearance.mechanism.contact import LankaraniNikravesh
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.simulation.batch import Sampling, run_batch, simulate
from clearance.simulation.decimation import Decimation
from clearance.simulation.failure import Failure
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal
from clearance.simulation.trajectory import simulate_trajectory

CHAIN = MeasurementChain()
EULER = Integrator()


def sampling(start, duration, chain=CHAIN):
    return Sampling(chain.base_rate, chain.filter(), start, duration)


def machines(count):
    rng = np.random.default_rng(3)
    return [
        SliderCrank(
            joint_c=Joint(rng.uniform(1e-5, 1e-3)), drive=SpeedControl(rng.uniform(500, 1000), ramp=0.05)
        )
        for _ in range(count)
    ]


def collect(runs, when, integrator=EULER, **options):
    found = {}
    run_batch(
        runs,
        integrator,
        when,
        lambda i, x: found.update({i: x if isinstance(x, Failure) else x.copy()}),
        **options,
    )
    return [found[i] for i in range(len(runs))]


def test_a_run_does_not_depend_on_its_group_the_workers_or_the_order():
    runs = [*machines(WIDTH + 3), SliderCrank(joint_b=Joint(2e-4)), SliderCrank()]
    when = sampling(0.1, 0.05)
    together = collect(runs, when, workers=2)
    backwards = collect(runs[::-1], when, workers=1)[::-1]
    alone = [simulate(run, Integrator(), when) for run in (runs[0], runs[-2], runs[-1])]
    for a, b in zip(together, backwards, strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip((together[0], together[-2], together[-1]), alone, strict=True):
        np.testing.assert_array_equal(a, b)


def test_lockstep_agrees_with_one_run_and_scipys_filter():
    # a small clearance is not chaotic: rounding stays rounding (MECHANISM, last section)
    machine = SliderCrank(joint_c=Joint(5e-5), drive=SpeedControl(520.0, ramp=0.05))
    duration = 0.2
    fast = simulate(machine, Integrator(), sampling(0.0, duration))
    single = simulate_trajectory(machine, Integrator(), duration + 0.05)
    slow = CHAIN.apply(single.signals[:, :10])[: len(fast)]
    settled = slice(300, None)  # the two treat the time before the record differently
    scale = np.abs(slow[settled]).max()
    np.testing.assert_allclose(fast[settled, :10], slow[settled], atol=1e-6 * scale)
    points = single.signals[:: CHAIN.decimation, 10:][: len(fast)]
    np.testing.assert_allclose(fast[:, 10:], points, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("factor", [2, 5, 10, 20])
def test_filter_has_unit_gain_at_zero_frequency_and_scipys_impulse_response(factor):
    chain = MeasurementChain(decimation=factor)
    impulse = np.zeros((20001, 1))
    impulse[10000] = 1.0
    expected = chain.apply(impulse)[:, 0]
    filters = chain.filter()
    n = np.arange(len(expected)) * factor - 10000
    residues = filters.residues[0] + 1j * filters.residues[1]
    log_pole = np.log(filters.decay[0] + 1j * filters.decay[1]) / factor  # poles turn less than pi a block
    poles = np.exp(log_pole)
    ours = np.real(poles[None] ** np.abs(n)[:, None] @ residues) + filters.direct * (n == 0)
    np.testing.assert_allclose(ours, expected, atol=1e-9 * np.abs(expected).max())
    total = np.real(np.sum(residues * (1 + poles) / (1 - poles))) + filters.direct
    assert total == pytest.approx(1.0, abs=1e-9)


def test_filters_tail_is_the_published_one():
    # MECHANISM: 2 % at 1 ms, 0.06 % at 3 ms, of the response at 0
    filters = CHAIN.filter()
    residues = filters.residues[0] + 1j * filters.residues[1]
    poles = filters.decay[0] + 1j * filters.decay[1]

    def envelope(milliseconds):
        return sum(abs(r) * abs(p) ** (milliseconds * 10) for r, p in zip(residues, poles, strict=True))

    peak = residues.sum().real + filters.direct
    assert envelope(1.0) / peak < 0.1
    assert envelope(3.0) / peak < 0.002


def test_an_unfiltered_chain_gives_the_signals_at_full_rate():
    machine = SliderCrank(joint_c=Joint(5e-5), drive=SpeedControl(520.0, ramp=0.05))
    chain = MeasurementChain(decimation=1)
    fast = simulate(machine, Integrator(), sampling(0.02, 0.02, chain))
    single = simulate_trajectory(machine, Integrator(), 0.04)
    np.testing.assert_allclose(fast[:, :10], single.signals[2000:, :10], atol=1e-6 * np.abs(fast).max())


def test_a_recording_can_start_from_any_state():
    machine = SliderCrank(joint_c=Joint(5e-5), drive=SpeedControl(520.0, ramp=0.05))
    whole = simulate(machine, Integrator(), sampling(0.0, 0.2))
    halfway = simulate_trajectory(machine, Integrator(), 0.1 + 1e-5).states[-1]
    rest = collect([machine], sampling(0.0, 0.1), states=halfway[None])[0]
    settled = slice(300, None)
    np.testing.assert_allclose(
        rest[settled], whole[1000:][settled], rtol=1e-5, atol=1e-5 * np.abs(whole).max()
    )


def test_contact_refinement_takes_the_same_steps_alone_and_in_a_group():
    refined = Integrator("runge_kutta_4", 1e-5, 3)
    runs = machines(4)
    together = collect(runs, sampling(0.05, 0.02), refined)
    for machine, found in zip(runs, together, strict=True):
        np.testing.assert_array_equal(simulate(machine, refined, sampling(0.05, 0.02)), found)


def test_refinement_in_contact_brings_the_trajectory_closer():
    machine = SliderCrank(joint_c=Joint(1e-4), drive=SpeedControl(520.0, ramp=0.05))
    start = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-6), 0.15 + 1e-6, every=1).states[-1]

    def signal(step, refinement):
        run = simulate_trajectory(machine, Integrator("runge_kutta_4", step, refinement), 0.02, state=start)
        return run.signals[:: round(1e-5 / step), Signal.SLIDER_HORIZONTAL]

    exact = signal(5e-7, 1)
    coarse, refined = (np.abs(signal(1e-5, n) - exact).std() for n in (1, 4))
    assert refined < 0.3 * coarse


def test_a_run_that_blows_up_is_named_and_the_others_go_on():
    # a step far beyond the contact's stability limit
    wild = Integrator("semi_implicit_euler", 1e-3)
    chain = MeasurementChain(base_rate=1e3, decimation=1)
    gentle = SpeedControl(600.0, 0.05, 2.0)
    runs = [SliderCrank(drive=gentle), SliderCrank(joint_c=Joint(1e-4), drive=gentle)]
    calm, failed = collect(runs, sampling(0.5, 2.5, chain), wild)
    assert isinstance(calm, np.ndarray)
    assert isinstance(failed, Failure)
    assert 0.0 < failed.time < 3.2
    assert "LankaraniNikravesh of joint C" in str(failed)
    assert "crank_speed" in str(failed)
    assert "integrator.step" in str(failed)


def test_a_run_that_blows_up_before_it_is_recorded_is_named_too():
    stiff = SliderCrank(joint_c=Joint(1e-3, contact=LankaraniNikravesh(stiffness_scale=30.0)))
    machine = replace(stiff, drive=SpeedControl(1000.0))
    (failed,) = collect([machine], sampling(2.0, 0.1))
    assert isinstance(failed, Failure)
    assert 0.2 < failed.time < 2.0
    assert "LankaraniNikravesh of joint C" in str(failed)


@pytest.mark.parametrize(("step", "count"), [(1e-5, 1), (3e-6, 4), (2e-6, 5), (1e-3, 1)])
def test_a_sampling_period_is_divided_into_the_fewest_steps_that_are_short_enough(step, count):
    integrator = Integrator(step=step)
    assert integrator.substeps(1e-5) == count
    assert integrator.within(1e-5).step == pytest.approx(1e-5 / count)
    divided, whole = (
        simulate(SliderCrank(joint_c=Joint(1e-4)), Integrator(step=one), sampling(0.1, 0.01))
        for one in (step, 1e-5 / count)
    )
    np.testing.assert_array_equal(divided, whole)


def test_no_filter_is_no_filter():
    assert Decimation.none().factor == 1
    assert Decimation.none().direct == 1.0
