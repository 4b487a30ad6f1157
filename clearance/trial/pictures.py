"""Pictures of a trial: power, confusion, and what was estimated beside what is true."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from clearance.evaluation.figures import new_figure
from clearance.trial.case import SEVERAL, UNNAMED
from clearance.trial.claim import ARGUMENTS
from clearance.trial.repertoire import EFFECTS, FAULTS, FORCES

Row = Mapping[str, Any]
_FAINTEST = 1e-2  # visibilities below are drawn there
_SMALL = 1e-3  # %, of an error: smaller ones are drawn on a straight scale
_ESTIMATORS = {"nominal": ("#b2182b", "x"), "true": ("#888888", "o"), "corrected": ("#1b7837", ".")}
_COLOURS = {"right": "#1b7837", "detected": "#e08214", "missed": "#b2182b"}
_ORDER = ("none", *EFFECTS, *FAULTS, *SEVERAL, *FORCES, *UNNAMED, "unknown", "equivalent", "no verdict")
"""Of rows and columns: the list's own, joint to instrument, then what it does not have."""


def power(rows: Sequence[Row], bins: Sequence[Mapping[str, Any]]) -> Figure:
    """Each thing that was missing, by how plainly it shows: named rightly, only detected, or missed.

    Args:
        rows: of all cases. Beside each line: how many above the threshold are right, of how many.
        bins: ``power`` of the summary; drawn below, with exact intervals.
    """
    shown = [row for row in rows if row["visibility"]]
    labels = [name for _, name in sorted({(_place(row["kind"], row["item"]), _label(row)) for row in shown})]
    height = 0.28 * len(labels) + 1.0
    figure = new_figure(9, height + 3.0)
    axes, curve = figure.subplots(2, 1, sharex=True, height_ratios=[height, 2.0])
    for state, colour in _COLOURS.items():
        points = [
            (max(row["visibility"].values()), labels.index(_label(row)))
            for row in shown
            if _state(row) == state
        ]
        x, y = zip(*points, strict=True) if points else ((), ())
        axes.scatter(np.maximum(x, _FAINTEST), y, s=18, alpha=0.7, color=colour, linewidths=0, label=state)
    axes.axvline(1.0, color="black", linewidth=1, linestyle=":")
    plainest = [max(row["visibility"].values()) for row in shown]
    span = max(0.5 * min([0.2, *plainest]), 0.5 * _FAINTEST), 2.0 * max([5.0, *plainest])
    axes.set(xscale="log", xlim=span, title="What was found, by how plainly it shows")
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.invert_yaxis()
    above = [[bool(row["right"]) for row in shown if row["visible"] and _label(row) == one] for one in labels]
    beside = axes.secondary_yaxis("right")
    beside.set_yticks(range(len(labels)), [f"{sum(one)} of {len(one)}" for one in above], fontsize=8)
    beside.set_ylabel("right, above the threshold", fontsize=8)
    axes.legend(loc="lower left", fontsize=8)
    _curves_of_power(curve, bins)
    curve.set(xlabel="change over the detection threshold", ylabel="share of the cases", ylim=(-0.03, 1.03))
    curve.legend(loc="lower right", fontsize=8)
    return figure


def confusion(table: Mapping[str, Mapping[str, int]]) -> Figure:
    """What is true against what was said first."""
    truths = sorted(table, key=_order)
    said = sorted({name for cells in table.values() for name in cells}, key=_order)
    counts = np.array([[table[t].get(s, 0) for s in said] for t in truths])
    figure = new_figure(0.32 * len(said) + 3.2, 0.28 * len(truths) + 2.8)
    axes = figure.add_subplot()
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for i, j in np.argwhere(counts > 0):
        axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=7,
                  color="white" if shares[i, j] > 0.5 else "black")  # fmt: skip
    axes.set_xticks(range(len(said)), said, rotation=90, fontsize=8)
    axes.set_yticks(range(len(truths)), truths, fontsize=8)
    axes.set(xlabel="said", ylabel="true")
    return figure


def estimates(rows: Sequence[Row]) -> Figure:
    """Errors of parameters and clearances, with 95 % intervals; held-out errors."""
    said = [row for row in rows if row["verdict"] is not None]
    figure = new_figure(12, 4)
    asserted = [p for row in said for p in row["parameters"] if p["true"]]
    _errors(figure.add_subplot(1, 3, 1), asserted, [p["true"] for p in asserted], "asserted parameters")
    known = [row for row in said if row["right"] and (row["clearance"] or {}).get("low") is not None]
    _errors(
        figure.add_subplot(1, 3, 2), [row["clearance"] for row in known],
        [row["clearance_m"] for row in known],
        "clearance, where the verdict is right",
    )  # fmt: skip
    axes = figure.add_subplot(1, 3, 3)
    held = [row["held_out"] for row in said if row["held_out"].get("before") and row["held_out"].get("after")]
    before, after = ([h[when] / h["floor"] for h in held] for when in ("before", "after"))
    axes.scatter(before, after, s=14)
    axes.axhline(1.1, color="black", linewidth=1, linestyle=":")
    axes.set(
        xscale="log",
        yscale="log",
        xlim=(0.8 * min([1.0, *before]), 1.25 * max([2.0, *before])),
        ylim=(0.8 * min([1.0, *after]), 1.25 * max([2.0, *after])),
        xlabel="held-out error before, over the floor",
        ylabel="after, over the floor",
    )
    return figure


def power_by_effect(bins: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Shares detected and right of each effect and fault, against how plainly it shows.

    Args:
        bins: ``power_by_effect`` of the summary, with exact intervals.
    """
    shown = sorted(bins, key=_order)
    columns = 6
    lines = max(1, -(-len(shown) // columns))
    figure = new_figure(2.3 * columns, 1.9 * lines + 0.5)
    panels = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, name in zip(panels, shown, strict=False):
        _curves_of_power(axes, bins[name])
        axes.set(xscale="log", ylim=(-0.05, 1.05))
        axes.set_title(name, fontsize=8)
        axes.tick_params(labelsize=7)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    figure.supxlabel("change over the detection threshold", fontsize=9)
    figure.supylabel("share of the cases, with exact 95 % intervals", fontsize=9)
    if shown:
        handles, names = panels[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower right", ncols=2, fontsize=8, frameon=False)
    return figure


def curves(rows: Sequence[Row]) -> Figure:
    """Forces of free form beside the true ones, over what the verdict says that they are functions of."""
    shown = [row for row in rows if row.get("curve") and row["visible"]]
    columns = max(1, min(len(shown), 5))
    lines = max(1, -(-len(shown) // columns))
    figure = new_figure(2.8 * columns, 2.4 * lines)
    if not shown:
        figure.text(0.5, 0.5, "no force of free form was found where it acts", ha="center", fontsize=8)
    for place, row in enumerate(shown, 1):
        axes = figure.add_subplot(lines, columns, place)
        curve = row["curve"]
        axes.plot(curve["argument"], curve["true"], ".", markersize=4, color="#888888", label="true")
        axes.plot(curve["argument"], curve["found"], color=_COLOURS["right"], linewidth=1.2, label="found")
        axes.set_title(f"{_label(row)}\ncorrelation {row['curve_correlation']:.3f}", fontsize=8)
        over = curve.get("over")  # trials before it was kept say it nowhere
        if over is not None:
            axes.set_xlabel(f"{over.replace('_', ' ')} [{ARGUMENTS[over]}]", fontsize=7)
            axes.set_ylabel("[N m]" if curve["direction"] in ("torque", "moment") else "[N]", fontsize=7)
        axes.tick_params(labelsize=7)
        if place == 1:
            axes.legend(fontsize=7, frameon=False)
    return figure


def loop(rows: Sequence[Row]) -> Figure:
    """Clearances that estimators read, against the true ones: one panel a case."""
    columns = min(len(rows), 4)
    lines = -(-len(rows) // columns)
    figure = new_figure(3.2 * columns, 3.2 * lines)
    for place, row in enumerate(rows, 1):
        axes = figure.add_subplot(lines, columns, place)
        true = 1e3 * np.array(row["true_m"])
        axes.plot([0.0, true.max()], [0.0, true.max()], color="black", linewidth=1)
        for name, (colour, marker) in _ESTIMATORS.items():
            read = 1e3 * np.array(row["estimates_m"][name])
            axes.scatter(true, read, s=14, color=colour, marker=marker, label=name)
        axes.set(title=f"{row['item']}, {row['joint']}", xlabel="true clearance [mm]", ylabel="read [mm]")
        if place == 1:
            axes.legend(frameon=False, fontsize="small")
    return figure


def _curves_of_power(axes: Axes, bins: Sequence[Mapping[str, Any]]) -> None:
    """Right and detected by visibility, with exact intervals; the threshold dotted."""
    for state in ("detected", "right"):
        known = [one for one in bins if one[state]["of"]]
        middle = [np.sqrt(max(one["from"], 0.05) * (one["to"] or 4.0 * one["from"])) for one in known]
        rates = np.array([[one[state][k] for k in ("rate", "low", "high")] for one in known]).reshape(-1, 3)
        spans = np.abs(rates[:, 1:] - rates[:, :1]).T
        axes.errorbar(
            middle, rates[:, 0], spans, fmt="o-", markersize=4, capsize=2, color=_COLOURS[state], label=state
        )
    axes.axvline(1.0, color="black", linewidth=1, linestyle=":")


def _errors(axes: Axes, found: Sequence[Mapping[str, Any]], true: Sequence[float], title: str) -> None:
    """Estimates beside the truth, sorted, with their intervals; red where these miss it."""
    ratios = np.array(
        [[one[k] / t for k in ("value", "low", "high")] for one, t in zip(found, true, strict=True)]
    )
    axes.axhline(0.0, color="black", linewidth=1)
    axes.set(title=title, ylabel="error [%]", xticks=[])
    axes.set_yscale("symlog", linthresh=_SMALL, linscale=0.5)
    axes.set_ylim(-100.0, 100.0)
    if len(ratios) == 0:
        return
    errors = 100.0 * (ratios[np.argsort(ratios[:, 0])] - 1.0)
    low, high = np.sort(errors[:, 1:], axis=1).T
    missed = (low > 0.0) | (high < 0.0)
    place = np.arange(len(errors))
    for kind, colour in ((~missed, _COLOURS["right"]), (missed, _COLOURS["missed"])):
        axes.vlines(place[kind], low[kind], high[kind], color=colour, linewidth=1, alpha=0.5)
        # what is far off is drawn at the edge
        axes.scatter(place[kind], np.clip(errors[kind, 0], -99.0, 99.0), s=10, color=colour)


def _label(row: Row) -> str:
    return f"{row['kind']}: {row['item']}" if row["kind"] in ("outside", "left_out") else str(row["item"])


def _order(name: str) -> tuple[int, str]:
    """Place of a name in tables: those that the list does not have come last."""
    return (_ORDER.index(name) if name in _ORDER else len(_ORDER)), name


def _place(kind: str, item: str) -> tuple[int, int, str]:
    """Effects, faults, pairs and triples, forces, and what was left out."""
    return (_order(kind)[0] if kind in UNNAMED else 0), *_order(item)


def _state(row: Row) -> str:
    return "right" if row["right"] else "detected" if row.get("detected") else "missed"
