"""The seal: truth in a folder of its own that only its owner reads, and a salted commitment to it.

The commitment is the SHA-256 of the sealed file, whose first entry is 32 random bytes: without the file it
tells nothing, and after the verdicts it shows that the truth was not changed to suit them.
"""

import hashlib
import json
import os
import secrets
from pathlib import Path
from typing import Any
from uuid import uuid4

from clearance.errors import InputError

TRUTH = "truth.json"


def digest(content: bytes) -> str:
    """SHA-256 in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def write_private(path: Path, content: Any) -> bytes:
    """Write plain data so that only the owner may read it, whole or not at all; returns the bytes."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    data = json.dumps(content, allow_nan=False).encode()
    temporary = path.with_name(f".{uuid4().hex}")
    try:
        with os.fdopen(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return data


def close(folder: Path, truth: dict[str, Any]) -> str:
    """Seal the truth and take away the right to look into its folder; returns the commitment."""
    data = write_private(folder / TRUTH, {"salt": secrets.token_hex(32), **truth})
    lock(folder)
    return digest(data)


def lock(folder: Path) -> None:
    """Nobody but a superuser looks into the folder until it is opened."""
    folder.chmod(0o000)


def unlock(folder: Path) -> None:
    """Let the owner into the folder again."""
    try:
        folder.chmod(0o700)
    except OSError as error:
        raise InputError(f"sealed = {folder}: {error.strerror}; set sealed to the truth's folder") from error


def open_seal(folder: Path, commitment: str) -> dict[str, Any]:
    """The truth; the folder is closed again.

    Args:
        folder: of the seal.
        commitment: published before the diagnoses.

    Raises:
        InputError: if there is none, or another one than was committed to.
    """
    unlock(folder)
    try:
        data = (folder / TRUTH).read_bytes()
    except OSError as error:
        raise InputError(f"{folder / TRUTH}: {error.strerror}; set sealed to the truth's folder") from error
    finally:
        lock(folder)
    found = digest(data)
    if found != commitment:
        raise InputError(
            f"{folder / TRUTH}: its SHA-256 {found[:16]}… is not the commitment {commitment[:16]}…: the "
            "truth was changed after it was sealed, and nothing is scored; set sealed to the original"
        )
    content: dict[str, Any] = json.loads(data)
    return content
