"""How long a user waits for the first run."""

import subprocess
import sys
import tempfile
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from clearance.benchmark.measurement import Cost, measure
from clearance.errors import InputError
from clearance.processes import quoted


def measure_startup(folder: Path) -> list[dict[str, Any]]:
    """Import alone, and one run of 3 s from the command line, each in a fresh interpreter on a warm cache."""
    with tempfile.TemporaryDirectory(dir=folder, prefix="startup-") as path:
        _run(["-m", "clearance.simulate", *_places(Path(path) / "warming")])
        whole = _run(["-m", "clearance.simulate", *_places(Path(path) / "measured")])
    imports = _run(["-c", "import clearance.simulate, clearance.recording.synthesis"])
    return [
        {"task": "imports of clearance.simulate", **asdict(imports)},
        {"task": "python -m clearance.simulate runs=1", **asdict(whole), "target_s": 3.0},
    ]


def _places(folder: Path) -> list[str]:
    places = {"dataset": folder / "data", "hydra.run.dir": folder}
    return ["runs=1", *(f"{key}={quoted(path)}" for key, path in places.items())]


def _run(arguments: list[str]) -> Cost:
    command = [sys.executable, *arguments]
    cost, process = measure(partial(subprocess.run, command, capture_output=True, text=True), children=True)
    if process.returncode != 0:
        raise InputError(f"{' '.join(command)} failed: {process.stderr.strip()}")
    return cost
