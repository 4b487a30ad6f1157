"""Several trainings at a time, each in a process of its own."""

import subprocess

import pytest

from clearance.errors import InputError
from clearance.models.run_folder import METRICS
from clearance.trial import trainings
from clearance.trial.trainings import PLAN, Training, train_all
from clearance.whole_files import write_json

LONG = ("experiment=smoke", "model=tcn", "trainer.epochs=100000", "trainer.accelerator=cpu")


@pytest.fixture
def started(monkeypatch):
    """The processes that were begun."""
    processes = []

    class Popen(subprocess.Popen):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            processes.append(self)

    monkeypatch.setattr(trainings.subprocess, "Popen", Popen)
    return processes


def test_where_one_fails_the_others_are_ended_and_all_share_the_processor(tmp_path, started, monkeypatch):
    monkeypatch.setattr(trainings.os, "sched_getaffinity", lambda _: set(range(6)))
    wanted = [
        Training("a long one", tmp_path / "long", LONG),
        Training("a wrong one", tmp_path / "wrong", ("model=ghost", "trainer.threads=1")),
    ]
    with pytest.raises(InputError, match=r"wrong: a training ended with exit code 2: .*ghost"):
        train_all(wanted, 2, lambda _: None)
    assert len(started) == 2
    assert all(process.poll() is not None for process in started)
    of_long, of_wrong = (
        [word for word in process.args if word.startswith("trainer.threads=")]
        for process in sorted(started, key=lambda process: "model=ghost" in process.args)
    )
    assert (of_long, of_wrong) == (["trainer.threads=3"], ["trainer.threads=1"])
    assert not (tmp_path / "long" / METRICS).exists()


def test_what_is_there_is_not_trained_again(tmp_path, started):
    done = Training("one", tmp_path, ("model=ghost",))
    (tmp_path / METRICS).write_text("{}")
    write_json(tmp_path / PLAN, ["model=ghost"])
    assert train_all([done], 1, lambda _: None) == {}
    assert not started
    other = Training("another", tmp_path, ("model=spectre",), may_fail=True)
    assert "spectre" in train_all([other], 1, lambda _: None)[tmp_path]
