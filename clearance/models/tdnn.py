"""Time-delay network: three convolutions over time and one of three aggregations (paper, Section 4.4.2)."""

import itertools
from collections.abc import Callable

from torch import Tensor, nn


class FlattenHead(nn.Module):
    """All time steps of all filters side by side, 512 neurons, sigmoid: the paper's best aggregation."""

    def __init__(self, filters: int, length: int, outputs: int, neurons: int = 512) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Flatten(),
            nn.Linear(filters * length, neurons),
            nn.ReLU(),
            nn.Linear(neurons, outputs),
            nn.Sigmoid(),
        )

    def forward(self, features: Tensor) -> Tensor:
        """(batch, filter, time) -> (batch, outputs)."""
        return self.layers(features)


class AverageHead(nn.Module):
    """Mean over time of each filter, one linear layer, sigmoid."""

    def __init__(self, filters: int, length: int, outputs: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(filters, outputs), nn.Sigmoid())

    def forward(self, features: Tensor) -> Tensor:
        """(batch, filter, time) -> (batch, outputs)."""
        return self.layers(features.mean(dim=2))


class MaxHead(nn.Module):
    """Maximum over time of each filter, one linear layer, sigmoid."""

    def __init__(self, filters: int, length: int, outputs: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(filters, outputs), nn.Sigmoid())

    def forward(self, features: Tensor) -> Tensor:
        """(batch, filter, time) -> (batch, outputs)."""
        return self.layers(features.amax(dim=2))


class TimeDelayNetwork(nn.Module):
    """Convolutions over time, each followed by ReLU, then an aggregation over time.

    Equation (12) with the window centred: the edges are padded by zeros, so that 200 steps stay 200.

    Args:
        channels: Channels of the input.
        length: Time steps of the input.
        outputs: Clearances that are estimated.
        head: Makes the aggregation from the numbers of filters, of time steps and of outputs.
        filters: Filters of each convolution.
        layers: Number of convolutions.
        width: Time steps that a filter sees.
    """

    def __init__(
        self,
        channels: int,
        length: int,
        outputs: int,
        head: Callable[[int, int, int], nn.Module],
        filters: int = 256,
        layers: int = 3,
        width: int = 5,
    ) -> None:
        super().__init__()
        sizes = [channels] + [filters] * layers
        steps: list[nn.Module] = []
        for before, after in itertools.pairwise(sizes):
            steps += [nn.Conv1d(before, after, width, padding="same"), nn.ReLU()]
        self.convolutions = nn.Sequential(*steps)
        self.head = head(filters, length, outputs)

    def forward(self, signals: Tensor) -> Tensor:
        """(batch, time, channel) scaled -> (batch, outputs) scaled clearances."""
        return self.head(self.convolutions(signals.transpose(1, 2)))
