"""What an earlier run has found on the same recordings, in a folder, so that it need not be found again.

A search is the same each time: what it finds follows from the recordings, the settings and what was found
before. A find is therefore known by its place in that history. A run that was killed, or stopped by its time
limit, goes on from there; another program, recording or setting begins anew. The files hold numbers alone.
"""

import contextlib
import hashlib
import os
import re
import zipfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import clearance
from clearance.errors import InputError
from clearance.provenance import fingerprint
from clearance.whole_files import write_atomically

_KEPT = 30  # diagnoses whose finds stay in a folder, of about a MiB each
_NAME = re.compile("[0-9a-f]{16}")  # of a diagnosis' folder
_PROGRAM = (  # what a find depends on
    *(f"{package}/**/*.py" for package in ("diagnosis", "mechanism", "recording", "simulation")),
    "lanes.py",
    "compilation.py",
)
Found = TypeVar("Found")
Arrays = Mapping[str, np.ndarray]


class Kept:
    """What one search finds, in a folder.

    Args:
        folder: for the files; ``None``: nothing is kept.
        report: called where they cannot be kept.
    """

    def __init__(self, folder: Path | None, report: Callable[[str], None]) -> None:
        self.folder, self.report = folder, report
        self._history = hashlib.sha256()
        if folder is not None:
            _make_room(folder)

    def stop(self) -> None:
        """Keep nothing from here on: what a search does once it is late is no part of one that goes on."""
        self.folder = None

    def recall(
        self,
        label: str,
        make: Callable[[], Found | None],
        pack: Callable[[Found], Arrays],
        unpack: Callable[[Arrays], Found],
    ) -> Found | None:
        """What ``make`` returns, or returned at this place of the history; an empty file is ``None``."""
        self._history.update(f"{label}\n".encode())
        if self.folder is None:
            return make()
        path = self.folder / f"{self._history.hexdigest()[:24]}.npz"
        kept = _read(path)
        if kept is not None:
            return unpack(kept) if kept else None
        found = make()
        if self.folder is None:  # what time has cut short is not what another run would find
            return found
        packed = {} if found is None else pack(found)
        try:
            write_atomically(path, lambda file: np.savez(file, **packed))  # type: ignore[arg-type]
        except InputError as error:
            self.report(f"fits are not kept for another run: {error}")
            self.stop()
        return found


def folder_in(root: Path, known: Mapping[str, Any]) -> Path:
    """The folder in ``root`` for one search, named by the program and all else that its finds depend on."""
    return root / fingerprint({"program": _program(), **known})


@cache
def _program() -> str:
    """SHA-256 of the source that fits depend on."""
    content, package = hashlib.sha256(), Path(clearance.__file__).parent
    for path in sorted(p for pattern in _PROGRAM for p in package.glob(pattern)):
        content.update(path.read_bytes())
    return content.hexdigest()


def _make_room(folder: Path) -> None:
    """Make the folder; of those like it beside it only the newest stay. Nothing else is touched there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)  # an old one that is in use again is no longer old
        alike = [p for p in folder.parent.iterdir() if _NAME.fullmatch(p.name) and p.is_dir()]
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror or error}); change finished") from error
    for outdated in sorted(alike, key=_age)[:-_KEPT]:
        with contextlib.suppress(OSError):  # another run may be at it, or it holds what is not ours
            for file in outdated.glob("*.npz"):
                file.unlink()
            outdated.rmdir()


def _age(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except OSError:  # another run has just removed it
        return 0.0


def _read(path: Path) -> dict[str, np.ndarray] | None:
    """The arrays of a file, or ``None`` where there is none that can be read."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return dict(arrays)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return None
