"""Where recordings with known clearances come from: one class per ``data=`` option, one protocol.

A source fills one array with all its recordings; later steps scale it in place and index it, so that a data
set is in memory once: samples x channels x 4 bytes (1000 runs of 10 000 samples on 4 channels: 160 MB).
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from clearance.errors import InputError
from clearance.mechanism.parameters import require
from clearance.provenance import fingerprint, simulator
from clearance.recording.chain import declared_chain
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.dataset import LABELS, Dataset
from clearance.recording.position import mounted
from clearance.recording.synthesis import Campaign
from clearance.windows.splitting import RandomSplit, Split

log = logging.getLogger(__name__)


@dataclass
class LabelledRecordings:
    """Recordings end to end in one array, with what is known about each."""

    channels: tuple[str, ...]
    rate: float  # [Hz]
    signals: np.ndarray  # (total samples, channels) float32 [channels' units]
    lengths: np.ndarray  # (recordings,) [samples]
    target: np.ndarray  # (recordings, targets) clearances [m]
    speed: np.ndarray  # (recordings,) mean crank speed [rad/s], NaN where unknown
    groups: np.ndarray  # (recordings,) equal numbers must stay on one side of a split
    fingerprint: str  # changes when any of the data changes
    chain: Mapping[str, Any] = field(default_factory=lambda: declared_chain(None))  # of measurement
    positions: Mapping[str, float] = field(default_factory=dict)  # of accelerometers, where known [m]
    offsets: np.ndarray = field(init=False)  # (recordings,) first sample in ``signals``

    def __post_init__(self) -> None:
        self.offsets = np.cumsum(self.lengths) - self.lengths

    def recording(self, index: int) -> np.ndarray:
        """View of one recording, (samples, channels)."""
        start = self.offsets[index]
        return self.signals[start : start + self.lengths[index]]


class Source(Protocol):
    """What a data module needs of any source.

    Attributes:
        reproducible: whether the configuration alone decides the recordings; files may change under it.
    """

    reproducible: bool

    def prepare(self) -> None:
        """Make what is missing; called once, before anything is read."""
        ...

    def load(self, channels: Sequence[str], targets: Sequence[str], limit: int) -> LabelledRecordings:
        """Read ``channels`` and the labels ``targets`` of all recordings, in at most ``limit`` bytes."""
        ...

    def divide(self, recordings: LabelledRecordings, split: RandomSplit) -> Split:
        """Indices of the recordings to train, validate and test with."""
        ...

    def refresh(self, recordings: LabelledRecordings, epoch: int) -> Sequence[int]:
        """Replace recordings before training epoch ``epoch``; return the indices of those replaced."""
        ...


class FixedSource:
    """A finite set, split at random and never refreshed; of files, unless a subclass says otherwise."""

    reproducible = False

    def prepare(self) -> None:
        """Nothing to make."""

    def divide(self, recordings: LabelledRecordings, split: RandomSplit) -> Split:
        """By recording, at random."""
        return split.divide(recordings.groups)

    def refresh(self, recordings: LabelledRecordings, epoch: int) -> Sequence[int]:
        """Nothing is replaced."""
        return ()


@dataclass
class StoredSource(FixedSource):
    """A data set on disk, written by ``python -m clearance.simulate``."""

    path: str
    start_time: float = 2.0  # [s] samples before it are left out: the start-up transient (paper, Section 4.2)
    runs: int | None = None  # only the first so many

    def __post_init__(self) -> None:
        require(self, start_time=self.start_time)
        if self.runs is not None:
            require(self, 1, whole=True, runs=self.runs)

    def load(self, channels: Sequence[str], targets: Sequence[str], limit: int) -> LabelledRecordings:
        """Read every run that is stored and finite."""
        dataset = Dataset.open(str(self.path))
        dataset.compare(simulator())
        missing = [run for run in dataset.missing() if self.runs is None or run < self.runs]
        if missing:
            log.warning(
                "%s: %d of its %d runs are not simulated yet; with them, it would be another training",
                self.path, len(missing), dataset.runs,
            )  # fmt: skip
        return read_dataset(dataset, channels, targets, limit, self.start_time, self.runs)


@dataclass
class SimulatedSource(FixedSource):
    """Runs that this command simulates first, kept under ``folder`` for the next that asks the same."""

    simulation: Campaign
    folder: str
    start_time: float = 2.0  # [s]
    reproducible = True

    def __post_init__(self) -> None:
        require(self, start_time=self.start_time)

    def prepare(self) -> None:
        """Simulate what is missing."""
        self.simulation.generate(self._path)

    def load(self, channels: Sequence[str], targets: Sequence[str], limit: int) -> LabelledRecordings:
        """Read the runs asked for, even where the store has grown beyond them."""
        dataset, runs = Dataset.open(self._path), self.simulation.runs
        missing = [run for run in dataset.missing() if run < runs]
        if missing or dataset.runs < runs:
            raise InputError(
                f"data.source.folder={self.folder}: {self._path.name} has lost {len(missing) or 'some'} of "
                f"its {runs} runs since they were simulated; the same command simulates them again"
            )
        return read_dataset(dataset, channels, targets, limit, self.start_time, runs)

    @property
    def _path(self) -> Path:
        return Path(str(self.folder)) / self.simulation.folder


@dataclass
class StreamingSource:
    """Freshly simulated training runs every epoch; validation and test runs stay the same.

    Simulating is cheaper than training, so a training run need never be seen twice. Epochs -1 and -2 are the
    validation and the test runs: no training epoch repeats them. A run that fails leaves its place to another
    of its epoch, so that an epoch's recordings do not depend on where a training was resumed.
    """

    simulation: Campaign
    runs: int  # per epoch
    held_out: int  # for validation, and as many for the test
    reproducible = True

    def __post_init__(self) -> None:
        require(self, 1, 10_000_000, whole=True, runs=self.runs, held_out=self.held_out)

    def prepare(self) -> None:
        """Nothing to make in advance."""

    def load(self, channels: Sequence[str], targets: Sequence[str], limit: int) -> LabelledRecordings:
        """Simulate the first epoch and the held-out runs."""
        _require(channels, ACCELERATIONS, "simulation")
        self._channels = tuple(channels)
        self._labels, self._epoch = [LABELS.index(target) for target in targets], 0
        samples = self.simulation.sampling.samples
        check_memory((self.runs + 2 * self.held_out) * samples * len(channels) * 4, limit)
        parts = [
            self.simulation.fresh(*part, self._channels)
            for part in ((self.runs, 0), (self.held_out, -1), (self.held_out, -2))
        ]
        self._sizes = [len(signals) for signals, _ in parts]
        if 0 in self._sizes:
            raise InputError(
                f"data=streaming: all of {self.runs} runs to train with, or all of {self.held_out} to "
                "validate or test with, became non-finite; set integrator.step, or another machine"
            )
        signals = [signal for part, _ in parts for signal in part]
        labels = np.concatenate([label for _, label in parts])
        return LabelledRecordings(
            channels=tuple(channels),
            rate=self.simulation.chain.rate,
            signals=np.concatenate(signals),
            lengths=np.array([len(s) for s in signals]),
            target=labels[:, self._labels],
            speed=labels[:, LABELS.index("speed")],
            groups=np.arange(len(signals)),
            fingerprint=f"stream-{self.simulation.folder}",
            chain=asdict(self.simulation.chain),
            positions=mounted(self.simulation.settings),
        )

    def divide(self, recordings: LabelledRecordings, split: RandomSplit) -> Split:
        """By order of simulation: the runs are independent draws already."""
        return Split(*np.split(np.arange(len(recordings.lengths)), np.cumsum(self._sizes[:2])))

    def refresh(self, recordings: LabelledRecordings, epoch: int) -> Sequence[int]:
        """Overwrite the training runs in place.

        Raises:
            InputError: all runs of the epoch became non-finite.
        """
        if epoch == self._epoch:
            return ()
        signals, labels = self.simulation.fresh(self.runs, epoch, self._channels)
        if not signals:
            raise InputError(
                f"data=streaming: all of {self.runs} runs of epoch {epoch + 1} became non-finite; set "
                "integrator.step, or another machine"
            )
        replaced = range(self._sizes[0])
        for index in replaced:
            run = index % len(signals)
            recordings.recording(index)[:] = signals[run]
            recordings.target[index] = labels[run, self._labels]
            recordings.speed[index] = labels[run, LABELS.index("speed")]
        self._epoch = epoch
        return replaced


def read_dataset(
    dataset: Dataset,
    channels: Sequence[str],
    targets: Sequence[str],
    limit: int,
    start_time: float,
    runs: int | None = None,
) -> LabelledRecordings:
    """Read a stored data set into one array, run by run."""
    _require(channels, dataset.channels, "data set")
    available = dataset.available()
    if runs is not None:
        available = available[available < runs]
    skip = max(0, round((start_time - dataset.start_time) * dataset.rate))
    samples = dataset.samples - skip
    if not len(available):
        raise InputError(
            f"{dataset.path}: none of its {dataset.runs} runs is there ({len(dataset.failures())} became "
            "non-finite); repeat the simulate command that makes it, with a smaller integrator.step or "
            "another machine where they fail"
        )
    if samples < 1:
        raise InputError(
            f"data.source.start_time={start_time} s: the data set ends at "
            f"{dataset.start_time + dataset.samples / dataset.rate} s; set data.source.start_time"
        )
    check_memory(len(available) * samples * len(channels) * 4, limit)
    signals = np.empty((len(available), samples, len(channels)), dtype=np.float32)
    for place, run in enumerate(available):
        signals[place] = dataset.read(int(run), tuple(channels))[skip:]
    return LabelledRecordings(
        channels=tuple(channels),
        rate=dataset.rate,
        signals=signals.reshape(-1, len(channels)),
        lengths=np.full(len(available), samples),
        target=np.stack([dataset.labels[target][available] for target in targets], axis=1),
        speed=dataset.labels["speed"][available],
        groups=np.arange(len(available)),
        fingerprint=fingerprint([dataset.fingerprint, dataset.simulator, available.tolist()]),
        chain=declared_chain(dataset.settings.get("chain")),
        positions=mounted(dataset.settings),
    )


def check_memory(size: int, limit: int) -> None:
    """Refuse a data set that would not fit, before it is read."""
    if size > limit:
        raise InputError(
            f"the recordings need {size / 2**30:.2f} GiB of memory: at most {limit / 2**30:.2f} GiB are "
            "allowed; set data.memory_gib, or fewer runs or sensors"
        )


def _require(channels: Sequence[str], present: Sequence[str], where: str) -> None:
    missing = [name for name in channels if name not in present]
    if missing:
        raise InputError(f"channels {missing} are not in the {where}, which has {list(present)}; set sensors")
