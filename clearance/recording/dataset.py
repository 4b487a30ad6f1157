"""Many runs on disk: one checksummed chunk a run, which several writers can fill and a kill cannot spoil.

A Zarr (version 3) group with ``signals`` (runs, samples, channels) float32 and ``labels`` (runs, 3). A chunk
is written to a temporary file and renamed, so that it is there whole or not at all; what is there is never
written again. A run that failed leaves a small file in ``failures`` instead.
"""

import errno
import logging
import os
import shutil
from pathlib import Path
from typing import Any
from uuid import uuid4

import google_crc32c
import numpy as np
import zarr
from filelock import FileLock
from zarr.codecs import Crc32cCodec

from clearance.errors import InputError
from clearance.whole_files import read_json, write_json

log = logging.getLogger(__name__)

LABELS = ("clearance_b", "clearance_c", "speed")
_SIGNALS, _LABELS, _FAILURES = "signals", "labels", "failures"


class Dataset:
    """Simulated runs on disk.

    Attributes:
        path: folder of the store.
        channels: names of the stored channels.
        rate: sampling rate [Hz].
        start_time: of the first stored sample [s].
        samples: a run.
        runs: planned; see ``available`` for those that are there.
        fingerprint: of the settings that made the runs.
        simulator: of the sources that did, see ``provenance.simulator``; empty where an older version did.
    """

    def __init__(self, path: Path, group: zarr.Group) -> None:
        self.path = path
        signals: Any = group[_SIGNALS]
        self._signals = signals
        self._labels: Any = group[_LABELS]
        attributes: dict[str, Any] = dict(group.attrs)
        self.channels = tuple(attributes["channels"])
        self.rate = float(attributes["rate"])
        self.start_time = float(attributes["start_time"])
        self.fingerprint = str(attributes["fingerprint"])
        self.simulator = str(attributes.get("simulator", ""))
        self.settings: dict[str, Any] = attributes["settings"]
        self.runs, self.samples, _ = signals.shape

    @classmethod
    def open(cls, path: str | Path) -> "Dataset":
        """Open a store.

        Raises:
            InputError: if there is none, or something else.
        """
        folder = Path(path)
        if not folder.is_dir():
            raise InputError(
                f"dataset = {folder} is not there; make it with python -m clearance.simulate dataset={folder}"
            )
        try:
            return cls(folder, zarr.open_group(folder, mode="r+", zarr_format=3))
        except InputError:
            raise
        except Exception as error:  # whatever Zarr raises for foreign or damaged metadata
            raise InputError(f"dataset = {folder} is not a data set of this project: {error}") from error

    @classmethod
    def create(
        cls,
        path: str | Path,
        labels: np.ndarray,
        channels: tuple[str, ...],
        samples: int,
        rate: float,
        start_time: float,
        fingerprint: str,
        settings: dict[str, Any],
        simulator: str,
    ) -> "Dataset":
        """Open a store for writing, making or growing it where needed.

        Args:
            path: folder.
            labels: (runs, 3) float64, in the order of ``LABELS``.
            channels: names.
            samples: a run.
            rate: sampling rate [Hz].
            start_time: of the first sample [s].
            fingerprint: of the settings.
            settings: their description, kept for people.
            simulator: of the sources that run them; runs of others stay, which is told.

        Raises:
            InputError: if the folder holds a data set of other settings.
        """
        folder = Path(path)
        if not (folder / "zarr.json").exists():
            attributes = {
                "channels": list(channels),
                "rate": rate,
                "start_time": start_time,
                "fingerprint": fingerprint,
                "settings": settings,
                "simulator": simulator,
            }
            _lay_out(folder, labels, (len(labels), samples, len(channels)), attributes)
        dataset = cls.open(folder)
        differing = ", ".join(_differences(dataset.settings, settings))
        if dataset.fingerprint != fingerprint and differing:  # 3 and 3.0 are the same
            raise InputError(
                f"dataset = {folder} was made with other settings ({differing}); choose another dataset= path"
            )
        dataset.compare(simulator)
        if dataset.runs < len(labels):
            with FileLock(folder / "growing.lock"):
                dataset = cls.open(folder)  # another may have grown it meanwhile, and further
                if dataset.runs < len(labels):
                    dataset._grow(labels)
        return dataset

    def compare(self, simulator: str) -> None:
        """Say so where runs were made by other sources than these."""
        if self.simulator != simulator:
            log.warning(
                "%s: its runs were made by another version of the simulator, which may move otherwise; "
                "delete it and simulate again to have all of this one", self.path,
            )  # fmt: skip

    def _grow(self, labels: np.ndarray) -> None:
        # The signals come last, because their number is the data set's: a kill before leaves the smaller one.
        self._labels.resize(labels.shape)
        self._labels[:] = labels
        self._signals.resize((len(labels), *self._signals.shape[1:]))
        self.runs = len(labels)

    @property
    def labels(self) -> dict[str, np.ndarray]:
        """(runs,) each: ``clearance_b`` and ``clearance_c`` [m], ``speed`` [rad/s]."""
        try:
            values = np.asarray(self._labels[:])
        except Exception as error:  # as in ``read``
            raise InputError(
                f"the labels of {self.path} are damaged ({error}): delete the data set and make it again"
            ) from error
        return {name: values[:, column] for column, name in enumerate(LABELS)}

    def available(self) -> np.ndarray:
        """Indices of the runs whose signals are on disk."""
        folder = self.path / _SIGNALS / "c"
        if not folder.is_dir():
            return np.zeros(0, dtype=np.int64)
        runs = [int(entry.name) for entry in os.scandir(folder) if (Path(entry.path) / "0" / "0").exists()]
        return np.array(sorted(run for run in runs if run < self.runs), dtype=np.int64)

    def failures(self) -> dict[int, str]:
        """Runs that became non-finite, with the reason."""
        folder = self.path / _FAILURES
        if not folder.is_dir():
            return {}
        return {
            int(file.stem): str(read_json(file, "dataset")["reason"])
            for file in sorted(folder.glob("[0-9]*.json"))
        }

    def missing(self) -> np.ndarray:
        """Indices of the runs that are neither stored nor failed."""
        done = set(self.available().tolist()) | set(self.failures())
        return np.array([run for run in range(self.runs) if run not in done], dtype=np.int64)

    def write(self, run: int, signals: np.ndarray) -> None:
        """Store one run's (samples, channels) signals.

        The same bytes as ``self._signals[run] = signals``, at half its processor time and without its single
        writing thread (measured: 1.6 for 3.5 ms a run of 3 s).
        """
        values = np.ascontiguousarray(signals, dtype="<f4")
        if values.shape != (self.samples, len(self.channels)):
            raise ValueError(f"signals {values.shape} are not ({self.samples}, {len(self.channels)})")
        content: Any = values.reshape(-1).view(np.uint8)  # Any: its stubs do not call an array a buffer
        chunk = self._chunk(run)
        chunk.parent.mkdir(parents=True, exist_ok=True)
        partial = chunk.with_name(f"0.{uuid4().hex}.partial")
        try:
            with partial.open("wb") as file:
                file.write(content)
                file.write(google_crc32c.value(content).to_bytes(4, "little"))
            partial.replace(chunk)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise

    def _chunk(self, run: int) -> Path:
        return self.path / _SIGNALS / "c" / str(run) / "0" / "0"

    def write_failure(self, run: int, reason: str) -> None:
        """Record that a run failed, so that it is not tried again."""
        folder = self.path / _FAILURES
        folder.mkdir(exist_ok=True)
        write_json(folder / f"{run}.json", {"run": run, "reason": reason})

    def read(self, run: int, channels: tuple[str, ...] | None = None) -> np.ndarray:
        """Signals of one run, (samples, channels) float32.

        Raises:
            InputError: for an unknown channel, or a run that is missing or damaged.
        """
        wanted = self.channels if channels is None else tuple(channels)
        unknown = [name for name in wanted if name not in self.channels]
        if unknown:
            raise InputError(
                f"dataset {self.path} lacks {', '.join(unknown)}; it has {', '.join(self.channels)}"
            )
        try:
            values = np.asarray(self._signals[run])
        except (
            Exception
        ) as error:  # a failed checksum or a truncated chunk: Zarr has no type of its own for either
            raise InputError(
                f"run {run} is damaged ({error}): delete {self._chunk(run)} and repeat the simulate command "
                "that made it"
            ) from error
        if not np.isfinite(values).all():
            raise InputError(
                f"run {run} of {self.path} is not there; repeat the simulate command that makes it"
            )
        return values[:, [self.channels.index(name) for name in wanted]]


def _differences(old: Any, new: Any, key: str = "") -> list[str]:
    """Keys whose values differ, with both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        names = sorted(set(old) | set(new))
        return [d for n in names for d in _differences(old.get(n), new.get(n), f"{key}.{n}" if key else n)]
    return [] if old == new else [f"{key}: {old} there, {new} here"]


def _lay_out(
    folder: Path, labels: np.ndarray, shape: tuple[int, int, int], attributes: dict[str, Any]
) -> None:
    """Make a data set without signals beside ``folder`` and rename it: it is there whole or not at all."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.{uuid4().hex}.partial")
    kept: dict[str, Any] = {"compressors": [Crc32cCodec()]}
    try:
        group = zarr.create_group(partial, zarr_format=3, attributes=attributes)
        group.create_array(
            _SIGNALS, shape=shape, chunks=(1, *shape[1:]), dtype="float32", fill_value=float("nan"), **kept
        )
        group.create_array(_LABELS, data=labels, chunks=labels.shape, **kept)
        partial.rename(folder)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
            raise
        if not (folder / "zarr.json").exists():  # else another writer was faster, with the same content
            raise InputError(
                f"dataset = {folder} holds something else; give a folder that is new or empty"
            ) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
