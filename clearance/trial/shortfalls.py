"""Everything in which a verdict falls short of what is wanted of it, a word each."""

from collections.abc import Iterator, Mapping
from typing import Any

from clearance.trial.case import UNNAMED

LIKE = 0.95
"""Correlation with the truth that is wanted of a force's curve."""
AT_FLOOR = 1.1
"""Times a perfect model's held-out errors that a corrected machine may leave."""


def shortfalls(row: Mapping[str, Any]) -> list[str]:
    """Why a verdict is wrong, and what of it is: place, curve, errors, intervals; empty of one without fault.

    Where something is missing below its detection threshold, a verdict that misses it is none.

    Args:
        row: of a score.
    """
    if row["why"] is not None and row["verdict"] is None:
        return [row["why"]]
    wrong = row["why"] is not None and (row["visible"] or row["verdict"] != "none")
    return [*([row["why"]] if wrong else []), *_of_place(row), *_of_errors(row), *_of_intervals(row)]


def _of_place(row: Mapping[str, Any]) -> Iterator[str]:
    if row["kind"] == "none" or not row["visible"]:
        return
    if row["body_right"] is False and row["kind"] not in UNNAMED:  # of those the verdict itself is wrong
        yield "on the wrong body"
    if row["body_right"] and row["direction_right"] is False:
        yield "in the wrong direction"
    likeness = row["curve_correlation"]
    if row["body_right"] and likeness is not None and likeness < LIKE:
        yield f"a curve that correlates by {likeness:.2f}" if likeness > 0.0 else "no curve"


def _of_errors(row: Mapping[str, Any]) -> Iterator[str]:
    held = row["held_out"]
    if held.get("after") is not None and held["after"] > AT_FLOOR * held["floor"]:
        yield f"a held-out error of {held['after'] / held['floor']:.3g} times the floor"
    if held.get("shares"):
        yield f"{min(held['shares'].values()):.0%} of a held-out recording followed"
    if row["left_over"] is not None and row["left_over"] > 1.0:
        yield f"{row['left_over']:.2f} times the threshold left over"
    if row["spurious"]:
        wrong = [name for name in row["named"] if name not in row["rightly"]]
        yield f"{' and '.join(wrong)} asserted, not there"


def _of_intervals(row: Mapping[str, Any]) -> Iterator[str]:
    missed = [f"{one['effect']}.{one['parameter']}" for one in row["parameters"] if not one["covered"]]
    if row["clearance"] and row["clearance"]["covered"] is False:
        missed.append("the clearance")
    if missed:
        yield f"{' and '.join(missed)} outside the interval"
