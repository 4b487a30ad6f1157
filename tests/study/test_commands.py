"""``clearance.study`` and the report of ``clearance.evaluate`` as a user runs them."""

import json
import re
from pathlib import Path

import pytest

from clearance.evaluation.paper.results import RECORD
from clearance.evaluation.paper.trainings import Setting, Training
from clearance.study.__main__ import _recorded
from tests.command_line import ROOT, call, launch
from tests.study_folder import finish


def test_evaluate_writes_the_report(tmp_path, monkeypatch, capfd):
    finish(tmp_path / "runs", Training(Setting("lstm"), 98, 42), 0.5, "scale=reduced")
    monkeypatch.chdir(tmp_path)
    where = ("runs=runs", "report=out/RESULTS.md", "pictures=out/pictures")
    # table7 in place of all experiments: no figures, whose simulations take seconds
    assert call(monkeypatch, capfd, "evaluate", *where, "experiment=table7") == (0, "")
    assert "| LSTM | 1 of 30 | 0.50 |" in (tmp_path / "out/RESULTS.md").read_text()
    assert len(json.loads((tmp_path / "out/pictures/study.json").read_text())) == 1


@pytest.mark.parametrize(
    ("name", "wrong", "words"),
    [
        ("evaluate", ("runs=30",), "runs = 30: no finished training there"),
        ("evaluate", ("perturbed=-1",), "perturbed = -1 is not a whole number, 0 or more; change perturbed"),
        (
            "evaluate",
            ("runs=outptus", "report=R.md"),
            "runs = outptus: there is no such folder, and no record",
        ),
        ("evaluate", ("readme=R.md",), "readme=R.md: made only together with the results; set results"),
        ("evaluate", ("picture=run",), "picture=run: made only together with the results; set results"),
        ("study.__main__", ("budget=soon",), "budget = 'soon' is no duration such as 90s, 30m, 2h or 1d"),
        ("study.__main__", ("scale=tiny",), "scale/tiny"),
        (
            "study.__main__",
            ("experiments=table6",),
            "experiments=table6: must be a list; write 'experiments=",
        ),
        ("study.__main__", ("experiments=[table7]",), "experiment=table7 sweeps nothing"),
        ("bench", ("workers=-1",), "workers = -1 is not a whole number, 1 or more; change workers"),
    ],
)
def test_a_wrong_input_is_one_line(tmp_path, monkeypatch, capfd, name, wrong, words):
    monkeypatch.chdir(tmp_path)
    code, error = call(monkeypatch, capfd, name, *wrong)
    assert (code, error.count("\n")) == (2, 1)
    assert words in error
    assert not (tmp_path / "R.md").exists()


def test_what_is_no_training_is_named(tmp_path, monkeypatch, capfd):
    (tmp_path / "runs/other").mkdir(parents=True)
    (tmp_path / "runs/other/metrics.json").write_text('{"accuracy": 1.0}')
    monkeypatch.chdir(tmp_path)
    code, error = call(monkeypatch, capfd, "evaluate", "runs=runs", "results=out")
    assert (code, error.count("\n")) == (2, 1)
    assert "runs/other: no training of clearance.train, or of an older version; set runs" in error


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ("scale=smoke", r"scale=smoke would train \(campaign.duration, "),
        (
            "arguments=['contact=flores']",
            r"scale=reduced contact=flores would train \(contact._target_\); set folder, pictures and report",
        ),
        ("arguments=['data.batch_size=32']", r"\(data.batch_size\)"),
        ("arguments=['campaign.seed=3']", r"\(campaign.seed\)"),
    ],
)
@pytest.mark.parametrize("place", ["record", "folder"])
def test_other_trainings_than_those_to_come_end_a_study_before_it_begins(
    tmp_path, monkeypatch, capfd, place, other, words
):
    finish(tmp_path / "runs", Training(Setting("lstm"), 98, 42), 0.5, "scale=reduced")
    monkeypatch.chdir(tmp_path)
    where = ("report=out/RESULTS.md", "pictures=out/pictures")
    if place == "record":
        assert call(monkeypatch, capfd, "evaluate", "runs=runs", *where, "experiment=table7") == (0, "")
    folder = "runs" if place == "folder" else "elsewhere"
    monkeypatch.setattr("clearance.study.__main__.Runner", None)  # it would train for hours
    code, error = call(monkeypatch, capfd, "study.__main__", f"folder={folder}", *where, other)
    assert (code, error.count("\n")) == (2, 1)
    assert re.search(words, error), error


@pytest.mark.parametrize("scale", ["reduced", "short"])
def test_the_committed_record_is_of_the_study_as_it_is(scale):
    record = ROOT / "docs/results/study" / scale / RECORD
    arguments = (f"scale={scale}", "trainer.threads=1", "trainer.accelerator=cpu")
    assert len(_recorded(Path("none"), record, arguments)) == len(json.loads(record.read_text()))


@pytest.mark.slow
def test_a_study_trains_evaluates_and_reports_and_goes_on(tmp_path):
    study = ("scale=smoke", "experiments=[table5,table6]", "perturbed=6", "folder=runs", "report=R.md")
    short = launch("study", *study, "budget=150s", "pictures=pictures", folder=tmp_path)
    assert short.returncode == 0, short.stderr
    first = (tmp_path / "R.md").read_text()
    assert "## Table 5" in first
    assert {"figure2.png", "figure5.png", "figure6.png"} <= {
        path.name for path in (tmp_path / "pictures").iterdir()
    }
    done = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").rglob("metrics.json")}
    assert done
    again = launch("study", *study, "budget=150s", "pictures=pictures", folder=tmp_path)
    assert again.returncode == 0, again.stderr
    assert all(path.stat().st_mtime_ns == time for path, time in done.items())
    assert len(list((tmp_path / "runs").rglob("metrics.json"))) > len(done)
