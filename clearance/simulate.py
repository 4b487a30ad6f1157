"""Simulate a data set: ``python -m clearance.simulate runs=1000 seed=1 joint=C dataset=PATH``."""

import logging
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from clearance.commands import command, shard, threads
from clearance.errors import InputError

log = logging.getLogger(__name__)


@command("simulate")
def main(cfg: DictConfig) -> None:
    """Simulate what the data set lacks and say what it holds, or write recordings."""
    campaign = instantiate(cfg.campaign, _convert_="all")
    part, workers = shard(cfg.shard), threads(cfg.workers)
    if cfg.recordings:
        if cfg.dataset:
            raise InputError(
                f"dataset={cfg.dataset} and recordings={cfg.recordings}: one of both; set the other to null"
            )
        paths = campaign.export(str(cfg.recordings), part, workers)
        log.info("%d of %d runs are recordings in %s", len(paths), campaign.runs, cfg.recordings)
        return
    path = Path(str(cfg.dataset or f"outputs/datasets/{campaign.folder}"))
    dataset = campaign.generate(path, part, workers)
    for run, reason in dataset.failures().items():
        log.warning("run %d: %s", run, reason)
    log.info(
        "%s holds %d of %d runs of %g s at %g kHz (%d failed)",
        path,
        len(dataset.available()),
        dataset.runs,
        dataset.samples / dataset.rate,
        dataset.rate / 1e3,
        len(dataset.failures()),
    )


if __name__ == "__main__":
    main()
