"""The simulator on a GPU against the processor's cores of the same machine: runs a second."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from clearance.benchmark.campaigns import Batch, simulate_all
from clearance.benchmark.measurement import circumstances, measure
from clearance.recording.synthesis import Campaign
from clearance.simulation.batch import run_batch
from clearance.simulation.failure import Failure
from clearance.simulation.gpu.batch import require_gpu, run_batch_on_gpu

_COMPARED, _COMPARED_SECONDS = 200, 0.02  # runs, and time from rest: long before chaos parts them


def measure_gpu(campaign: Campaign, workers: int, runs: int) -> dict[str, Any]:
    """Simulate on both, keep nothing.

    Args:
        campaign: what runs; its ``runs`` on the processor.
        workers: threads of the processor.
        runs: on the GPU, which needs many to be busy.

    Raises:
        InputError: if there is no GPU.
    """
    require_gpu("suite = gpu", "choose suite=simulator or suite=together")
    from numba import cuda

    short = replace(campaign, runs=_COMPARED, duration=_COMPARED_SECONDS, record_start=0.0)
    first, together = measure(lambda: _largest_difference(short))  # compiles both
    rows = [_row("cpu", run_batch, campaign, workers)]
    rows.append(_row("cuda", run_batch_on_gpu, replace(campaign, runs=runs), workers))
    return circumstances() | {
        "gpu": str(cuda.get_current_device().name),
        "scale": {
            "duration_s": campaign.duration,
            "recorded_s": campaign.duration - campaign.record_start,
            "step_s": campaign.integrator.step,
            "workers": workers,
        },
        "compilation_s": first.wall_s,
        "difference": together,
        "devices": rows,
        "ratio": rows[1]["runs_per_second"] / rows[0]["runs_per_second"],
    }


def _row(device: str, batch: Batch, campaign: Campaign, workers: int) -> dict[str, Any]:
    machines = [campaign.machine(run) for run in range(campaign.runs)]
    cost, failed = measure(
        lambda: simulate_all(machines, campaign.integrator, campaign.sampling, workers, device, batch)
    )
    return {
        "device": device,
        "runs": campaign.runs,
        "wall_s": cost.wall_s,
        "cpu_s": cost.cpu_s,
        "runs_per_second": campaign.runs / cost.wall_s,
        "failed": failed,
    }


def _largest_difference(campaign: Campaign) -> float:
    """Between signals of CPU and GPU, of the largest value that a signal takes in its run."""
    machines = [campaign.machine(run) for run in range(campaign.runs)]
    both: list[dict[int, np.ndarray]] = [{}, {}]
    batches: tuple[Batch, Batch] = (run_batch, run_batch_on_gpu)
    for found, batch in zip(both, batches, strict=True):

        def keep(run: int, outcome: np.ndarray | Failure, found: dict[int, np.ndarray] = found) -> None:
            found[run] = np.array([np.nan]) if isinstance(outcome, Failure) else outcome.copy()

        batch(machines, campaign.integrator, campaign.sampling, keep, 1)
    ours, theirs = (np.stack([found[run] for run in range(campaign.runs)]) for found in both)
    largest = np.abs(ours).max(axis=1)
    return float((np.abs(ours - theirs).max(axis=1) / np.where(largest > 0.0, largest, 1.0)).max())


def lines(report: dict[str, Any]) -> Iterator[str]:
    """The table, line by line."""
    scale, hardware = report["scale"], report["hardware"]
    yield (
        f"runs of {scale['duration_s']:g} s, {scale['recorded_s']:g} s recorded, h = {scale['step_s']:g} s; "
        f"{report['gpu']} against {scale['workers']} threads on {hardware['cpu']}, {hardware['cores']} cores"
    )
    yield f"{'':8}{'runs':>10}{'wall s':>10}{'runs/s':>12}{'failed':>8}"
    for row in report["devices"]:
        yield (
            f"{row['device']:8}{row['runs']:10}{row['wall_s']:10.2f}{row['runs_per_second']:12.1f}"
            f"{row['failed']:8}"
        )
    yield (
        f"ratio {report['ratio']:.1f}; compiled in {report['compilation_s']:.0f} s; over the first "
        f"{_COMPARED_SECONDS * 1e3:g} ms the two differ by {report['difference']:.1e} of a signal's largest"
    )
