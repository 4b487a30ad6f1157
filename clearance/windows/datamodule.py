"""From a source of recordings to batches of scaled windows: the LightningDataModule of every model."""

import logging
from collections.abc import Sequence
from copy import copy

import lightning as L
import numpy as np
import torch
from torch.utils.data import DataLoader

from clearance.errors import InputError
from clearance.mechanism.parameters import require
from clearance.windows.scaling import MinMaxScaler, Scalers, StandardScaler
from clearance.windows.sources import LabelledRecordings, Source
from clearance.windows.splitting import RandomSplit, Split
from clearance.windows.window_set import Batch, BatchOrder, WindowSet
from clearance.windows.windowing import RegularWindows, WindowPlan

log = logging.getLogger(__name__)
TARGETS = (("clearance_b",), ("clearance_c",), ("clearance_b", "clearance_c"))
"""What a model may estimate: one joint's clearance, or those of both."""


class WindowData(L.LightningDataModule):
    """Recordings of a source, split, scaled and cut.

    The order of the training windows, and their places where they are random, depend on ``seed`` and the
    epoch alone; a training that is resumed therefore goes on with the batches it would have had.

    Args:
        source: Gives the recordings.
        channels: Names of the channels that the model reads.
        targets: Names of the labels to estimate, in metres; one of ``TARGETS``.
        split: Divides the recordings.
        windows: Places the training windows. Validation and test windows never overlap.
        batch_size: Windows a training step [-].
        seed: Of shuffling and random windows.
        memory_gib: Most memory that the recordings may take [GiB].
    """

    def __init__(
        self,
        source: Source,
        channels: Sequence[str],
        targets: Sequence[str],
        split: RandomSplit,
        windows: WindowPlan,
        batch_size: int = 64,
        seed: int = 42,
        memory_gib: float = 4.0,
    ) -> None:
        super().__init__()
        require(self, 1, whole=True, batch_size=batch_size)
        require(self, 0, 2**32 - 1, whole=True, seed=seed)  # what NumPy's first generator takes
        require(self, 0.0, 1e6, strict=True, memory_gib=memory_gib)
        self.source, self.channels, self.targets = source, tuple(channels), tuple(targets)
        if self.targets not in TARGETS:
            allowed = " or ".join(f"[{','.join(names)}]" for names in TARGETS)
            raise InputError(f"targets={targets}: must be {allowed}; set targets")
        self.split, self.windows, self.batch_size, self.seed = split, windows, batch_size, seed
        self.memory_gib = memory_gib
        self.scalers: Scalers
        self.recordings: LabelledRecordings
        self.parts: Split
        self._loaded = False

    def prepare_data(self) -> None:
        """Make the data where they are missing."""
        self.source.prepare()

    def setup(self, stage: str | None = None) -> None:
        """Read, split, fit the scalers on the training recordings, and scale everything in place, once."""
        if self._loaded:
            return
        recordings = self.source.load(self.channels, self.targets, int(self.memory_gib * 2**30))
        shortest = int(recordings.lengths.min()) if len(recordings.lengths) else 0
        if shortest < self.windows.length:
            raise InputError(
                f"the shortest recording has {shortest} samples: at least {self.windows.length} are "
                "needed for a window; set windows.length or data"
            )
        self.parts = self.source.divide(recordings, self.split)
        training = [recordings.recording(int(i)) for i in self.parts.train]
        self.scalers = Scalers(
            StandardScaler.fit(self.channels, training), MinMaxScaler.fit(recordings.target[self.parts.train])
        )
        self.scalers.signals.apply(recordings.signals)
        self.recordings = recordings
        self._loaded = True
        log.info(
            "%d recordings (train %d, validation %d, test %d), %d channels, %.2f GiB in memory",
            len(recordings.lengths), len(self.parts.train), len(self.parts.validation), len(self.parts.test),
            len(self.channels), recordings.signals.nbytes / 2**30,
        )  # fmt: skip

    def reseeded(self, seed: int) -> "WindowData":
        """The same recordings, shared in memory, with training windows placed and ordered by ``seed``."""
        other = copy(self)
        other.seed = seed
        return other

    def training_windows(self, epoch: int = 0) -> WindowSet:
        """Windows to train with in an epoch, after the source has refreshed its recordings."""
        for index in self.source.refresh(self.recordings, epoch):
            self.scalers.signals.apply(self.recordings.recording(index))
        return self._cut(self.parts.train, self.windows, epoch)

    def validation_windows(self) -> WindowSet:
        """Windows of the validation recordings, side by side."""
        return self._cut(self.parts.validation, self._regular)

    def test_windows(self) -> WindowSet:
        """Windows of the test recordings, side by side."""
        return self._cut(self.parts.test, self._regular)

    def train_dataloader(self) -> DataLoader[Batch]:
        """Shuffled batches of the current epoch; Lightning asks for them anew every epoch."""
        epoch, share = 0, (0, 1)
        if self.trainer:
            epoch, share = self.trainer.current_epoch, (self.trainer.global_rank, self.trainer.world_size)
        windows = self.training_windows(epoch)
        return self._loader(windows, self.training_order(len(windows), epoch, share))

    def val_dataloader(self) -> DataLoader[Batch]:
        """Batches of the validation windows, in order."""
        return self._loader(self.validation_windows())

    def training_order(self, windows: int, epoch: int, share: tuple[int, int] = (0, 1)) -> BatchOrder:
        """Batches of an epoch's training windows; of each a device's ``share`` (see ``BatchOrder``)."""
        return BatchOrder(windows, self.batch_size, (self.seed, epoch), share)

    @property
    def _regular(self) -> RegularWindows:
        return RegularWindows(self.windows.length, self.windows.length)

    def _cut(self, indices: np.ndarray, plan: WindowPlan, epoch: int = 0) -> WindowSet:
        rng = np.random.default_rng((self.seed, epoch, 1))
        starts, place = plan.starts(self.recordings.lengths[indices], rng)
        recording = indices[place]
        target = self.scalers.target.transform(self.recordings.target[recording])
        return WindowSet(
            signals=torch.from_numpy(self.recordings.signals),
            starts=torch.from_numpy(starts + self.recordings.offsets[recording]),
            recording=torch.from_numpy(recording),
            target=torch.from_numpy(target.astype(np.float32)),
            length=plan.length,
        )

    def _loader(self, windows: WindowSet, order: BatchOrder | None = None) -> DataLoader[Batch]:
        # Indexing memory is cheaper than sending batches between processes: no workers.
        in_order = BatchOrder(len(windows), self.batch_size)
        return DataLoader(windows, batch_size=None, sampler=order or in_order)
