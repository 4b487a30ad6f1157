import errno
import json
import os
import stat

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from clearance.errors import InputError
from clearance.recording.channels import CHANNELS
from clearance.recording.files import read, write
from clearance.recording.recording import Recording

from .formats import (
    RATE,
    TIME,
    WRITERS,
    B,
    C,
    columns,
    declare,
    write_csv,
)

PROPERTY = settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)

scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text()
json_like = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@st.composite
def recordings(draw):
    names = tuple(draw(st.lists(st.sampled_from(tuple(CHANNELS)), min_size=1, max_size=5, unique=True)))
    shape = (draw(st.integers(2, 40)), len(names))
    values = draw(arrays(np.float64, shape, elements=st.floats(allow_nan=False, allow_infinity=False)))
    rate, start = draw(st.floats(20.0, 1e6)), draw(st.floats(-1e6, 1e6))
    assume(np.all(np.diff(start + np.arange(len(values)) / rate) > 0.0))
    return Recording(values, names, rate, start, draw(st.dictionaries(st.text(), json_like, max_size=3)))


# round trips


@given(recordings())
@PROPERTY
def test_a_written_recording_reads_back_exactly(tmp_path, recording):
    path = tmp_path / "run.parquet"
    write(recording, path)
    copy = read(path)
    assert copy.values.tobytes() == recording.values.tobytes()
    assert (copy.channels, copy.rate, copy.start_time) == (
        recording.channels,
        recording.rate,
        recording.start_time,
    )
    assert copy.metadata == recording.metadata
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.parquet"]


def test_single_precision_rounds_the_channels_and_not_the_clock(tmp_path):
    recording = Recording(np.column_stack([B, C]), ("rod_b_axial", "rod_c_axial"), 2999.7, 0.123)
    write(recording, tmp_path / "run.parquet", "float32")
    copy = read(tmp_path / "run.parquet")
    np.testing.assert_array_equal(copy.values, recording.values.astype(np.float32))
    assert (copy.rate, copy.start_time) == (2999.7, 0.123)


def test_others_can_read_the_file(tmp_path):
    write(
        Recording(B[:, None], ("rod_b_axial",), RATE, 2.0, {"speed": np.float64(60.0)}),
        tmp_path / "run.parquet",
    )
    table = pq.read_table(tmp_path / "run.parquet")
    assert table.column_names == ["time", "rod_b_axial"]
    np.testing.assert_array_equal(table["time"].to_numpy(), 2.0 + TIME)
    assert table.field("rod_b_axial").metadata == {b"unit": b"m/s^2"}
    assert json.loads(table.schema.metadata[b"clearance"])["metadata"] == {"speed": 60.0}


def test_rows_cut_from_a_written_file_keep_their_own_time(tmp_path):
    write(Recording(B[:, None], ("rod_b_axial",), RATE), tmp_path / "run.parquet")
    pq.write_table(pq.read_table(tmp_path / "run.parquet").slice(10), tmp_path / "cut.parquet")
    cut = read(tmp_path / "cut.parquet")
    assert (cut.rate, cut.start_time) == (RATE, 0.01)


@pytest.mark.parametrize("suffix", sorted(WRITERS))
def test_every_format_gives_the_same_recording(tmp_path, suffix):
    WRITERS[suffix](tmp_path / f"run{suffix}", columns())
    recording = read(tmp_path / f"run{suffix}")
    assert set(recording.channels) == {"rod_b_axial", "rod_c_axial"}
    assert (recording.rate, recording.start_time) == (RATE, 0.0)
    np.testing.assert_array_equal(recording.channel("rod_b_axial"), B)
    np.testing.assert_array_equal(recording.channel("rod_c_axial"), C)


@given(arrays(np.float64, (5,), elements=st.floats(allow_nan=False, allow_infinity=False)))
@PROPERTY
def test_a_csv_reads_every_number_as_it_was_printed(tmp_path, values):
    write_csv(tmp_path / "run.csv", {"time": TIME[:5], "rod_b_axial": values})
    np.testing.assert_array_equal(read(tmp_path / "run.csv").channel("rod_b_axial"), values)


@pytest.mark.parametrize(
    ("delimiter", "decimal"), [(",", "."), (";", "."), ("\t", "."), (";", ","), ("\t", ",")]
)
def test_delimiters_and_decimal_commas(tmp_path, delimiter, decimal):
    write_csv(tmp_path / "run.csv", columns(), delimiter, decimal)
    np.testing.assert_array_equal(read(tmp_path / "run.csv").values, np.column_stack([B, C]))


def test_quoted_names_windows_line_ends_and_a_byte_order_mark(tmp_path):
    text = '\ufeff"time","rod_b_axial"\r\n' + "".join(f"{k / 100}, +{k}.5\r\n" for k in range(5))
    (tmp_path / "run.csv").write_bytes(text.encode())
    np.testing.assert_array_equal(read(tmp_path / "run.csv").values[:, 0], np.arange(5) + 0.5)


def test_a_matlab_7_3_file_is_read_as_the_hdf5_file_that_it_is(tmp_path):
    with h5py.File(tmp_path / "run.mat", "w", userblock_size=512) as file:
        file["time"] = TIME[:, None]
        file["rod_b_axial"] = B[None, :]
        file["rod_b_axial"].attrs["MATLAB_class"] = np.bytes_("double")
        file["comment"] = np.frombuffer(b"p\0u\0", dtype=np.uint16)
        file["comment"].attrs["MATLAB_class"] = np.bytes_("char")
    np.testing.assert_array_equal(read(tmp_path / "run.mat").channel("rod_b_axial"), B)


@pytest.mark.parametrize("unit", ["g", [b"g"], np.array(["g"], dtype=object)])
def test_an_hdf5_dataset_goes_by_its_path_where_two_share_a_name_and_states_its_unit(tmp_path, unit):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for place in ("left", "right"):
            file[f"{place}/acc"] = B
        file["left/acc"].attrs["unit"] = unit
        file["time"] = TIME
        file["matrix"] = np.ones((3, 3))
    path = declare(tmp_path / "run.h5", columns={"left/acc": "rod_b_axial", "/right/acc": "rod_c_axial"})
    recording = read(path)
    np.testing.assert_allclose(recording.channel("rod_b_axial"), 9.80665 * B)
    np.testing.assert_array_equal(recording.channel("rod_c_axial"), B)
    declare(path, columns={"acc": "rod_b_axial"})
    with pytest.raises(InputError, match="maps the column 'acc', but the file has left/acc, right/acc"):
        read(path)


# writing

SMALL = Recording(np.zeros((4, 1)), ("rod_b_axial",), RATE)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        (errno.ENOSPC, r"run\.parquet: not written \(No space left on device\); make room"),
        (errno.EIO, "Input/output error"),
    ],
)
def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, code, message):
    path = tmp_path / "run.parquet"
    path.write_bytes(b"what was there")

    def fail(descriptor):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(InputError, match=message):
        write(SMALL, path)
    assert path.read_bytes() == b"what was there"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.parquet"]


def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch):
    def interrupt(descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write(SMALL, tmp_path / "run.parquet")
    assert list(tmp_path.iterdir()) == []


def test_a_written_file_has_the_permissions_of_any_other(tmp_path):
    write(SMALL, tmp_path / "run.parquet")
    (tmp_path / "plain").touch()
    modes = {stat.S_IMODE(entry.stat().st_mode) for entry in tmp_path.iterdir()}
    assert len(modes) == 1


@pytest.mark.parametrize(
    ("name", "precision", "message"),
    [
        ("run.csv", "float64", r"give a name that ends in \.parquet"),
        ("no/run.parquet", "float64", "not written"),
        ("file/run.parquet", "float64", "not written"),
        ("run.parquet", "float16", "choose float64 or float32"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path, name, precision, message):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=message):
        write(SMALL, tmp_path / name, precision)


def test_metadata_that_is_not_plain_is_refused_by_its_key(tmp_path):
    recording = Recording(SMALL.values, SMALL.channels, RATE, metadata={"a": [1, object()]})
    with pytest.raises(InputError, match=r"metadata\.a\[1\]: object cannot be written"):
        write(recording, tmp_path / "run.parquet")
