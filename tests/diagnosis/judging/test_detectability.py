"""What is said to be the smallest size that can be seen: fits find it, and do not find a third of it."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.judging.detectability import (
    _standard_errors,
    _with_faults,
    differentiable,
    faults_of_sensors,
    follower_on_path,
    linearised,
    seen,
    smallest,
)
from clearance.diagnosis.judging.nominal_map import CLEARANCES, SPEEDS, detectability_map, nominal_map
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.shooting.covariance import deviations
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.follow import Follower
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS, SensorSet

CLEARANCE, RPM = 3e-4, 700.0
MACHINE = SliderCrank(joint_c=Joint(CLEARANCE))
SETTING = Setting(MACHINE, "C")
ALL = SensorSet("all", ACCELERATIONS)
ROD = SensorSet("rod", ACCELERATIONS[4:8])


def hypotheses(*names):
    groups = gather(load_effects(list(names), []), MACHINE, "C", ())
    return {h.name: h for h in differentiable(groups, MACHINE)}


def test_a_size_is_seen_with_power_ninety_at_five_per_cent():
    draws = np.random.default_rng(0).normal(smallest(np.array(2.0)), 2.0, 200000)
    assert (np.abs(draws) > 1.959964 * 2.0).mean() == pytest.approx(0.9, abs=3e-3)


def test_effects_without_a_derivative_are_left_out_and_sizes_beyond_the_bounds_too():
    found = hypotheses("guide_friction", "rod_flexibility", "flexible_base", "rod_inertia", "timebase")
    assert set(found) == {"guide_friction", "rod_inertia", "timebase"}
    few = seen([found["guide_friction"]] * 3, [0.01, 1e9, np.inf])
    assert few[0] == {"name": "guide_friction", "parameter": "coulomb_force", "unit": "N", "size": 0.0324}
    assert [entry["size"] for entry in few[1:]] == [None, None]


def test_noise_and_sensors_set_the_standard_error():
    chosen = list(hypotheses("guide_friction", "torque_ripple").values())
    one = linearised(SETTING, chosen, CLEARANCE, RPM)
    everywhere, _ = one.errors(ALL)
    assert (everywhere < one.errors(ROD)[0]).all()
    friction, ripple = linearised(SETTING, chosen, CLEARANCE, RPM, noise=0.02).errors(ALL)[0] / everywhere
    assert ripple == pytest.approx(2.0, rel=0.1)
    assert 1.1 < friction < 1.9  # the unknown forces, which do not follow the noise, cover a part of it


@pytest.mark.parametrize("joint", ["B", "C"])
def test_the_stored_map_is_complete_and_knows_where_a_recording_lies(joint):
    setting = Setting(SliderCrank(), joint)
    stored = nominal_map(setting, 3.1e-4, -690.0, (*ACCELERATIONS[2:8], "slider_horizontal"), [])
    assert stored["here"] == {"clearance_m": 3.1e-4, "speed_rpm": 690.0, "sensors": "all", "effects": []}
    assert nominal_map(setting, 3e-4, 700.0, ACCELERATIONS[4:8], [])["here"]["sensors"] == "rod"
    assert nominal_map(setting, 3e-4, 700.0, ["slider_position"], [])["here"]["sensors"] is None
    names = {effect["name"] for effect in stored["effects"]}
    assert names == {effect.name for effect in load_effects("all", [])}
    ends = {effect["name"]: effect["weakest"] for effect in stored["effects"] if "weakest" in effect}
    assert set(ends) == {
        "second_clearance", "guide_clearance", "rod_flexibility", "flexible_base", "sensor_resonance",
    }  # fmt: skip
    for effect in stored["effects"]:
        for name in stored["sensor_sets"]:
            assert np.shape(effect["size"][name]) == (len(CLEARANCES), len(SPEEDS))


def test_no_map_is_shown_of_another_machine():
    here = [{"name": "gravity", "size": 0.1}]
    usual = replace(MACHINE, joint_c=Joint(5e-4), drive=SpeedControl(950.0))
    assert nominal_map(Setting(usual, "C"), 5e-4, 950.0, ACCELERATIONS, here)["effects"]
    for other in (replace(MACHINE, gravity=(0.0, -9.81)), replace(MACHINE, joint_b=Joint(1e-4))):
        found = nominal_map(Setting(other, "C"), 5e-4, 950.0, ACCELERATIONS, here)
        assert "effects" not in found
        assert found["here"]["effects"] == here


def test_the_stored_map_is_what_this_simulator_gives():
    names = [
        "guide_friction",
        "joint_friction",
        "timebase",
        "sensor_gain",
        "sensor_delay",
        "sensor_resonance",
    ]
    fresh = detectability_map(SETTING, load_effects(names, []), [CLEARANCE], [RPM], [ROD])
    stored = {e["name"]: e for e in nominal_map(SETTING, CLEARANCE, RPM, [], [])["effects"]}
    assert [effect["name"] for effect in fresh["effects"]] == names
    place = CLEARANCES.index(CLEARANCE), SPEEDS.index(RPM)
    for effect in fresh["effects"]:
        kept = stored[effect["name"]]["size"]["rod"][place[0]][place[1]]
        assert kept is not None
        assert effect["size"]["rod"][0][0] == pytest.approx(kept, rel=0.1)
        assert effect["seen"] == ("below" if effect["name"] == "sensor_resonance" else "above")


@pytest.mark.parametrize("name", ["sensor_gain", "sensor_delay"])
def test_a_sensors_fault_of_that_size_is_estimated_three_errors_away_from_off(name):
    fault = faults_of_sensors(load_effects([name], []))[0]
    model, values = SETTING.model(), np.array([CLEARANCE, RPM])
    machine = model.machine(values)
    channel = ACCELERATIONS.index("slider_horizontal")
    off = fault.effect.free[0]
    truth = follower_on_path(machine, 0.01)
    steps = np.array([*(model.step(values, i) for i in range(2)), *[1.0] * len(ACCELERATIONS)])
    clean = _with_faults(truth.look(machine, model.columns(values)[0]), truth.measured, [fault]).solve()
    error = _standard_errors(clean.gram, steps, model)[channel]
    values_with = Instrument().changed(off.path, off.off + smallest(np.array(error)), "slider_horizontal")
    measured = truth.measured
    flat = values_with.apply(measured.values.reshape(-1, 10), ACCELERATIONS, measured.chain.rate)

    def score(noise):
        """The estimate over its standard error."""
        noisy = replace(measured, values=(flat + noise).reshape(measured.values.shape))
        follower = Follower(noisy, truth.integrator, truth.input_sigma.copy())
        follower.path = truth.path.copy()
        one = _with_faults(follower.look(machine, model.columns(values)[0]), truth.measured, [fault]).solve()
        own = [0, 1, 2 + channel]
        gram = one.gram / np.outer(np.append(steps, 1.0), np.append(steps, 1.0))
        return np.linalg.solve(gram[np.ix_(own, own)], gram[own, -1])[-1] / error

    assert score(0.0) == pytest.approx(3.24, rel=0.02)
    generators = [np.random.default_rng(seed) for seed in range(6)]
    scores = [score(measured.sigma * each.normal(size=flat.shape)) for each in generators]
    assert np.mean(scores) == pytest.approx(3.24, abs=1.2)  # three standard errors of a mean of six
    assert 0.4 < np.std(scores, ddof=1) < 2.0  # a standard error is that: chi-square of 5, beyond 1 in 1000


def test_a_clock_is_known_as_well_as_the_fit_of_a_recording_by_a_wrong_one_says():
    clock = hypotheses("timebase")["timebase"]
    error = linearised(SETTING, [clock], CLEARANCE, RPM).errors(ALL)[0][0]
    wrong = 4e-4  # a sample lasts so much longer than it says
    late = follower_on_path(
        SETTING.model().machine(np.array([CLEARANCE, RPM])), 0.01, MeasurementChain(1e5 / (1.0 + wrong))
    )
    chain = MeasurementChain()
    follower = Follower(replace(late.measured, chain=chain), late.integrator, late.input_sigma.copy())
    follower.path = late.path.copy()
    done = fit([follower], SETTING.model([clock]), np.array([[CLEARANCE, 0.0, RPM]]), 8, 1e-6, 1)
    assert done.values[0, 1] == pytest.approx(wrong, rel=0.05)
    longer = np.sqrt(follower.measured.seconds)
    assert deviations(done)[1] * longer == pytest.approx(error, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "sensors"), [("guide_friction", ALL), ("rod_inertia", ROD)])
def test_fits_find_an_effect_of_that_size_and_not_a_third_of_it(name, sensors):
    hypothesis = hypotheses(name)[name]
    model = SETTING.model([hypothesis])
    start = np.array([[CLEARANCE, *hypothesis.off, RPM]])
    found = {}
    for share in (1.0, 1.0 / 3.0):
        values = hypothesis.off.copy()
        seconds = 0.3
        error = linearised(SETTING, [hypothesis], CLEARANCE, RPM).errors(sensors)[0][0]
        values[0] += share * smallest(error) / np.sqrt(seconds)
        truth = follower_on_path(hypothesis.apply(SETTING.model().machine(start[0, [0, -1]]), values), 0.01)
        assert truth.measured.seconds == pytest.approx(seconds)
        use = [ACCELERATIONS.index(channel) for channel in sensors.channels]
        found[share] = 0
        for seed in range(6):
            noisy = truth.measured.values + truth.measured.sigma * np.random.default_rng(seed).normal(
                size=truth.measured.values.shape
            )
            measured = replace(
                truth.measured, values=noisy[..., use], channels=sensors.channels, signals=tuple(use),
                sigma=truth.measured.sigma[use],
            )  # fmt: skip
            follower = Follower(measured, truth.integrator, truth.input_sigma.copy())
            follower.path = truth.path.copy()
            done = fit([follower], model, start, 6, 1e-5, 1)
            found[share] += abs(done.values[0, 1] - hypothesis.off[0]) > 1.96 * deviations(done)[1]
    assert found[1.0] >= 5  # of six
    assert found[1.0 / 3.0] <= 2
