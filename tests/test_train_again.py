"""Folders in which a training is already: kept, gone on with, or replaced when that is asked for."""

import shutil

import pytest
import yaml

from clearance.errors import InputError
from clearance.models.seen import require_same_division
from clearance.whole_files import read_json, read_yaml
from tests.command_line import TREES, call


def test_train_does_not_replace_another_training_unasked(refused, trained, tmp_path):
    shutil.copytree(trained / "run", tmp_path / "run")
    before = {path: path.read_bytes() for path in (tmp_path / "run").glob("*.json")}
    refused(
        "train",
        r"run holds a training with other settings \(.*seed.*\): choose.*resume=false",
        *TREES,
        "seed=5",
    )
    assert before == {path: path.read_bytes() for path in before}


def test_training_anew_once_does_not_spoil_later_plain_runs(trained, tmp_path, monkeypatch, capfd):
    shutil.copytree(trained, tmp_path / "home")
    monkeypatch.chdir(tmp_path / "home")
    metrics = tmp_path / "home/run/metrics.json"
    begin = metrics.stat().st_mtime_ns
    measured = metrics.with_name("fresh.json")
    measured.write_text("[]")
    assert call(monkeypatch, capfd, "train", *TREES, "hydra.run.dir=run", "resume=false")[0] == 0
    anew = metrics.stat().st_mtime_ns
    assert anew > begin
    assert not measured.exists()  # it was of other weights
    elsewhere = ("trainer.progress=false", "trainer.threads=1", "data.memory_gib=3")
    assert call(monkeypatch, capfd, "train", *TREES, "hydra.run.dir=run", *elsewhere)[0] == 0
    assert metrics.stat().st_mtime_ns == anew


def test_training_anew_on_data_that_are_not_there_keeps_the_finished_model(refused, trained, tmp_path):
    shutil.copytree(trained / "run", tmp_path / "run")
    refused(
        "train", "nothing is not there", *TREES, "resume=false", "data=stored", "data.source.path=nothing"
    )
    assert {"metrics.json", "model.ubj"} <= {path.name for path in (tmp_path / "run").iterdir()}


def test_a_job_that_slurm_queued_again_does_not_begin_anew_twice(trained, tmp_path, monkeypatch, capfd):
    shutil.copytree(trained, tmp_path / "home")
    monkeypatch.chdir(tmp_path / "home")
    metrics = tmp_path / "home/run/metrics.json"
    anew = (*TREES, "hydra.run.dir=run", "resume=false")
    times = [metrics.stat().st_mtime_ns]
    for job, restarts in (("7", "0"), ("7", "1"), ("8", "1")):
        monkeypatch.setenv("SLURM_JOB_ID", job)
        monkeypatch.setenv("SLURM_RESTART_COUNT", restarts)
        assert call(monkeypatch, capfd, "train", *anew)[0] == 0
        times.append(metrics.stat().st_mtime_ns)
    assert times[0] < times[1] == times[2] < times[3]


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ("split_seed=7", "split_seed"),
        ("runs=25", "runs"),
        ("data.split.train=0.6", "data.split.train"),
        (("runs=25", "campaign.duration=0.8"), "runs"),  # the same machines, recorded for longer
        # the same machines, but for those that draw more
        (("runs=25", "campaign.random={gravity.1: [-9.81, 0]}", "campaign.random_share=0.5"), "runs"),
    ],
)
def test_weights_that_have_seen_what_they_would_be_tested_on_are_refused(refused, trained, other, words):
    words = rf"has seen recordings that this training would be tested on \({words} differ\)"
    other = (other,) if isinstance(other, str) else other
    refused("train", words, *TREES, f"begin='{trained}/run'", *other)


def test_weights_that_have_seen_other_machines_are_not(refused, trained):
    apart = (f"begin='{trained}/run'", "runs=25", "data_seed=8")
    refused("train", "trees do not go on from others", *TREES, *apart)


def test_weights_whose_weights_have_seen_it_are_refused(refused, trained, tmp_path):
    later = tmp_path / "later"
    shutil.copytree(trained / "run", later)
    config = read_yaml(later / "config.yaml")
    config |= {"begin": str(trained / "run")}
    config["data"]["source"]["simulation"]["seed"] = 8
    (later / "config.yaml").write_text(yaml.safe_dump(config))
    words = r"run has seen recordings that this training would be tested on \(split_seed differ\)"
    refused("train", words, *TREES, f"begin='{later}'", "split_seed=7")


def test_weights_that_have_seen_a_stored_data_set_are_refused(refused, trained):
    stored = next((trained / "outputs/datasets").iterdir())
    stored = ("data=stored", f"data.source.path='{stored}'", "split_seed=7")
    words = "has seen recordings that this training would be tested on"
    refused("train", words, *TREES, f"begin='{trained}/run'", *stored)


def test_weights_that_divided_other_recordings_of_the_same_machines_are_refused(trained, tmp_path):
    run = shutil.copytree(trained / "run", tmp_path / "run")
    config, metrics = read_yaml(run / "config.yaml"), read_json(run / "metrics.json")
    count, fingerprint = metrics["data"]["recordings"], metrics["data"]["fingerprint"]
    require_same_division(run, config, count, "of the same runs, recorded otherwise")
    with pytest.raises(InputError, match=f"divided {count} recordings of these machines.*{count - 1} now"):
        require_same_division(run, config, count - 1, fingerprint)
    config["data"]["source"]["simulation"]["seed"] = 8  # other machines
    require_same_division(run, config, count - 1, fingerprint)
    config["data"]["source"] = {"_target_": "clearance.windows.measured.MeasuredSource", "path": "list.csv"}
    (run / "config.yaml").write_text(yaml.safe_dump(config))
    require_same_division(run, config, count, fingerprint)
    with pytest.raises(InputError, match="or others"):
        require_same_division(run, config, count, "of a list with other lines")


def test_weights_that_have_seen_the_files_of_a_list_are_known_by_what_these_hold(trained, tmp_path):
    run = shutil.copytree(trained / "run", tmp_path / "run")
    config, metrics = read_yaml(run / "config.yaml"), read_json(run / "metrics.json")
    count, fingerprint = metrics["data"]["recordings"], metrics["data"]["fingerprint"]
    config["data"]["source"] = {"_target_": "clearance.windows.measured.MeasuredSource", "path": "list.csv"}
    (run / "config.yaml").write_text(yaml.safe_dump(config))
    config["data"]["source"]["path"] = "copy-of-list.csv"
    require_same_division(run, config, count, fingerprint)
    config["data"]["split"]["seed"] = 98
    require_same_division(run, config, count, "of other recordings")
    words = r"has seen recordings that this training would be tested on \(split_seed differ\)"
    with pytest.raises(InputError, match=words):
        require_same_division(run, config, count, fingerprint)


@pytest.mark.parametrize("threads", ["0", "many", "1.5"])
def test_trees_are_not_grown_on_an_impossible_number_of_threads(refused, threads):
    words = f"trainer.threads = '?{threads}'? is not a whole number from 1 to 1024, or null; change trainer"
    refused("train", words, *TREES, f"trainer.threads={threads}")


@pytest.mark.parametrize("left", ["config.yaml", "checkpoints"])
def test_files_that_no_training_left_are_kept(refused, tmp_path, left):
    (tmp_path / "run").mkdir()
    (tmp_path / "run/model.step").write_text("a drawing")
    (tmp_path / "run" / left).write_text("- mine\n")
    refused("train", "run holds files that no training left; choose another hydra.run.dir", *TREES)
    assert (tmp_path / "run/model.step").read_text() == "a drawing"
    assert (tmp_path / "run" / left).read_text() == "- mine\n"


@pytest.mark.parametrize("other", ["sensors=crank", "joint=unknown"])
def test_weights_that_read_something_else_are_refused(refused, trained, other):
    words = "reads .* for clearance_c, and this training .*; set sensors and joint as there"
    refused("train", words, *TREES, f"begin='{trained}/run'", other)


def test_what_is_finished_needs_the_weights_it_began_with_no_more(trained, tmp_path, monkeypatch, capfd):
    shutil.copytree(trained, tmp_path / "home")
    monkeypatch.chdir(tmp_path / "home")
    config = read_yaml(tmp_path / "home/run/config.yaml") | {"begin": "gone"}
    (tmp_path / "home/run/config.yaml").write_text(yaml.safe_dump(config))
    assert call(monkeypatch, capfd, "train", *TREES, "hydra.run.dir=run", "begin=gone")[0] == 0


def test_weights_that_do_not_say_what_they_have_seen_are_refused(refused, trained, tmp_path):
    shutil.copytree(trained / "run", tmp_path / "older")
    config = read_yaml(tmp_path / "older/config.yaml")
    del config["targets"]
    (tmp_path / "older/config.yaml").write_text(yaml.safe_dump(config))
    refused("train", "older/config.yaml does not say what it has seen", *TREES, "begin=older", "data_seed=8")
