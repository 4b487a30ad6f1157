"""Read a recording from a user's file (with an optional YAML beside it), write one as Parquet.

What the YAML may say is in `declaration.py`, what the formats may hold in `tables.py`. A file that this
module wrote reads back exactly: values, rate, start and metadata. Writing is atomic: the file is there whole,
or not at all.
"""

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import date, datetime
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from clearance.errors import InputError
from clearance.recording.bounds import listing, resembling
from clearance.recording.channels import CHANNELS, TIME, si_factor, si_unit
from clearance.recording.declaration import Declaration, read_declaration, require_chain
from clearance.recording.recording import SAME_RATE, Recording
from clearance.recording.tables import FORMATS, Table, read_table
from clearance.recording.timing import TimeBase, uniform_time_base
from clearance.whole_files import write_atomically

_FORMAT_VERSION = 1


def read(path: str | os.PathLike[str]) -> Recording:
    """Return the recording in a Parquet, CSV, HDF5 or MATLAB file.

    Channels keep the order of the file. Declared sensors and chain are kept in the metadata, under `sensors`
    and `chain`; they describe the values and do not change them.

    Raises:
        InputError: one line with the path, what is wrong, and what to change.
    """
    source = Path(path)
    _require_readable(source)
    declaration = read_declaration(source)
    try:
        # What overflows is not finite, and is reported as such.
        with np.errstate(all="ignore"):
            return _assemble(read_table(source), declaration)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error.__cause__


def write(
    recording: Recording, path: str | os.PathLike[str], precision: Literal["float64", "float32"] = "float64"
) -> None:
    """Write a recording as Parquet: time first, units in the fields, rate and metadata in the schema.

    Args:
        recording: what to write. Its metadata must be expressible in JSON; tuples come back as lists.
        path: where to; an existing file is replaced, whole.
        precision: of the channels; time stays float64.
    """
    target = Path(path)
    if target.suffix.lower() != ".parquet":
        raise InputError(f"{target}: recordings are written as Parquet; give a name that ends in .parquet")
    if precision not in ("float64", "float32"):
        raise InputError(f"precision: {precision!r} is not known; choose float64 or float32")
    content = _serialised(recording, precision)
    write_atomically(target, lambda file: file.write_bytes(content))


def recordings_in(folder: Path, key: str) -> list[Path]:
    """Return the recordings in a folder, by name; hidden files are some program's own.

    Raises:
        InputError: it has none; `key` is what named the folder.
    """
    inside = sorted(file for file in folder.iterdir() if file.suffix.lower() in FORMATS)
    found = [file for file in inside if file.is_file() and not file.name.startswith(".")]
    if not found:
        raise InputError(f"{key}: no recording in the folder {folder}; recordings end in {listing(FORMATS)}")
    return found


def _require_readable(source: Path) -> None:
    if source.is_dir():
        raise InputError(f"{source}: is a folder; name a file in it that ends in {listing(FORMATS)}")
    if source.suffix.lower() not in FORMATS:
        raise InputError(
            f"{source}: the ending {source.suffix!r} is not known; recordings end in {listing(FORMATS)}"
        )
    if source.is_file():
        return
    if not source.parent.is_dir():
        raise InputError(f"{source}: there is no folder {source.parent}; correct the path")
    present = sorted(entry.name for entry in source.parent.iterdir() if entry.suffix.lower() in FORMATS)
    near = get_close_matches(source.name, present, n=3) or present
    raise InputError(f"{source}: there is no such file; the folder has {listing(near, 5)}")


def _assemble(table: Table, declaration: Declaration) -> Recording:
    found = _match(table, declaration)
    lengths = {name: len(table.columns[theirs]) for name, theirs in found.items()}
    if len(set(lengths.values())) > 1:
        shown = listing(f"{name} {length}" for name, length in lengths.items())
        raise InputError(f"the columns differ in length ({shown}); export them with one length")
    factors = {name: _factor(name, theirs, table, declaration) for name, theirs in found.items()}
    header = _own_header(table)
    stamps = table.columns[found[TIME]] if TIME in found else None
    base = _time_base(stamps, factors.get(TIME, 1.0), declaration, header)
    channels = tuple(name for name in found if name != TIME)
    values = np.empty((lengths[channels[0]], len(channels)))
    for column, name in enumerate(channels):
        np.multiply(table.columns[found[name]], factors[name], out=values[:, column])
    metadata = {**header.get("metadata", {}), **declaration.metadata}
    if declaration.sensors:  # of each what the YAML says, else what the file itself does
        own = metadata.get("sensors", {})
        said = {name: {**own.get(name, {}), **entry} for name, entry in declaration.sensors.items()}
        metadata["sensors"] = {**own, **said}
    if declaration.chain:
        metadata["chain"] = _consistent_chain({**metadata.get("chain", {}), **declaration.chain}, base.rate)
    return Recording(values, channels, base.rate, base.start_time, metadata)


def _match(table: Table, declaration: Declaration) -> dict[str, str]:
    """Return which column each channel (and time) is in; every other column must be ignored on purpose."""
    everything = [*table.columns, *table.refused]
    found: dict[str, str] = {}
    unknown: list[str] = []
    used: set[str] = set()
    last_parts = Counter(_last_part(theirs) for theirs in everything)
    for theirs in everything:
        names = [theirs]
        if not table.strict:  # a tree: the path, and its last part where only one has it
            names += [f"/{theirs}", *([_last_part(theirs)] if last_parts[_last_part(theirs)] == 1 else [])]
        mapped = [name for name in names if name in declaration.columns]
        used.update(mapped)
        if not mapped and any(name in declaration.ignore for name in names):
            continue
        known = [name for name in names if name == TIME or name in CHANNELS]
        channel = declaration.columns[mapped[0]] if mapped else next(iter(known), None)
        if channel is None:
            if table.strict or theirs in table.columns:
                unknown.append(theirs)
            continue
        if theirs in table.refused:
            raise InputError(f"column {theirs!r} {table.refused[theirs]}")
        if channel in found:
            raise InputError(
                f"columns {found[channel]!r} and {theirs!r} are both {channel}; put one under `ignore:` in "
                f"{declaration.name}"
            )
        found[channel] = theirs
    absent = [name for name in declaration.columns if name not in used]
    if absent:
        raise InputError(
            f"{declaration.name} maps the column {absent[0]!r}, but the file has {listing(everything)}"
        )
    if unknown:
        raise InputError(_unknown_columns(unknown, declaration))
    for key in ("units", "scale"):
        idle = [name for name in getattr(declaration, key) if name not in found]
        if idle:
            raise InputError(
                f"{key}.{idle[0]} in {declaration.name}: the file has no {idle[0]}, only {listing(found)}; "
                f"correct {key}"
            )
    if not set(found) - {TIME}:
        raise InputError(
            f"no channel in it, only {listing(everything)}; name the columns under `columns:` in "
            f"{declaration.name}"
        )
    return found


def _last_part(name: str) -> str:
    return name.rsplit("/", 1)[-1]


def _unknown_columns(unknown: list[str], declaration: Declaration) -> str:
    hint = resembling(_last_part(unknown[0]), [*CHANNELS, TIME])
    shown = listing(name or "''" for name in unknown)
    return (
        f"columns {shown} are no channels (or share their last name){hint}; in {declaration.name} "
        f'name them under `columns:` ("{unknown[0]}": CHANNEL) or list them under `ignore:`; channels are '
        f"{listing([TIME, *CHANNELS], len(CHANNELS) + 1)}"
    )


def _factor(channel: str, theirs: str, table: Table, declaration: Declaration) -> float:
    if channel in declaration.units:
        unit, where = declaration.units[channel], f"units.{channel} in {declaration.name}"
    else:
        unit, where = table.units.get(theirs, si_unit(channel)), f"unit of column {theirs!r}"
    return si_factor(unit, channel, where) * declaration.scale.get(channel, 1.0)


def _own_header(table: Table) -> dict[str, Any]:
    """Return what `write` left in the file; a header that it could not have left is a damaged file."""
    if table.header is None:
        return {}
    try:
        header = json.loads(table.header)
        metadata = {str(key): value for key, value in header["metadata"].items()}
        for key in ("sensors", "chain"):
            if not isinstance(metadata.get(key, {}), dict):
                raise TypeError(key)
        if not all(isinstance(entry, dict) for entry in metadata.get("sensors", {}).values()):
            raise TypeError("sensors")
        require_chain(metadata.get("chain", {}))
        return {
            "rate": float(header["rate"]),
            "start_time": float(header["start_time"]),
            "metadata": metadata,
        }
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(
            "the header under 'clearance' in its schema is damaged; write the file again"
        ) from error


def _time_base(
    stamps: NDArray[np.float64] | None, unit: float, declaration: Declaration, header: Mapping[str, Any]
) -> TimeBase:
    if stamps is None:
        if declaration.rate is None:
            raise InputError(
                "neither a column 'time' nor a rate; give `rate:` in Hz, or `columns:` with time, in "
                f"{declaration.name}"
            )
        return TimeBase(declaration.rate, 0.0)
    if header and declaration.rate is None and header["rate"] > 0.0:
        # Rows may have been cut since: the header stands only while the stamps are those it makes.
        made = header["start_time"] + np.arange(len(stamps)) / header["rate"]
        if np.array_equal(stamps * unit, made):
            return TimeBase(header["rate"], header["start_time"])
    return uniform_time_base(stamps, unit, declaration.rate)


def _consistent_chain(chain: Mapping[str, float], rate: float) -> dict[str, float]:
    if "base_rate" in chain:
        delivered = chain["base_rate"] / chain.get("decimation", max(1, round(chain["base_rate"] / rate)))
        if abs(delivered - rate) > SAME_RATE * rate:  # one clock is declared, the other measured
            raise InputError(
                f"chain: base_rate / decimation is {delivered:g} Hz, the recording has {rate:g} Hz; "
                "correct chain.base_rate or chain.decimation"
            )
    return dict(chain)


def _serialised(recording: Recording, precision: str) -> memoryview:
    header = {
        "format": _FORMAT_VERSION,
        "rate": recording.rate,
        "start_time": recording.start_time,
        "metadata": _plain(recording.metadata, "metadata"),
    }
    kind = pa.from_numpy_dtype(np.dtype(precision))
    fields = [pa.field(TIME, pa.float64(), metadata={"unit": "s"})]
    fields += [pa.field(name, kind, metadata={"unit": si_unit(name)}) for name in recording.channels]
    columns = [recording.time, *(column.astype(precision) for column in recording.values.T)]
    schema = pa.schema(fields, metadata={"clearance": json.dumps(header)})
    sink = pa.BufferOutputStream()
    # Signals hardly repeat: a dictionary would only cost time.
    pq.write_table(
        pa.table(columns, schema=schema),
        sink,
        compression="zstd",
        use_dictionary=False,
        write_page_checksum=True,
    )
    return memoryview(sink.getvalue())


def _plain(value: Any, key: str) -> Any:
    """Return `value` in JSON's own types."""
    if isinstance(value, np.generic | np.ndarray):
        return _plain(value.tolist(), key)
    if isinstance(value, Mapping):
        return {str(name): _plain(entry, f"{key}.{name}") for name, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_plain(entry, f"{key}[{index}]") for index, entry in enumerate(value)]
    if isinstance(value, date | datetime | Path):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InputError(
        f"{key}: {type(value).__name__} cannot be written; give numbers, text, lists or mappings"
    )
