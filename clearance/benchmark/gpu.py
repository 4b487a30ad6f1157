"""The simulator on a GPU against the processor's cores of the same machine: runs a second."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from clearance.benchmark.campaigns import Batch, simulate_all
from clearance.benchmark.measurement import circumstances, measure
from clearance.mechanism.slider_crank import SliderCrank
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

    Returns:
        The rows of both, and of 200 short runs before them: ``first_on_gpu_s``, what they took on the GPU
        with what they compile [s]; ``difference``, the largest between the signals of both, of the largest
        value that a signal takes in its run; ``left_out``, how many failed on either. ``difference`` is
        ``None`` where all did.

    Raises:
        InputError: if there is no GPU.
    """
    require_gpu("suite = gpu", "choose suite=simulator or suite=together")
    from numba import cuda

    short = replace(campaign, runs=_COMPARED, duration=_COMPARED_SECONDS, record_start=0.0)
    machines = [short.machine(run) for run in range(short.runs)]
    ours = _signals(run_batch, machines, short)  # before the clock runs: this compiles, too
    first, theirs = measure(lambda: _signals(run_batch_on_gpu, machines, short))
    both = sorted(ours.keys() & theirs.keys())
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
        "first_on_gpu_s": first.wall_s,
        "difference": max((_difference(ours[run], theirs[run]) for run in both), default=None),
        "left_out": len(machines) - len(both),
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


def _signals(batch: Batch, machines: Sequence[SliderCrank], campaign: Campaign) -> dict[int, np.ndarray]:
    """(samples, SIGNALS) of each run that does not fail."""
    found = {}

    def keep(run: int, outcome: np.ndarray | Failure) -> None:
        if not isinstance(outcome, Failure):
            found[run] = outcome.copy()

    batch(machines, campaign.integrator, campaign.sampling, keep, 1)
    return found


def _difference(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Between (samples, SIGNALS) of one run, of the largest value that a signal takes."""
    largest = np.abs(ours).max(axis=0)
    return float((np.abs(ours - theirs).max(axis=0) / np.where(largest > 0.0, largest, 1.0)).max())


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
        f"ratio {report['ratio']:.1f}; the first {_COMPARED} short runs on the GPU, with what they compile: "
        f"{report['first_on_gpu_s']:.0f} s"
    )
    if report["difference"] is not None:
        yield (
            f"over the first {_COMPARED_SECONDS * 1e3:g} ms of these the two differ by "
            f"{report['difference']:.1e} of a signal's largest"
        )
    if report["left_out"]:
        yield f"{report['left_out']} of them failed on either and are not compared"
