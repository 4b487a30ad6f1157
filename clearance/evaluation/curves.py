"""How accuracy grows with the number of simulated runs and the length of a window: tables, a picture."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from clearance.evaluation.figures import new_figure
from clearance.models.run_folder import hardware

Row = Mapping[str, Any]
_MODEL = "tcn on rod, joint C"
_LENGTH = 200  # samples of a window, unless it is what changes
_RUNS = 300  # likewise
_EPOCHS = 30  # of the recipe: more of them would make another curve
_ALIKE = {"by_runs": ("by_runs", "quick", "best"), "by_window": ("by_window", "quick")}  # the same recipe
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


def markdown(rows: Sequence[Row]) -> str:
    """Both tables, with what they are about; empty where no curve has two points."""
    parts = []
    for own, key, head, text in (
        (by_runs(rows), "recordings", "runs", "the number of simulated runs (`experiment=by_runs`)"),
        (by_window(rows), "window", "samples a window", "the length of a window (`experiment=by_window`)"),
    ):
        if len(own) > 1:
            machines = ", ".join(sorted({hardware(row["environment"]) for row in own}))
            lines = [
                f"By {text}; {_MODEL}, one training each, errors on its test recordings; {machines}.\n",
                f"| {head} | {' | '.join(_HEADS)} |",
                "| --- " * (1 + len(_HEADS)) + "|",
                *(f"| {row[key]} | {_errors(row)} |" for row in own),
            ]
            parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def draw(rows: Sequence[Row]) -> Figure | None:
    """A panel a curve, errors over what changes; ``None`` where no curve has two points."""
    panels = [
        (own, [row[key] * scale for row in own], label)
        for own, key, scale, label in (
            (by_runs(rows), "recordings", 1.0, "simulated runs"),
            (by_window(rows), "window", 0.1, "length of a window [ms]"),
        )
        if len(own) > 1
    ]
    if not panels:
        return None
    figure = new_figure(4.6 * len(panels), 3.8)
    for axes, (own, places, label) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
    ):
        for key, name in (("nmae", "a window"), ("recording_nmae", "a recording of 1 s")):
            axes.plot(places, [row["test"][key] for row in own], marker="o", markersize=4, label=name)
        axes.set(xscale="log", yscale="log", xlabel=label, ylabel="NMAE [% of 1 mm]")
        axes.set_xticks(places, [f"{place:g}" for place in places])
        axes.minorticks_off()
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.grid(True, alpha=0.3)
        axes.legend()
    return figure


def _alike(rows: Sequence[Row], experiment: str) -> list[Row]:
    # Of the same training in two experiments one is enough; of several seeds the least, not the best of them.
    found: dict[tuple[int, int], Row] = {}
    for name in _ALIKE[experiment]:
        for row in sorted(rows, key=lambda row: (row["split_seed"], row["seed"])):
            as_it_is = (row["experiment"], row["name"], row["epochs"]) == (name, _MODEL, _EPOCHS)
            if as_it_is and not row.get("overrides"):
                found.setdefault((row["recordings"], row["window"]), row)
    return list(found.values())


def _errors(row: Row) -> str:
    test = row["test"]
    cells = (
        f"{test['nmae']:.2f} %", f"{test['nrmse']:.2f} %", f"{test['p95_ae'] * 1e6:.1f} µm",
        f"{test['recording_nmae']:.3f} %", f"{row['training_seconds'] / 60:.1f} min",
    )  # fmt: skip
    return " | ".join(cells)
