"""Writing a recording as a logger would: a plain Parquet table that says nothing of its origin."""

import os
from collections.abc import Mapping

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq


def write_parquet(table: Mapping[str, np.ndarray], path: str | os.PathLike[str]) -> None:
    """Write ``time`` and the channels as columns of float64, ``time`` first, without metadata.

    Nothing is compressed, so that a file's size tells its shape and nothing of what is in it.

    Args:
        table: what ``Plant.recording`` returns.
        path: of the file.
    """
    names = ["time", *(name for name in table if name != "time")]
    columns = {name: np.asarray(table[name], dtype=np.float64) for name in names}
    content = pa.table(columns).replace_schema_metadata(None)
    pq.write_table(content, path, use_dictionary=False, compression="none", write_statistics=False)
