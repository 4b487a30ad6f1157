"""What users do today: right where it can be right, and in the form that the score judges."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.sensing.demonstration import record
from clearance.errors import InputError
from clearance.mechanism.bearing import Worn
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.recording import Recording
from clearance.trial.baselines import sparse, trajectory, two_sample
from clearance.trial.baselines.runs import FIT, JUDGED, Bench, spread
from clearance.trial.examine import Examiner
from clearance.trial.reveal import commit_verdicts, reveal
from clearance.trial.score import score_case
from clearance.trial.summary import comparison, summarise
from tests.command_line import call
from tests.trial.conftest import TOOL
from tests.trial.tool import verdict

CLEARANCE = 2e-5  # m: so small that the journal keeps to its bearing, at every speed near this one


@pytest.fixture(scope="module")
def recorded():
    machine = SliderCrank()
    joint = replace(machine.joint_c, clearance=CLEARANCE)
    return record(replace(machine, joint_c=joint, drive=SpeedControl(700.0, ramp=0.1)), 1)


def bench(recording, seconds=FIT + JUDGED):
    return Bench.of(SliderCrank(), "C", [recording], seconds)


def with_gain(recording, channel, gain):
    values = recording.values.copy()
    values[:, recording.channels.index(channel)] *= gain
    return Recording(values, recording.channels, recording.rate)


def test_a_trajectory_without_impacts_is_fitted(recorded):
    said = trajectory.judge(bench(recorded), load_effects(["guide_friction", "sensor_gain"]))
    assert said["verdict"] == "none"
    assert said["clearance"]["after_m"] == pytest.approx(CLEARANCE, rel=0.01)


def test_lobes_are_tried_as_whole_numbers(recorded):
    (worn,) = load_effects(["worn_bearing"])
    values = np.array([3e-4, 73.0, 0.0, 2e-5, 2.0 + 1e-4, 0.5])  # as a derivative by differences asks for
    assert bench(recorded).machine_with(values, 0, worn).joint_c.bearing == Worn(2e-5, 2.0, 0.5)


def test_a_wrong_gain_is_found_in_its_channel(recorded):
    faulty = with_gain(recorded, "rod_c_axial", 0.8)
    said = trajectory.judge(bench(faulty), load_effects(["guide_friction", "sensor_gain"]))
    (effect,) = said["effects"]
    assert (said["verdict"], effect["name"], effect["channel"]) == (
        "instrument",
        "sensor_gain",
        "rod_c_axial",
    )
    gain = effect["parameters"]["gain"]
    assert gain["value"] == pytest.approx(0.8, abs=0.01)
    assert gain["low"] < gain["value"] < gain["high"]


def test_standard_deviations_are_those_of_a_linear_fit():
    x, rng = np.linspace(0.0, 1.0, 2000), np.random.default_rng(1)
    columns = np.stack([np.ones_like(x), x], axis=1)
    noise = 0.1 * rng.normal(size=x.size)
    left = noise - columns @ np.linalg.lstsq(columns, noise, rcond=None)[0]
    exact = 0.1 * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    np.testing.assert_allclose(spread(columns, left), exact, rtol=0.05)


def test_features_tell_a_machine_of_another_gain(recorded):
    pytest.importorskip("sbi")
    said = two_sample.judge(bench(recorded, 60.0), ())
    assert said["verdict"] == "none"
    said = two_sample.judge(bench(with_gain(recorded, "rod_c_axial", 0.5), 60.0), ())
    assert (said["verdict"], said["effects"]) == ("unknown", [])


def test_a_sparse_model_names_the_term_that_explains_most(recorded):
    pytest.importorskip("pysindy")
    said = sparse.judge(bench(with_gain(recorded, "rod_c_axial", 0.8)), load_effects())
    (effect,) = said["effects"]
    assert (effect["name"], effect["channel"]) == ("sensor_gain", "rod_c_axial")
    without = sparse.judge(
        bench(with_gain(recorded, "rod_c_axial", 0.8)), load_effects(without=["sensor_gain"])
    )
    assert (without["verdict"], without["mismatch"]["body"]) == ("unknown", "rod")


@pytest.mark.parametrize(
    ("judge", "module"), [(sparse.judge, "pysindy"), (two_sample.judge, "sbi.diagnostics.misspecification")]
)
def test_a_library_that_is_not_installed_is_named(recorded, monkeypatch, judge, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"pip install '\.\[baselines\]'"):
        judge(bench(recorded), load_effects(["guide_friction"]))


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("method=guess", "method = 'guess' is unknown"),
        ("joint=unknown", "joint=B or joint=C"),
        ("method=sparse", "nothing to judge"),
    ],
)
def test_a_wrong_input_is_one_line(capfd, monkeypatch, tmp_path, override, said):
    monkeypatch.chdir(tmp_path)
    code, error = call(monkeypatch, capfd, "trial.baselines.__main__", override, "hydra.run.dir=run")
    assert (code, error.count("\n")) == (2, 1)
    assert said in error


def test_several_programs_are_compared_on_the_same_cases(trial):
    trial.examine()
    accused = {"name": "guide_friction", "kind": "physics", "probability": 0.9, "parameters": {}}
    (null,) = [part["truth"]["name"] for part in trial.truth()["cases"] if part["truth"]["kind"] == "none"]
    trial.answer({null: verdict("physics", [accused])})
    program = [sys.executable, str(TOOL), str(trial.answers)]
    Examiner(program, verdicts="baselines/sparse").examine(trial.folder, 2, lambda line: None)
    assert len(trial.asked()) == 8
    commit_verdicts(trial.folder, "baselines/sparse")
    assert (trial.folder / "baselines" / "sparse.json").exists()
    summaries = {
        name: summarise([score_case(one) for one in reveal(trial.folder, trial.sealed, folder)[1]])
        for name, folder in (("ours", "verdicts"), ("theirs", "baselines/sparse"))
    }
    text = comparison(summaries)
    assert text.startswith("| | ours | theirs |\n|---|---|---|\n")
    assert "| false alarms where nothing is missing | 0 of 1 (0.0%) | 1 of 1 (100.0%) |" in text
