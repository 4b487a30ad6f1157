"""Numbers and names that a user wrote: used where they are within range, answered with one line if not."""

import math
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from numbers import Real

import numpy as np

from clearance.errors import InputError

MOST_SAMPLES = 100_000_000  # a column: 0.8 GB; a damaged header may claim anything


def bounded(value: object, key: str, low: float, high: float, unit: str = "") -> float:
    """Return `value` as a number in [low, high], or say which key to change.

    Text that reads as a number is accepted: YAML 1.1 takes `1e-3` (no dot) for text.
    """
    suffix = f" {unit}" if unit else ""
    allowed = f"give a number from {low:g} to {high:g}{suffix}"
    if isinstance(value, bool) or not isinstance(value, Real | str):
        raise InputError(f"{key}: {value!r} is not a number; {allowed}")
    try:
        number = float(value)
    except (ValueError, OverflowError):
        raise InputError(f"{key}: {value!r} is not a number; {allowed}") from None
    if not math.isfinite(number) or not low <= number <= high:
        raise InputError(f"{key}: {number:g}{suffix} is out of range; {allowed}")
    return number


def whole(value: object, key: str, least: int, most: int | None = None, null: bool = False) -> None:
    """Refuse what is no whole number in [least, most], nor null where that is allowed; 1e3 is none."""
    if null and value is None:
        return
    limit = math.inf if most is None else most
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= limit:
        allowed = f", {least} or more" if most is None else f" from {least} to {most}"
        instead = ", or null" if null else ""
        raise InputError(f"{key} = {value!r} is not a whole number{allowed}{instead}; change {key}")


def resembling(name: str, known: Iterable[str]) -> str:
    """Return `"; did you mean 'x'?"` for the nearest known name, or nothing where none is near."""
    near = get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"; did you mean {near[0]!r}?" if near else ""


def listing(names: Iterable[str], limit: int = 12) -> str:
    """Return the names on one line, the first `limit` of them and a count of the rest."""
    everything = [str(name) for name in names]
    shown = ", ".join(everything[:limit])
    return f"{shown} and {len(everything) - limit} more" if len(everything) > limit else shown or "none"


def require_single(single: np.ndarray, values: np.ndarray, channels: Sequence[str]) -> None:
    """Refuse samples that single precision, in which models compute, does not hold.

    Args:
        single: (samples, channels) in single precision.
        values: the same as they were.
        channels: their names.

    Raises:
        InputError: with the largest one.
    """
    lost = ~np.isfinite(single)
    if lost.any():
        sample, place = np.argwhere(lost)[0]
        raise InputError(
            f"{channels[place]}: {values[sample, place]:g}, in sample {sample}, is larger than any model "
            "reads (3.4e38 at most); repair the recording"
        )


def require_size(samples: int) -> None:
    """Refuse a column that no memory is meant to hold."""
    if samples > MOST_SAMPLES:
        raise InputError(f"{samples} samples are too many; at most {MOST_SAMPLES}, cut the file")


def shape_refusal(shape: tuple[int, ...] | None) -> str:
    """Return why an array of this shape is no column, or nothing if it is; MATLAB's vectors are."""
    if shape is None or sum(length > 1 for length in shape) != 1:
        return f"has shape {shape}, not one dimension with at least 2 samples"
    return ""
