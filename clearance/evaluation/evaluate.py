"""Judge a gauge on recordings: the paper's metrics by window and by recording, and pictures."""

import time
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.figure import Figure
from torchmetrics import MetricCollection

from clearance.evaluation.figures import error_against_clearance_and_speed, predicted_against_true
from clearance.models.gauge import Gauge, by_recording, estimate_windows
from clearance.models.interval import robust_mean
from clearance.windows.datamodule import WindowData
from clearance.windows.window_set import WindowSet


@dataclass(frozen=True)
class Evaluation:
    """Errors of one part of the data."""

    metrics: dict[str, float]  # by name, ``recording_`` for those of whole recordings
    seconds: float  # to predict all windows
    estimate: np.ndarray  # (windows,) [m]
    truth: np.ndarray  # (windows,) [m]
    speed: np.ndarray  # (windows,) [rad/s]

    def figures(self, title: str) -> dict[str, Figure]:
        """Pictures by name."""
        return {
            "predicted_against_true": predicted_against_true(self.estimate, self.truth, title),
            "error": error_against_clearance_and_speed(self.estimate, self.truth, self.speed, title),
        }


def evaluate(gauge: Gauge, data: WindowData, windows: WindowSet, metrics: MetricCollection) -> Evaluation:
    """Errors of ``gauge`` on ``windows`` of ``data``."""
    begin = time.perf_counter()
    estimate = estimate_windows(gauge.estimator, gauge.scalers, windows)
    seconds = time.perf_counter() - begin
    recording = windows.recording.numpy()
    truth = data.recordings.target[recording]
    pairs = [
        (robust_mean(values), clearance)
        for values, clearance in by_recording(estimate, windows, data.recordings.target)
    ]
    points, clearances = np.array(pairs).T
    result = _compute(metrics, estimate, truth)
    result |= {f"recording_{name}": value for name, value in _compute(metrics, points, clearances).items()}
    return Evaluation(result, seconds, estimate, truth, data.recordings.speed[recording])


def _compute(metrics: MetricCollection, estimate: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    fresh = metrics.clone()
    fresh.update(torch.from_numpy(estimate), torch.from_numpy(truth))
    return {name: float(value) for name, value in fresh.compute().items()}
