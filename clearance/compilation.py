"""How the numerical kernels are compiled: one place for the options, and a disk cache that cannot go stale.

``kernel`` marks a piece that is inlined into its caller; ``entry`` marks what Python calls. Numba's own cache
looks only at the file of the entry itself, so a changed law would go unnoticed: here the cache folder carries
a digest of every kernel source.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba import njit

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}  # a*b+c may fuse; no reordering


def _cache_folder() -> Path:
    package = Path(__file__).parent
    digest = hashlib.sha256(numba.__version__.encode())
    sources = [package / "lanes.py", package / "compilation.py"]
    for folder in ("mechanism", "simulation", "diagnosis/kinematics"):
        sources += package.glob(f"{folder}/**/*.py")
    for source in sorted(sources):
        digest.update(source.read_bytes())
    root = os.environ.get("CLEARANCE_CACHE") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "clearance" / f"kernels-{digest.hexdigest()[:16]}"


_CACHE_FOLDER = str(_cache_folder())


def kernel(function: Callable[..., Any]) -> Any:
    """A compiled function that is inlined wherever another kernel calls it."""
    return njit(forceinline=True, **_OPTIONS)(function)


def subroutine(function: Callable[..., Any]) -> Any:
    """A compiled function that other kernels call: for long bodies with more than one caller."""
    return njit(**_OPTIONS)(function)


def entry(function: Callable[..., Any]) -> Any:
    """A compiled function that Python calls: cached on disk, releases the interpreter lock."""
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = _CACHE_FOLDER  # type: ignore[attr-defined]  # read while the cache is made
    try:
        return njit(cache=True, nogil=True, **_OPTIONS)(function)
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]
