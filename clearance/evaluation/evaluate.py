"""Judge a gauge on recordings: the paper's metrics by window and by recording, and pictures."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.figure import Figure
from torchmetrics import MetricCollection

from clearance.evaluation.figures import (
    error_against_clearance_and_speed,
    location_confusion,
    predicted_against_true,
)
from clearance.models.gauge import Gauge, by_recording, estimate_windows, point
from clearance.models.location import LOCATIONS, location
from clearance.windows.datamodule import WindowData
from clearance.windows.window_set import WindowSet

_VISIBLE = 5e-5  # m; a smaller clearance hardly differs from none


@dataclass(frozen=True)
class Evaluation:
    """Errors of one part of the data."""

    metrics: dict[str, float]  # by name, ``recording_`` for those of whole recordings
    seconds: float  # to predict all windows
    joints: tuple[str, ...]  # whose clearances are estimated
    estimate: np.ndarray  # (windows, targets) [m]
    truth: np.ndarray  # (windows, targets) [m]
    speed: np.ndarray  # (windows,) [rad/s]
    locations: np.ndarray | None  # (true, said) recordings, in the order of LOCATIONS; None where it is known

    def figures(self, title: str) -> dict[str, Figure]:
        """Pictures by name, of several targets one each."""
        made: dict[str, Figure] = {}
        for suffix, joint, estimate, truth in zip(
            suffixes(self.joints), self.joints, self.estimate.T, self.truth.T, strict=True
        ):
            own = f"{title}, joint {joint}" if suffix else title
            made[f"predicted_against_true{suffix}"] = predicted_against_true(estimate, truth, own)
            made[f"error{suffix}"] = error_against_clearance_and_speed(estimate, truth, self.speed, own)
        if self.locations is not None:
            made["location"] = location_confusion(self.locations, title)
        return made


def evaluate(gauge: Gauge, data: WindowData, windows: WindowSet, metrics: MetricCollection) -> Evaluation:
    """Errors of ``gauge`` on ``windows`` of ``data``."""
    begin = time.perf_counter()
    estimate = estimate_windows(gauge.estimator, gauge.scalers, windows)
    seconds = time.perf_counter() - begin
    recording = windows.recording.numpy()
    truth = data.recordings.target[recording]
    pairs = by_recording(estimate, windows, data.recordings.target)
    points = np.array([[point(own) for own in values.T] for values, _ in pairs])
    clearances = np.array([clearances for _, clearances in pairs])
    result: dict[str, float] = {}
    for prefix, found, true in (("", estimate, truth), ("recording_", points, clearances)):
        result |= {f"{prefix}{name}": value for name, value in _compute(metrics, found, true).items()}
        for place, suffix in enumerate(filter(None, suffixes(gauge.joints))):
            own = _compute(metrics, found[:, place], true[:, place])
            result[f"{prefix}nmae{suffix}"] = own["nmae"]
    confusion = None
    if (loose := gauge.loose(points)) is not None:
        said, real = location(loose), location(clearances > 0.0)
        visible = ((clearances == 0.0) | (clearances > _VISIBLE)).all(axis=1)
        result["location_accuracy"] = float(np.mean(said == real))
        if visible.any():
            result["location_accuracy_above_50_um"] = float(np.mean((said == real)[visible]))
        confusion = np.zeros((len(LOCATIONS), len(LOCATIONS)), dtype=int)
        np.add.at(confusion, (real, said), 1)
    return Evaluation(
        result, seconds, gauge.joints, estimate, truth, data.recordings.speed[recording], confusion
    )


def suffixes(joints: Sequence[str]) -> list[str]:
    """What tells the names of several joints' metrics and pictures apart; nothing where there is one."""
    return [f"_{joint.lower()}" for joint in joints] if len(joints) > 1 else [""]


def _compute(metrics: MetricCollection, estimate: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    fresh = metrics.clone()
    fresh.update(torch.from_numpy(estimate), torch.from_numpy(truth))
    return {name: float(value) for name, value in fresh.compute().items()}
