"""Finished trainings as rows of a table, and the files that README and RESULTS are made from."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from clearance.configuration import set_key
from clearance.errors import InputError
from clearance.evaluation.fresh import read_fresh
from clearance.models.run_folder import CONFIG, HARDWARE, METRICS, hardware
from clearance.whole_files import read_json, read_yaml


def collect(folder: Path) -> list[dict[str, Any]]:
    """One row a finished training below ``folder``, best first within each experiment.

    Raises:
        InputError: if there is none.
    """
    rows = [_row(metrics.parent) for metrics in sorted(folder.rglob(METRICS))]
    if not rows:
        raise InputError(
            f"runs = {folder}: no finished training there; make one with python -m clearance.train"
        )
    return sorted(rows, key=lambda row: (row["experiment"], row["test"]["nmae"]))


def with_recorded(rows: Sequence[dict[str, Any]], record: Path) -> list[dict[str, Any]]:
    """The rows, and those of a record whose trainings are on another machine.

    Args:
        rows: of ``collect``.
        record: file of rows; need not be there.

    Raises:
        InputError: it holds others.
    """
    try:
        found = {_key(row): row for row in read_json(record, "results")} if record.exists() else {}
    except (KeyError, TypeError):
        raise InputError(
            f"results = {record.parent}: {record.name} there holds no rows of trainings, or those of an "
            "older version; move it away or set results to another folder"
        ) from None
    own = {_key(row) for row in rows}
    return sorted(
        [*rows, *(row for key, row in found.items() if key not in own)],
        key=lambda row: (row["experiment"], row["test"]["nmae"]),
    )


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    # The rows of an older version tell no overrides.
    return *(row[key] for key in _TRAINING), *row.get("overrides", ())


_TRAINING = ("experiment", "name", "recordings", "epochs", "window", "seed", "split_seed")
_TOLD = (
    "experiment", "model", "sensors", "joint", "name", "runs", "trainer.epochs", "windows.length",
    "seed", "seeds", "split_seed", "folder", "resume", *HARDWARE,
)  # fmt: skip
"""Overrides that the other columns of a row tell, or that do not change what is learnt."""


def _row(run: Path) -> dict[str, Any]:
    try:
        return _row_of(run)
    except (KeyError, TypeError, AttributeError):
        raise InputError(
            f"{run}: no training of clearance.train, or of an older version; set runs to another folder"
        ) from None


def _row_of(run: Path) -> dict[str, Any]:
    metrics, config = read_json(run / METRICS, "runs"), read_yaml(run / CONFIG, "runs") or {}
    fresh = [one["summary"] for one in read_fresh(run)]
    epochs = config["model"].get("training", {}).get("epochs")  # a forest has none
    source = config["data"]["source"]
    return {
        "name": config.get("name", run.name),
        # A training from before its configuration told has a folder named by it.
        "experiment": config.get("experiment", run.parent.name),
        "overrides": [one for one in config.get("overrides", ()) if set_key(one) not in _TOLD],
        "recordings": metrics["data"]["recordings"],
        "streamed": source["runs"] * (epochs or 1) if "held_out" in source else None,  # none seen twice
        "epochs": epochs,
        "window": config["windows"]["length"],
        "parameters": metrics["parameters"],
        "seed": metrics["seed"],
        "split_seed": metrics["split_seed"],
        "training_seconds": metrics["training_seconds"],
        "environment": metrics["environment"],
        "validation": metrics["validation"],
        "test": metrics["test"],
        "fresh": fresh,
    }


_HEAD = (
    "experiment",
    "model",
    "recordings",
    "epochs",
    "NMAE, window",
    "NRMSE, window",
    "95 % of errors below",
    "NMAE, recording",
    "interval holds",
    "training",
)


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as a Markdown table: errors on test recordings, coverage on freshly simulated ones."""
    lines = [_HEAD, ("---",) * len(_HEAD), *(_cells(row) for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    test, fresh = row["test"], row["fresh"]
    held = "{coverage:.1%} of {recordings} ({coverage_low:.1%}-{coverage_high:.1%})"
    return (
        row["experiment"],
        ", ".join([row["name"], *row.get("overrides", ())]),
        str(row["recordings"]),
        str(row["epochs"] or ""),
        f"{test['nmae']:.2f} %",
        f"{test['nrmse']:.2f} %",
        f"{test['p95_ae'] * 1e6:.1f} µm",
        f"{test['recording_nmae']:.2f} %",
        ", ".join(held.format(**joint) for joint in fresh) or "not measured",
        f"{row['training_seconds'] / 60:.1f} min, {hardware(row['environment'])}",
    )


def marks(name: str, command: str = "evaluate") -> tuple[str, str]:
    """The lines of a page between which the block ``name``, made by a command, belongs."""
    return f"<!-- {name}: made by python -m clearance.{command} -->", f"<!-- /{name} -->"


def put_between_marks(text: str, name: str, block: str, command: str = "evaluate") -> str:
    """Replace what stands between the marks of a block.

    Raises:
        InputError: if the marks are not there, one after the other.
    """
    begin, end = marks(name, command)
    head, _, rest = text.partition(begin)
    if end not in rest:
        raise InputError(
            f"readme lacks the lines {begin!r} and {end!r} in this order, between which the table belongs"
        )
    return f"{head}{begin}\n{block}{end}{rest.partition(end)[2]}"
