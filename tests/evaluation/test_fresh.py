"""The interval keeps its promise on simulations newer than the training; tables are made from files."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import OmegaConf

from clearance.commands import CONFIGURATION
from clearance.errors import InputError
from clearance.evaluate import measure_coverage
from clearance.evaluation.fresh import FRESH, FreshEvaluation, evaluate_fresh, read_fresh
from clearance.evaluation.results import collect, markdown, marks, put_between_marks
from clearance.models.gauge import Gauge
from clearance.models.run_folder import RunFolder
from clearance.recording.synthesis import Campaign

CALIBRATION, FRESH_RECORDINGS = 60, 150


@pytest.fixture(scope="module")
def forest(tmp_path_factory):
    """A small forest on short recordings: the interval must hold for a poor estimator too."""
    folder = tmp_path_factory.mktemp("forest")
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        cfg = compose(
            "train",
            [
                "model=random_forest", "experiment=smoke", "runs=200", "data_seed=11", "model.trees=20",
                "model.jobs=1", "model.features=0.1", "campaign.duration=0.5", "start_time=0.4",
                "data.split.train=0.5", "data.split.validation=0.2", f"data.source.folder={folder}/data",
            ],
        )  # fmt: skip
    OmegaConf.set_struct(cfg, False)
    data, campaign = instantiate(cfg.data), instantiate(cfg.campaign, _convert_="all")
    data.prepare_data()
    data.setup()
    assert len(data.parts.test) == CALIBRATION
    estimator = instantiate(cfg.model)
    estimator.fit(data, RunFolder.open(folder / "run", {}, 42))
    return Gauge.calibrate(estimator, data, 0.9, 0.02, 1e-3), campaign


def test_coverage_on_fresh_simulations(forest):
    gauge, campaign = forest
    (result,) = evaluate_fresh(gauge, campaign, FRESH_RECORDINGS)
    summary = result.summary()
    assert summary["joint"] == "C"
    # Coverage given the calibration is Beta distributed around 0.9: 3.5 deviations, binomial ones included.
    deviation = np.sqrt(0.9 * 0.1 * (1 / (CALIBRATION + 2) + 1 / FRESH_RECORDINGS))
    assert abs(summary["coverage"] - 0.9) < 3.5 * deviation
    assert summary["median_width_m"] < 0.9e-3  # not by calling everything possible
    assert summary["trusted"] > 0.8
    assert len(set(result.truth)) == FRESH_RECORDINGS
    seen = [campaign.labels(range(campaign.runs))[:, 1], campaign.fresh(5, 0, ("rod_b_axial",))[1][:, 1]]
    assert not set(result.truth) & {float(value) for values in seen for value in values}


def test_the_brackets_of_a_coverage_are_of_95_percent():
    nine = FreshEvaluation("C", [1.0] * 10, [1.0] * 10, [0.0] * 9 + [2.0], [3.0] * 10, [True] * 10).summary()
    assert nine["coverage"] == pytest.approx(0.9)
    assert (nine["coverage_low"], nine["coverage_high"]) == pytest.approx((0.55498, 0.99747), abs=1e-4)


def test_of_recordings_that_no_campaign_made_nothing_fresh_is_simulated(tmp_path):
    source = {"source": {"_target_": "clearance.windows.measured.MeasuredSource"}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"campaign": {"runs": 3}, "data": source}))
    measure_coverage(tmp_path, 10)
    assert not (tmp_path / FRESH).exists()


def test_of_what_was_asked_a_run_that_fails_is_not_asked_again(forest, tmp_path, monkeypatch):
    gauge, campaign = forest
    asked, plain = [], Campaign.fresh

    def fresh(self, runs, epoch, channels):
        asked.append(runs)
        return plain(self, runs - 1, epoch, channels)

    monkeypatch.setattr(Campaign, "fresh", fresh)
    monkeypatch.setattr("clearance.evaluate.load_gauge", lambda run: gauge)
    monkeypatch.setattr("clearance.evaluate.instantiate_trusted", lambda config, where: campaign)
    source = {"source": {"_target_": "clearance.windows.sources.SimulatedSource"}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"campaign": {"runs": 3}, "data": source}))
    measure_coverage(tmp_path, 3)  # without weights there is nothing to measure
    (tmp_path / "model.npz").touch()
    for _ in range(2):
        measure_coverage(tmp_path, 3)
    assert asked == [3]
    assert read_fresh(tmp_path)[0]["summary"]["recordings"] == 2


def test_fresh_runs_that_all_fail_are_one_line(forest, tmp_path, monkeypatch):
    gauge, campaign = forest
    monkeypatch.setattr(Campaign, "fresh", lambda *_: ([], np.empty((0, 3))))
    monkeypatch.setattr("clearance.evaluate.load_gauge", lambda run: gauge)
    monkeypatch.setattr("clearance.evaluate.instantiate_trusted", lambda config, where: campaign)
    (tmp_path / "model.npz").touch()
    source = {"source": {"_target_": "clearance.windows.sources.SimulatedSource"}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"campaign": {"runs": 3}, "data": source}))
    with pytest.raises(
        InputError, match=r"fresh=7: every fresh run became non-finite; set fresh=0"
    ) as caught:
        measure_coverage(tmp_path, 7)
    assert str(caught.value).startswith(f"{tmp_path}: ")
    assert not (tmp_path / FRESH).exists()


@pytest.mark.parametrize(("start_time", "expected"), [(2.5, 2.5), (1.0, 2.0), (None, 2.0)])
def test_fresh_recordings_begin_where_those_of_the_training_did(
    forest, tmp_path, monkeypatch, start_time, expected
):
    gauge, campaign = forest
    begun = []

    def fresh(self, runs, epoch, channels):
        begun.append(self.record_start)
        return [], np.empty((0, 3))

    monkeypatch.setattr(Campaign, "fresh", fresh)
    monkeypatch.setattr("clearance.evaluate.load_gauge", lambda run: gauge)
    made = replace(campaign, duration=3.0, record_start=2.0)
    monkeypatch.setattr("clearance.evaluate.instantiate_trusted", lambda config, where: made)
    (tmp_path / "model.npz").touch()
    source = {"_target_": "clearance.windows.sources.SimulatedSource", "start_time": start_time}
    (tmp_path / "config.yaml").write_text(
        yaml.safe_dump({"campaign": {"runs": 3}, "data": {"source": source}})
    )
    with pytest.raises(InputError, match="every fresh run"):
        measure_coverage(tmp_path, 7)
    assert begun == [expected]


def test_a_gauge_of_another_machine_is_not_trusted(forest):
    gauge, _campaign = forest
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        cfg = compose(
            "simulate",
            ["campaign.duration=0.5", "campaign.record_start=0.4", "mechanism.slider.mass=0.5", "runs=30"],
        )
    other = instantiate(cfg.campaign, _convert_="all")
    assert evaluate_fresh(gauge, other, 30)[0].summary()["trusted"] < 0.5


def finished(folder, name, nmae, source="{runs: 20}"):
    folder.mkdir(parents=True)
    scores = {"nmae": nmae, "nrmse": 2 * nmae, "p95_ae": 1e-5, "recording_nmae": nmae / 2}
    metrics = {
        "data": {"recordings": 10}, "parameters": 5, "seed": 1, "split_seed": 2, "training_seconds": 60.0,
        "environment": {"gpu": "a GPU"}, "validation": scores, "test": scores,
    }  # fmt: skip
    (folder / "metrics.json").write_text(json.dumps(metrics))
    (folder / "config.yaml").write_text(
        f"name: {name}\nwindows: {{length: 200}}\nmodel: {{training: {{epochs: 30}}}}\n"
        f"data: {{source: {source}}}\n"
    )


def test_the_table_is_made_from_the_runs_files(tmp_path):
    finished(tmp_path / "quick" / "a", "worse", 2.0)
    finished(tmp_path / "quick" / "b", "better", 1.0, "{runs: 20, held_out: 5}")
    rows = collect(tmp_path)
    assert [(row["name"], row["streamed"]) for row in rows] == [("better", 600), ("worse", None)]
    table = markdown(rows)
    assert "1.00 %" in table
    assert "| 10 | 30 | 1.00 % |" in table
    assert "not measured | 1.0 min, a GPU |" in table
    begin, end = marks("results")
    text = put_between_marks(f"head\n{begin}\nformerly\n{end}\ntail\n", "results", table)
    assert "formerly" not in text
    assert text.startswith("head\n")
    assert text.endswith("tail\n")
    assert put_between_marks(text, "results", table) == text


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(InputError, match=r"clearance\.train"):
        collect(tmp_path)
    with pytest.raises(InputError, match="results"):
        put_between_marks("no marks", "results", "")


def test_what_an_older_version_measured_is_measured_again(tmp_path):
    assert read_fresh(tmp_path) == []
    (tmp_path / FRESH).write_text('{"summary": {"recordings": 300}}')
    assert read_fresh(tmp_path) == []
    (tmp_path / FRESH).write_text('[{"summary": {"recordings": 300}}]')
    assert read_fresh(tmp_path)[0]["summary"]["recordings"] == 300
