"""The one-dimensional datasets of an HDF5 file, read in a process of their own.

The HDF5 library writes beyond its buffers on some damaged files: of files with a few bytes changed at random
a rare one crashes it. In a child process that ends the child and not the caller, whose memory stays as it is.
It costs the start of a Python process for each file.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clearance.errors import InputError
from clearance.processes import environment
from clearance.recording.bounds import require_size, shape_refusal

SIGNATURE = b"\x89HDF\r\n\x1a\n"
_PATIENCE = 600.0  # s: damaged lists may lead in circles
_CHILD = "from clearance.recording.hdf5 import answer; answer()"
_LENGTH = 8  # bytes that say how long the description is
_MATLAB_NUMBERS = {b"double", b"single"} | {
    b"%sint%d" % (sign, bits) for sign in (b"", b"u") for bits in (8, 16, 32, 64)
}


@dataclass(frozen=True)
class Datasets:
    """Path in the file to numbers, to the reason why there are none, and to the unit that it states."""

    columns: Mapping[str, NDArray[np.float64]]
    refused: Mapping[str, str]
    units: Mapping[str, str]


def datasets(path: Path) -> Datasets:
    """Return the datasets of a file; a child process reads them."""
    try:
        # -P: the current folder is the user's, not a place to import from.
        child = subprocess.run(
            [sys.executable, "-P", "-c", _CHILD, os.fspath(path.resolve())],
            capture_output=True,
            env=environment(),
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"not readable as HDF5 (no end after {_PATIENCE:g} s); export it again") from None
    if child.returncode == -signal.SIGKILL:
        raise InputError("not readable as HDF5 (memory ran out); export fewer datasets, or shorter ones")
    if child.returncode != 0:
        reason = f"the HDF5 library stopped with {child.returncode}"
        raise InputError(f"not readable as HDF5 ({reason}); the file is damaged, export it again")
    return _unpacked(child.stdout)


def _unpacked(reply: bytes) -> Datasets:
    start = _LENGTH + int.from_bytes(reply[:_LENGTH], "little")
    description = json.loads(reply[_LENGTH:start])
    if "error" in description:
        raise InputError(description["error"])
    columns = {}
    for name, samples in description["samples"].items():
        columns[name] = np.frombuffer(reply, dtype=np.float64, count=samples, offset=start)
        start += 8 * samples
    return Datasets(columns, description["refused"], description["units"])


def answer() -> None:
    """Read the file that the command line names and reply on standard output; what the child process runs."""
    columns: dict[str, NDArray[np.float64]] = {}
    try:
        found = _collect(sys.argv[1])
        columns = dict(found.columns)
        samples = {name: len(values) for name, values in columns.items()}
        description: dict[str, Any] = {"samples": samples, "refused": found.refused, "units": found.units}
    except InputError as error:
        description = {"error": str(error)}
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        description = {"error": f"not readable as HDF5 ({reason}); check that the file is whole"}
    text = json.dumps(description).encode()
    out = sys.stdout.buffer
    out.write(len(text).to_bytes(_LENGTH, "little") + text)
    for values in columns.values():
        out.write(values.tobytes())
    out.flush()


def _collect(path: str) -> Datasets:
    # Only here: the caller's process never loads the library.
    import h5py

    columns: dict[str, NDArray[np.float64]] = {}
    refused: dict[str, str] = {}
    units: dict[str, str] = {}

    def refusal(node: Any) -> str:
        if node.dtype.kind not in "fiu" or node.attrs.get("MATLAB_class", b"double") not in _MATLAB_NUMBERS:
            return "does not hold plain numbers"
        if node.is_virtual or node.external:
            return "keeps its data in another file"
        return shape_refusal(node.shape)

    def visit(name: str, node: Any) -> None:
        # MATLAB keeps the contents of its cells and strings under #refs#.
        if not isinstance(node, h5py.Dataset) or name.startswith("#"):
            return
        reason = refusal(node)
        if reason:
            refused[name] = reason
            return
        require_size(node.size)
        columns[name] = np.asarray(node[()], dtype=np.float64).reshape(-1)
        stated = node.attrs.get("unit", node.attrs.get("units"))
        if isinstance(stated, np.ndarray) and stated.size == 1:  # as some writers store a text
            stated = stated.reshape(-1)[0]
        if isinstance(stated, str | bytes):
            units[name] = stated.decode() if isinstance(stated, bytes) else str(stated)

    with h5py.File(path, "r") as file:
        file.visititems(visit)  # follows neither soft nor external links
    return Datasets(columns, refused, units)
