"""Trainings are processes of the ordinary command: kept to the budget, resumed, reported when they fail."""

import json
import os
import signal
import sys
import time
from threading import Thread

import pytest

from clearance.evaluation.paper.trainings import Setting
from clearance.study import running
from clearance.study.plan import Batch
from clearance.study.running import Budget, Runner

# Stands for `python -m`: leaves what a training leaves, as quickly or slowly as the test wants.
TRAINER = """
import json, pathlib, sys, time
given = dict(word.split("=", 1) for word in sys.argv[1:] if "=" in word)
place = pathlib.Path(given["hydra.sweep.dir"].strip("'"))
for seed in given["seed"].split(","):
    folder = place / f"seed={seed}"
    (folder / "checkpoints").mkdir(parents=True, exist_ok=True)
    with (place / "begun.txt").open("a") as file:
        file.write(seed + " ")
    time.sleep(float(given.get("pause", 0)))
    if "fail" in given:
        sys.exit(2)
    if "forget" in given:
        continue
    (folder / "metrics.json").write_text("{}")
    (folder / "checkpoints").rmdir()
"""
BATCH = Batch(Setting("lstm"), 98, (42, 98, 123))


@pytest.fixture
def runner(tmp_path, monkeypatch):
    (tmp_path / "trainer.py").write_text(TRAINER)
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nshift 2\nexec {sys.executable} {tmp_path}/trainer.py "$@"\n')
    python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setattr(running, "_GRACE", 0.2)
    monkeypatch.setattr(running, "_LEAST", 0.4)
    return lambda seconds, *arguments: Runner(tmp_path / "runs", "smoke", arguments, Budget(seconds))


def begun(runner):
    return (runner._cell(BATCH.trainings[0]) / "begun.txt").read_text().split()


def test_an_untimed_model_is_timed_by_one_training_and_the_rest_is_one_list(runner, tmp_path):
    one = runner(1000.0)
    assert one.train(BATCH) == 0
    assert begun(one) == ["42", "98", "123"]
    costs = json.loads((tmp_path / "runs/costs.json").read_text())
    assert [cost[:2] for cost in costs] == [["lstm", 10]] * 2  # two processes: one, then two trainings
    again = runner(1000.0)
    assert again.train(BATCH) == 0
    assert begun(again) == ["42", "98", "123"]  # nothing is repeated


def test_what_the_record_holds_is_not_trained_again(runner):
    one = runner(1000.0)
    one.recorded = frozenset(BATCH.trainings[:2])
    assert one.train(BATCH) == 0
    assert begun(one) == ["123"]


def test_what_does_not_fit_is_not_begun(runner, tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs/costs.json").write_text('[["lstm", 10, 50.0], ["report", 1, 10.0]]')
    one = runner(80.0)  # less 1.5 times 10 s for the report: 65 s, one training
    handed = []

    def take(batch, begun):
        handed.append(batch.seeds)
        one.failed, one.budget = batch.trainings, Budget(60.0)

    one._train = take
    assert one.train(BATCH) == 2
    assert handed == [(42,)]


def test_a_training_is_cut_at_the_end_of_its_time_and_goes_on_the_next(runner):
    one = runner(2.0, "pause=30")  # 0.6 s of it are kept for the report
    assert one.train(BATCH) == 3
    assert one.budget.left > 0
    assert begun(one) == ["42"]
    assert not one.failed
    assert runner(1000.0).train(BATCH) == 0
    assert begun(one) == ["42", "42", "98", "123"]


def test_batches_run_side_by_side_and_an_interruption_ends_them(runner):
    one = runner(1000.0, "pause=30")
    one.parallel = 2
    other = BATCH._replace(split_seed=42)

    def interrupt():
        while not all((one._cell(b.trainings[0]) / "begun.txt").exists() for b in (BATCH, other)):
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    # a test run in the background ignores Ctrl-C
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    Thread(target=interrupt, daemon=True).start()
    began = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            one.train_all([BATCH, other])
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - began < 25  # and not a training's 30 s
    assert (begun(one), one.failed) == (["42"], [])
    again = runner(1000.0)
    again.parallel = 2
    assert again.train_all([BATCH, other]) == 0
    assert all(again.finished(t) for t in (*BATCH.trainings, *other.trainings))


def test_what_was_interrupted_tells_no_cost(runner, tmp_path):
    one = runner(1000.0)
    one._stopped.set()  # between two trainings
    one._train(BATCH, begun=False)
    assert not (tmp_path / "runs/costs.json").exists()
    assert not one.failed


@pytest.mark.parametrize("model", ["lstm", "random_forest", "xgboost"])
def test_trainings_side_by_side_share_the_cores(runner, monkeypatch, model):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(6))
    one, handed = runner(1000.0), []
    one.parallel, one._run = 2, lambda command, *_: handed.append(command)
    one._train(Batch(Setting(model), 98, (42,)), begun=False)
    assert "trainer.threads=3" in handed[0]
    assert one._omp == {"OMP_NUM_THREADS": "3"}


@pytest.mark.parametrize("way", ["fail=1", "forget=1"])
def test_a_failure_is_kept_and_the_others_go_on(runner, way):
    one = runner(1000.0, way)
    assert one.train(BATCH) == 0
    assert one.failed == BATCH.trainings
