"""Residual temporal convolutions, our own best: strided blocks that halve time and widen the features.

After He et al. 2016 (deep residual learning, CVPR) and Bai et al. 2018 (arXiv:1803.01271), without the
causality of the latter: a window is read as a whole.
"""

import itertools

import torch
from torch import Tensor, nn


class ResidualBlock(nn.Module):
    """Two convolutions with batch norm beside a shortcut; time is divided by ``stride``."""

    def __init__(self, before: int, after: int, width: int, stride: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv1d(before, after, width, stride, padding=width // 2, bias=False),
            nn.BatchNorm1d(after),
            nn.ReLU(),
            nn.Conv1d(after, after, width, padding=width // 2, bias=False),
            nn.BatchNorm1d(after),
        )
        self.shortcut = nn.Sequential(nn.Conv1d(before, after, 1, stride, bias=False), nn.BatchNorm1d(after))

    def forward(self, features: Tensor) -> Tensor:
        """(batch, before, time) -> (batch, after, time / stride)."""
        return torch.relu(self.layers(features) + self.shortcut(features))


class TemporalConvolutions(nn.Module):
    """A strided residual network; mean and maximum over the remaining time lead to a linear output.

    Args:
        channels: Channels of the input.
        length: Time steps of the input.
        stem: Filters of the first convolution, which sees ``stem_width`` steps.
        widths: Filters of each block.
        width: Time steps that a block's filters see.
        stem_width: Time steps that the first convolution sees.
        stem_stride: Division of time by the first convolution.
    """

    def __init__(
        self,
        channels: int,
        length: int,
        stem: int = 48,
        widths: tuple[int, ...] = (64, 96, 128, 160),
        width: int = 5,
        stem_width: int = 9,
        stem_stride: int = 1,
    ) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            nn.Conv1d(channels, stem, stem_width, stem_stride, padding=stem_width // 2, bias=False),
            nn.BatchNorm1d(stem),
            nn.ReLU(),
        )
        sizes = [stem, *widths]
        self.blocks = nn.Sequential(
            *(ResidualBlock(a, b, width, stride=2) for a, b in itertools.pairwise(sizes))
        )
        self.output = nn.Linear(2 * sizes[-1], 1)

    def forward(self, signals: Tensor) -> Tensor:
        """(batch, time, channel) scaled -> (batch,) scaled clearance."""
        features = self.blocks(self.stem(signals.transpose(1, 2)))
        return self.output(torch.cat([features.mean(dim=2), features.amax(dim=2)], dim=1)).squeeze(1)
