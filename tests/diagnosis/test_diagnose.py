"""The diagnosis as a user runs it: an effect is named and modelled; where nothing is missing, nothing is."""

import json
import os
import re
from dataclasses import replace

import numpy as np
import pytest
from filelock import FileLock

from clearance.diagnose import _files, _load, _unused
from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.outcome import diagnose
from clearance.diagnosis.sensing.demonstration import CLEARANCE, FRICTION, SPEED, record
from clearance.diagnosis.sensing.instrument import FAULTY_CHANNELS, Instrument
from clearance.diagnosis.sensing.measured import Measured, chain_of
from clearance.diagnosis.sensing.tolerances import Tolerances
from clearance.errors import InputError
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.files import read, write
from clearance.recording.recording import Recording
from tests.command_line import call, launch

RPM = 3.141592653589793 / 30.0


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory):
    home = tmp_path_factory.mktemp("home")
    done = launch("diagnose", "hypotheses=[guide_friction,gravity]", "hydra.run.dir=run", folder=home)
    assert done.returncode == 0, done.stderr
    return home, done.stdout, json.loads((home / "run/diagnosis.json").read_text())


def test_the_demonstration_names_the_friction_and_its_size(demonstrated):
    _, output, found = demonstrated
    assert found["verdict"] == "physics"
    (effect,) = found["effects"]
    assert (effect["name"], effect["body"], effect["direction"]) == ("guide_friction", "slider", "x")
    force = effect["parameters"]["coulomb_force"]
    assert force["value"] == pytest.approx(FRICTION, rel=0.01)
    assert 0.0 < force["low"] < force["value"] < force["high"]
    assert "of Coulomb friction" in output
    assert found["summary"][0] in output
    assert found["recordings"][0]["held_out_seconds"] == pytest.approx(0.2, abs=2e-3)


def test_with_it_the_clearance_and_the_held_out_error_come_right(demonstrated):
    _, _, found = demonstrated
    assert found["clearance"]["after_m"] == pytest.approx(CLEARANCE, rel=2e-3)
    held_out = found["fit"]["held_out"]
    assert held_out["before"] > 2.0
    assert held_out["after"] < 1.1


def test_it_says_how_small_an_effect_these_recordings_would_have_shown(demonstrated):
    _, _, found = demonstrated
    sizes = {entry["parameter"]: entry for entry in found["smallest_seen"]}
    assert {entry["name"] for entry in sizes.values()} == {"gravity"}
    assert sizes["gravity_x"]["unit"] == "m/s^2"
    assert 1e-4 < sizes["gravity_x"]["size"] < 1.0


def test_the_corrected_machine_is_simulated_by_the_other_commands(demonstrated):
    home, _, _ = demonstrated
    done = launch(
        "simulate", "mechanism=run/corrected.yaml", "runs=1", "seed=1", "campaign.duration=0.3",
        "campaign.record_start=0.1", "dataset=data", folder=home,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "coulomb_force" in (home / "run/corrected.yaml").read_text()


def test_the_report_carries_the_very_numbers(demonstrated):
    home, _, found = demonstrated
    page = (home / "run/report.html").read_text()
    assert found["summary"][0].split(":")[0] in page
    assert json.dumps(found["clearance"]["after_m"]) in page


@pytest.mark.parametrize("window", [{}, {"width": 390, "height": 800, "touch": True}])
def test_the_report_opens_without_a_network_and_shows_the_same(demonstrated, browser, window):
    home, _, found = demonstrated
    page = home / "run/report.html"
    browser.open(page, **window)
    assert browser.complaints == []
    assert [url for url in browser.requests if not url.startswith("data:")] == [page.as_uri()]
    assert browser.run("document.documentElement.scrollWidth") <= window.get("width", 1280)
    assert found["summary"][0] in browser.run("document.body.innerText")
    shown = browser.every("[data-key][data-source=diagnosis]", "[one.dataset.key, one.dataset.value]")
    assert len(shown) > 10
    for key, value in shown:
        truth = found
        for part in key.split("."):
            truth = truth[int(part)] if isinstance(truth, list) else truth[part]
        assert float(value) == pytest.approx(truth, rel=1e-7), key


@pytest.mark.slow  # the small trial has a machine that lacks nothing, too
@pytest.mark.parametrize(("joint", "clearance", "told"), [("C", 5e-4, "C"), ("B", 2e-4, "BC")])
def test_nothing_is_found_where_nothing_is_missing(joint, clearance, told):
    setting = Setting(SliderCrank(), joint)
    machine = replace(setting.with_clearance(clearance), drive=SpeedControl(SPEED, ramp=0.1))
    recording = record(machine, 2)
    whole = Measured.of(recording, chain_of(recording, "null"), "null")
    cut = 2 * len(whole.values) // 3
    outcome = diagnose(
        [whole.part(0, cut)],
        [whole.part(cut, len(whole.values))],
        [Setting(SliderCrank(), one) for one in told],
        load_effects("physics"),
        (150 * RPM, 3000 * RPM),
        workers=1,
        most=1,
        report=lambda _: None,
    )
    found = outcome.diagnosis
    assert (found["verdict"], found["effects"]) == ("none", [])
    assert found["clearance"]["joint"] == joint
    assert found["clearance"]["after_m"] == pytest.approx(clearance, rel=2e-3)
    assert found["fit"]["held_out"]["after"] < 1.1


def test_sensors_that_are_all_off_within_their_tolerances_are_no_missing_physics():
    setting = Setting(SliderCrank(), "C")
    machine = replace(setting.with_clearance(2e-4), drive=SpeedControl(SPEED, ramp=0.1))
    recording = record(machine, 4)
    names = [name for name in recording.channels if name in FAULTY_CHANNELS]
    gains = dict(
        zip(names, 1.0 + 0.03 * np.random.default_rng(0).uniform(-1.0, 1.0, len(names)), strict=True)
    )
    seen = Instrument(gain=gains).apply(recording.values, recording.channels, recording.rate)
    tolerances = Tolerances(gain=0.04)
    parts = _load({"a": replace(recording, values=seen)}, {}, recording.channels, tolerances)
    effects = load_effects(["gravity", "sensor_gain"])
    found = diagnose(*parts, [setting], effects, (150 * RPM, 3000 * RPM), 1, 1, lambda _: None).diagnosis
    assert (found["verdict"], found["effects"]) == ("none", [])
    assert found["fit"]["held_out"]["after"] < 1.1
    assert found["clearance"]["low_m"] < 2e-4 < found["clearance"]["high_m"]
    told = {name: own["gain"] for name, own in found["sensors"].items() if own["gain"]["high"] < 1.039}
    assert len(told) > 3
    for name, gain in told.items():
        assert gain["high"] - gain["low"] < 0.03
        assert gain["value"] == pytest.approx(gains[name], abs=gain["high"] - gain["low"])


@pytest.mark.slow
@pytest.mark.parametrize("stopped", ["time_limit", "interrupted"])
def test_what_was_found_so_far_is_judged(stopped, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    setting = Setting(SliderCrank(), "C")
    machine = replace(setting.with_clearance(2e-4), drive=SpeedControl(SPEED, ramp=0.1))
    recording = record(replace(machine, gravity=(0.0, -4.0)), 2)
    whole = Measured.of(recording, chain_of(recording, "one"), "one")
    cut = 2 * len(whole.values) // 3
    parts = [whole.part(0, cut)], [whole.part(cut, len(whole.values))]
    if stopped == "interrupted":
        monkeypatch.setattr("clearance.diagnosis.judging.outcome.find_explanation", interrupt)
    limit = 1e-3 if stopped == "time_limit" else float("inf")
    found = diagnose(
        *parts, [setting], load_effects("physics"), (150 * RPM, 3000 * RPM), 1, 1, lambda _: None,
        time_limit=limit,
    ).diagnosis  # fmt: skip
    assert (found["verdict"], found["effects"]) == ("unknown", [])
    (warning,) = found["warnings"]
    assert stopped in warning


@pytest.mark.slow
def test_nothing_missing_is_not_said_without_a_look_though_it_was_interrupted(monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    setting = Setting(SliderCrank(), "C")
    machine = replace(setting.with_clearance(2e-4), drive=SpeedControl(SPEED, ramp=0.1))
    recording = record(machine, 4)
    whole = Measured.of(recording, chain_of(recording, "one"), "one")
    cut = 2 * len(whole.values) // 3
    parts = [whole.part(0, cut)], [whole.part(cut, len(whole.values))]
    monkeypatch.setattr("clearance.diagnosis.judging.outcome.find_explanation", interrupt)
    found = diagnose(
        *parts, [setting], load_effects("physics"), (150 * RPM, 3000 * RPM), 1, 1, lambda _: None
    ).diagnosis
    assert found["verdict"] == "none"
    assert 0.0 <= found["mismatch"]["score"] < 60.0
    assert found["mismatch"]["p_value"] > 0.05


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Recordings: a right one, too short ones, one at another rate, with fewer channels, of motion alone."""
    folder = tmp_path_factory.mktemp("recordings")
    machine = replace(Setting(SliderCrank(), "C").with_clearance(3e-4), drive=SpeedControl(SPEED, ramp=0.1))
    whole = record(machine, 5)
    write(whole, folder / "a.parquet")
    write(replace(whole, values=whole.values[:600]), folder / "short.parquet")
    write(replace(whole, values=whole.values[:3]), folder / "tiny.parquet")
    write(replace(whole, values=whole.values[:1500]), folder / "short_of_a_third.parquet")
    write(replace(whole, values=whole.values[::2], rate=5e3), folder / "slow.parquet")
    write(whole.select(["crank_b_axial"]), folder / "crank.parquet")
    write(whole, folder / "moved.parquet")
    (folder / "moved.yaml").write_text("sensors: {rod_c_axial: {position: 0.1}}")
    turned = np.arange(300.0)[:, None] * [0.5, 1e-4]
    write(Recording(turned, ("crank_angle", "slider_position"), 100.0), folder / "motion.parquet")
    return folder


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (("joint=both",), "joint=B, joint=C or joint=unknown"),
        (("hypotheses=[gide_friction]",), "guide_friction"),
        (("hypotheses=[gravity]", "without=gravity"), "change hypotheses or without"),
        (("hypotheses=null",), "hypotheses = None is no name or list of names"),
        (("without=5",), "without = 5 is no name or list of names"),
        (("recordings=a.parquet", "speed_range=[150,inf]"), "two rising speeds above 0 and up to 20000 rpm"),
        (("recordings=[run (1).csv]",), "needs quotes: 'recordings=["),
        (("recordings=[Prüfung.csv]",), "needs quotes: 'recordings=["),
        (("recordings=[nowhere.parquet]",), "nowhere.parquet"),
        (("recordings=a.parquet", "speed_range=[3000,150]"), "speed_range = [3000, 150]"),
        (("recordings=a.parquet", "speed_range=[abc,150]"), "speed_range = ['abc', 150]"),
        (("recordings=a.parquet", "most_effects=-1"), "most_effects = -1"),
        (("recordings=a.parquet", "finished=5"), "finished = 5"),
        (("recordings=a.parquet", "workers=0"), "workers = 0"),
        (("recordings=a.parquet", "time_limit=-5"), "time_limit = -5"),
        (("recordings=a.parquet", "simulations=5"), "simulations = 5"),
        (("recordings=motion.parquet", "simulations=19"), "simulations = 19: only a diagnosis by accel"),
        (("recordings=a.parquet", "tolerances=0.02"), "tolerances = 0.02 is not null or limits"),
        (("recordings=a.parquet", "tolerances={gain: 5}"), "tolerances.gain = 5 is not between 0 and 0.2"),
        (
            ("recordings=a.parquet", "uncertain={slider.mass: [0.1, 0.2]}"),
            "which these are not; uncertain=nu",
        ),
        (("recordings=a.parquet", "encoder_zero=unknown"), "which these are not; encoder_zero=known"),
        (("recordings=motion.parquet", "tolerances={gain: 0.02}"), "have no accelerometers"),
        (("recordings=a.parquet", "tolerances={gain: 0.02}", "simulations=19"), "accelerometers are exact"),
        (("recordings=a.parquet", "sensors=crank"), "change sensors"),
        (("recordings=[a.parquet,crank.parquet]",), "at least one on rod or slider"),
        (("recordings=[a.parquet,slow.parquet]",), "their rates differ (a.parquet: "),
        (("recordings=[a.parquet,./a.parquet]",), "count twice; change recordings"),
        (
            ("recordings=moved.parquet",),
            "moved.parquet: sensor rod_c_axial is at 0.1 m, the machine has it at 0.12 m; change mech",
        ),
        (
            ("recordings=a.parquet", "held_out=moved.parquet", "mechanism.sensor_positions=[0,0.05,0,0.11]"),
            "the machine has it at 0.11 m",
        ),
        (("recordings=tiny.parquet",), "tiny.parquet: 3 samples are too few to follow; give at least 160"),
        (("held_out=a.parquet",), "nothing to fit; give recordings"),
        (("recordings=a.parquet", "chain.decimation=5"), "key chain of NAME.yaml); leave chain out"),
        (("recordings=a.parquet", "integrator=euler"), "leave integrator out"),
        (("recordings=a.parquet", "+sensor_chain.default.noise=0.01"), "leave sensor_chain out"),
    ],
)
def test_wrong_inputs_are_one_line(monkeypatch, capfd, recordings, wrong, words):
    monkeypatch.chdir(recordings)
    code, said = call(monkeypatch, capfd, "diagnose", *wrong)
    assert code == 2
    assert words in said
    assert len(said.strip().splitlines()) == 1


def test_a_file_whose_name_no_report_can_say_is_refused_before_anything_is_done(tmp_path):
    (tmp_path / os.fsdecode(b"messung_\xe4.csv")).write_text("time\n0\n")
    with pytest.raises(InputError, match=r"recordings: the name .*messung_.*is no UTF-8; rename the file"):
        _files("recordings", str(tmp_path))


def test_a_folder_in_which_another_diagnosis_is_writing_is_refused(recordings, monkeypatch, capfd, tmp_path):
    monkeypatch.chdir(recordings)
    with FileLock(tmp_path / ".running"):
        code, said = call(monkeypatch, capfd, "diagnose", "recordings=a.parquet", f"hydra.run.dir={tmp_path}")
    assert code == 2
    assert "another diagnosis is writing there; set hydra.run.dir to another" in said


@pytest.mark.parametrize("name", ["short", "short_of_a_third"])
def test_a_recording_that_is_too_short_is_said_to_be_before_anything_is_done(recordings, name):
    done = launch("diagnose", f"recordings={name}.parquet", folder=recordings)
    assert done.returncode == 2
    assert "rpm" not in done.stdout + done.stderr
    assert "s are too short to follow" in done.stderr
    assert "give 0.2 s or more" in done.stderr


def test_a_recording_of_another_machine_is_said_to_be_one(tmp_path):
    machine = replace(SliderCrank(), drive=SpeedControl(SPEED, ramp=0.1))
    recording = record(machine, 3)
    generator_like = recording.values[::-1] ** 2  # no slider-crank moves like that
    write(replace(recording, values=generator_like), tmp_path / "other.parquet")
    done = launch("diagnose", "recordings=[other.parquet]", folder=tmp_path)
    assert done.returncode == 2
    assert re.search(r"other\.parquet: .*explains \d+% .*is it another machine's", done.stderr)


def test_a_folder_is_all_recordings_in_it_that_are_not_held_out(tmp_path):
    for name in ("b.csv", "a.parquet", "._a.parquet", "notes.txt"):
        (tmp_path / name).write_text("")
    (tmp_path / "c.csv").mkdir()
    a, b = tmp_path / "a.parquet", tmp_path / "b.csv"
    assert _files("recordings", str(tmp_path)) == [a, b]
    assert _files("recordings", str(tmp_path), [b]) == [a]
    with pytest.raises(InputError, match=r"a\.parquet is held out as well"):
        _files("recordings", str(a), [a])
    with pytest.raises(InputError, match="none is left to fit"):
        _files("recordings", str(tmp_path), [a, b])
    with pytest.raises(InputError, match=r"held_out: no recording in the folder .*parquet"):
        _files("held_out", str(tmp_path / "c.csv"))
    with pytest.raises(InputError, match="names no file"):
        _files("held_out", "")


def test_a_sensor_that_is_constant_in_one_recording_is_left_out_of_all(recordings):
    whole = read(recordings / "a.parquet")
    values = whole.values.copy()
    values[:, whole.channels.index("rod_b_axial")] = 0.0
    fitted, judged = _load({"a": whole, "b": replace(whole, values=values)}, {}, whole.channels)
    assert [one.silent for one in (*fitted, *judged)] == [(), ("rod_b_axial",)] * 2
    assert len({one.channels for one in (*fitted, *judged)}) == 1
    assert "rod_b_axial" not in fitted[0].channels


def test_sensors_of_the_rod_that_say_nothing_are_none(recordings):
    whole = read(recordings / "a.parquet").select(["crank_b_axial", "rod_b_axial"])
    values = whole.values.copy()
    values[:, 1] = 0.0
    with pytest.raises(InputError, match=r"of which \['crank_b_axial'\] say something; at least one on rod"):
        _load({"a": replace(whole, values=values)}, {}, whole.channels)


def test_a_channel_that_one_recording_lacks_is_said_to_be_left_out(recordings):
    whole, axial = read(recordings / "a.parquet"), read(recordings / "crank.parquet")
    (told, *_) = _unused({"a": whole, "b": axial}, ("rod_b_axial", "crank_b_axial", "slider_vertical"))
    assert told == "rod_b_axial is not in b and was left out of all recordings"
    assert _unused({"a": whole, "b": whole}, whole.channels) == []


def test_noise_and_limits_are_told_without_what_is_held_out(recordings):
    whole = read(recordings / "a.parquet")
    values = whole.values.copy()
    last = 2 * len(values) // 3 + 10
    noise = np.random.default_rng(3).normal(size=values[last:].shape)
    values[last:] = np.clip(values[last:] + 30.0 * values.std(axis=0) * noise, -500.0, 500.0)
    (fitted,), (judged,) = _load({"a": whole}, {}, whole.channels)
    (other,), (loud,) = _load({"a": replace(whole, values=values)}, {}, whole.channels)
    for one, before in ((other, fitted), (loud, judged)):
        np.testing.assert_array_equal(one.sigma, before.sigma)
        np.testing.assert_array_equal(one.limits, before.limits)


def test_recordings_that_no_motion_is_near_end_in_a_line(recordings):
    whole = read(recordings / "a.parquet")
    values = whole.values.copy()
    values[:, whole.channels.index("rod_c_transverse")] *= 1000.0  # mm/s^2
    fitted, judged = _load({"a": replace(whole, values=values)}, {}, whole.channels)
    with pytest.raises(InputError, match=r"is a unit or a scale wrong|explains \d+%"):
        diagnose(
            fitted,
            judged,
            [Setting(SliderCrank(), "C")],
            load_effects("gravity"),
            (50.0, 150.0),
            1,
            1,
            lambda _: None,
        )
