"""The paper's tables and figures in the time that is given: ``python -m clearance.study budget=2h``."""

import logging
import re
from collections.abc import Sequence
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from clearance.commands import command
from clearance.errors import InputError
from clearance.evaluation.paper.results import RECORD
from clearance.evaluation.paper.trainings import (
    Training,
    finished_trainings,
    recorded_trainings,
    reduction,
    trainings_of,
)
from clearance.recording.bounds import whole
from clearance.study.plan import stages
from clearance.study.running import Budget, Runner

log = logging.getLogger(__name__)
_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


@command("study")
def main(cfg: DictConfig) -> None:
    """Train in order of value what fits, evaluate, report; the same command goes on where it stopped."""
    budget = Budget(seconds_of(cfg.budget))
    whole(cfg.perturbed, "perturbed", 0)
    whole(cfg.parallel, "parallel", 1)
    scale = str(HydraConfig.get().runtime.choices["scale"])
    for name in ("experiments", "arguments"):
        if not OmegaConf.is_list(cfg[name]):
            raise InputError(f"{name}={cfg[name]}: must be a list; write '{name}=[...]'")
    order = stages([trainings_of(str(name)) for name in cfg.experiments])
    arguments = list(map(str, cfg.arguments))
    folder, record = Path(str(cfg.folder)), Path(str(cfg.pictures)) / RECORD
    recorded = _recorded(folder, record, (f"scale={scale}", *arguments))
    runner = Runner(folder, scale, arguments, budget, cfg.parallel, recorded)
    every = [training for stage in order for batch in stage for training in batch.trainings]
    log.info(
        "%d of %d trainings at scale %s are finished", sum(map(runner.finished, every)), len(every), scale
    )
    left = 0
    try:
        for stage in order:
            left += runner.train_all(stage)
            if cfg.perturbed:
                try:
                    runner.perturb(cfg.perturbed)
                except InputError as error:  # the trainings are worth their report all the same
                    log.warning("Table 7 is left out: %s", error)
    finally:
        done = sum(map(runner.finished, every))
        log.info("%d of %d trainings are finished", done, len(every))
    runner.report(str(cfg.report), str(cfg.pictures))
    log.info("%s is written; %d trainings are left: the same command goes on with them", cfg.report, left)
    if runner.failed:
        where = runner.place(runner.failed[0])
        raise InputError(f"{len(runner.failed)} trainings failed, the first in {where}; change arguments")


def _recorded(folder: Path, record: Path, arguments: Sequence[str]) -> frozenset[Training]:
    """What the record says need not be trained again.

    Args:
        folder: of trainings.
        record: of those that are reported.
        arguments: of the trainings to come.

    Raises:
        InputError: folder or record hold trainings that differ from them: one report cannot hold both.
    """
    recorded = recorded_trainings(record)
    for one in [*recorded, *finished_trainings(folder)]:
        known, wanted = dict(one.reduced), reduction(one.training.setting, *arguments)
        other = sorted(key for key in {*known, *wanted} if known.get(key) != wanted.get(key))
        if other:
            raise InputError(
                f"{one.path or record} differs from what {' '.join(arguments)} would train "
                f"({', '.join(other)}); set folder, pictures and report to others"
            )
    return frozenset(one.training for one in recorded)


def seconds_of(text: object) -> float:
    """Seconds of ``90s``, ``30m``, ``2h`` or ``1d``.

    Raises:
        InputError: it is no duration.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smhd])", str(text).strip())
    if not found or float(found[1]) == 0:
        raise InputError(f"budget = {text!r} is no duration such as 90s, 30m, 2h or 1d; change budget")
    return float(found[1]) * _UNITS[found[2]]


if __name__ == "__main__":
    main()
