"""Curves beside the paper's tables, and rows of trainings that are on another machine."""

import json

import pytest

from clearance.errors import InputError
from clearance.evaluation import curves
from clearance.evaluation.paper.results import write_results
from clearance.evaluation.paper.trainings import recorded_trainings
from clearance.evaluation.results import markdown, with_recorded
from tests.command_line import ROOT


def row(experiment, recordings, nmae, window=200, name="tcn on rod, joint C", epochs=30, streamed=None):
    errors = {"nmae": nmae, "nrmse": 2 * nmae, "p95_ae": nmae * 3e-5, "recording_nmae": nmae / 4}
    return {
        "experiment": experiment, "name": name, "recordings": recordings, "epochs": epochs, "window": window,
        "streamed": streamed, "seed": 42, "split_seed": 42, "test": errors, "training_seconds": 60.0,
        "environment": {"processor": "P", "threads": 2, "gpu": None},
    }  # fmt: skip


ROWS = [
    row("best", 1000, 0.31), row("quick", 300, 0.73), row("by_runs", 100, 1.6), row("by_runs", 300, 0.7),
    row("by_window", 300, 2.0, 50), row("quick", 300, 0.81, name="lstm on rod, joint C"),
    row("best", 1000, 0.21, epochs=100), row("by_streaming", 1300, 0.2, epochs=9, streamed=9000),
    row("by_streaming", 1300, 0.9, epochs=1, streamed=1000),
]  # fmt: skip


def test_a_curve_takes_trainings_of_the_same_recipe_from_wherever_they_are():
    assert [(one["recordings"], one["test"]["nmae"]) for one in curves.by_runs(ROWS)] == [
        (100, 1.6), (300, 0.7), (1000, 0.31),
    ]  # fmt: skip
    assert [(one["window"], one["test"]["nmae"]) for one in curves.by_window(ROWS)] == [
        (50, 2.0),
        (200, 0.73),
    ]
    assert [(one["streamed"], one["test"]["nmae"]) for one in curves.by_streaming(ROWS)] == [
        (1000, 0.9),
        (9000, 0.2),
    ]


def test_of_several_seeds_a_curve_does_not_take_the_best():
    lucky = row("quick", 300, 0.5) | {"seed": 43}
    assert curves.by_window([lucky, *ROWS]) == curves.by_window(ROWS)


def test_tables_and_picture_are_in_the_report(tmp_path):
    write_results(tmp_path / "none", tmp_path / "R.md", tmp_path / "pictures", {}, ROWS)
    text = (tmp_path / "R.md").read_text()
    assert "| 100 | 1.60 % | 3.20 % | 48.0 µm | 0.400 % | 1.0 min |" in text
    assert "| 50 | 2.00 % |" in text
    assert "| 9000 | 0.20 % |" in text
    assert "P, 2 threads" in text
    assert "](pictures/curves.png)" in text
    assert (tmp_path / "pictures/curves.png").stat().st_size > 1000


@pytest.mark.parametrize("rows", [[], ROWS[:1]])
def test_one_point_is_no_curve(tmp_path, rows):
    write_results(tmp_path / "none", tmp_path / "R.md", tmp_path / "pictures", {}, rows)
    assert "Beyond the paper" not in (tmp_path / "R.md").read_text()


def test_rows_of_other_machines_stay_and_a_training_repeated_here_counts(tmp_path):
    record = tmp_path / "trainings.json"
    assert with_recorded(ROWS[:1], record) == ROWS[:1]
    record.write_text(json.dumps(ROWS))
    again = [row("quick", 300, 0.6)]
    merged = with_recorded(again, record)
    assert len(merged) == len(ROWS)
    assert again[0] in merged
    assert ROWS[1] not in merged
    assert [one["experiment"] for one in merged] == sorted(one["experiment"] for one in ROWS)


def test_a_training_with_another_override_does_not_replace_one_without(tmp_path):
    record = tmp_path / "trainings.json"
    record.write_text(json.dumps(ROWS))
    own = row("quick", 300, 0.6) | {"overrides": ["contact=flores"]}
    merged = with_recorded([own], record)
    assert len(merged) == len(ROWS) + 1
    assert curves.by_runs(merged) == curves.by_runs(ROWS)
    assert "| quick | tcn on rod, joint C, contact=flores | 300 |" in markdown([own | {"fresh": []}])
    record.write_text(json.dumps(merged))
    assert len(with_recorded([row("quick", 300, 0.5) | {"overrides": []}], record)) == len(merged)


def test_the_committed_record_is_made_anew_from_its_own_rows():
    record = ROOT / "docs/results/trainings.json"
    assert with_recorded([], record) == json.loads(record.read_text())


def test_trainings_that_differ_in_what_a_row_does_not_tell_are_both_reported(tmp_path):
    own = [row("quick", 300, 0.6), row("quick", 300, 0.9)]
    assert with_recorded(own, tmp_path / "trainings.json") == own


@pytest.mark.parametrize("content", ['[{"name": "x"}]', "[1]", "{"])
def test_a_file_that_is_no_record_is_named_and_kept(tmp_path, content):
    (tmp_path / "trainings.json").write_text(content)
    with pytest.raises(InputError, match=r"trainings\.json"):
        with_recorded(ROWS, tmp_path / "trainings.json")
    (tmp_path / "study.json").write_text(content)
    with pytest.raises(InputError, match=r"study\.json"):
        recorded_trainings(tmp_path / "study.json")
    assert (tmp_path / "study.json").read_text() == content
