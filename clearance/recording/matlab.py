"""The numeric arrays of a MATLAB file of version 5 to 7 (since 7.3 it is an HDF5 file, see `tables.py`).

SciPy's reader of this format ends the process (segmentation fault) on some damaged files, and it builds
objects that a recording has no use for. Here only real numeric arrays are read, every length is checked
against the bytes there are.

Reference: The MathWorks, MAT-File Format, chapter 1 (Level 5).
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clearance.errors import InputError

_HEADER = 128  # bytes: text, version and byte order
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {1: "cell", 2: "struct", 3: "object", 4: "char", 5: "sparse", 16: "function", 17: "object"}
_NUMERIC = range(6, 16)  # double, single, and the integers
_COMPLEX, _LOGICAL = 0x0800, 0x0200
_BROKEN = "its lengths contradict each other"


@dataclass(frozen=True)
class Variable:
    """One variable: its name, its shape, and its numbers in the file's order, or why it has none."""

    name: str
    shape: tuple[int, ...]
    values: NDArray[np.float64] | None
    refusal: str = ""


def variables(content: bytes, largest: int) -> Iterator[Variable]:
    """Yield the variables of a file of version 5 to 7.

    Args:
        content: the whole file.
        largest: bytes that one variable may need; a damaged or hostile length claims more.
    """
    if not content.startswith(b"MATLAB 5.0 MAT") or len(content) < _HEADER:
        raise InputError("it does not begin as a MATLAB file of version 5 to 7.3; save it with -v7 or -v7.3")
    order = {b"IM": "<", b"MI": ">"}.get(content[_HEADER - 2 : _HEADER])
    if order is None:
        raise InputError("its byte order is not stated; check that the file is whole, or export it again")
    for kind, data in _elements(memoryview(content)[_HEADER:], order):
        if kind == _COMPRESSED:
            inflater = zlib.decompressobj()
            inflated = inflater.decompress(data, largest)
            if not inflater.eof:
                raise InputError(f"a variable in it is cut off, or larger than {largest} bytes")
            for inner, matrix in _elements(memoryview(inflated), order):
                if inner == _MATRIX:
                    yield _variable(matrix, order)
        elif kind == _MATRIX:
            yield _variable(data, order)


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of each element; short ones hold theirs in the tag."""
    start = 0
    while start < len(data):
        if len(data) - start < 8:
            raise InputError(_BROKEN)
        kind, length = struct.unpack_from(f"{order}II", data, start)
        begin = start + 8
        if kind >> 16:
            kind, length, begin = kind & 0xFFFF, kind >> 16, start + 4
            if length > 4:
                raise InputError(_BROKEN)
        end = begin + length
        if end > len(data):
            raise InputError("it is cut off: a variable is longer than the rest of the file")
        yield kind, data[begin:end]
        # Everything but compressed elements is padded to eight bytes.
        start = end if kind == _COMPRESSED else start + 8 * -(-(end - start) // 8)


def _variable(data: memoryview, order: str) -> Variable:
    parts = _elements(data, order)
    try:
        flags = int(_numbers(next(parts), order)[0])
        shape = tuple(int(length) for length in _numbers(next(parts), order))
        name = bytes(next(parts)[1]).decode("ascii")
        category = flags & 0xFF
        if category not in _NUMERIC:
            return Variable(name, shape, None, f"is a MATLAB {_CLASSES.get(category, 'object')}, not numbers")
        if flags & (_COMPLEX | _LOGICAL):
            return Variable(name, shape, None, "does not hold real numbers")
        values = _numbers(next(parts), order).astype(np.float64)
    except (StopIteration, IndexError):
        raise InputError(_BROKEN) from None
    # Exact integers: a product of damaged lengths overflows machine words.
    if min(shape, default=0) < 0 or int(np.prod(shape, dtype=object)) != len(values):
        raise InputError(f"variable {name!r} has shape {shape} but {len(values)} numbers")
    return Variable(name, shape, values)


def _numbers(element: tuple[int, memoryview], order: str) -> NDArray[np.generic]:
    kind, data = element
    if kind not in _NUMBERS:
        raise InputError(_BROKEN)
    return np.frombuffer(data, dtype=np.dtype(order + _NUMBERS[kind]))
