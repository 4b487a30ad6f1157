"""Processes of this package's own commands."""

import os
import signal
import subprocess
from contextlib import suppress
from pathlib import Path

from hydra.core.override_parser.types import Quote, QuotedString

RUNNING = ".running"
"""File in a run's folder that is locked while a diagnosis writes there."""
_ROOT = Path(__file__).parents[1]


def environment(**more: str) -> dict[str, str]:
    """Of a process that takes the package from where this one is, whatever the working folder."""
    paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "HYDRA_FULL_ERROR": "0", **more}


def quoted(path: Path) -> str:
    """A path as Hydra's grammar takes it from a command line, whatever signs it holds."""
    return str(QuotedString(str(path.resolve()), Quote.single).with_quotes())


def end(process: subprocess.Popen[bytes]) -> None:
    """End a process that has a session of its own, and what it started, which may outlive it."""
    with suppress(ProcessLookupError):  # all have ended
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
