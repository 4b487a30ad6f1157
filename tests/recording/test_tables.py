from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from clearance.errors import InputError
from clearance.recording.files import read, write
from clearance.recording.recording import Recording
from clearance.recording.tables import read_mat

from .formats import (
    RATE,
    SAMPLES,
    WRITERS,
    B,
    C,
    columns,
    declare,
    read_or_complain,
    write_csv,
    write_mat,
    write_parquet,
)


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "run.csv"
    write_csv(path, columns())
    return path


def test_unknown_columns_are_named_with_the_way_out(tmp_path):
    write_csv(tmp_path / "run.csv", columns(rod_c_transvers=C, temperature=C))
    with pytest.raises(InputError, match="columns rod_c_transvers, temperature are no channels") as caught:
        read(tmp_path / "run.csv")
    for part in ("did you mean 'rod_c_transverse'", "`columns:`", "`ignore:`", "run.yaml", "crank_angle"):
        assert part in str(caught.value)


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".mat"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_located(tmp_path, suffix, bad):
    values = C.copy()
    values[[5, 9]] = bad
    WRITERS[suffix](tmp_path / f"run{suffix}", columns(rod_c_axial=values))
    with pytest.raises(InputError, match=r"'rod_c_axial' has 2 values .* in sample 5 at 0\.005 s"):
        read(tmp_path / f"run{suffix}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("\n", "the first row is empty"),
        ("time,rod_b_axial\n", "(?i)empty|too few"),
        ("time,rod_b_axial\n0,1\n", "1 samples are too few"),
        ("0.0,1.0\n0.1,2.0\n", "the first row holds numbers"),
        ("time,rod_b_axial\ns,m/s^2\n0,1\n1,2\n", "row 2 holds .*a second row with units is not supported"),
        ("time,rod_b_axial\nlong,abc\nshort,def\n", "'time' row 2 holds 'long', not a number$"),
        ("time,rod_b_axial,\n0,1,5\n0.01,2,\n", """columns '' are no channels .*"": CHANNEL"""),
        ("time,rod_b_axial\n0,1\n1,2\n2,abc\n", "column 'rod_b_axial' row 4 holds 'abc', not a number"),
        ("time,rod_b_axial\n0,1\n0.01,2\n0.02\n", "Expected 2 columns"),
        ("time,rod_b_axial\n0,1\n0.01,\n", "'rod_b_axial' has 1 values"),
        ("time,rod_b_axial,rod_b_axial\n0,1,2\n1,2,3\n", "rod_b_axial occurs more than once"),
        ("time,rod_b_axial\n0,1\n0.01,2\n0.05,3\n0.06,4\n", r"time jumps by 0\.04 s after 0\.01 s"),
        ("time,rod_b_axial\n0,1\n0.02,2\n0.01,3\n", "time goes back"),
        ("time,rod_b_axial\n0,1\n0.01,2\n0.0212,3\n0.03,4\n", "not uniform"),
        ("time,rod_b_axial\n0,1\n1,2\n2,3\n", "rate: 1 Hz is out of range"),
        ("time;rod_b_axial\n0;1.234,5\n0.01;2\n", "row 2 holds '1.234,5'"),
        ("rod_b_axial\n0\n1\n", "neither a column 'time' nor a rate; give `rate:`"),
        ("time\n0\n1\n", "no channel in it, only time"),
        ("time,rod_b_axial\n0,1e999\n0.01,2\n", "not finite"),
        ("time,rod_b_axial\n0,1\n1e308,2\n", "time reaches"),
    ],
)
def test_a_bad_csv_is_one_line(tmp_path, text, message):
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path / "run.csv")
    assert str(caught.value).startswith(str(tmp_path / "run.csv"))
    assert "\n" not in str(caught.value)


def test_a_blank_line_between_rows_is_a_sample_that_is_missing(tmp_path):
    (tmp_path / "run.yaml").write_text("rate: 1000")
    (tmp_path / "run.csv").write_text("rod_b_axial\n1\n2\n3\n\n\n")
    assert read(tmp_path / "run.csv").values[:, 0].tolist() == [1.0, 2.0, 3.0]
    (tmp_path / "run.csv").write_text("rod_b_axial\n1\n\n3\n")
    with pytest.raises(InputError, match=r"in sample 1 at 0\.001 s"):
        read(tmp_path / "run.csv")


@pytest.mark.parametrize("end", [",", ",,"])
def test_a_delimiter_at_the_end_of_each_row_is_no_column(tmp_path, end):
    rows = ("time,rod_b_axial", "0,1", "0.01,2", "0.02,4")
    (tmp_path / "run.csv").write_text("".join(f"{row}{end}\n" for row in rows))
    assert read(tmp_path / "run.csv").values[:, 0].tolist() == [1.0, 2.0, 4.0]


@pytest.mark.parametrize(
    ("text", "encoding", "words"),
    [
        ("time,temperature °C,rod_b_axial\n0,1,1\n0.01,2,2\n", "latin-1", r"Latin-1 .*save it as UTF-8"),
        ("time,rod_b_axial\ns,m/s²\n0,1\n0.01,2\n", "cp1252", r"Latin-1 .*save it as UTF-8"),
        ("time,rod_b_axial\n0,1\n0.01,2\n", "utf-16", "UTF-16 text.* in UTF-8"),
        ("time,rod_b_axial\n0,1\n0.01,2\n", "utf-16-be", "UTF-16 text.* in UTF-8"),
    ],
)
def test_another_encoding_is_named(tmp_path, text, encoding, words):
    (tmp_path / "run.csv").write_bytes(text.encode(encoding))
    with pytest.raises(InputError, match=words):
        read(tmp_path / "run.csv")


def test_columns_of_different_length_are_refused(tmp_path):
    write_mat(tmp_path / "run.mat", columns(rod_c_axial=C[:-1]))
    with pytest.raises(InputError, match=r"differ in length .*rod_c_axial 39"):
        read(tmp_path / "run.mat")


def test_whole_nanoseconds_since_1970_are_a_clock(tmp_path):
    clock = 1_700_000_000_000_000_000 + (np.arange(SAMPLES) * 1e9 / RATE).astype(np.int64)
    write_parquet(tmp_path / "run.parquet", columns(time=clock))
    declare(tmp_path / "run.parquet", units={"time": "ns"})
    assert read(tmp_path / "run.parquet").rate == pytest.approx(RATE)


def test_what_matlab_adds_beside_a_function_handle_is_no_column(tmp_path):
    own = Path(scipy.io.matlab.__file__).parent / "tests/data/parabola.mat"
    found = read_mat(own)
    assert "" not in {**found.columns, **found.refused}


def test_a_parquet_column_that_is_no_number_is_refused_unless_ignored(tmp_path):
    path = tmp_path / "run.parquet"
    write_parquet(path, columns(rod_c_axial=["x"] * SAMPLES))
    with pytest.raises(InputError, match="'rod_c_axial' holds string, not numbers"):
        read(path)
    assert read(declare(path, ignore=["rod_c_axial"])).channels == ("rod_b_axial",)


FOREIGN = {
    ".csv": "is not UTF-8|UTF-16 text, or none",
    ".h5": "not readable as HDF5", ".hdf5": "not readable as HDF5",
    ".mat": "does not begin as a MATLAB file", ".parquet": "not readable as Parquet",
}  # fmt: skip


@pytest.mark.parametrize("suffix", sorted(WRITERS))
def test_a_foreign_file_is_named_as_such(tmp_path, suffix):
    (tmp_path / f"run{suffix}").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)))
    with pytest.raises(InputError, match=FOREIGN[suffix]):
        read(tmp_path / f"run{suffix}")


def test_missing_files_folders_and_endings(tmp_path, csv):
    with pytest.raises(InputError, match=r"there is no such file; the folder has run\.csv"):
        read(tmp_path / "rum.csv")
    with pytest.raises(InputError, match="there is no folder"):
        read(tmp_path / "no" / "run.csv")
    with pytest.raises(InputError, match=r"'\.xlsx' is not known; recordings end in \.parquet"):
        read(tmp_path / "run.xlsx")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        read(tmp_path / "folder.csv")


def original(suffix, folder):
    path = folder / f"original{suffix}"
    if suffix == ".parquet":
        write(Recording(np.column_stack([B, C]), ("rod_b_axial", "rod_c_axial"), RATE, 0.0, {"run": 1}), path)
    else:
        WRITERS[suffix](path, columns())
    return path.read_bytes()


@pytest.mark.parametrize(
    ("suffix", "examples"), [(".parquet", 150), (".csv", 150), (".mat", 150), (".h5", 8)]
)
def test_damaged_files_are_a_recording_or_one_line(tmp_path, suffix, examples):
    whole = original(suffix, tmp_path)
    path = tmp_path / f"run{suffix}"

    @given(
        cut=st.none() | st.integers(0, len(whole)),
        changes=st.lists(st.tuples(st.integers(0, len(whole) - 1), st.integers(0, 255)), max_size=6),
    )
    @settings(deadline=None, max_examples=examples, database=None)
    def damaged(cut, changes):
        content = bytearray(whole)
        for place, value in changes:
            content[place] = value
        path.write_bytes(bytes(content[:cut]))
        outcome = read_or_complain(path)
        assert isinstance(outcome, Recording) or (str(path) in outcome and "\n" not in outcome)

    damaged()


def test_one_changed_byte_in_the_data_of_a_written_file_is_found(tmp_path):
    path = tmp_path / "run.parquet"
    write(Recording(np.random.default_rng(0).standard_normal((500, 1)), ("rod_b_axial",), RATE), path)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match="not readable as Parquet"):
        read(path)
