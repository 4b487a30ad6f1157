"""What a piece of work costs, and on which machine."""

import os
import platform
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Cost:
    """Time of a piece of work; other programs on the machine lengthen the first, hardly the second.

    Attributes:
        wall_s: seconds on the clock.
        cpu_s: seconds of all threads of this process, or of the child where there is one.
    """

    wall_s: float
    cpu_s: float


def measure(work: Callable[[], T], children: bool = False) -> tuple[Cost, T]:
    """Do some work in this process, or in child processes, and say what it cost."""

    def spent() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN if children else resource.RUSAGE_SELF)
        return usage.ru_utime + usage.ru_stime

    begin, before = time.perf_counter(), spent()
    result = work()
    return Cost(time.perf_counter() - begin, spent() - before), result


def circumstances() -> dict[str, Any]:
    """Date, machine and versions."""
    return {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "hardware": {
            "cpu": _processor(),
            "cores": os.cpu_count(),
            "platform": f"{platform.system()} {platform.machine()}",
            "load_average": os.getloadavg(),
        },
        "versions": {"python": platform.python_version()} | _versions(),
    }


def _versions() -> dict[str, str]:
    found = {}
    for name in ("clearance", "numpy", "numba", "llvmlite", "zarr", "exudyn"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    """The processor's name, as far as the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
