"""Windows of recordings in memory, addressed in batches."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from clearance.windows.windowing import RegularWindows


class Batch(NamedTuple):
    """Windows and what they should give."""

    signals: Tensor  # (batch, time, channel) scaled
    target: Tensor  # (batch, targets) scaled


@dataclass
class WindowSet(Dataset[Batch]):
    """First samples of windows on one array of recordings; windows are copied only when asked for."""

    signals: Tensor  # (total samples, channels) float32, scaled
    starts: Tensor  # (windows,) int64, first sample of each window in ``signals``
    recording: Tensor  # (windows,) int64, index of the window's recording
    target: Tensor  # (windows, targets) float32, scaled
    length: int  # [samples]

    @classmethod
    def side_by_side(cls, signals: np.ndarray, lengths: np.ndarray, length: int, targets: int) -> "WindowSet":
        """Windows of ``length`` samples that do not overlap, of recordings whose clearances are not known.

        Args:
            signals: (total samples, channels) scaled, one recording behind the other.
            lengths: (recordings,) samples of each.
            length: of a window [samples].
            targets: clearances that a model estimates.
        """
        starts, place = RegularWindows(length, length).starts(lengths, np.random.default_rng(0))
        offsets = np.cumsum(lengths) - lengths
        return cls(
            torch.from_numpy(signals), torch.from_numpy(starts + offsets[place]), torch.from_numpy(place),
            torch.zeros(len(starts), targets), length,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, index: Tensor) -> Batch:
        """Windows of a whole batch by one indexing operation."""
        rows = self.starts[index][:, None] + torch.arange(self.length)
        return Batch(self.signals[rows], self.target[index])

    def flattened(self) -> np.ndarray:
        """All windows as rows (windows, time * channel): what a forest reads."""
        windows = self.signals.unfold(0, self.length, 1)[self.starts]  # (windows, channel, time)
        return windows.transpose(1, 2).flatten(1).numpy()

    @property
    def channels(self) -> int:
        """Number of channels."""
        return self.signals.shape[1]


class BatchOrder:
    """Lists of window indices, a list per batch; shuffled from a seed or in order.

    Args:
        windows: How many there are.
        batch_size: Windows of a batch [-].
        seed: Of shuffling; None keeps the order.
        share: (k, n): the k-th of n devices, from 0, takes its part of every batch. The parts are equal, so
            that the mean of their gradients is the batch's; the first windows of a batch that cannot be
            divided are taken twice.
    """

    def __init__(
        self,
        windows: int,
        batch_size: int,
        seed: tuple[int, int] | None = None,
        share: tuple[int, int] = (0, 1),
    ) -> None:
        self._windows, self._batch_size, self._seed, self._share = windows, batch_size, seed, share

    def __len__(self) -> int:
        return -(-self._windows // self._batch_size)

    def __iter__(self) -> Iterator[Tensor]:
        part, parts = self._share
        order = np.arange(self._windows)
        if self._seed is not None:
            np.random.default_rng(self._seed).shuffle(order)
        for start in range(0, self._windows, self._batch_size):
            batch = order[start : start + self._batch_size]
            divisible = np.resize(batch, -(-len(batch) // parts) * parts)
            yield torch.from_numpy(divisible[part::parts])
