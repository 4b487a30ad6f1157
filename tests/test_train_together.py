"""``seeds=[...]``: the folders that separate trainings would leave, and what later commands make of them."""

import json

import numpy as np
import pytest
from omegaconf import OmegaConf
from safetensors.numpy import load_file
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from clearance.evaluation.results import collect
from clearance.train import of_seed
from clearance.whole_files import read_yaml
from tests.command_line import SMALL, call

RUNS = "model.net.fold=4,model.net.hidden_size=16"
END = "trainer.accelerator=cpu,trainer.epochs=3,trainer.threads=1"
TRAIN = (*SMALL, "trainer.epochs=3")


@pytest.fixture
def train(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)

    def run(*overrides):
        code, error = call(monkeypatch, capfd, "train", *TRAIN, *overrides)
        assert code == 0, error
        return tmp_path / "outputs/train/smoke"

    return run


def test_each_seed_has_the_folder_that_it_would_have_alone(train, tmp_path):
    together = train("seeds=[1,2]")
    both = together / f"{RUNS},seeds=[1,2],{END}"
    one, two = (together / f"{RUNS},seed={seed},{END}" for seed in (1, 2))
    assert not (both / "checkpoints").exists()
    assert not (both / "metrics.json").exists()
    together.rename(tmp_path / "together")
    alone = train("seed=2") / two.name  # the very name: it would otherwise be trained again
    two = tmp_path / "together" / two.name
    files = [{path.name for path in run.iterdir() if path.is_file()} for run in (two, alone)]
    events = [{name for name in names if name.startswith("events")} for names in files]
    assert files[0] - events[0] == files[1] - events[1] - {"train.log"}
    assert len(events[0]) == 1
    ours, theirs = (read_yaml(run / "config.yaml") for run in (two, alone))
    assert ours | {"overrides": []} == theirs | {"overrides": []}  # but for seeds=[1,2]
    assert (two / "scalers.json").read_bytes() == (alone / "scalers.json").read_bytes()
    ours, theirs = (load_file(run / "model.safetensors") for run in (two, alone))
    assert ours.keys() == theirs.keys()
    for name, weight in theirs.items():
        np.testing.assert_allclose(ours[name], weight, rtol=1e-4, atol=2e-6, err_msg=name)
    ours, theirs = (json.loads((run / "metrics.json").read_text()) for run in (two, alone))
    assert ours.keys() == theirs.keys()
    assert (ours.pop("trained_together"), theirs.pop("trained_together")) == (2, 1)
    for part in ("validation", "test"):
        assert ours[part] == pytest.approx(theirs[part], rel=1e-4)
    assert (ours["seed"], ours["parameters"]) == (2, theirs["parameters"])
    rows = collect(tmp_path / "together")
    assert {row["seed"] for row in rows} == {1, 2}
    assert one.name in {path.parent.name for path in (tmp_path / "together").rglob("metrics.json")}


def test_what_a_kill_between_two_seeds_left_is_finished_without_training(train, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("clearance.models.run_folder.RunFolder.drop_checkpoints", lambda self: None)
        train("seeds=[1,2]", "hydra.run.dir=run")
    one, two = (tmp_path / "run" / f"seed={seed}" for seed in (1, 2))
    weights = load_file(two / "model.safetensors")
    (two / "metrics.json").unlink()
    (two / "model.safetensors").unlink()
    before = {path: path.stat().st_mtime_ns for path in one.iterdir()}
    train("seeds=[1,2]", "hydra.run.dir=run")
    again = load_file(two / "model.safetensors")  # the file's bytes may differ: its header has no order
    assert again.keys() == weights.keys()
    assert all(np.array_equal(again[name], weight) for name, weight in weights.items())
    assert (two / "metrics.json").exists()
    epochs = [one.step for one in EventAccumulator(str(two)).Reload().Scalars("val/loss")]
    assert len(epochs) == 3  # none was trained again
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert not (tmp_path / "run/checkpoints").exists()
    rows = collect(tmp_path / "run")  # whatever the folder is called
    assert [(row["experiment"], row["seed"]) for row in rows] == [("smoke", row["seed"]) for row in rows]
    assert rows[0]["overrides"] == ["model.net.hidden_size=16", "model.net.fold=4"]


@pytest.mark.parametrize(
    ("folder", "expected"),
    [
        ("a/model=gru,seeds=[1,2],trainer.monitor=val/loss", "a/model=gru,seed=2,trainer.monitor=val/loss"),
        ("seeds=[7]/x/seeds=[1,2]", "seeds=[7]/x/seed=2"),
        ("a/mine", "a/mine/seed=2"),
    ],
)
def test_a_folder_is_named_by_its_seed(folder, expected):
    cfg = OmegaConf.create({"folder": folder, "seeds": [1, 2], "seed": 42})
    assert of_seed(cfg, 2) == {"folder": expected, "seeds": None, "seed": 2}
