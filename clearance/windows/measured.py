"""Recordings of a real machine whose clearances are known, as a source to train on."""

import csv
import hashlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from clearance.errors import InputError
from clearance.recording.bounds import require_single
from clearance.recording.chain import declared_chain
from clearance.recording.correction import corrected
from clearance.recording.position import declared_positions, elsewhere
from clearance.recording.recording import SAME_RATE, Recording
from clearance.windows.sources import FixedSource, LabelledRecordings, check_memory

_LARGEST = 0.02  # m, of a clearance


@dataclass
class MeasuredSource(FixedSource):
    """Files of measured recordings and a list (YAML or CSV) of their known clearances.

    Each entry of the list has ``path`` (relative to the list), each target's name with the clearance in
    metres, and optionally ``speed`` [rad/s] and ``group``: recordings of one machine in one state share a
    group and are never split.
    """

    path: str
    read: Callable[[Path], Recording]  # clearance.recording.files.read

    def load(self, channels: Sequence[str], targets: Sequence[str], limit: int) -> LabelledRecordings:
        """Read every file of the list."""
        listed = Path(str(self.path))  # a name of digits alone is a number
        entries = _entries(listed)
        signals, rates, declared, places = [], [], [], []
        digest, used = hashlib.sha256(), 0
        for entry in entries:
            file = listed.parent / str(entry["path"])
            recording = self.read(file)
            try:
                values = corrected(recording, channels).values
                with np.errstate(over="ignore"):
                    signals.append(values.astype(np.float32))
                require_single(signals[-1], values, channels)
                declared_chain(said := recording.metadata.get("chain"))
                declared.append(said)
                places.append(declared_positions(recording))
            except InputError as error:
                raise InputError(f"{file}: {error}") from error
            rates.append(recording.rate)
            used += signals[-1].nbytes
            check_memory(used, limit)
            digest.update(signals[-1].tobytes())
        rate = float(np.median(rates))
        if max(abs(one / rate - 1) for one in rates) > SAME_RATE:
            raise InputError(
                f"{self.path}: recordings at {sorted(set(rates))} Hz: one common rate is needed (within "
                f"{SAME_RATE:.1%}); set data.source.path"
            )
        chains = [declared_chain(said, rate) for said in declared]
        other = next((chain for chain in chains if chain != chains[0]), None)
        if other:
            raise InputError(
                f"{self.path}: recordings with different chains ({chains[0]} and {other}): one common "
                "chain is needed; set data.source.path"
            )
        clearances = np.array([[_number(entry, name, self.path) for name in targets] for entry in entries])
        names = [_group(entry, number) for number, entry in enumerate(entries)]
        own = [{name: place for name, place in one.items() if name in channels} for one in places]
        digest.update(clearances.tobytes() + repr((names, rates, chains, own)).encode())
        lengths = np.array([len(one) for one in signals])
        return LabelledRecordings(
            channels=tuple(channels),
            rate=rate,
            signals=_joined(signals),
            lengths=lengths,
            target=clearances,
            speed=np.array([_speed(entry, self.path) for entry in entries]),
            groups=np.unique(names, return_inverse=True)[1],
            fingerprint=digest.hexdigest(),
            chain=chains[0],
            positions=_common(places, self.path),
        )


def _joined(signals: list[np.ndarray]) -> np.ndarray:
    """One recording behind the other, (samples, channels); empties the list, so that no two copies exist."""
    whole = np.empty((sum(map(len, signals)), signals[0].shape[1]), dtype=np.float32)
    end = len(whole)
    while signals:
        last = signals.pop()
        whole[end - len(last) : end] = last
        end -= len(last)
    return whole


def _common(places: Sequence[Mapping[str, float]], path: str) -> dict[str, float]:
    """Where every recording declares its accelerometers."""
    known: dict[str, float] = {}
    for own in places:
        if moved := elsewhere(own, known):
            raise InputError(
                f"{path}: recordings with sensor {moved[0]} at {known[moved[0]]:g} m and at "
                f"{own[moved[0]]:g} m: one common place is needed; set data.source.path"
            )
        known |= own
    return {name: place for name, place in known.items() if all(name in own for own in places)}


def _entries(path: Path) -> list[dict[str, Any]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        entries = _rows(text) if path.suffix.lower() == ".csv" else yaml.safe_load(text)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(
            f"{path}: not a readable list of recordings ({error}); set data.source.path"
        ) from error
    if not (
        isinstance(entries, list) and entries and all(isinstance(e, dict) and e.get("path") for e in entries)
    ):
        raise InputError(f"{path}: must be a list of entries, each with a path; set data.source.path")
    name, times = Counter((path.parent / str(entry["path"])).resolve() for entry in entries).most_common(1)[0]
    if times > 1:
        raise InputError(
            f"{path}: {name.name} occurs {times} times: a model might be tested on what it was trained on; "
            "leave one entry in the list"
        )
    return entries


def _rows(text: str) -> list[dict[str, Any]]:
    """Rows of a table with commas, semicolons or tabs between its columns."""
    lines = text.splitlines()
    header = lines[0] if lines else ""
    rows = csv.DictReader(lines, delimiter=max(",;\t", key=header.count))
    return [
        {str(name).strip(): value.strip() if isinstance(value, str) else value for name, value in row.items()}
        for row in rows
    ]


def _float(given: Any) -> float:
    """A number, which in a table may have a comma as its decimal mark."""
    return float(given.replace(",", ".") if isinstance(given, str) else given)


def _group(entry: dict[str, Any], number: int) -> str:
    """What must not be split: a group of the list, which may be 0, or the entry alone."""
    group = entry.get("group")
    return f"alone {number}" if group in (None, "") else f"group {group}"


def _speed(entry: dict[str, Any], path: str) -> float:
    """Nominal speed [rad/s]; no number where none is given."""
    given = entry.get("speed")
    try:
        return float("nan") if given in (None, "") else _float(given)
    except (TypeError, ValueError):
        raise InputError(
            f"{path}: {entry['path']} has speed={given!r}: must be a number [rad/s]; correct the list"
        ) from None


def _number(entry: dict[str, Any], key: str, path: str) -> float:
    try:
        value = _float(entry[key])
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path}: {entry['path']} has no number {key} [m]; add it to the list") from None
    if not 0.0 <= value <= _LARGEST:
        raise InputError(
            f"{path}: {entry['path']} has {key}={value}: must be 0 ... {_LARGEST} m (not mm); correct "
            "the list"
        )
    return value
