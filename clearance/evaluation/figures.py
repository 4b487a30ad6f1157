"""Pictures of a model's errors, drawn without a display."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from clearance.models.location import LOCATIONS

_BINS = 10  # of clearances or speeds, for medians
_POINT: dict[str, Any] = {"s": 6, "alpha": 0.35, "linewidths": 0}


def predicted_against_true(estimate: np.ndarray, truth: np.ndarray, title: str) -> Figure:
    """Estimates over true clearances, (windows,) [m] each, with the line on which they agree."""
    figure = new_figure(5, 5)
    axes = figure.add_subplot()
    scatter_against_true(axes, estimate, truth)
    axes.set(title=title)
    return figure


def scatter_against_true(axes: Axes, estimate: np.ndarray, truth: np.ndarray) -> None:
    """The same in a panel of a figure."""
    axes.scatter(truth * 1e3, estimate * 1e3, **_POINT)
    ends = [0.0, max(float(truth.max()), float(estimate.max())) * 1e3]
    axes.plot(ends, ends, color="black", linewidth=1, label="agreement")
    axes.set(xlabel="true clearance [mm]", ylabel="predicted clearance [mm]")
    axes.legend()


def error_against_clearance_and_speed(
    estimate: np.ndarray, truth: np.ndarray, speed: np.ndarray, title: str
) -> Figure:
    """Errors over clearance [m] and over crank speed [rad/s], (windows,) each, with binned medians."""
    figure = new_figure(9, 4)
    error = np.abs(estimate - truth) * 1e6
    panels = ((truth * 1e3, "true clearance [mm]"), (speed * 30 / np.pi, "crank speed [rpm]"))
    for place, (value, label) in enumerate(panels, start=1):
        axes = figure.add_subplot(1, 2, place)
        known = np.isfinite(value)
        axes.scatter(value[known], error[known], **_POINT)
        centres, medians = _binned_median(value[known], error[known])
        axes.plot(centres, medians, color="black", marker="o", markersize=4, linewidth=1, label="median")
        axes.set(xlabel=label, ylabel="absolute error [µm]", yscale="log")
        axes.legend()
    figure.suptitle(title)
    return figure


def location_confusion(counts: np.ndarray, title: str) -> Figure:
    """Recordings by where they have clearance and where they are said to, (true, said) counts."""
    figure = new_figure(5, 4.5)
    axes = figure.add_subplot()
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0)
    for (row, column), count in np.ndenumerate(counts):
        colour = "white" if shares[row, column] > 0.5 else "black"
        axes.annotate(str(count), (column, row), ha="center", va="center", color=colour)
    places = range(len(LOCATIONS))
    axes.set(xticks=places, yticks=places, xticklabels=LOCATIONS, yticklabels=LOCATIONS)
    axes.set(xlabel="said to have clearance", ylabel="has clearance", title=title)
    return figure


def _binned_median(value: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if len(value) == 0:
        return np.empty(0), np.empty(0)
    edges = np.linspace(value.min(), value.max(), _BINS + 1)
    place = np.clip(np.digitize(value, edges) - 1, 0, _BINS - 1)
    filled = np.unique(place)
    return (edges[filled] + edges[filled + 1]) / 2, np.array([np.median(error[place == b]) for b in filled])


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size [inch]."""
    # Without pyplot: no global list of figures, nothing to close.
    figure = Figure(figsize=(width, height), layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    return figure


def best_of_each_size(groups: Sequence[Sequence[tuple[Sequence[str], float]]], title: str) -> Figure:
    """Bars of errors [m] over sets of channels, one panel a size, on one logarithmic scale."""
    figure = new_figure(9, 0.6 + 0.28 * sum(map(len, groups)) + 0.3 * len(groups))
    panels = figure.subplots(
        len(groups), 1, sharex=True, squeeze=False, height_ratios=[len(group) for group in groups]
    )[:, 0]
    for axes, group in zip(panels, groups, strict=True):
        names = [", ".join(channels) for channels, _ in group]
        bars = axes.barh(range(len(group)), [error * 1e6 for _, error in group], height=0.6)
        axes.bar_label(bars, fmt="%.3g", padding=3, fontsize=7)
        axes.set_yticks(range(len(group)), names, fontsize=7)
        axes.invert_yaxis()
        axes.set_xscale("log")
        axes.grid(axis="x", which="both", linewidth=0.3)
    panels[0].set_title(title)
    panels[-1].set_xlabel("least mean error of a window [µm]")
    return figure
