"""Residual temporal convolutions, our own best: strided blocks without batch norm, read out by attention.

Batch norm was tried first and was worse: the statistics of a batch are noise on an output that is wanted to a
thousandth. Without it each block begins as its shortcut alone and learns how much to add (SkipInit).

After He et al. 2016 (deep residual learning, CVPR), De & Smith 2020 (arXiv:2002.10444, SkipInit) and Lin et
al. 2017 (arXiv:1703.03130, several attentions over time).
"""

import itertools

import torch
from torch import Tensor, nn

from clearance.errors import InputError


class ResidualBlock(nn.Module):
    """Two convolutions, weighted by a scale that starts at zero, beside a shortcut; time over ``stride``."""

    def __init__(self, before: int, after: int, width: int, stride: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv1d(before, after, width, stride, padding=width // 2),
            nn.ReLU(),
            nn.Conv1d(after, after, width, padding=width // 2),
        )
        self.scale = nn.Parameter(torch.zeros(1))
        self.shortcut = nn.Conv1d(before, after, 1, stride)

    def forward(self, features: Tensor) -> Tensor:
        """(batch, before, time) -> (batch, after, time / stride)."""
        return torch.relu(self.scale * self.layers(features) + self.shortcut(features))


class TemporalConvolutions(nn.Module):
    """A strided residual network; several attentions over the remaining time lead to two dense layers.

    What a window says about the clearance it says at certain crank angles: where to look is learned.

    Args:
        channels: Channels of the input.
        length: Time steps of the input.
        outputs: Clearances that are estimated.
        stem: Filters of the first convolution, which sees ``stem_width`` steps.
        widths: Filters of each block.
        width: Time steps that a block's filters see.
        stem_width: Time steps that the first convolution sees.
        stem_stride: Division of time by the first convolution.
        attentions: Weighted means over time that are read out.
        hidden: Neurons of the last hidden layer.
    """

    def __init__(
        self,
        channels: int,
        length: int,
        outputs: int,
        stem: int = 64,
        widths: tuple[int, ...] = (96, 128, 160, 192),
        width: int = 5,
        stem_width: int = 9,
        stem_stride: int = 2,
        attentions: int = 8,
        hidden: int = 128,
    ) -> None:
        super().__init__()
        if width % 2 == 0:  # the shortcut of a block would be a step shorter
            raise InputError(f"model.net.width={width}: must be odd; set model.net.width")
        self.stem = nn.Sequential(
            nn.Conv1d(channels, stem, stem_width, stem_stride, padding=stem_width // 2), nn.ReLU()
        )
        sizes = [stem, *widths]
        self.blocks = nn.Sequential(
            *(ResidualBlock(a, b, width, stride=2) for a, b in itertools.pairwise(sizes))
        )
        self.attention = nn.Conv1d(sizes[-1], attentions, 1)
        self.output = nn.Sequential(
            nn.Linear(attentions * sizes[-1], hidden), nn.ReLU(), nn.Linear(hidden, outputs)
        )

    def forward(self, signals: Tensor) -> Tensor:
        """(batch, time, channel) scaled -> (batch, outputs) scaled clearances."""
        features = self.blocks(self.stem(signals.transpose(1, 2)))
        weights = torch.softmax(self.attention(features), dim=2)
        means = torch.einsum("bat,bft->baf", weights, features)
        return self.output(means.flatten(1))
