"""Run the ordinary commands, each in a process of its own, within a budget of time."""

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Lock

from clearance.errors import InputError
from clearance.evaluation.paper.trainings import Training
from clearance.models.run_folder import METRICS
from clearance.processes import end, environment, quoted
from clearance.study.plan import Batch, Cost, expected_seconds, that_fit
from clearance.whole_files import read_json, write_json

log = logging.getLogger(__name__)
_COSTS, _LOG, _CHECKPOINTS = "costs.json", "output.txt", "checkpoints"
_REPORT = "report"  # its own cost, under the name of no model
_REPORT_SECONDS, _SHARE = 120.0, 0.3  # until it has been measured: this long, or this share of the budget
_SLOWER = 1.5  # what the report may take over its last time: there is more in it
_GRACE = 20.0  # s, for a training to stop by itself
_LEAST = 2.0 * _GRACE  # s: less is not worth a start


class Budget:
    """Seconds from now on."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._end = time.monotonic() + seconds

    @property
    def left(self) -> float:
        """Negative when it is spent."""
        return self._end - time.monotonic()


@dataclass
class Runner:
    """Trains and evaluates below one folder.

    Attributes:
        folder: of the trainings.
        scale: option of ``clearance.train``.
        arguments: more overrides of every training.
        budget: of the whole study.
        parallel: trainings at a time, which share the cores.
        recorded: trainings that were finished before, here or on another machine.
    """

    folder: Path
    scale: str
    arguments: Sequence[str]
    budget: Budget
    parallel: int = 1
    recorded: Set[Training] = frozenset()
    failed: list[Training] = field(default_factory=list)
    _running: set[subprocess.Popen[bytes]] = field(default_factory=set)
    _stopped: Event = field(default_factory=Event)
    _lock: Lock = field(default_factory=Lock)  # of the costs

    def place(self, training: Training) -> Path:
        """The folder of a training."""
        return self._cell(training) / f"seed={training.seed}"

    def finished(self, training: Training) -> bool:
        """Whether nothing is left to do."""
        return training in self.recorded or (self.place(training) / METRICS).exists()

    @property
    def left(self) -> float:
        """Seconds for trainings: what remains before the report must be begun."""
        reports = [cost.seconds for cost in self._costs() if cost.model == _REPORT]
        expected = _SLOWER * reports[-1] if reports else min(_REPORT_SECONDS, _SHARE * self.budget.seconds)
        return self.budget.left - expected

    def train_all(self, batches: Sequence[Batch]) -> int:
        """Train batches in their order; returns how many trainings were left for another time."""
        pool = ThreadPoolExecutor(self.parallel)
        try:
            return sum(pool.map(self.train, batches))
        except BaseException:
            self._stopped.set()
            raise
        finally:
            for process in list(self._running):
                end(process)
            pool.shutdown(cancel_futures=True)

    def train(self, batch: Batch) -> int:
        """The same for one batch."""
        wanted = [t for t in batch.trainings if not self.finished(t) and t not in self.failed]
        while wanted and not self._stopped.is_set():
            seconds = expected_seconds(batch.setting, self._costs())
            begun = {t: (self.place(t) / _CHECKPOINTS).exists() for t in wanted}
            rest = batch._replace(seeds=tuple(t.seed for t in wanted))
            part = that_fit(rest, seconds, self.left, begun)
            if not part.seeds or self.left < _LEAST:
                break
            self._train(part, begun[part.trainings[0]])
            wanted = [t for t in wanted if not self.finished(t) and t not in self.failed]
        return len(wanted)

    def perturb(self, recordings: int) -> None:
        """Evaluate what is trained for Table 7, as far as the time goes."""
        if self.left >= _LEAST and any(self.folder.rglob(METRICS)):
            self._evaluate(self.left, f"perturbed={recordings}")

    def report(self, results: str, pictures: str) -> None:
        """Write the report; it is let end whatever is left."""
        began = time.monotonic()
        self._evaluate(None, f"report='{results}'", f"pictures='{pictures}'")
        self._add_costs([Cost(_REPORT, 1, round(time.monotonic() - began, 1))])

    def _train(self, batch: Batch, begun: bool) -> None:
        began, cell = time.monotonic(), self._cell(batch.trainings[0])
        command = [
            "clearance.train", "-m", "experiment=paper", f"scale={self.scale}", "trainer.progress=false",
            *batch.setting.overrides, f"split_seed={batch.split_seed}",
            f"seed={','.join(map(str, batch.seeds))}", f"hydra.sweep.dir={quoted(cell)}",
            "hydra.sweep.subdir='seed=${seed}'", *self._shared_cores, *self.arguments,
        ]  # fmt: skip
        code = self._run(command, cell / _LOG, self.left)
        if self._stopped.is_set():  # what was interrupted tells nothing of what it would have taken
            return
        seconds = time.monotonic() - began
        done = [t for t in batch.trainings if self.finished(t)]
        missing = [t for t in batch.trainings if t not in done]
        if code is not None and (code != 0 or missing):
            self.failed += missing
            log.warning("%s: exit code %s; see %s", batch, code, cell / _LOG)
        elif code is None:
            log.info("%s: the time is up after %.0f s; it goes on from there next time", batch, seconds)
        else:
            log.info("%s: %.0f s", batch, seconds)
        # Trees that were cut begin anew: that they take longer than this is all that is known.
        lost = code is None and not any((self.place(t) / _CHECKPOINTS).exists() for t in batch.trainings)
        if (code == 0 and done and not begun) or lost:
            each = round(seconds / (len(done) + lost), 3)
            self._add_costs([Cost(batch.setting.model, batch.setting.decimation, each)])

    def _evaluate(self, limit: float | None, *overrides: str) -> None:
        command = ["clearance.evaluate", f"runs={quoted(self.folder)}", *overrides]
        output = self.folder / _LOG
        code = self._run(command, output, limit)
        if code not in (0, None):
            raise InputError(f"{self.folder}: {_last_line(output)}; see {output}; change folder or scale")

    def _run(self, command: Sequence[str], output: Path, limit: float | None) -> int | None:
        """The exit code of a command, ``None`` where it was ended because its time was up."""
        output.parent.mkdir(parents=True, exist_ok=True)
        with output.open("wb") as out:
            process = subprocess.Popen(
                [sys.executable, "-m", *command], stdout=out, stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL, env=environment(**self._omp), start_new_session=True,
            )  # fmt: skip
            self._running.add(process)
            try:
                if self._stopped.is_set():
                    return None
                return process.wait(None if limit is None else max(limit - _GRACE, 0.0))
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGTERM)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(_GRACE)
                return None
            finally:
                end(process)
                self._running.discard(process)

    @property
    def _threads(self) -> int:
        return max(1, len(os.sched_getaffinity(0)) // self.parallel)

    @property
    def _shared_cores(self) -> list[str]:
        # Threads that wait for one another on a core that is taken cost two orders of magnitude.
        return [f"trainer.threads={self._threads}"] if self.parallel > 1 else []

    @property
    def _omp(self) -> dict[str, str]:
        return {"OMP_NUM_THREADS": str(self._threads)} if self.parallel > 1 else {}

    def _cell(self, training: Training) -> Path:
        names = [*training.setting.overrides, f"split_seed={training.split_seed}"]
        return self.folder / ",".join(names)

    def _costs(self) -> list[Cost]:
        path = self.folder / _COSTS
        return [Cost(*one) for one in read_json(path, "folder")] if path.exists() else []

    def _add_costs(self, costs: Sequence[Cost]) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        with self._lock:
            write_json(self.folder / _COSTS, [*self._costs(), *costs])


def _last_line(output: Path) -> str:
    lines = output.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return lines[-1][:300] if lines else "no output"
