"""Processes of this package's own commands."""

import os
import signal
import subprocess
from pathlib import Path

_ROOT = Path(__file__).parents[1]


def environment(**more: str) -> dict[str, str]:
    """Of a process that takes the package from where this one is, whatever the working folder."""
    paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "HYDRA_FULL_ERROR": "0", **more}


def end(process: subprocess.Popen[bytes]) -> None:
    """End a process and what it started; nothing happens where it has ended."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
