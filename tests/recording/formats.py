"""One recording in every format, and the YAML beside it, for the tests of the readers."""

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
import yaml

from clearance.errors import InputError
from clearance.recording.files import read

RATE = 1000.0
SAMPLES = 40
TIME = np.arange(SAMPLES) / RATE
B = np.sin(TIME * 300.0) * 50.0
C = np.cos(TIME * 200.0)


def columns(**more):
    return {"time": TIME, "rod_b_axial": B, "rod_c_axial": C, **more}


def write_parquet(path, table):
    pq.write_table(pa.table(table), path)


def write_csv(path, table, delimiter=",", decimal="."):
    rows = [delimiter.join(table)]
    for row in zip(*table.values(), strict=True):
        rows.append(delimiter.join(str(value).replace(".", decimal) for value in row))
    path.write_text("\n".join(rows) + "\n")


def write_hdf5(path, table):
    with h5py.File(path, "w") as file:
        for name, values in table.items():
            file[f"run/{name}"] = values


def write_mat(path, table):
    scipy.io.savemat(path, {**table, "comment": "pump 7", "fs": RATE})


WRITERS = {
    ".parquet": write_parquet,
    ".csv": write_csv,
    ".h5": write_hdf5,
    ".hdf5": write_hdf5,
    ".mat": write_mat,
}


def declare(path, **keys):
    path.with_suffix(".yaml").write_text(yaml.safe_dump(keys))
    return path


def read_or_complain(path):
    """The recording, or the one message; any other exception fails the test."""
    try:
        return read(path)
    except InputError as error:
        return str(error)
