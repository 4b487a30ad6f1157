"""A sweep whose jobs fail alone: a plugin of Hydra's, which finds it by the name of this folder.

``conf/hydra/_plugins.yaml`` puts it in the place of Hydra's own sweeper, which ends with the error of the
first job that failed and says nothing of the others.
"""

import sys
from collections.abc import Sequence
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.utils import JobReturn, JobStatus
from hydra.errors import HydraException
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class Sweeper(BasicSweeper):
    """All combinations, each a job; those that failed are listed at the end, and the exit code is 1."""

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Put something that keeps failed jobs before the launcher."""
        super().setup(hydra_context=hydra_context, task_function=task_function, config=config)
        assert self.launcher is not None
        self._jobs = self.launcher = _Separating(self.launcher)

    def sweep(self, arguments: list[str]) -> Any:
        """Run all jobs; then list those that failed."""
        returns = super().sweep(arguments)
        if failed := self._jobs.failed:
            all_jobs = len(failed) + sum(map(len, returns))
            lines = [f"  {' '.join(one.overrides or ())}: {one._return_value}" for one in failed]
            sys.stderr.write(
                f"{len(failed)} of {all_jobs} jobs failed; the same command runs these again:\n"
                + "\n".join(lines)
                + "\n"
            )
            raise SystemExit(1)
        return returns


class _Separating(Launcher):
    """Any launcher; it returns the jobs that were completed and keeps those that failed.

    A process that is killed, or a queue that takes no job, ends the launcher, which tells so in many words.
    """

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher
        self.failed: list[JobReturn] = []

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Nothing: the launcher is set up already."""

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        try:
            returned = self._launcher.launch(job_overrides, initial_job_idx)
        except RuntimeError as error:  # of submitit and of joblib alike
            reason = " ".join(str(error).split("\n")[:2])  # after them the job's whole log
            raise HydraException(
                f"{reason}; jobs that are queued go on, and the same command runs what is missing then"
            ) from error
        self.failed += [one for one in returned if one.status is JobStatus.FAILED]
        return [one for one in returned if one.status is JobStatus.COMPLETED]
