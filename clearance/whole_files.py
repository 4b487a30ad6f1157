"""Files of plain data that are written whole or not at all."""

import contextlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

import yaml

from clearance.errors import InputError


def write_atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """Let ``write`` fill a neighbour of ``path``, then rename it: readers see the old file or the new one.

    Both are on the disk when this returns: a loss of power after it loses nothing.

    Raises:
        InputError: the disk is full, or the folder is missing or not to be written to.
    """
    temporary = path.with_name(f".{path.stem}.{uuid4().hex}{path.suffix}")
    try:
        write(temporary)
        _on_disk(temporary)
        temporary.replace(path)
        _on_disk(path.parent)
    except OSError as error:
        raise InputError(
            f"{path}: not written ({error.strerror or error}); make room or name another folder"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def _on_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_json(path: Path, content: Any) -> None:
    """Write plain data atomically; NaN and infinity are refused, since JSON has neither."""
    text = json.dumps(content, indent=1, allow_nan=False)
    write_atomically(path, lambda file: file.write_text(text + "\n", encoding="utf-8"))


def write_yaml(path: Path, content: Mapping[str, Any], comment: str = "") -> None:
    """Write plain data atomically in the order it is in, below the lines of a comment."""
    lines = [f"# {line}\n" for line in comment.splitlines()]
    text = "".join(lines) + yaml.safe_dump(content, sort_keys=False)
    write_atomically(path, lambda file: file.write_text(text, encoding="utf-8"))


def read_json(path: Path, key: str = "checkpoint") -> Any:
    """Read plain data; a missing or foreign file is the user's error, to be mended by a configuration key."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a readable file of a run ({error}); set {key}") from error


def read_yaml(path: Path, key: str = "checkpoint") -> dict[str, Any] | None:
    """Read a configuration; None where there is none. One that cannot be read is mended by a key's value."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InputError(f"{path}: not a readable configuration ({error}); set {key}") from error
    return content if isinstance(content, dict) else None
