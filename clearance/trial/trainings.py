"""Trainings of a loop: each in a process of its own, several at a time.

A network this small keeps two threads waiting for each other: on two cores two trainings of one thread each
take 30 s an epoch, one of two threads takes 21 s.
"""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from clearance.errors import InputError
from clearance.models.run_folder import METRICS
from clearance.processes import end, environment, quoted
from clearance.whole_files import read_json, write_json

PLAN = "plan.json"
"""What was asked for, beside what came of it."""
_LOG = "output.txt"


@dataclass(frozen=True)
class Training:
    """One training.

    Attributes:
        title: what is trained, for the reports.
        place: folder of the run.
        overrides: of the command.
        may_fail: whether the others go on without it.
    """

    title: str
    place: Path
    overrides: tuple[str, ...]
    may_fail: bool = False

    def done(self) -> bool:
        """Whether it is there already; what is there of others the training itself refuses."""
        if not (self.place / METRICS).exists() or not (self.place / PLAN).exists():
            return False
        return read_json(self.place / PLAN, "folder") == list(self.overrides)


def train_all(wanted: Sequence[Training], parallel: int, report: Callable[[str], None]) -> dict[Path, str]:
    """Train what is not there yet; stopped, what runs is ended with this process, and goes on another time.

    Args:
        wanted: none of which needs another.
        parallel: processes at a time, which share the processor's threads evenly.
        report: called with progress.

    Returns:
        Why those failed that may, by their folders.

    Raises:
        InputError: if another one fails.
    """
    left = [one for one in wanted if not one.done()]
    threads = max(1, len(os.sched_getaffinity(0)) // parallel)
    failed, began = dict[Path, str](), time.monotonic()
    running, stopped = set[subprocess.Popen[bytes]](), threading.Event()
    pool = ThreadPoolExecutor(parallel)
    try:
        tasks = {pool.submit(_train, one, threads, running, stopped, report): one for one in left}
        for count, task in enumerate(as_completed(tasks), 1):
            try:
                task.result()
            except InputError as error:
                if not tasks[task].may_fail:
                    raise
                failed[tasks[task].place] = str(error)
            minutes = (time.monotonic() - began) / count * (len(left) - count) / 60.0
            report(f"{count} of {len(left)} trainings ended, about {minutes:.0f} min left of these")
    finally:
        stopped.set()
        pool.shutdown(wait=False, cancel_futures=True)
        for process in list(running):
            end(process)
    return failed


def _train(
    one: Training, threads: int, running: set[subprocess.Popen[bytes]], stopped: threading.Event,
    report: Callable[[str], None],
) -> None:  # fmt: skip
    report(f"training {one.title}")
    one.place.mkdir(parents=True, exist_ok=True)
    shared = [] if any(given.startswith("trainer.threads=") for given in one.overrides) else [threads]
    command = [
        sys.executable, "-m", "clearance.train", *one.overrides,
        *(f"trainer.threads={count}" for count in shared), f"hydra.run.dir={quoted(one.place)}",
    ]  # fmt: skip
    log = one.place / _LOG
    with log.open("wb") as out:
        process = subprocess.Popen(
            command, stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True,
            env=environment(OMP_NUM_THREADS=str(threads), NUMBA_NUM_THREADS=str(threads)),
        )  # fmt: skip
    running.add(process)
    try:
        if stopped.is_set():  # begun just as the others were ended
            return
        code = process.wait()
    finally:
        end(process)
        running.discard(process)
    if stopped.is_set():
        return
    if code != 0:
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        said = lines[-1][:300] if lines else "no output"
        raise InputError(
            f"{one.place}: a training ended with exit code {code}: {said}; "
            f"see {log}; change loop.train, loop.goes_on or loop.random"
        )
    write_json(one.place / PLAN, list(one.overrides))
