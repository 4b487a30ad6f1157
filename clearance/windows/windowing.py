"""Where windows start: the cut of a recording into the fixed-length pieces that a model sees.

Second stop of the flow recording -> windows -> models. The paper (Section 4.2) cuts 10 000 samples into 50
windows of 200 that do not overlap; training may instead draw its windows anywhere, freshly every epoch.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from clearance.mechanism.parameters import require


class WindowPlan(Protocol):
    """Chooses the first sample of every window."""

    @property
    def length(self) -> int:
        """Samples in a window."""
        ...

    def starts(self, samples: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Place windows on recordings of ``samples`` (recordings,) samples each.

        Returns:
            First samples (windows,) from their recording's start, and the recordings' indices (windows,).
        """
        ...


@dataclass(frozen=True)
class RegularWindows:
    """Windows every ``stride`` samples from the first one on; the remainder at the end is not used."""

    length: int = 200  # [samples]
    stride: int = 200  # [samples]

    def __post_init__(self) -> None:
        require(self, 1, whole=True, length=self.length)
        require(self, 1, whole=True, stride=self.stride)

    def count(self, samples: int) -> int:
        """Windows in a recording of ``samples`` samples: floor((samples - length) / stride) + 1, or none."""
        return max(0, (samples - self.length) // self.stride + 1)

    def starts(self, samples: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Place windows regularly; ``rng`` is not used."""
        counts = np.array([self.count(int(n)) for n in samples], dtype=np.int64)
        recording = np.repeat(np.arange(len(counts)), counts)
        first = np.repeat(np.cumsum(counts) - counts, counts)
        return (np.arange(counts.sum()) - first) * self.stride, recording


@dataclass(frozen=True)
class RandomWindows:
    """As many windows as fit side by side, each at a random place: an augmentation, for training only.

    A window's phase against the crank becomes arbitrary, so that a model cannot learn the grid of the cut.
    """

    length: int = 200  # [samples]
    density: float = 1.0  # windows per ``length`` samples of recording [-]

    def __post_init__(self) -> None:
        require(self, 1, whole=True, length=self.length)
        require(self, 0.0, 1e3, strict=True, density=self.density)

    def starts(self, samples: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Place windows uniformly at random, from ``rng`` alone."""
        room = np.maximum(np.asarray(samples) - self.length + 1, 0)
        counts = np.where(room > 0, np.maximum(1, np.rint(samples / self.length * self.density)), 0)
        recording = np.repeat(np.arange(len(counts)), counts.astype(np.int64))
        return np.floor(rng.random(len(recording)) * room[recording]).astype(np.int64), recording
