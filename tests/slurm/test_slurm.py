"""Simulations and trainings through a real Slurm, whose node is lost or taken away in the middle.

``make test-slurm``, with Debian's packages slurm-wlm and munge; some minutes, most of them waiting until
Slurm notices that its node is gone.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from clearance.recording.dataset import Dataset
from clearance.trial.conceal import conceal, names_of
from tests.command_line import SMALL, command, environment, launch
from tests.slurm.one_node import OneNode, missing, wait_until
from tests.trial.conftest import SCOPE, TOOL

pytestmark = pytest.mark.slurm

# Long enough to be interrupted; 0.1 s of each run is kept.
SIMULATE = ("runs=3000", "seed=3", "campaign.record_start=2.9", "workers=1")
TRAIN = (*SMALL, "trainer.epochs=150")
ON_SLURM = ("-m", "hydra/launcher=submitit_slurm")


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher")
    if absent := missing():
        pytest.fail(f"not installed: {', '.join(absent)}; apt-get install slurm-wlm munge")
    with OneNode(tmp_path_factory.mktemp("slurm") / "node") as node:
        yield node


@pytest.fixture
def submitted(slurm, tmp_path):
    """A function that starts a command as a user does, who then waits for its jobs."""
    started = []

    def submit(name, *overrides):
        process = subprocess.Popen(
            command(name, *ON_SLURM, *overrides), cwd=tmp_path, text=True,
            env={**environment(), **slurm.environment, "PYTHONPATH": environment()["PYTHONPATH"]},
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        started.append(process)
        return process

    yield submit
    for process in started:
        process.kill()
        process.communicate()


def logs(folder):
    return "\n".join(
        path.read_text() for path in sorted(folder.glob("outputs/**/.submitit/*/*.[oe][ur][tr]"))
    )


def finished(process, folder):
    output, errors = process.communicate(timeout=400)
    assert process.returncode == 0, f"{output}\n{errors}\n{logs(folder)}"
    return output


def test_a_sharded_simulation_survives_the_loss_of_its_node(slurm, submitted, tmp_path):
    process = submitted("simulate", *SIMULATE, "shard=1/2,2/2", "dataset=shared")
    wait_until("a data set", (tmp_path / "shared/zarr.json").exists)
    dataset = Dataset.open(tmp_path / "shared")
    wait_until("some runs", lambda: len(dataset.available()) > 100)
    assert sorted(slurm.jobs().values()) == ["RUNNING", "RUNNING"]
    slurm.kill_node()
    there = {run: dataset._chunk(run).stat().st_mtime_ns for run in dataset.available()}
    assert 100 < len(there) < 2900, "killed too late"
    wait_until("both jobs queued again", lambda: set(slurm.jobs().values()) == {"PENDING"})
    assert process.poll() is None  # who waits for the jobs goes on waiting
    slurm.start_node()
    finished(process, tmp_path)

    done = launch("simulate", *SIMULATE, "workers=null", "dataset=alone", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    whole = {p.relative_to(tmp_path / "alone"): p for p in (tmp_path / "alone").rglob("*") if p.is_file()}
    shared = {p.relative_to(tmp_path / "shared"): p for p in (tmp_path / "shared").rglob("*") if p.is_file()}
    assert whole.keys() == shared.keys()
    assert [name for name, path in whole.items() if path.read_bytes() != shared[name].read_bytes()] == []
    assert all(dataset._chunk(run).stat().st_mtime_ns == when for run, when in there.items())


def test_a_sweep_of_which_a_job_is_preempted_gives_the_same_weights(slurm, submitted, tmp_path):
    process = submitted("train", *TRAIN, "seed=range(2)")
    folders = [
        tmp_path / "outputs/train/smoke" / ",".join(sorted((*TRAIN[1:], f"seed={seed}"))) for seed in (0, 1)
    ]
    wait_until(
        "both in training",
        lambda: all((one / "checkpoints/last.ckpt").exists() for one in folders),
        300,
    )
    (first, *_) = sorted(slurm.jobs())
    slurm.ask(
        "scancel", "--signal=USR2", first
    )  # what Slurm sends before a time limit, and submitit waits for
    wait_until("the job queued again", lambda: slurm.jobs().get(first) == "PENDING")
    assert not (folders[0] / "metrics.json").exists()
    finished(process, tmp_path)
    assert "this job is preempted" in logs(tmp_path)
    assert "going on from" in (folders[0] / "train.log").read_text()
    assert "going on from" not in (folders[1] / "train.log").read_text()

    done = launch("train", *TRAIN, "seed=0", "hydra.run.dir=alone", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    once, again = (load_file(one / "model.safetensors") for one in (tmp_path / "alone", folders[0]))
    assert once.keys() == again.keys()
    for name, weight in once.items():
        np.testing.assert_array_equal(again[name], weight, err_msg=name)


def test_the_cases_of_a_trial_are_divided_among_jobs(submitted, tmp_path):
    public = tmp_path / "public"
    conceal(SCOPE, 11, public, tmp_path / "sealed", 1, lambda line: None)
    answers = tmp_path / "answers.json"
    answers.write_text("{}")
    program = f"program=[{sys.executable},{TOOL},{answers}]"
    parts = ("stage=diagnose", "shard=1/2,2/2", "arguments=[]", f"folder={public}", program)
    finished(submitted("trial", *parts), tmp_path)
    assert {path.parent.name for path in public.glob("verdicts/*/verdict.json")} == set(names_of(public))
    assert sorted(Path(f"{answers}.log").read_text().split()) == sorted(names_of(public))  # each once
