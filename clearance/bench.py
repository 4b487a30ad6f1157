"""Measure what simulating costs: ``python -m clearance.bench``, beside Exudyn where it is installed."""

import logging
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from clearance.benchmark.campaigns import FULL_SCALE, measure_campaign, warm_up
from clearance.benchmark.measurement import circumstances
from clearance.benchmark.report import lines, save
from clearance.benchmark.startup import measure_startup
from clearance.commands import command
from clearance.recording.synthesis import Campaign

log = logging.getLogger(__name__)


def bench(campaign: Campaign, workers: int, folder: Path, comparison: dict[str, Any]) -> dict[str, Any]:
    """Measure everything and write ``bench.json``.

    Args:
        campaign: nominal machine with clearance in C.
        workers: threads.
        folder: for the result, and for data sets while they are measured.
        comparison: arguments of ``benchmark.comparison.compare``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    report = circumstances() | {
        "scale": {
            "runs": campaign.runs,
            "duration_s": campaign.duration,
            "step_s": campaign.integrator.step,
            "workers": workers,
            "full": campaign.runs == FULL_SCALE,
        }
    }
    log.info("compiled loop ready after %.1f s", warm_up(campaign).wall_s)
    report["campaign"] = measure_campaign(
        campaign, workers, folder, lambda done: log.info("%s: %.2f s", done["task"], done["wall_s"])
    )
    report["startup"] = measure_startup(folder)
    report["comparison"] = None
    if find_spec("exudyn"):
        from clearance.benchmark.comparison import compare

        report["comparison"] = compare(campaign, **comparison)
    save(report, folder / "bench.json")
    return report


@command("bench")
def main(cfg: DictConfig) -> None:
    """Measure and print the table."""
    campaign = instantiate(cfg.campaign, _convert_="all")
    report = bench(campaign, cfg.workers, Path(cfg.folder), dict(cfg.comparison))
    for line in lines(report):
        log.info("%s", line)
    log.info("written to %s", Path(cfg.folder) / "bench.json")


if __name__ == "__main__":
    main()
