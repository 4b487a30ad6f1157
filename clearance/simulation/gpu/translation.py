"""The kernels' own source, compiled for CUDA: no law, step or filter is written a second time.

A function made by ``clearance.compilation`` remembers its Python source. Here that source is compiled once
more, with what it calls: other kernels likewise, and the few functions that know what lanes are
(``clearance.lanes``, ``clearance.mechanism.choice``) by those of a thread. The CPU's functions stay as they
are.
"""

from collections.abc import Callable, Iterator, Mapping
from types import CodeType, FunctionType
from typing import Any

from numba import cuda
from numba.core.dispatcher import Dispatcher

Replacements = Mapping[Callable[..., Any], Any]
"""Plain functions that a kernel calls, and device functions that a thread calls instead."""


def translate(kernel: Dispatcher, replacements: Replacements) -> Any:
    """The device function of a compiled function's source."""
    return _translate(kernel.py_func, replacements, {})


def _translate(source: Any, replacements: Replacements, known: dict[Any, Any]) -> Any:
    if source not in known:
        names = dict(source.__globals__)
        for name in set(_names(source.__code__)) & names.keys():
            value = names[name]
            if isinstance(value, Dispatcher):
                names[name] = _translate(value.py_func, replacements, known)
            elif isinstance(value, FunctionType) and value in replacements:
                names[name] = replacements[value]
        copy = FunctionType(source.__code__, names, source.__name__, source.__defaults__, source.__closure__)
        known[source] = cuda.jit(device=True)(copy)
    return known[source]


def _names(code: CodeType) -> Iterator[str]:
    """Names of globals and attributes that a function's code mentions."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)
