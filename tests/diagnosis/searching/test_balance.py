"""The balance of work: which force the motion needs, whatever happens in the joints."""

from copy import copy
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.free_form import lasting
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.hypotheses.two_levels import levels_of, two_levels
from clearance.diagnosis.kinematics.agreement import aligned
from clearance.diagnosis.kinematics.regression import regressed
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.searching.balance import (
    _inertia_force,
    find_clock,
    settle_clocks,
    settle_in,
    suggest_forces,
    suggest_names,
)
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.work import Balance
from clearance.diagnosis.sensing.demonstration import record
from clearance.diagnosis.sensing.measured import Measured, chain_of
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.drive import DirectCurrentMotor, SpeedControl, TorqueRipple
from clearance.mechanism.guide import StribeckGuide
from clearance.mechanism.load import ConstantProcess, LinearSpring
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.layout import State

SETTING = Setting(SliderCrank(), "C")
NOMINAL = replace(SETTING.with_clearance(3e-4), drive=SpeedControl(700.0, ramp=0.1))
EFFECTS = [
    "guide_friction", "slider_spring", "soft_drive", "torque_ripple", "rod_inertia",
    "contact_stiffness", "process_load",
]  # fmt: skip


@cache
def traced(machine, setting=SETTING):
    """A search after its first step, for a recording of a machine."""
    recording = record(machine, 4)
    measured = Measured.of(recording, chain_of(recording, "one"), "one").part(0, 200)
    nominal = setting.with_clearance(3e-4)
    groups = gather(load_effects(EFFECTS), nominal, "C", measured.channels)
    search = Search(
        [measured], [aligned(measured, nominal, (50.0, 150.0))], setting, groups, 1, lambda _: None
    )
    search.trace()
    return search


def suggested(search, setting=SETTING):
    """What the balance says of the machine as it is."""
    return suggest_forces(search, setting, search.profile.best)


def test_a_machine_that_lacks_nothing_needs_no_force():
    assert suggested(traced(NOMINAL)).forces == []


def test_the_slowest_recording_says_what_inertia_forces_there_are_whichever_way_the_crank_turns():
    def force(*speeds):
        search = SimpleNamespace(alignments=[SimpleNamespace(speed=speed) for speed in speeds])
        return _inertia_force(search, SETTING.machine)

    assert force(-70.0, -140.0) == force(70.0, 140.0) == force(140.0, -70.0)


@pytest.mark.slow
def test_a_nominal_motor_whose_voltage_nobody_knows_accuses_no_force():
    motor = Setting(replace(SETTING.machine, drive=DirectCurrentMotor(8.0, 700.0)), "C")
    machine = replace(motor.with_clearance(3e-4), drive=DirectCurrentMotor(8.0, 760.0))
    assert suggested(traced(machine, motor), motor) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("laws", "name", "values"),
    [
        ({"spring": LinearSpring(400.0, 0.11)}, "slider_spring", [400.0, 0.11]),
        ({"drive": SpeedControl(700.0, 1.5, 40.0, ramp=0.1)}, "soft_drive", [1.5, 40.0]),
        ({"guide_friction": StribeckGuide(coulomb_force=8.0)}, "guide_friction", [8.0]),
        ({"ripple": TorqueRipple(1.5, 3.0, 0.7)}, "torque_ripple", [1.5, 3.0]),
        ({"drive": DirectCurrentMotor(8.0, 740.0)}, "soft_drive", [8.0]),
    ],
)
def test_a_force_is_named_from_the_motion_alone(laws, name, values):
    best = suggested(traced(replace(NOMINAL, **laws))).forces[0]
    assert [h.name for h in best.hypotheses] == [name]
    np.testing.assert_allclose(best.values[: len(values)], values, rtol=0.1)


@pytest.mark.parametrize(("noise", "blind"), [(5.0, False), (30.0, True)])
def test_where_the_scatter_would_hide_a_force_nothing_is_called_balanced(noise, blind):
    clean = traced(NOMINAL)
    (measured,) = clean.recordings
    sigma = noise * measured.sigma
    values = measured.values + sigma * np.random.default_rng(3).normal(size=measured.values.shape)
    search = copy(clean)
    search.recordings = [replace(measured, values=values, sigma=sigma)]
    found = suggest_forces(search, SETTING, 3e-4)
    assert (found.blind, found.balanced) == (blind, not blind)
    assert found.forces == []


def test_gravity_that_the_sensors_feel_is_a_force_that_the_machine_lacks():
    search = traced(replace(NOMINAL, gravity=(-9.81, 0.0)))
    balance = Balance(search, SETTING, SETTING.with_clearance(3e-4), 3e-4)
    (gravity,) = gather(load_effects(["gravity"]), NOMINAL, "C", ())["gravity(gravity_x)"]
    found = balance.best([gravity])
    assert found.values[0] == pytest.approx(-9.81, rel=0.1)
    assert found.cost < 0.3 * balance.fit((), np.zeros(0)).cost


@pytest.mark.slow
def test_a_load_moves_the_journal_and_with_it_the_clearance():
    search = traced(replace(NOMINAL, spring=LinearSpring(400.0, 0.11)))
    assert search.profile.best != pytest.approx(3e-4, rel=0.04)
    settled = settle_in(search, SETTING, suggested(search).forces[0])
    assert settled.clearance == pytest.approx(3e-4, rel=0.03)
    assert settled.values[0] == pytest.approx(400.0, rel=0.03)


def test_a_load_over_a_part_of_the_stroke_begins_and_ends_where_it_does():
    search = traced(replace(NOMINAL, process=ConstantProcess(12.0, 0.1096, 0.1476)))
    balance = Balance(search, SETTING, SETTING.with_clearance(3e-4), 3e-4)
    found = balance.best(search.groups["process_load(force, start, end)"])
    assert found.values[0] == pytest.approx(12.0, rel=0.05)
    np.testing.assert_allclose(found.values[1:], [0.1096, 0.1476], atol=1e-3)  # of a stroke of 0.1 m


def test_a_load_beside_a_spring_is_found_where_the_one_alone_spans_the_stroke():
    search = traced(
        replace(NOMINAL, spring=LinearSpring(700.0, 0.106), process=ConstantProcess(27.0, 0.1065, 0.143))
    )
    balance = Balance(search, SETTING, SETTING.with_clearance(3e-4), 3e-4)
    spring, load = (search.groups[label][0] for label in (
        "slider_spring(stiffness, free_position)", "process_load(force, start, end)",
    ))  # fmt: skip
    alone = [balance.best([spring]), balance.best([load])]
    assert alone[1].values[2] > 0.16  # it does some of what the spring does
    found = balance.together(*alone)
    np.testing.assert_allclose(found.values[:2], [700.0, 0.106], rtol=0.15)
    np.testing.assert_allclose(found.values[3:], [0.1065, 0.143], atol=3e-3)


@pytest.mark.parametrize("speed", [None, 950.0])  # what the drive is asked for is not the table's
def test_a_table_is_known_for_the_load_that_it_is(speed):
    machine = SETTING.with_clearance(3e-4)
    if speed is not None:
        machine = replace(machine, drive=SpeedControl(speed, ramp=0.1))
    place = np.linspace(0.06, 0.16, 12)
    force = np.where((place > 0.0999) & (place < 0.1401), -9.0, 0.0)
    law = TabulatedForce("slider", "x", "slider_position", 0.06, place[1] - place[0], tuple(force))
    likeliest = suggest_names(traced(NOMINAL), replace(machine, force=law), 3e-4)[0]
    assert likeliest.label == "process_load(force, start, end)"
    np.testing.assert_allclose(likeliest.values, [9.0, 0.1, 0.14], rtol=0.06)


def test_a_table_is_known_for_the_two_loads_that_it_is():
    machine = SETTING.with_clearance(3e-4)
    place = np.linspace(0.06, 0.172, 12)
    force = -258.0 * (place - 0.1117) - np.where((place > 0.104) & (place < 0.156), 8.7, 0.0)
    law = TabulatedForce("slider", "x", "slider_position", 0.06, place[1] - place[0], tuple(force))
    both = suggest_names(traced(NOMINAL), replace(machine, force=law), 3e-4)[0]
    values = {
        unknown.name: value
        for unknown, value in zip((u for h in both.hypotheses for u in h.unknowns), both.values, strict=True)
    }
    assert {h.name for h in both.hypotheses} == {"slider_spring", "process_load"}
    assert values["stiffness"] == pytest.approx(258.0, rel=0.1)
    assert values["force"] == pytest.approx(8.7, rel=0.1)


@pytest.mark.slow
def test_two_forces_at_once():
    both = replace(NOMINAL, spring=LinearSpring(400.0, 0.11), ripple=TorqueRipple(1.5, 3.0, 0.7))
    best = suggested(traced(both)).forces[0]
    assert {h.name for h in best.hypotheses} == {"slider_spring", "torque_ripple"}


@pytest.mark.slow
def test_a_force_by_a_clock_of_its_own_is_a_table_over_time_that_repeats():
    wave = tuple(9.0 * np.sin(2.0 * np.pi * np.arange(24) / 24))
    law = TabulatedForce("slider", "x", "time", 0.0, None, wave, "cubic", period=0.037)
    search = traced(replace(NOMINAL, force=law))
    best = suggested(search).forces[0]
    assert (best.curve.body, best.curve.argument) == ("slider", "time")
    assert best.rhythm.period == pytest.approx(0.037, rel=0.01)
    with search.timed(best.rhythm):
        first = search.retrace(0, SETTING.with_clearance(3e-4)).follower(0.1)
    assert search.recordings[0].period == 0.0
    assert first.measured.period == best.rhythm.period


@pytest.mark.slow
def test_a_force_that_jumps_is_timed_better_beside_the_motion_that_it_makes():
    law = TabulatedForce("slider", "x", "time", 0.0035, 8e-4, (-12.0, 12.0), period=0.037, returns=0.0193)
    search = traced(replace(NOMINAL, force=law))
    best = next(one for one in suggested(search).forces if one.rhythm is not None)
    levels = levels_of(best.curve)

    def force(period):
        return two_levels(lasting(best.curve, period), levels)

    begun = replace(best, hypotheses=(force(best.curve.period),), values=levels, curve=None)
    with search.timed(best.rhythm):
        settled = settle_clocks(search, SETTING, settle_in(search, SETTING, begun), force)
    assert abs(settled.rhythm.period - 0.037) < abs(best.rhythm.period - 0.037)
    assert settled.cost < best.cost
    assert settled.clearance == pytest.approx(3e-4, rel=0.05)
    high, low, rises, falls, _ = settled.values
    assert (high, low) == (pytest.approx(12.0, abs=1.0), pytest.approx(-12.0, abs=1.0))
    assert (falls - rises) % 1.0 == pytest.approx((0.0193 - 8e-4) / 0.037, abs=0.02)


def test_what_comes_again_by_its_own_clock_is_seen_where_the_scatter_hides_all_else(monkeypatch):
    """A force that changes as fast as impacts are strong is scatter, too, unless its period is asked for."""
    wave = tuple(np.random.default_rng(63).normal(0.0, 14.0, 24))
    law = TabulatedForce("slider", "x", "time", 0.0, None, wave, "cubic", period=0.037)
    search = traced(replace(NOMINAL, force=law))
    monkeypatch.setattr("clearance.diagnosis.searching.balance._BALANCED", np.inf)
    monkeypatch.setattr("clearance.diagnosis.searching.balance._FAINT", 0.0)
    found = suggested(search)
    assert found.forces[0].rhythm.period == pytest.approx(0.037, rel=0.01)
    assert (found.blind, found.balanced) == (False, False)


@pytest.mark.parametrize("clock", [0.0, 0.013])
def test_a_stretch_is_followed_by_its_recordings_clock_for_a_period_at_least(clock):
    search = traced(NOMINAL)
    machine = SETTING.with_clearance(3e-4)
    short = search.retrace(0, machine)
    with search.timed(Rhythm(0.15, (clock,))):
        later = replace(search.recordings[0].part(20, 200), name="later")
        trace = search.retrace(0, machine)
    own = trace.follower(0.1)
    assert short.length < 0.15 / own.measured.segment <= trace.length <= len(own.path.nodes)
    time = own.path.nodes[:, State.TIME]
    np.testing.assert_allclose(time[0], clock + own.measured.first * own.measured.segment)
    np.testing.assert_allclose(np.diff(time), own.measured.segment)
    assert later.begin == pytest.approx(clock + 20 * later.segment)


@pytest.mark.slow
def test_a_table_whose_load_the_reconstruction_counts_is_found_again_beside_it():
    velocity = np.linspace(-4.5, 4.5, 12)
    drag = tuple(-2.8 * velocity)
    law = TabulatedForce("slider", "x", "slider_velocity", -4.5, velocity[1] - velocity[0], drag)
    search = traced(replace(NOMINAL, force=law))
    tables = Balance(search, SETTING, SETTING.with_clearance(3e-4), 3e-4).tables(np.inf, np.inf)
    table = next(one for one in tables if one.curve.argument == "slider_velocity")
    settled = settle_in(search, SETTING, table)
    inner = slice(2, -2)
    np.testing.assert_allclose(settled.values[inner], -2.8 * settled.curve.knots[inner], atol=1.0)


@pytest.mark.slow
def test_a_moment_on_the_rod_is_a_function_of_how_the_rod_is_turned():
    angle = np.linspace(-0.42, 0.42, 12)
    law = TabulatedForce("rod", "moment", "rod_angle", -0.42, angle[1] - angle[0], tuple(-9.0 * angle**3))
    search = traced(replace(NOMINAL, force=law))
    tables = Balance(search, SETTING, SETTING.with_clearance(3e-4), 3e-4).tables(np.inf, np.inf)
    table = next(one for one in tables if one.curve.argument == "rod_angle")
    assert (table.curve.body, table.curve.direction) == ("rod", "moment")
    inner = slice(1, -1)
    expected = -9.0 * table.curve.knots[inner] ** 3
    assert np.corrcoef(table.values[inner], expected)[0, 1] > 0.95


@pytest.mark.slow
def test_the_clock_of_another_recording_is_found_by_a_table():
    wave = tuple(9.0 * np.sign(np.arange(24) - 5.5) + 2.0)
    law = TabulatedForce("slider", "x", "time", 0.0, None, wave, period=0.037)
    machine = replace(SETTING.with_clearance(3e-4), force=law)
    search = traced(replace(NOMINAL, force=law))
    known, later = search.alignments[0], search.recordings[0].part(60, 200)
    later = replace(later, values=later.values, recorded=later.recorded[600:], first=0)
    ahead = replace(known, angle=known.angle + known.speed * 0.06)
    first = find_clock(search.recordings[0], known, machine)
    second = find_clock(later, ahead, machine)
    apart = (second - first - 0.06) / 0.037
    assert abs((apart + 0.5) % 1.0 - 0.5) < 0.03


def test_waves_are_told_by_a_spline():
    search = traced(replace(NOMINAL, ripple=TorqueRipple(1.5, 6.0, 0.7)))
    balance = Balance(search, SETTING, SETTING.with_clearance(3e-4), 3e-4)
    before = balance.fit((), np.zeros(0)).cost
    (table,) = (one for one in balance.tables(0.65 * before, 0.65 * before) if one.curve.body == "crank")
    assert (table.curve.interpolation, len(table.values)) == ("cubic", 24)
    wave = 1.5 * np.cos(6.0 * table.curve.knots + 0.7)
    assert np.corrcoef(table.values, wave)[0, 1] > 0.98
    assert balance.tables(0.0, 0.0) == []


def test_a_finer_table_says_enough_where_a_coarser_one_fails_to():
    search = traced(replace(NOMINAL, process=ConstantProcess(30.0, 0.117, 0.131)))
    balance = Balance(search, SETTING, SETTING.with_clearance(3e-4), 3e-4)

    def over_place(enough):
        tables = balance.tables(enough, np.inf)
        return next(one for one in tables if one.curve.argument == "slider_position")

    cheapest = over_place(np.inf)
    said = over_place(0.99 * cheapest.cost)
    assert len(cheapest.values) == 12
    assert len(said.values) == 23
    assert said.cost <= 0.99 * cheapest.cost
    assert said.price > cheapest.price
    assert over_place(0.0).label == cheapest.label  # none says enough


def test_a_force_without_a_name_is_a_table_and_what_is_inside_a_joint_does_no_work():
    search = traced(replace(NOMINAL, spring=LinearSpring(400.0, 0.11)))
    balance = Balance(search, SETTING, SETTING.with_clearance(search.profile.best), search.profile.best)
    tables = [one for one in balance.tables(np.inf, np.inf) if one.curve.body == "slider"]
    place = next(one for one in tables if one.curve.argument == "slider_position")
    force = -400.0 * (place.curve.knots - 0.11)
    np.testing.assert_allclose(place.values, force, atol=1.5)  # at dead centres, where it does no work, too
    settled = settle_in(search, SETTING, place)
    np.testing.assert_allclose(settled.values, force, atol=2.0)
    before = balance.fit((), np.zeros(0)).cost
    assert place.cost < 0.5 * before
    stiffness = balance.best(search.groups["contact_stiffness(stiffness_scale)"])
    assert stiffness.cost == pytest.approx(before, rel=1e-6)


@pytest.mark.parametrize(("amplitude", "apart"), [(-10.0, 0.002), (-100.0, 2e-4), (3.0, 0.4)])
def test_derivatives_of_another_place_do_not_stall_the_fit(amplitude, apart):
    # The phase of a sine is nearly known, its size is not: from size 1 the phase's slope has the wrong sign.
    angle = np.linspace(0.0, 40.0, 800)
    truth = amplitude * np.sin(angle + apart) + 0.05 * np.random.default_rng(2).normal(size=800)
    balance = object.__new__(Balance)
    balance.scatter, balance.clearance = 0.05, 3e-4

    def left(hypotheses, values):
        return truth - values[0] * np.sin(angle + values[1]), np.ones((800, 1))

    def steps(hypotheses, values, free):
        sine, cosine = np.sin(angle + values[1]), values[0] * np.cos(angle + values[1])
        return np.column_stack([sine, cosine])[:, free]

    balance._left, balance._steps = left, steps
    unknowns = tuple(SimpleNamespace(low=-1e3, high=1e3) for _ in range(2))
    found = balance.fit((SimpleNamespace(unknowns=unknowns),), np.array([1.0, 0.0]))
    assert found.values == pytest.approx([amplitude, apart], abs=0.02)
    assert found.cost < 1.0


def test_torques_that_are_not_finite_are_an_error_that_callers_expect():
    with pytest.raises(np.linalg.LinAlgError):
        regressed(np.ones((10, 1)), np.full(10, np.nan), 1.0)
    assert regressed(np.ones((10, 0)), np.ones(10), 1.0).shape == (0,)
