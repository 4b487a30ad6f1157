"""Measure what simulating costs: ``python -m clearance.bench``, beside Exudyn where it is installed.

``suite=together`` measures what training several seeds at once gains over one after another, ``suite=gpu``
what simulating on a GPU gains.
"""

import logging
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from hydra import compose
from hydra.utils import instantiate
from omegaconf import DictConfig

from clearance.benchmark import gpu, together
from clearance.benchmark.campaigns import FULL_SCALE, measure_campaign, warm_up
from clearance.benchmark.comparable import comparable
from clearance.benchmark.measurement import circumstances
from clearance.benchmark.report import lines, save
from clearance.benchmark.startup import measure_startup
from clearance.commands import command
from clearance.errors import InputError
from clearance.models.neural import NeuralEstimator
from clearance.models.together import shareable
from clearance.recording.bounds import whole
from clearance.recording.synthesis import Campaign
from clearance.whole_files import write_json

log = logging.getLogger(__name__)


def bench(
    campaign: Campaign, workers: int, folder: Path, comparison: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Measure everything and write ``bench.json``, anew after each part: a failure loses its own part alone.

    Args:
        campaign: nominal machine with clearance in C.
        workers: threads.
        folder: that is there; for the result, and for data sets while they are measured.
        comparison: arguments of ``benchmark.comparison.compare``; ``None``: without Exudyn.

    Raises:
        InputError: Exudyn cannot be compared with; nothing has been measured then.
    """
    compared = None
    if comparison is not None and find_spec("exudyn"):
        compared = comparable(campaign, **comparison)
    path = folder / "bench.json"
    report: dict[str, Any] = circumstances() | {
        "scale": {
            "runs": campaign.runs,
            "duration_s": campaign.duration,
            "step_s": campaign.integrator.step,
            "workers": workers,
            "full": campaign.runs == FULL_SCALE,
        },
        "campaign": [],
        "startup": [],
        "comparison": None,
    }
    log.info("compiled loop ready after %.1f s", warm_up(campaign).wall_s)
    for row in measure_campaign(campaign, workers, folder):
        log.info("%s: %.2f s", row["task"], row["wall_s"])
        report["campaign"].append(row)
        save(report, path)
    report["startup"] = measure_startup(folder)
    save(report, path)
    if compared is not None:
        from clearance.benchmark.comparison import compare

        report["comparison"] = compare(campaign, **compared)
        save(report, path)
    return report


def simulator(cfg: DictConfig, folder: Path) -> Iterator[str]:
    """What simulating costs."""
    return lines(bench(_campaign(cfg), cfg.workers, folder, cfg.comparison))


def trainings_together(cfg: DictConfig, folder: Path) -> Iterator[str]:
    """What training several seeds at once gains; writes ``together.json``."""

    def model(name: str, epochs: int) -> NeuralEstimator:
        # The data are noise: with the paper's patience a training would end before its epochs do.
        settings = [f"trainer.epochs={epochs}", f"trainer.patience={epochs}"]
        settings += [f"trainer.threads={cfg.workers}", "trainer.progress=false"]
        chosen = compose("train", ["experiment=paper", f"model={name}", *settings])
        (estimator,) = shareable([instantiate(chosen.model, _convert_="all")])
        return estimator

    report = together.measure_together(
        model,
        **cfg.together,
        threads=cfg.workers,
        folder=folder,
        announce=lambda row: log.info("%s: ratio %.2f", row["model"], row["ratio"]),
    )
    write_json(folder / "together.json", report)
    return together.lines(report)


def simulator_on_gpu(cfg: DictConfig, folder: Path) -> Iterator[str]:
    """What simulating on a GPU gains over the processor; writes ``gpu.json``."""
    report = gpu.measure_gpu(_campaign(cfg), cfg.workers, **cfg.gpu)
    write_json(folder / "gpu.json", report)
    return gpu.lines(report)


def _campaign(cfg: DictConfig) -> Campaign:
    """What is measured, with the step that divides its sampling period: whole steps are counted."""
    given: Campaign = instantiate(cfg.campaign, _convert_="all")
    return replace(given, integrator=given.integrator.within(1.0 / given.chain.base_rate))


SUITES = {"simulator": simulator, "together": trainings_together, "gpu": simulator_on_gpu}


@command("bench", resumes=False)
def main(cfg: DictConfig) -> None:
    """Measure and print the table."""
    whole(cfg.workers, "workers", 1)
    if cfg.suite not in SUITES:
        raise InputError(f"suite={cfg.suite}: must be one of {', '.join(SUITES)}; set suite")
    folder = Path(str(cfg.folder))
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryFile(dir=folder):  # now: measuring takes minutes, of which nothing could be kept
        pass
    for line in SUITES[cfg.suite](cfg, folder):
        log.info("%s", line)
    log.info("written to %s", folder)


if __name__ == "__main__":
    main()
