"""Columns of numbers out of the users' file formats, before anything is known about them.

Parquet, CSV, HDF5 and MATLAB files become one `Table`. Only plain numbers are read: no pickles, no objects,
no links to other files, and nothing in a file is executed. Whatever a library raises becomes one line.
"""

import csv
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from clearance.errors import InputError
from clearance.recording.bounds import MOST_SAMPLES, listing, require_size, shape_refusal
from clearance.recording.hdf5 import SIGNATURE, datasets
from clearance.recording.matlab import variables

HEADER_BYTES = 2**20
MATLAB_BLOCK = 512


@dataclass(frozen=True)
class Table:
    """The columns of a file.

    Attributes:
        columns: name (in HDF5 the full path) to (samples,) numbers.
        refused: name to the reason why a column is not numbers.
        strict: every column must be a channel or be ignored; files that are trees may hold anything else.
        units: name to the unit that the file itself states.
        header: the text that this project's own writer left in the file, if any.
    """

    columns: Mapping[str, NDArray[np.float64]]
    refused: Mapping[str, str]
    strict: bool
    units: Mapping[str, str] = field(default_factory=dict)
    header: bytes | None = None


def read_table(path: Path) -> Table:
    """Return the columns of a file; its name's ending says the format."""
    label, reader = FORMATS[path.suffix.lower()]
    with _one_line(label):
        if path.stat().st_size == 0:
            raise InputError("the file is empty; export it again")
        return reader(path)


@contextmanager
def _one_line(label: str) -> Iterator[None]:
    """Turn whatever a library makes of a damaged or foreign file into one line."""
    try:
        # Libraries warn and go on where a file contradicts itself; here that is an error.
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", DeprecationWarning)
            yield
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(
            f"not readable as {label} ({reason}); check that the file is whole, or export it again"
        ) from error


def read_parquet(path: Path) -> Table:
    """Return the columns of a Parquet file; a field's metadata may state its unit."""
    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        require_size(file.metadata.num_rows)
        schema = file.schema_arrow
        names = [entry.name for entry in schema]
        _require_distinct(names)
        refused = {
            entry.name: f"holds {entry.type}, not numbers" for entry in schema if not _is_number(entry.type)
        }
        wanted = [name for name in names if name not in refused]
        table = file.read(columns=wanted) if wanted else None
    columns = {
        # Whole numbers beyond 2^53, as nanoseconds since 1970, are rounded as in the other formats.
        name: table.column(name).cast(pa.float64(), safe=False).to_numpy()
        for name in wanted
        if table is not None
    }
    units = {
        entry.name: entry.metadata[b"unit"].decode()
        for entry in schema
        if entry.metadata and b"unit" in entry.metadata
    }
    return Table(columns, refused, strict=True, units=units, header=(schema.metadata or {}).get(b"clearance"))


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_null(kind)


def _require_distinct(names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"the column {listing(twice)} occurs more than once; give each column its own name")


def read_csv(path: Path) -> Table:
    """Return the columns of a text table with a header row; commas, semicolons or tabs between the columns.

    Between semicolons or tabs a comma may be the decimal mark; marks for thousands are not read.
    """
    with path.open("rb") as file:
        line = file.readline(HEADER_BYTES)
    if b"\0" in line:
        raise InputError("the file is UTF-16 text, or none; save it as text in UTF-8")
    with _of_utf8():
        header = line.decode("utf-8-sig").rstrip("\r\n")
    delimiter = max(",;\t", key=header.count)
    names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter), [])]
    if not any(names):
        raise InputError("the first row is empty; it must name the columns")
    if all(_reads_as_number(name) for name in names):
        raise InputError(f"the first row holds numbers ({listing(names, 3)}); it must name the columns")
    with _of_utf8():
        table = pacsv.read_csv(
            path,
            read_options=pacsv.ReadOptions(column_names=names, skip_rows=1),
            parse_options=pacsv.ParseOptions(delimiter=delimiter, ignore_empty_lines=False),
            convert_options=pacsv.ConvertOptions(
                column_types={name: pa.string() for name in names}, strings_can_be_null=True, null_values=[""]
            ),
        )
    table = table.slice(0, _filled(table))  # a blank line between rows is a sample that is missing
    require_size(table.num_rows)
    while not names[-1] and table.column(len(names) - 1).null_count == table.num_rows:
        names.pop()  # of a delimiter that ends each row
    _require_distinct(names)
    columns: dict[str, NDArray[np.float64]] = {}
    refused: dict[str, str] = {}
    for name in names:
        text = pc.replace_substring_regex(pc.utf8_trim_whitespace(table.column(name)), r"^\+", "")
        if delimiter != ",":
            text = pc.replace_substring(text, ",", ".")
        try:
            columns[name] = text.cast(pa.float64()).to_numpy()
        except pa.ArrowInvalid:
            refused[name] = _first_text(table.column(name), text)
    return Table(columns, refused, strict=True)


def _filled(table: pa.Table) -> int:
    """Rows up to the last one in which a column holds something."""
    last = 0
    for column in table.columns:
        filled = pc.indices_nonzero(pc.is_valid(column))
        last = max(last, filled[-1].as_py() + 1 if len(filled) else 0)
    return last


@contextmanager
def _of_utf8() -> Iterator[None]:
    """Say of text in another encoding that it is."""
    try:
        yield
    except (UnicodeDecodeError, pa.ArrowInvalid) as error:
        if isinstance(error, pa.ArrowInvalid) and "invalid UTF8" not in str(error):
            raise
        raise InputError(
            "the file is not UTF-8 but another encoding, such as Latin-1 (Windows-1252); save it as UTF-8"
        ) from error


def _reads_as_number(text: str | None) -> bool:
    try:
        float(text or "")
    except ValueError:
        return False
    return True


def _first_text(raw: pa.ChunkedArray, text: pa.ChunkedArray) -> str:
    """Return where the first entry is that is no number: the end of the longest prefix that casts."""
    good, bad = 0, len(text)
    while bad - good > 1:
        middle = (good + bad) // 2
        try:
            text.slice(0, middle).cast(pa.float64())
            good = middle
        except pa.ArrowInvalid:
            bad = middle
    hint = ""
    if good == 0 and _reads_as_number(text[1].as_py() if len(text) > 1 else None):
        hint = " (a second row with units is not supported: delete it and give `units:` in the YAML)"
    return f"row {good + 2} holds {raw[good].as_py()[:40]!r}, not a number{hint}"


def read_hdf5(path: Path) -> Table:
    """Return every dataset that is a row of numbers, by its path; its attribute `unit` may state its unit."""
    found = datasets(path)
    return Table(found.columns, found.refused, strict=False, units=found.units)


def read_mat(path: Path) -> Table:
    """Return the numeric vectors of a MATLAB file, version 5 to 7.3."""
    with path.open("rb") as file:
        # Version 7.3 is HDF5 behind a block of MATLAB's own.
        if SIGNATURE in (file.read(len(SIGNATURE)), file.read(MATLAB_BLOCK)[-len(SIGNATURE) :]):
            return read_hdf5(path)
    columns: dict[str, NDArray[np.float64]] = {}
    refused: dict[str, str] = {}
    for variable in variables(path.read_bytes(), 8 * MOST_SAMPLES):
        if not variable.name:  # MATLAB's own, beside function handles and objects
            continue
        if variable.values is None:
            refused[variable.name] = variable.refusal
        elif reason := shape_refusal(variable.shape):
            refused[variable.name] = reason
        elif variable.name in columns:
            raise InputError(f"the variable {variable.name!r} occurs more than once; save the file again")
        else:
            columns[variable.name] = variable.values
    return Table(columns, refused, strict=False)


FORMATS: Mapping[str, tuple[str, Callable[[Path], Table]]] = {
    ".parquet": ("Parquet", read_parquet),
    ".csv": ("CSV", read_csv),
    ".h5": ("HDF5", read_hdf5),
    ".hdf5": ("HDF5", read_hdf5),
    ".mat": ("MATLAB", read_mat),
}
