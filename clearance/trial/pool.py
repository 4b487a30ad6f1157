"""Trials that were revealed, added up: cases of several machines or nights, each sealed on its own."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from clearance.errors import InputError
from clearance.whole_files import read_json

_FACTS = ("seed", "date", "cases", "commitment", "verdicts", "asked")


def pool(results: Sequence[Path]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The rows of several trials, each named by its seed too.

    Args:
        results: of trials, as they are written beside their verdicts (``result.json``) or published.

    Returns:
        ``trials``, the facts of each (seed, date, commitment, hash of its verdicts, what was asked), and the
        ``scope`` that they share but for the number of cases; and the rows.

    Raises:
        InputError: if there is nothing to add, a file is no result with rows, a trial comes twice, or cases
            were drawn or asked in another way.
    """
    found = [read_json(path, "pooled") for path in results]
    if not found:
        raise InputError("pooled = []: there is nothing to add up; list results of trials, pooled=[A,B]")
    for path, one in zip(results, found, strict=True):
        _require_whole(path, one)
    for path, one in zip(results, found, strict=True):
        if [other["seed"] for other in found].count(one["seed"]) > 1:  # concealed again it has another seal
            raise InputError(f"{path}: the trial of seed {one['seed']} comes twice; change pooled")
        if _drawing(one) != _drawing(found[0]):
            raise InputError(
                f"{path}: its cases were drawn in another way than those of {results[0]}, so that no rate "
                "over both has a meaning; change pooled"
            )
        if _asking(one) != _asking(found[0]):
            raise InputError(
                f"{path}: another program, or with another limit of time, was put to the test than in "
                f"{results[0]}, so that no rate over both has a meaning; change pooled"
            )
    trials = [{key: one[key] for key in _FACTS} for one in found]
    rows = [row | {"name": f"{one['seed']}/{row['name']}"} for one in found for row in one["rows"]]
    return {"trials": trials, "scope": _drawing(found[0])}, rows


def _require_whole(path: Path, one: dict[str, Any]) -> None:
    if "trials" in one:
        raise InputError(f"{path}: is a sum of trials already; list theirs in pooled")
    lacking = [key for key in (*_FACTS, "scope", "rows") if key not in one]
    if lacking:
        raise InputError(
            f"{path}: has no {lacking[0]}, as results of older versions; reveal that trial again, or leave "
            "it out of pooled"
        )
    old = [row["name"] for row in one["rows"] if row["verdict"] is not None and "rightly" not in row]
    if old:
        raise InputError(
            f"{path}: {old[0]} does not say what was rightly named, as rows of older versions; reveal that "
            "trial again, or leave it out of pooled"
        )


def _asking(one: dict[str, Any]) -> set[tuple[str, float]]:
    """What was put to the test, and its limits of time [s], whatever its version."""
    return {(each["program"], each["time_limit"]) for each in one["asked"]}


def _drawing(one: dict[str, Any]) -> dict[str, Any]:
    """How cases are drawn, whatever their number."""
    return {key: value for key, value in one["scope"].items() if key != "cases"}
