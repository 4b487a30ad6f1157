"""How accuracy grows with the number of simulated runs and the length of a window: tables, a picture."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from clearance.evaluation.figures import new_figure
from clearance.models.run_folder import hardware

Row = Mapping[str, Any]
_MODEL = "tcn on rod, joint C"
_LENGTH = 200  # samples of a window, unless it is what changes
_RUNS = 300  # likewise
_EPOCHS = 30  # of the recipe: more of them would make another curve
_ALIKE = {  # the same recipe
    "by_runs": ("by_runs", "quick", "best"),
    "by_window": ("by_window", "quick"),
    "by_streaming": ("by_streaming",),
}
EXPERIMENTS = tuple(_ALIKE)
_HEADS = ("NMAE, window", "NRMSE, window", "95 % of errors below", "NMAE, recording", "training")


def by_runs(rows: Sequence[Row]) -> list[Row]:
    """Trainings that differ in the number of runs alone, the fewest first."""
    own = [row for row in _alike(rows, "by_runs") if row["window"] == _LENGTH]
    return sorted(own, key=lambda row: row["recordings"])


def by_window(rows: Sequence[Row]) -> list[Row]:
    """Trainings that differ in the length of a window alone, the shortest first."""
    own = [row for row in _alike(rows, "by_window") if row["recordings"] == _RUNS]
    return sorted(own, key=lambda row: row["window"])


def by_streaming(rows: Sequence[Row]) -> list[Row]:
    """Trainings that saw no run twice, which differ in their number alone, the fewest first."""
    return sorted(_alike(rows, "by_streaming"), key=lambda row: row["streamed"])


class _Curve(NamedTuple):
    """What changes along a curve, and how a table and a picture call it."""

    points: Callable[[Sequence[Row]], list[Row]]
    key: str
    head: str
    text: str
    label: str
    scale: float = 1.0


_CURVES = (
    _Curve(
        by_runs, "recordings", "runs", "the number of simulated runs (`experiment=by_runs`)", "simulated runs"
    ),
    _Curve(
        by_streaming, "streamed", "runs",
        "the number of simulated runs, each seen once (`experiment=by_streaming`)",
        "simulated runs, each seen once",
    ),
    _Curve(
        by_window, "window", "samples a window", "the length of a window (`experiment=by_window`)",
        "length of a window [ms]", 0.1,
    ),
)  # fmt: skip


def markdown(rows: Sequence[Row]) -> str:
    """The tables, with what they are about; empty where no curve has two points."""
    parts = []
    for curve, own in _drawn(rows):
        machines = sorted({hardware(row["environment"]) for row in own})
        computed = "; ".join(machines)
        which = [f" ({hardware(row['environment'])})" if len(machines) > 1 else "" for row in own]
        lines = [
            f"By {curve.text}; {_MODEL}, one training each, errors on its test recordings; {computed}.\n",
            f"| {curve.head} | {' | '.join(_HEADS)} |",
            "| --- " * (1 + len(_HEADS)) + "|",
            *(f"| {row[curve.key]} | {_errors(row, also)} |" for row, also in zip(own, which, strict=True)),
        ]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def draw(rows: Sequence[Row]) -> Figure | None:
    """A panel a curve, errors over what changes; ``None`` where no curve has two points."""
    panels = _drawn(rows)
    if not panels:
        return None
    figure = new_figure(4.6 * len(panels), 3.8)
    for axes, (curve, own) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        places = [row[curve.key] * curve.scale for row in own]
        for key, name in (("nmae", "a window"), ("recording_nmae", "a recording of 1 s")):
            axes.plot(places, [row["test"][key] for row in own], marker="o", markersize=4, label=name)
        axes.set(xscale="log", yscale="log", xlabel=curve.label, ylabel="NMAE [% of 1 mm]")
        axes.set_xticks(places, [f"{place:,g}" for place in places])
        axes.minorticks_off()
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.grid(True, alpha=0.3)
        axes.legend()
    return figure


def _drawn(rows: Sequence[Row]) -> list[tuple[_Curve, list[Row]]]:
    found = [(curve, curve.points(rows)) for curve in _CURVES]
    return [(curve, own) for curve, own in found if len(own) > 1]


def _alike(rows: Sequence[Row], experiment: str) -> list[Row]:
    # Of the same training in two experiments one is enough; of several seeds the least, not the best of them.
    found: dict[tuple[int, int, int | None], Row] = {}
    for name in _ALIKE[experiment]:
        for row in sorted(rows, key=lambda row: (row["split_seed"], row["seed"])):
            streamed = row.get("streamed")  # rows of an older version have none
            as_it_is = (row["experiment"], row["name"]) == (name, _MODEL) and not row.get("overrides")
            if as_it_is and (streamed or row["epochs"] == _EPOCHS):
                found.setdefault((row["recordings"], row["window"], streamed), row)
    return list(found.values())


def _errors(row: Row, also: str = "") -> str:
    """Cells of a line; to the seconds what computed is added where lines differ in it."""
    test = row["test"]
    cells = (
        f"{test['nmae']:.2f} %", f"{test['nrmse']:.2f} %", f"{test['p95_ae'] * 1e6:.1f} µm",
        f"{test['recording_nmae']:.3f} %", f"{row['training_seconds'] / 60:.1f} min{also}",
    )  # fmt: skip
    return " | ".join(cells)
