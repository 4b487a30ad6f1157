"""Recordings without accelerometers: what their machine lacks is named, with an interval."""

import json
import os
import signal
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.motion.attempt import zeros_of
from clearance.diagnosis.motion.fit import OWN
from clearance.diagnosis.motion.judged import squares
from clearance.diagnosis.motion.model import Model
from clearance.diagnosis.motion.outcome import diagnose
from clearance.diagnosis.motion.prediction import Guess, predict
from clearance.diagnosis.motion.recordings import only_motion, tracks_of, uncertain_bounds, zero_is_known
from clearance.diagnosis.motion.track import LATEST, LowPass, Track, respond
from clearance.diagnosis.motion.verdict import _zero, verdict_of
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.errors import InputError
from clearance.mechanism.drive import DirectCurrentMotor, SpeedControl
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.files import write
from clearance.recording.recording import Recording
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal
from clearance.simulation.trajectory import simulate_trajectory
from clearance.trial.plant import Plant
from clearance.trial.plant.measurement import Fault
from tests.command_line import launch

RPM = np.pi / 30.0
MOTOR = {"stall_torque": 1.0, "no_load_rpm": 700.0}
CHANNELS = ("crank_angle", "crank_speed", "slider_position")


def planted(seconds, rate, channels=CHANNELS, faults=(), seed=1, **plant):
    """A recording of the independent plant with ideal joints."""
    made = Plant(joint="none", speed_rpm=600.0, step=1e-5, **plant)
    table = made.recording(seconds, 0.5, channels, rate, 0.01, seed, 4096, faults)
    return Recording(np.stack([table[c] for c in channels], axis=1), channels, rate)


def diagnosed(recording, names, most=2, uncertain=None, machine=None, report=lambda _: None, finished=None):
    """The diagnosis of one recording with some effects."""
    return diagnose(
        *tracks_of({"rig": recording}, {}),
        Setting(machine or SliderCrank(), "C"),
        load_effects(names),
        uncertain or {},
        True,
        (100.0 * RPM, 3000.0 * RPM),
        seconds=60.0,
        workers=1,
        most=most,
        report=report,
        finished=finished,
    ).diagnosis


def named(found):
    return {effect["name"]: effect["parameters"] for effect in found["effects"]}


def holds(parameter, truth):
    """Whether an interval of twice the stated width holds the truth: one of 95 % may miss it by chance."""
    half = parameter["high"] - parameter["low"]
    assert half < 0.5 * abs(truth)
    return abs(parameter["value"] - truth) < half


def test_a_run_of_ideal_joints_is_that_of_the_general_simulator():
    machine = replace(
        SliderCrank(), drive=DirectCurrentMotor(1.0, 700.0), gravity=(1.0, -9.81), guide_offset=2e-3
    )
    channels = ("crank_angle", "crank_speed", "drive_torque", "slider_position", "slider_velocity")
    track = Track("", np.zeros((200, 5)), channels, 500.0)
    seen = predict(track, [Guess(machine, Instrument(), 0.0, 0.0, 0.0)])[0]
    run = simulate_trajectory(machine, Integrator("runge_kutta_4", 1e-4), 0.4, 20)
    expected = run.signals[:, [Signal[c.upper()] for c in channels]]
    # the step of the prediction is five times longer: its error stays a tenth of an encoder's count
    assert (np.abs(seen - expected).max(axis=0) < [5e-5, 5e-4, 1e-5, 2e-6, 1e-4]).all()


def test_a_clearance_moves_the_slider_by_no_more_than_itself_over_the_cosine_of_the_rod():
    machine = replace(SliderCrank(), drive=SpeedControl(600.0, ramp=0.0))
    track = Track("", np.zeros((200, 1)), ("slider_position",), 1000.0)
    tight, loose = predict(
        track, [Guess(machine, Instrument(), 0.0, 62.8, 0.0, clearance) for clearance in (0.0, 1e-4)]
    )
    moved = np.abs(loose - tight)
    assert 0.5e-4 < moved.max() <= 1e-4 / np.cos(np.arcsin(0.05 / 0.12)) + 1e-12


def test_the_filter_is_that_of_the_measurement_chain():
    chain = MeasurementChain(base_rate=1e4, decimation=100)
    time = np.arange(40_000) / 1e4
    signal = np.cos(2.0 * np.pi * 9.0 * time) + 0.3 * np.cos(2.0 * np.pi * 31.0 * time)
    low_pass = LowPass(chain.cutoff * 50.0, chain.filter_order, chain.ripple_db)
    ours = respond(signal[:, None, None], 1e4, low_pass, np.zeros((1, 1)), np.array([True]))[::100, 0, 0]
    assert ours[50:-50] == pytest.approx(chain.apply(signal[:, None])[50:-50, 0], abs=2e-3)


def test_a_delay_is_a_delay():
    time = np.arange(2000) / 1000.0
    signal = np.stack([np.sin(30.0 * time), 60.0 * time], axis=1)[:, None, :]
    late = respond(signal, 1000.0, None, np.array([[3.3e-3, 3.3e-3]]), np.array([True, False]))[100:-100, 0]
    expected = np.stack([np.sin(30.0 * (time - 3.3e-3)), 60.0 * (time - 3.3e-3)], axis=1)[100:-100]
    assert late == pytest.approx(expected, abs=1e-4)


def test_nothing_is_found_where_nothing_is_missing():
    found = diagnosed(planted(4.0, 200.0), "all")
    assert (found["verdict"], found["effects"]) == ("none", [])
    assert found["clearance"]["after_m"] is None
    assert 0.0 < found["clearance"]["high_m"] < 1e-4
    assert "cannot be seen here" in " ".join(found["summary"])
    assert found["fit"]["held_out"]["after"] < 1.1


def test_a_signal_that_is_ignored_does_not_end_the_search(handled):
    def report(text):
        said.append(text)
        if len(said) == 1:
            os.kill(os.getpid(), signal.SIGHUP)

    said = []
    handled(signal.SIGHUP, signal.SIG_IGN)
    diagnosed(planted(4.0, 200.0), ["gravity"], report=report)
    assert said
    assert not any("interrupted" in text for text in said)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_search_and_what_was_found_so_far_is_judged(number, handled):
    said = []

    def report(text):
        said.append(text)
        if len(said) == 1:
            os.kill(os.getpid(), number)

    before = handled(number, lambda *_: None)
    found = diagnosed(planted(4.0, 200.0), ["gravity"], report=report)
    assert any("interrupted: what was found so far" in text for text in said)
    assert "interrupted" in " ".join(found["warnings"])
    assert signal.getsignal(number) is before


@pytest.mark.slow
def test_a_motor_that_sags_under_gravity_and_an_encoder_off_zero():
    recording = planted(
        6.0,
        100.0,
        faults=(Fault(kind="sensor_bias", channel="crank_angle", bias=0.2),),
        effects={"soft_drive": MOTOR, "gravity": {"gravity_x": -9.81}},
    )
    found = diagnosed(recording, ["soft_drive", "gravity", "slider_offset", "sensor_gain", "sensor_bias"])
    assert found["verdict"] == "mixed"
    effects = named(found)
    assert set(effects) == {"soft_drive", "gravity", "sensor_bias"}
    assert holds(effects["soft_drive"]["stall_torque"], 1.0)
    assert holds(effects["gravity"]["gravity_x"], -9.81)
    assert holds(effects["sensor_bias"]["bias"], 0.2)
    held_out = found["fit"]["held_out"]
    assert held_out["after"] < 1.1 < held_out["before"]


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_what_repeats_within_a_turn_repeats_a_whole_number_of_times(order):
    ripple = {"amplitude": 0.1, "order": order}
    recording = planted(4.0, 200.0, effects={"soft_drive": MOTOR, "torque_ripple": ripple})
    effects = named(diagnosed(recording, ["soft_drive", "torque_ripple"]))
    assert set(effects) == {"soft_drive", "torque_ripple"}
    assert effects["torque_ripple"]["order"]["value"] == order
    assert holds(effects["torque_ripple"]["amplitude"], 0.1)


@pytest.mark.slow
def test_a_spring_from_angle_and_position_alone():
    spring = {"stiffness": 150.0, "free_position": 0.13}
    recording = planted(
        4.0, 500.0, ("crank_angle", "slider_position"), effects={"soft_drive": MOTOR, "slider_spring": spring}
    )
    effects = named(diagnosed(recording, ["soft_drive", "slider_spring", "gravity"]))
    assert set(effects) == {"soft_drive", "slider_spring"}
    assert holds(effects["slider_spring"]["stiffness"], 150.0)
    assert holds(effects["slider_spring"]["free_position"], 0.13)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "fault", "parameter", "truth"),
    [
        ({"slider_offset": {"offset": 2e-3}}, (), ("slider_offset", "offset"), 2e-3),
        pytest.param(
            {},
            (Fault(kind="sensor_gain", channel="slider_position", gain=1.03),),
            ("sensor_gain", "gain"),
            1.03,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_geometry_and_gain(effect, fault, parameter, truth):
    found = diagnosed(
        planted(4.0, 100.0, effects=effect, faults=fault), ["slider_offset", "sensor_gain", "gravity"]
    )
    name, key = parameter
    assert set(named(found)) == {name}
    assert holds(named(found)[name][key], truth)


@pytest.mark.parametrize(
    ("kinds", "held_out", "zero", "expected"),
    [
        (["physics"], 1.05, None, "physics"),
        (["physics"], 5.0, None, "unknown"),  # it explains what it was fitted to alone
        ([], 5.0, None, "unknown"),
        ([], 1.05, None, "none"),  # an encoder's zero that nobody asks for is a matter of course
        ([], 1.05, "sensor_bias", "instrument"),
        (["physics"], 1.05, "sensor_bias", "mixed"),
    ],
)
def test_a_verdict_needs_what_was_held_out_and_names_what_was_asked_for(kinds, held_out, zero, expected):
    terms = [SimpleNamespace(effect=SimpleNamespace(kind=kind)) for kind in kinds]
    findings = SimpleNamespace(
        enough=SimpleNamespace(enough=True), zero=True, best=SimpleNamespace(terms=terms)
    )
    assert verdict_of(findings, [], zero, {"before": 8.0, "after": held_out}) == expected


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [(169.0, 1.4, "physics"), (169.0, 2.5, "unknown"), (3.0, 1.4, "unknown")],
)
def test_next_to_nothing_that_is_left_of_much_leaves_names_right(before, after, expected):
    findings = SimpleNamespace(
        enough=SimpleNamespace(enough=False), zero=False,
        best=SimpleNamespace(terms=[SimpleNamespace(effect=SimpleNamespace(kind="physics"))]),
    )  # fmt: skip
    assert verdict_of(findings, [], None, {"before": before, "after": after}) == expected


def test_values_that_a_recording_does_not_tell_are_not_given_as_known():
    recording = planted(4.0, 200.0, effects={"gravity": {"gravity_y": -9.81}, "soft_drive": MOTOR})
    machine = replace(SliderCrank(), gravity=(0.0, -9.81), drive=DirectCurrentMotor(1.0, 650.0))
    bounds = {
        "slider.mass": (0.03, 0.6),
        "rod.mass": (0.05, 0.9),
        "rod.inertia": (5e-5, 1e-3),
        "crank.mass": (0.05, 1.0),
        "crank.inertia": (1e-6, 1e-3),
        "drive.stall_torque": (0.1, 10.0),
    }
    found = diagnosed(recording, ["slider_offset"], uncertain=bounds, machine=machine)
    assert found["verdict"] == "none"
    unknown = [one["path"] for one in found["uncertain"] if not one["determined"]]
    assert {"rod.inertia", "crank.inertia"} <= set(unknown)
    assert "do not tell" in " ".join(found["summary"])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([1, 2], "not a mapping"),
        ({"slider.wheels": [0, 1]}, "slider.wheels"),
        ({"slider.mass": [0.5, 0.1]}, "rising"),
        ({"slider.mass": "heavy"}, "rising"),
        ({"slider": [0.1, 0.5]}, "not a number"),
        ({"slider.mass": [-1.0, 0.5]}, "mass"),
        ({"joint_c.clearance": [0.0, 1e-3]}, "is fitted anyway"),
    ],
)
def test_wrong_bounds_of_uncertain_values(given, words):
    with pytest.raises(InputError, match=words):
        uncertain_bounds(given, SliderCrank())


def test_bounds_above_a_nominal_value_of_zero_are_taken():
    """A fit on their logarithm begins inside them."""
    model = Model(SliderCrank(), "C", uncertain={"guide_offset": (1e-3, 1e-2)})
    assert len(model.own(np.array([0.0, 60.0, 0.0, 600.0, 0.0]))) == 5
    assert model.apply(np.array([u.prior[0] for u in model.shared]))[0].guide_offset == pytest.approx(1e-3)


def test_what_a_late_channel_does_not_know_at_the_ends_is_not_compared():
    track = Track("rig", np.zeros((500, 1)), ("slider_position",), 100.0)
    assert track.judged == slice(round(LATEST * 100.0), 500 - round(LATEST * 100.0))
    assert track.part(0, 30).judged == slice(3, 27)  # a tenth of a short stretch at most


def test_play_in_the_other_joint_is_refused():
    machine = replace(SliderCrank(), joint_b=Joint(1e-4))
    with pytest.raises(InputError, match=r"mechanism\.joint_b\.clearance = 0\.0001.*set mechanism\.joint_b"):
        diagnosed(planted(1.0, 100.0), [], machine=machine)


def test_what_was_held_out_is_read_before_the_search():
    said = []
    fitted, _ = tracks_of({"rig": planted(1.0, 100.0)}, {})
    torque = Track("torque", np.random.default_rng(0).normal(size=(100, 1)), ("drive_torque",), 100.0)
    with pytest.raises(InputError, match="torque: has drive_torque"):
        diagnose(
            fitted,
            [torque],
            Setting(SliderCrank(), "C"),
            [],
            {},
            True,
            (10.0, 300.0),
            60.0,
            1,
            1,
            said.append,
        )
    assert not said


def test_a_channel_that_a_recording_lacks_does_not_count():
    both = ("crank_angle", "slider_position")
    tracks = [Track(str(i), np.zeros((9, 2 - i)), both[: 2 - i], 100.0) for i in range(2)]
    found = SimpleNamespace(residuals=[np.full((9, 2), 3.0), np.full((9, 1), 4.0)])
    means = squares(found, tracks, SimpleNamespace(channels=both), np.array([1.0, 1.0]))
    np.testing.assert_allclose(means, [*[9.0] * 9, *[16.0] * 9])


@pytest.mark.parametrize(
    ("zeros", "low", "high"),
    [
        ({"a": (0.30, 1e-3)}, 0.298, 0.302),
        ({"a": (0.30, 1e-3), "b": (0.3005, 1e-3)}, 0.2988, 0.3017),
        ({"a": (0.30, 1e-3), "b": (-0.30, 1e-3)}, -0.302, 0.302),  # switched off between the two
    ],
)
def test_zeros_that_recordings_disagree_on_are_spanned(zeros, low, high):
    found = _zero(zeros)
    assert (found.low, found.high) == pytest.approx((low, high), abs=2e-4)
    assert low < found.value < high


def test_each_recording_may_have_a_zero_of_its_own():
    own, covariance = np.zeros((3, OWN)), np.eye(3 * OWN)
    own[:, 4] = 0.3, 0.3, -0.3
    fit = SimpleNamespace(shared=np.zeros(0), own=own, covariance=covariance)
    zeros = zeros_of(fit, ["a", "a", "b"])
    assert zeros == {"a": pytest.approx((0.3, 0.5**0.5)), "b": pytest.approx((-0.3, 1.0))}


def test_wrong_settings_and_recordings():
    with pytest.raises(InputError, match="encoder_zero"):
        zero_is_known("perhaps")
    still = Recording(np.zeros((200, 1)), ("slider_position",), 100.0)
    with pytest.raises(InputError, match="constant"):
        Track.of(still, "still")
    with pytest.raises(InputError, match="too few"):
        Track.of(Recording(np.random.default_rng(0).normal(size=(20, 1)), ("crank_angle",), 100.0), "short")
    assert not only_motion([])
    assert only_motion([still])
    assert not only_motion([Recording(np.zeros((9, 1)), ("rod_c_axial",), 1e4)])


def test_the_command_takes_such_recordings_and_writes_all_that_it_always_writes(tmp_path):
    write(planted(4.0, 100.0, effects={"slider_offset": {"offset": 3e-3}}), tmp_path / "rig.parquet")
    done = launch(
        "diagnose", "recordings=[rig.parquet]", "joint=C", "hypotheses=[slider_offset,gravity]",
        "uncertain={slider.mass: [0.1, 0.2]}", "hydra.run.dir=run", folder=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "run/diagnosis.json").read_text())
    assert found["verdict"] == "physics"
    assert found["effects"][0]["name"] == "slider_offset"
    assert found["summary"][0] in done.stdout
    assert "guide_offset" in (tmp_path / "run/corrected.yaml").read_text()
    assert "Error of the whole run" in (tmp_path / "run/report.html").read_text()
    events = EventAccumulator(str(tmp_path / "run")).Reload()
    assert {"misfit/nominal", "clearance/nominal"} <= set(events.Tags()["scalars"])
    assert np.isfinite(events.Scalars("misfit/nominal")[0].value)
