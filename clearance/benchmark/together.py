"""Trainings of several seeds together against one after another: what an epoch costs, on the device at hand.

Both are the trainings that ``clearance.train`` makes, at the paper's sizes, on noise: what windows hold does
not change what they cost. Each begins anew, so that short ones on a GPU show less than long ones gain.
"""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from clearance.benchmark.measurement import Cost, measure
from clearance.models.neural import NeuralEstimator
from clearance.models.run_folder import RunFolder, environment, hardware
from clearance.models.together import fit_together
from clearance.windows.datamodule import WindowData
from clearance.windows.sources import FixedSource, LabelledRecordings
from clearance.windows.splitting import RandomSplit
from clearance.windows.windowing import RegularWindows

PAPER_WINDOWS, PAPER_EPOCHS = 35_000, 200
"""Training windows and most epochs of one training in the paper (Sections 4.2 and 4.4.1)."""

_CHANNELS, _LENGTH, _BATCH = ("1", "2", "3", "4"), 200, 64  # the rod's sensors, 20 ms, the paper's batch


@dataclass(frozen=True)
class Noise(FixedSource):
    """Recordings of ten windows each."""

    recordings: int

    def load(self, channels: Sequence[str], targets: Sequence[str], limit: int) -> LabelledRecordings:
        """Draw them."""
        rng = np.random.default_rng(0)
        count, samples = self.recordings, 10 * _LENGTH
        return LabelledRecordings(
            channels=tuple(channels),
            rate=1e4,
            signals=rng.standard_normal((count * samples, len(channels)), dtype=np.float32),
            lengths=np.full(count, samples),
            target=rng.uniform(0.0, 1e-3, (count, len(targets))),
            speed=np.full(count, np.nan),
            groups=np.arange(count),
            fingerprint="noise",
        )


def measure_together(
    model: Callable[[str, int], NeuralEstimator],
    names: Sequence[str],
    seeds: int,
    steps: int,
    epochs: int,
    threads: int,
    folder: Path,
    announce: Callable[[dict[str, Any]], None],
) -> dict[str, Any]:
    """Measure one model after the other.

    Args:
        model: Makes one of ``names`` to be trained for a number of epochs.
        names: Of models.
        seeds: Trained together.
        steps: Batches of 64 an epoch, about; 15 windows validate to 70 that train, as in the paper.
        epochs: Of the trainings that are measured, which must not stop earlier.
        threads: Of the processor, as ``model`` sets them.
        folder: For what trainings leave, while they are measured.
        announce: Called with every row.
    """
    data = WindowData(
        Noise(max(-(-steps * _BATCH // 7), 10)), _CHANNELS, ("clearance_c",), RandomSplit(),
        RegularWindows(_LENGTH, _LENGTH), _BATCH,
    )  # fmt: skip
    data.setup()
    windows = len(data.training_windows())
    # The paper's trainings in an hour, by the seconds of one that is measured.
    per_hour = 3600 * windows * epochs / PAPER_WINDOWS / PAPER_EPOCHS
    rows = []
    for name in names:
        _measured([model(name, 1)], data, folder)  # what only the first training of a process does
        apart, together = (
            _measured([model(name, epochs) for _ in range(count)], data, folder) for count in (1, seeds)
        )
        rows.append(
            {
                "model": name,
                "apart_s": apart.wall_s,
                "apart_cpu_s": apart.cpu_s,
                "together_s": together.wall_s,
                "together_cpu_s": together.cpu_s,
                "per_hour_apart": per_hour / apart.wall_s,
                "per_hour_together": seeds * per_hour / together.wall_s,
                "ratio": seeds * apart.wall_s / together.wall_s,
                "ratio_cpu": seeds * apart.cpu_s / together.cpu_s,
            }
        )
        announce(rows[-1])
    return {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "environment": environment(threads),
        "scale": {"seeds": seeds, "windows": windows, "batch": _BATCH, "epochs": epochs},
        "models": rows,
    }


def _measured(estimators: Sequence[NeuralEstimator], data: WindowData, folder: Path) -> Cost:
    """Cost of one training alone, or of several together."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        runs = [RunFolder.open(Path(place) / str(seed), {}, seed) for seed in range(len(estimators))]
        shared = RunFolder.open(Path(place) / "shared", {}, 0)
        work: Callable[[], Any] = partial(fit_together, estimators, data, runs, shared)
        if len(estimators) == 1:
            work = partial(estimators[0].fit, data, runs[0])
        cost, _ = measure(work)
        for run in runs:
            run.logger.finalize("success")
    return cost


def lines(report: dict[str, Any]) -> Iterator[str]:
    """The table, line by line."""
    scale = report["scale"]
    yield (
        f"{scale['seeds']} seeds together against one after another on {hardware(report['environment'])}; "
        f"{scale['windows']} windows an epoch; a run is {PAPER_EPOCHS} epochs of the paper's {PAPER_WINDOWS}"
    )
    yield f"{'':14}{'runs/h apart':>14}{'together':>12}{'ratio':>8}{'by processor time':>20}"
    for row in report["models"]:
        yield (
            f"{row['model']:14}{row['per_hour_apart']:14.3g}{row['per_hour_together']:12.3g}{row['ratio']:8.2f}"
            f"{row['ratio_cpu']:20.2f}"
        )
