"""What the benchmark of trainings together reports is consistent; its numbers depend on the machine."""

import json

import pytest

from clearance.benchmark import together
from clearance.benchmark.together import lines
from clearance.errors import InputError
from tests.command_line import call


def test_a_row_for_each_model(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    settings = (
        "together.names=[tcn]",
        "together.seeds=2",
        "together.steps=1",
        "together.epochs=1",
        "workers=3",
    )
    code, error = call(monkeypatch, capfd, "bench", "suite=together", *settings, "folder=measured")
    assert code == 0, error
    assert [path.name for path in (tmp_path / "measured").iterdir()] == ["together.json"]
    report = json.loads((tmp_path / "measured/together.json").read_text())
    assert report["environment"]["threads"] == 3
    (row,) = report["models"]
    assert row["apart_s"] > 0
    assert row["ratio"] == pytest.approx(2 * row["apart_s"] / row["together_s"])
    assert row["per_hour_together"] == pytest.approx(row["per_hour_apart"] * row["ratio"])
    as_much = 200 * 35_000 / report["scale"]["windows"]  # trainings like the measured one in the paper's
    assert row["per_hour_apart"] * row["apart_s"] * as_much == pytest.approx(3600)
    assert any(line.startswith("tcn ") for line in lines(report))


def test_no_training_stops_before_the_epochs_that_are_counted(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    plans = []

    def measured(model, names, epochs, **_):
        plans.extend(model(name, epochs).training for name in names)
        raise InputError("enough")

    monkeypatch.setattr(together, "measure_together", measured)
    call(monkeypatch, capfd, "bench", "suite=together", "together.epochs=60", "folder=measured")
    assert len(plans) == 4
    # The first epoch is always the best so far, so that 59 without a better one are the most.
    assert all(plan.epochs == 60 <= plan.patience for plan in plans)


def test_a_suite_that_is_not_there_is_refused(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    code, error = call(monkeypatch, capfd, "bench", "suite=training")
    assert code == 2
    assert "suite=training: must be one of simulator, together, gpu; set suite" in error
