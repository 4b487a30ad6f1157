"""``joint=unknown``: one model is trained that tells the clearances of both joints, and which have any."""

import json
import re
import sys
from io import StringIO

import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from clearance.configuration import CONFIGURATION
from clearance.models.location import LOCATIONS
from clearance.recording.files import write
from tests.command_line import SMALL, call

MODELS = {
    "lstm": SMALL,
    "random_forest": ("experiment=smoke", "model=random_forest", "model.trees=5", "model.jobs=1"),
    "xgboost": ("experiment=smoke", "model=xgboost", "model.rounds=5", "model.depth=4"),
}


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A folder in which the simulated runs are shared, with recordings of others of the same machine."""
    folder = tmp_path_factory.mktemp("home")
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        cfg = compose("train", [*SMALL, "joint=unknown", "data_seed=7"])
    campaign = instantiate(cfg.campaign, _convert_="all")
    for run in (0, 1):
        write(campaign.recording(run), folder / f"{run}.parquet")
    return folder


@pytest.mark.parametrize("model", MODELS)
def test_a_model_of_any_location_is_trained_and_says_where_the_clearance_is(model, home, monkeypatch, capfd):
    monkeypatch.chdir(home)
    code, error = call(monkeypatch, capfd, "train", *MODELS[model], "joint=unknown", f"hydra.run.dir={model}")
    assert code == 0, error
    found = json.loads((home / model / "metrics.json").read_text())["test"]
    assert found["nmae"] == pytest.approx((found["nmae_b"] + found["nmae_c"]) / 2)
    assert found["recording_nmae"] == pytest.approx(
        (found["recording_nmae_b"] + found["recording_nmae_c"]) / 2
    )
    assert found["location_accuracy"] in (0, 1 / 3, 2 / 3, 1)  # three test recordings
    calibration = json.loads((home / model / "calibration.json").read_text())
    assert calibration["targets"] == ["clearance_b", "clearance_c"]
    assert all(0 < threshold <= 1e-3 for threshold in calibration["thresholds"])
    events = EventAccumulator(str(home / model), size_guidance={"images": 0}).Reload()
    assert {"test/location", "test/error_b", "test/error_c"} <= set(events.Tags()["images"])
    assert {"test/location_accuracy", "test/nmae_b"} <= set(events.Tags()["scalars"])

    output = f"{model}.json"
    asked = (f"checkpoint={model}", "recordings=[0.parquet,1.parquet]", f"output={output}")
    with monkeypatch.context() as patch:
        patch.setattr("sys.stdout", StringIO())
        code, error = call(patch, capfd, "predict", *asked)
        written = sys.stdout.getvalue()
    assert code == 0, error
    said = json.loads((home / output).read_text())
    assert [(one["path"], one["joint"]) for one in said] == [
        (path, joint) for path in ("0.parquet", "1.parquet") for joint in "BC"
    ]
    for one, threshold in zip(said, 2 * calibration["thresholds"], strict=True):
        assert one["has_clearance"] == (one["clearance_m"] > threshold)
        assert 0 <= one["low_m"] <= one["high_m"]
    for path in ("0.parquet", "1.parquet"):
        at_b, at_c = (one["has_clearance"] for one in said if one["path"] == path)
        assert f"{path}: clearance in {LOCATIONS[at_b + 2 * at_c]}\n" in written
        assert len(re.findall(rf"^{path} +[BC] +0\.\d{{4}} ", written, re.MULTILINE)) == 2


def test_where_both_joints_are_loose_both_are_estimated(home, monkeypatch, capfd):
    monkeypatch.chdir(home)
    settings = MODELS["random_forest"]
    code, error = call(monkeypatch, capfd, "train", *settings, "joint=both", "hydra.run.dir=loose")
    assert code == 0, error
    test = json.loads((home / "loose/metrics.json").read_text())["test"]
    assert {"nmae_b", "nmae_c"} < test.keys()
    asked = ("checkpoint=loose", "recordings=[0.parquet]", "output=loose.json")
    code, error = call(monkeypatch, capfd, "predict", *asked)
    assert code == 0, error
    assert [one["joint"] for one in json.loads((home / "loose.json").read_text())] == ["B", "C"]
