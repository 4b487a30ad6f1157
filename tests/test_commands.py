"""The commands as a user runs them: simulate, train, predict; repeated, killed, mistyped."""

import json
import math
import re
import signal
import subprocess
import time

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import OmegaConf
from safetensors.numpy import load_file
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

from clearance.commands import CONFIGURATION, _quoted, _reported
from clearance.mechanism.description import write_mechanism
from clearance.mechanism.joint import Joint
from clearance.mechanism.load import ConstantProcess
from clearance.mechanism.slider_crank import Link, SliderCrank
from clearance.recording.dataset import Dataset
from clearance.recording.files import write
from tests.command_line import SMALL, command, environment, launch

# Many short epochs: time for a signal to arrive before the last one.
TRAIN = (*SMALL, "trainer.epochs=40", "hydra.run.dir=run")
SIMULATE = ("runs=4", "seed=3", "campaign.duration=0.3", "campaign.record_start=0.1", "dataset=data")


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="module")
def trained(home):
    done = launch("train", *TRAIN, folder=home)
    assert done.returncode == 0, done.stderr
    return home / "run", done.stdout


@pytest.fixture(scope="module")
def campaign():
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        cfg = compose("train", [*SMALL, "data_seed=7"])
    return instantiate(cfg.campaign, _convert_="all")


def test_simulate_makes_a_data_set_and_has_nothing_to_do_the_second_time(home):
    first = launch("simulate", *SIMULATE, folder=home)
    assert first.returncode == 0, first.stderr
    assert "data holds 4 of 4 runs of 0.2 s at 10 kHz (0 failed)" in first.stdout
    chunks = {path: path.stat().st_mtime_ns for path in (home / "data/signals/c").rglob("*")}
    second = launch("simulate", *SIMULATE, folder=home)
    assert (second.returncode, second.stderr) == (0, "")
    assert "data holds 4 of 4 runs" in second.stdout
    assert chunks == {path: path.stat().st_mtime_ns for path in (home / "data/signals/c").rglob("*")}
    assert Dataset.open(home / "data").available().tolist() == [0, 1, 2, 3]


@pytest.mark.slow
def test_a_mechanism_from_a_file_is_simulated_and_trained_on(tmp_path):
    folder = tmp_path / "found, by=diagnosis"
    folder.mkdir()
    heavy = SliderCrank(rod=Link(0.3, 2.5e-4, 0.12), joint_b=Joint(1e-4), process=ConstantProcess(7.0))
    write_mechanism(folder / "corrected.yaml", heavy)
    named = f"mechanism={folder.relative_to(tmp_path)}/corrected.yaml"
    done = launch("simulate", *SIMULATE[:-1], "dataset=heavy", named, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (Dataset.open(tmp_path / "heavy").labels["clearance_b"] == 1e-4).all()
    done = launch("train", *SMALL, named, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    (run,) = (tmp_path / "outputs/train/smoke").iterdir()
    assert "mechanism=corrected-" in run.name
    assert "mass: 0.3" in (run / "config.yaml").read_text()
    wrong = launch("train", *SMALL, "mechanism=nowhere.yaml", folder=tmp_path)
    assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)
    assert "error: mechanism=nowhere.yaml: No such file" in wrong.stderr


def test_a_training_leaves_what_it_says(trained):
    run, output = trained
    assert {"config.yaml", "model.safetensors", "scalers.json", "calibration.json", "metrics.json"} <= {
        path.name for path in run.iterdir()
    }
    assert not (run / "checkpoints").exists()
    metrics = json.loads((run / "metrics.json").read_text())
    assert all(math.isfinite(metrics[part]["nmae"]) for part in ("validation", "test"))
    assert "epoch 1 of 40: validation NMAE" in output
    assert "s left" in output
    assert "mean error on 3 test recordings" in output


def test_a_finished_training_is_reported_and_left_alone(trained, home):
    run, _ = trained
    before = {
        path: path.stat().st_mtime_ns for path in run.iterdir() if path.suffix in (".json", ".safetensors")
    }
    again = launch("train", *TRAIN, folder=home)
    assert again.returncode == 0, again.stderr
    assert "run is finished: resume=false trains again" in again.stdout
    assert before == {path: path.stat().st_mtime_ns for path in before}


def test_tensorboard_shows_losses_metrics_hyperparameters_and_pictures(trained):
    run, _ = trained
    events = EventAccumulator(str(run), size_guidance={"images": 0, "scalars": 0}).Reload()
    assert {"train/loss", "val/loss", "val/nmae", "test/nmae", "lr-AdamW"} <= set(events.Tags()["scalars"])
    assert len(events.Scalars("val/nmae")) == 40
    assert {"test/predicted_against_true", "test/error"} <= set(events.Tags()["images"])
    started = events.PluginTagToContent("hparams")["_hparams_/session_start_info"]
    parameters = HParamsPluginData.FromString(started).session_start_info.hparams
    assert parameters["seed"].number_value == 42
    assert parameters["model/net/hidden_size"].number_value == 16
    assert any("lr" in name for name in parameters)


def test_predict_estimates_a_recording_that_the_model_has_not_seen(trained, home, campaign):
    (home / "more").mkdir()
    for run, path in enumerate(("0.parquet", "more/1.parquet")):
        write(campaign.recording(run), home / path)
    done = launch("predict", "checkpoint=run", "recordings=[0.parquet,more]", "output=p.json", folder=home)
    assert (done.returncode, done.stderr) == (0, "")
    estimates = json.loads((home / "p.json").read_text())
    assert [one["path"] for one in estimates] == ["0.parquet", "more/1.parquet"]
    for one in estimates:
        assert {"path", "clearance_m", "low_m", "high_m", "trusted", "reason"} <= set(one)
        assert 0 <= one["low_m"] <= one["clearance_m"] <= one["high_m"] <= 1e-3
        assert f"{one['clearance_m'] * 1e3:.4f}" in done.stdout
    assert "90% interval mm" in done.stdout


def started(home, *overrides):
    """A training that has finished its first epoch."""
    process = subprocess.Popen(
        command("train", *overrides), cwd=home, env=environment(), text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        # a test run in the background ignores Ctrl-C, and its children would inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    deadline = time.time() + 120
    while not (home / "killed/checkpoints/last.ckpt").exists() and time.time() < deadline:
        time.sleep(0.005)
    return process


def test_a_killed_training_goes_on_to_the_very_same_weights(trained, home):
    run, _ = trained
    overrides = (*TRAIN[:-1], "hydra.run.dir=killed")
    stopped = started(home, *overrides)
    stopped.send_signal(signal.SIGINT)
    assert "interrupted; the same command goes on from here" in stopped.communicate()[1]
    assert stopped.returncode == 130
    killed = started(home, *overrides)
    time.sleep(0.05)
    killed.kill()
    killed.communicate()
    assert not (home / "killed/metrics.json").exists()
    resumed = launch("train", *overrides, folder=home)
    assert resumed.returncode == 0, resumed.stderr
    assert "going on from" in resumed.stdout
    # Bit by bit: the order of the windows and the optimiser's state are those of the uninterrupted run.
    for name in ("scalers.json", "calibration.json"):
        assert (home / "killed" / name).read_bytes() == (run / name).read_bytes(), name
    once, again = (load_file(folder / "model.safetensors") for folder in (run, home / "killed"))
    assert once.keys() == again.keys()
    for name, weight in once.items():
        np.testing.assert_array_equal(again[name], weight, err_msg=name)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("rnus=3", "error: Could not override 'rnus'"),
        ("contact=flroes", "error: .*contact/flroes.*flores"),
    ],
)
def test_a_mistyped_override_is_one_line(home, wrong, words):
    done = launch("simulate", wrong, folder=home)
    assert done.returncode == 2
    assert re.fullmatch(f"{words}.*\n", done.stderr)


def test_help_is_the_commands_own_and_runs_nothing(home):
    before = sorted(home.rglob("*"))
    done = launch("simulate", "joint=B", "--help", folder=home)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Simulate a data set.")
    assert sorted(home.rglob("*")) == before


def test_an_unknown_option_is_named(home):
    done = launch("simulate", "--fast", folder=home)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "simulate.py: error: unrecognized arguments: --fast"


def test_a_folder_named_by_overrides_needs_no_quotes():
    assert _quoted("checkpoint=runs/model=lstm,seed=1") == "checkpoint='runs/model=lstm,seed=1'"
    assert _quoted("begin=runs/begin='runs/a=1',seed=1") == "begin=\"runs/begin='runs/a=1',seed=1\""
    for as_it_is in (
        "model=lstm,gru",
        "recordings=[a.csv,b.csv]",
        "+a={b=1}",
        "model.rate=choice('a/b=1',c)",
        "seed=range(3)",
        "seed=range(start=0,stop=3)",
        "model=glob(*,exclude=xgboost)",
        "a='b=c'",
        "--help",
    ):
        assert _quoted(as_it_is) == as_it_is


def test_an_interrupted_training_anew_does_not_promise_that_the_same_command_goes_on(capsys):
    with pytest.raises(SystemExit), _reported(OmegaConf.create({"resume": False})):
        raise KeyboardInterrupt
    assert (
        "the same command, with resume=true once it has begun to train, goes on from here"
        in capsys.readouterr().err
    )


def test_a_command_that_keeps_nothing_does_not_promise_to_go_on(capsys):
    for settings in ({"resumes": False}, {"cfg": OmegaConf.create({"finished": None})}):
        with pytest.raises(SystemExit) as left, _reported(**settings):
            raise KeyboardInterrupt
        assert left.value.code == 130
        assert capsys.readouterr().err == "interrupted; the same command begins anew\n"


def test_an_error_that_ctrl_c_caused_is_reported_as_an_interruption(capsys):
    def interrupted_between_two_steps():
        try:
            raise KeyboardInterrupt
        finally:
            raise RuntimeError("a library that was interrupted between two steps")

    with pytest.raises(SystemExit) as left, _reported():
        interrupted_between_two_steps()
    assert left.value.code == 130
    assert "interrupted; the same command goes on from here" in capsys.readouterr().err
