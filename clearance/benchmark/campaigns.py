"""Cost of a campaign: stepping alone, with the filter, and stored on disk."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from clearance.benchmark.measurement import Cost, measure
from clearance.mechanism.slider_crank import SliderCrank
from clearance.provenance import peak_memory
from clearance.recording.synthesis import Campaign
from clearance.simulation.batch import Sampling, Sink, run_batch
from clearance.simulation.decimation import Decimation
from clearance.simulation.failure import Failure
from clearance.simulation.integrator import Integrator

FULL_SCALE = 1000
"""Runs for which the targets hold."""

Row = dict[str, Any]
Batch = Callable[[Sequence[SliderCrank], Integrator, Sampling, Sink, int], None]


def steps_of(campaign: Campaign) -> int:
    """Time steps of all runs together."""
    return campaign.runs * round(campaign.duration / campaign.integrator.step)


def row(task: str, cost: Cost, steps: int, **more: Any) -> Row:
    """One line of the table; the speed a core is by processor time, which other programs hardly change."""
    return {
        "task": task,
        **asdict(cost),
        "steps": steps,
        "steps_per_second": steps / cost.wall_s,
        "steps_per_second_per_core": steps / cost.cpu_s,
        "ns_per_step_per_core": 1e9 * cost.cpu_s / steps,
        **more,
    }


def last_sample(base_rate: float, duration: float) -> Sampling:
    """Of a run of ``duration``, unfiltered: the steps and nearly nothing else."""
    return Sampling(base_rate, Decimation.none(), duration - 1.0 / base_rate, 1.0 / base_rate)


def simulate_all(
    machines: Sequence[SliderCrank],
    integrator: Integrator,
    sampling: Sampling,
    workers: int,
    title: str | None = None,
    batch: Batch = run_batch,
) -> int:
    """Simulate by ``batch``, keep nothing, and count the runs that failed; without title no progress bar."""
    failed = 0
    with tqdm(total=len(machines), unit="run", desc=title, disable=title is None, mininterval=0.5) as bar:

        def count(_: int, outcome: np.ndarray | Failure) -> None:
            nonlocal failed
            failed += isinstance(outcome, Failure)
            bar.update()

        batch(machines, integrator, sampling, count, workers)
    return failed


def warm_up(campaign: Campaign) -> Cost:
    """Read the compiled loop from its cache, or compile it."""
    short = replace(campaign, duration=0.01, record_start=0.0)
    return measure(partial(simulate_all, [short.machine(0)], short.integrator, short.sampling, 1))[0]


def measure_stepping(campaign: Campaign, workers: int) -> Row:
    """All runs at full length without filter; one sample of each is kept."""
    machines = [campaign.machine(run) for run in range(campaign.runs)]
    sampling = last_sample(campaign.chain.base_rate, campaign.duration)
    cost, failed = measure(lambda: simulate_all(machines, campaign.integrator, sampling, workers, "stepping"))
    remains = f"the last {3 * sampling.decimation.chunk} of a run's steps also read the sensors"
    return row("stepping", cost, steps_of(campaign), target_s=5.0, failed=failed, remains=remains)


def measure_filtering(campaign: Campaign, workers: int) -> Row:
    """All runs, ten accelerations filtered and decimated from the first step on, nothing stored."""
    whole = replace(campaign, record_start=0.0)
    machines = [whole.machine(run) for run in range(whole.runs)]
    cost, failed = measure(
        lambda: simulate_all(machines, whole.integrator, whole.sampling, workers, "filtering")
    )
    return row("stepping + filter", cost, steps_of(whole), failed=failed)


def measure_storing(campaign: Campaign, workers: int, record_start: float, folder: Path) -> Row:
    """A data set on disk, made as ``python -m clearance.simulate`` makes it, and removed afterwards."""
    stored = replace(campaign, record_start=record_start)
    with tempfile.TemporaryDirectory(dir=folder, prefix="dataset-") as path:
        cost, dataset = measure(lambda: stored.generate(Path(path) / "data", workers=workers))
        there, failed = len(dataset.available()), len(dataset.failures())
        written = sum(file.stat().st_size for file in Path(path).rglob("*") if file.is_file()) / 2**20
    return row(
        f"stepping + filter + store, {record_start:g}-{campaign.duration:g} s",
        cost,
        steps_of(stored),
        target_s=10.0,
        stored=there,
        failed=failed,
        written_mib=written,
        peak_rss_mib=peak_memory(),
        target_peak_rss_mib=2048.0,
    )


def measure_campaign(campaign: Campaign, workers: int, folder: Path) -> Iterator[Row]:
    """All of the above, in the order of growing memory, so that each peak is that of its own row."""
    yield measure_stepping(campaign, workers)
    yield measure_storing(campaign, workers, campaign.record_start, folder)
    yield measure_filtering(campaign, workers)
    yield measure_storing(campaign, workers, 0.0, folder)
