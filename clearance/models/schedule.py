"""How the learning rate changes over a training."""

import math
from dataclasses import dataclass
from typing import Protocol

from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR, LRScheduler

from clearance.mechanism.parameters import require


class Schedule(Protocol):
    """Makes a scheduler that is stepped after every batch."""

    def build(self, optimizer: Optimizer, steps: int) -> LRScheduler:
        """Scheduler for ``steps`` batches."""
        ...


@dataclass(frozen=True)
class ConstantRate:
    """The optimiser's own rate, throughout."""

    def build(self, optimizer: Optimizer, steps: int) -> LRScheduler:
        """A factor of one."""
        return LambdaLR(optimizer, lambda step: 1.0)


@dataclass(frozen=True)
class OneCycle:
    """Up to the optimiser's rate, then down to nearly nothing, both along a cosine.

    PyTorch's own divides by zero where the warm-up is shorter than two steps.
    Reference: Smith & Topin 2019, Super-convergence, SPIE 11006.
    """

    warmup: float = 0.2  # share of the training in which the rate rises [-]
    start: float = 0.04  # first rate as a share of the highest [-]
    end: float = 1e-4  # last rate as a share of the highest [-]

    def __post_init__(self) -> None:
        require(self, 0.0, 0.99, warmup=self.warmup)  # of all of it nothing would be left to fall in
        require(self, 0.0, 1.0, start=self.start, end=self.end)

    def factor(self, progress: float) -> float:
        """Share of the highest rate when a share ``progress`` of the training is done."""
        if progress < self.warmup:
            return _cosine(self.start, 1.0, progress / self.warmup)
        return _cosine(1.0, self.end, min((progress - self.warmup) / (1 - self.warmup), 1.0))

    def build(self, optimizer: Optimizer, steps: int) -> LRScheduler:
        """One cycle over ``steps`` batches."""
        return LambdaLR(optimizer, lambda step: self.factor(step / max(steps, 1)))


def _cosine(first: float, last: float, progress: float) -> float:
    return last + (first - last) * (1 + math.cos(math.pi * progress)) / 2
