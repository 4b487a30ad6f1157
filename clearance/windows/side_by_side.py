"""Training batches of several seeds next to each other, for networks that are trained together."""

from collections.abc import Sequence
from typing import NamedTuple

import lightning as L
import torch
from torch import Tensor
from torch.utils.data import DataLoader

from clearance.windows.datamodule import WindowData
from clearance.windows.window_set import Batch


class SideBySideBatch(NamedTuple):
    """Where the windows of each seed's batch begin, and what they should give; recordings stay in place."""

    starts: Tensor  # (seeds, batch) int64, first sample of each window in the recordings
    target: Tensor  # (seeds, batch, targets) scaled


class SideBySideWindows(L.LightningDataModule):
    """Every seed's training windows in the order that a training of its own would have them.

    Args:
        data: Set up; its recordings, split, scalers and validation windows are everyone's.
        seeds: Of the order of the windows, and of their places where they are random.
    """

    def __init__(self, data: WindowData, seeds: Sequence[int]) -> None:
        super().__init__()
        self.data, self._each = data, [data.reseeded(seed) for seed in seeds]

    def train_dataloader(self) -> DataLoader[SideBySideBatch]:
        """Batches of the current epoch; Lightning asks for them anew every epoch."""
        epoch = self.trainer.current_epoch if self.trainer else 0
        starts, targets = [], []
        for data in self._each:
            windows = data.training_windows(epoch)
            order = torch.cat(list(data.training_order(len(windows), epoch)))
            starts.append(windows.starts[order])
            targets.append(windows.target[order])
        parts = [torch.stack(rows).split(self.data.batch_size, dim=1) for rows in (starts, targets)]
        return DataLoader([SideBySideBatch(*part) for part in zip(*parts, strict=True)], batch_size=None)  # type: ignore[arg-type]

    def val_dataloader(self) -> DataLoader[Batch]:
        """Batches of the validation windows, in order."""
        return self.data.val_dataloader()
