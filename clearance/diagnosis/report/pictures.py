"""Pictures of a diagnosis for TensorBoard: what the report draws in the browser, plainly and without one."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

_RANKED = 12  # explanations
_CHANNELS = 3  # beside their recordings, the loudest first
_LEAST = 3.0  # end of the scale of errors, in units of the noise
_CUT = 60  # letters of an explanation
_LINES = (("recorded", "black", 1.6), ("before", "tab:red", 0.9), ("after", "tab:blue", 0.9))


def where_it_shows(where: Mapping[str, Any]) -> Figure | None:
    """Channels by crank angle, before and after, in units of the noise; ``where`` of the evidence."""
    maps = [where.get("heat"), where.get("heat_after")]
    shown = [
        (name, np.nan_to_num(np.array(one, dtype=float), nan=1.0))
        for name, one in zip(("before", "after"), maps, strict=True)
        if one
    ]
    if not shown:
        return None
    channels, angle = where["channels"], where["crank_angle_deg"]
    half = 0.5 * (angle[1] - angle[0])
    most = max(_LEAST, float(np.max([one for _, one in shown])))
    figure = _figure(10.0, 1.2 + 0.3 * len(channels))
    for place, (name, values) in enumerate(shown, start=1):
        axes = figure.add_subplot(1, len(shown), place)
        picture = axes.imshow(
            np.maximum(values, 1.0), norm=LogNorm(1.0, most), cmap="viridis", aspect="auto",
            extent=(angle[0] - half, angle[-1] + half, len(channels) - 0.5, -0.5), interpolation="nearest",
        )  # fmt: skip
        axes.set(title=name, xlabel="crank angle [deg]", xticks=range(0, 361, 90), yticks=[])
        if place == 1:
            axes.set_yticks(range(len(channels)), channels)
    figure.colorbar(picture, ax=figure.axes, label="error / noise")
    return figure


def ranked(ranking: Sequence[Mapping[str, Any]]) -> Figure | None:
    """How much likelier each explanation makes the recordings; ``ranking`` of the evidence."""
    best: dict[str, float] = {}
    for row in ranking:
        if row["log_likelihood_gain"] is not None:
            best[row["name"]] = max(best.get(row["name"], -np.inf), row["log_likelihood_gain"])
    first = sorted(best.items(), key=lambda one: -one[1])[:_RANKED]
    if not first:
        return None
    figure = _figure(9.0, 1.0 + 0.3 * len(first))
    axes = figure.add_subplot()
    names = [name if len(name) <= _CUT else f"{name[: _CUT - 3]}..." for name, _ in first]
    axes.barh(range(len(first)), [gain for _, gain in first], color="tab:blue")
    axes.set_yticks(range(len(first)), names)
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=10.0)
    axes.set_xlabel("log-likelihood gained on the fitted recordings")
    return figure


def beside_the_recording(overlays: Sequence[Mapping[str, Any]]) -> Figure | None:
    """What was recorded, and both models' predictions, of the channels that the nominal one is worst in."""

    def error(one: Mapping[str, Any]) -> float:
        recorded = np.array(one["recorded"], dtype=float)
        told = np.array(one["before"] or one["after"], dtype=float)
        return float(np.nanmean((told - recorded) ** 2) / max(float(np.nanvar(recorded)), 1e-300))

    first = sorted(overlays, key=error, reverse=True)[:_CHANNELS]
    if not first:
        return None
    figure = _figure(10.0, 0.6 + 2.0 * len(first))
    for place, one in enumerate(first, start=1):
        axes = figure.add_subplot(len(first), 1, place)
        for key, colour, width in _LINES:
            if one[key] is not None:
                values = np.array(one[key], dtype=float)
                axes.plot(one["time_s"], values, color=colour, linewidth=width, label=key)
        axes.set(
            ylabel=f"{one['channel']}\n[{one['unit']}]", xlabel="time [s]" if place == len(first) else ""
        )
        axes.legend(loc="upper right", ncols=3, fontsize="small")
    return figure


def as_png(figure: Figure) -> tuple[bytes, int, int]:
    """A PNG file of a figure, its width and its height [pixels]."""
    file = BytesIO()
    figure.savefig(file, format="png")
    width, height = figure.canvas.get_width_height()
    return file.getvalue(), width, height


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    return figure
