"""What made a result: a canonical description of settings, its fingerprint, and the memory that it took."""

import hashlib
import json
import resource
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

_COMMIT = ("rev-parse", "--short", "HEAD")
_RECORDING = ("chain", "sensors", "synthesis")  # what sees a run
_CHANGES = ("status", "--porcelain", "--", "clearance", "conf")


def describe(value: Any) -> Any:
    """A JSON-able description of nested dataclasses: class names and fields, in a fixed order."""
    if is_dataclass(value) and not isinstance(value, type):
        described = {"class": type(value).__name__}
        return described | {field.name: describe(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): describe(value[key]) for key in sorted(value)}
    if isinstance(value, list | tuple):
        return [describe(item) for item in value]
    return value


def fingerprint(value: Any) -> str:
    """SHA-256 of the description of ``value``, 16 hexadecimal digits."""
    text = json.dumps(describe(value), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def simulator() -> str:
    """Of the sources that decide what a simulated run holds, which settings do not tell; 16 digits."""
    package, digest = Path(__file__).parent, hashlib.sha256()
    sources = [package / "lanes.py", package / "compilation.py"]
    sources += (package / "recording" / f"{name}.py" for name in _RECORDING)
    for folder in ("mechanism", "simulation"):
        sources += package.glob(f"{folder}/**/*.py")
    for source in sorted(sources):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def revision() -> str | None:
    """The commit of the sources that run, marked where they were changed since; ``None`` outside of git."""
    root = Path(__file__).parents[1]
    if not (root / ".git").exists():
        return None
    git = ["git", "-C", str(root)]
    try:
        commit, changes = (
            subprocess.run([*git, *words], capture_output=True, text=True, check=True).stdout.strip()
            for words in (_COMMIT, _CHANGES)
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{commit}, changed" if changes else commit


def peak_memory() -> float:
    """Largest resident memory of this process so far [MiB].

    Where the kernel tells it (Linux), its own; elsewhere also that of the one which started it, whose record
    a new program inherits.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):  # some sandboxes have none
                return int(line.split()[1]) / 2**10
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)  # bytes there, KiB elsewhere
