"""Run the commands: as a user does, in a process of their own, or within the test's, which is quicker."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Seconds a training: a small network on recordings of 0.2 s, on one thread so that figures repeat exactly.
SMALL = (
    "experiment=smoke", "model.net.hidden_size=16", "model.net.fold=4",
    "trainer.accelerator=cpu", "trainer.threads=1",
)  # fmt: skip

TREES = ("experiment=smoke", "model=xgboost", "model.rounds=5", "model.depth=3")


def command(name, *overrides):
    return [sys.executable, "-m", f"clearance.{name}", *map(str, overrides)]


def environment():
    return {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


def launch(name, *overrides, folder):
    """Run a command in ``folder`` to its end."""
    return subprocess.run(
        command(name, *overrides), cwd=folder, env=environment(), capture_output=True, text=True, timeout=300
    )


def call(monkeypatch, capfd, name, *overrides):
    """Run a command in this process; return its exit code and what it wrote on standard error."""
    quiet = ("hydra/job_logging=disabled", "hydra/hydra_logging=disabled")
    monkeypatch.setattr(sys, "argv", [name, *map(str, overrides), *quiet])
    monkeypatch.setenv("HYDRA_FULL_ERROR", "0")
    capfd.readouterr()
    code = 0
    try:
        importlib.import_module(f"clearance.{name}").main()
    except SystemExit as stop:
        code = stop.code
    return code, capfd.readouterr().err
