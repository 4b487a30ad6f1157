"""What lanes are in a GPU's thread: one, a number; its arrays have a single column.

Each function stands for that of the same name in ``clearance.lanes``. A member of an enumeration becomes a
number where an array is indexed: Numba's CUDA arrays take nothing else.
"""

import math
from collections.abc import Callable
from typing import Any

from numba import cuda

from clearance import lanes
from clearance.mechanism import choice
from clearance.simulation.gpu.translation import Replacements

_INTEGERS_FROM = 6755399441055744.0  # 1.5 * 2**52: doubles of this size are whole


def get(array: Any, row: int) -> float:
    """Row ``row`` of a (rows, 1) array."""
    return array[row + 0, 0]


def put(array: Any, row: int, value: float) -> None:
    """Store ``value`` in row ``row``."""
    array[row + 0, 0] = value


def where(condition: bool, a: float, b: float) -> float:
    """``a`` where the condition holds, else ``b``."""
    return a if condition else b


def any_lane(condition: bool) -> bool:
    """Whether the condition holds."""
    return condition


def zero(like: float) -> float:
    """Zero."""
    return 0.0


def square_root(x: float) -> float:
    """Square root."""
    return math.sqrt(x)


def absolute(x: float) -> float:
    """Magnitude."""
    return math.fabs(x)


def nearest_integer(x: float) -> float:
    """Nearest integer, ties to even, for ``|x|`` below 2**51: what the sum has no room for is rounded."""
    return (x + _INTEGERS_FROM) - _INTEGERS_FROM


def arcsine(x: float) -> float:
    """Angle of a sine, in [-pi/2, pi/2]."""
    return math.asin(x)


def exponential(x: float) -> float:
    """The exponential function."""
    return math.exp(x)


def logarithm(x: float) -> float:
    """The natural logarithm."""
    return math.log(x)


_OF_LANES: tuple[Callable[..., Any], ...] = (
    get, put, where, any_lane, zero, square_root, absolute, nearest_integer, arcsine, exponential, logarithm,
)  # fmt: skip


def of_thread(codes: tuple[int, ...]) -> Replacements:
    """Device functions for all that kernels know of lanes, and for one choice of laws as constants."""

    def chosen(_: Any, family: int) -> int:
        return codes[family + 0]

    device = cuda.jit(device=True)
    return {choice.chosen: device(chosen)} | {
        getattr(lanes, function.__name__): device(function) for function in _OF_LANES
    }
