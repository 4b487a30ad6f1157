"""Which recordings train a model, choose its epoch and judge it: a split by recording, never by window.

Windows of one recording share its clearance, its speed and much of its noise; a split by window would let a
model recognise the recording. The paper (Section 4.2) splits 70/15/15 with the seeds 42, 98 and 1024.
"""

from dataclasses import dataclass

import numpy as np

from clearance.errors import InputError
from clearance.mechanism.parameters import require


@dataclass(frozen=True)
class Split:
    """Indices of recordings, disjoint."""

    train: np.ndarray  # (train recordings,)
    validation: np.ndarray  # (validation recordings,)
    test: np.ndarray  # (test recordings,)


@dataclass(frozen=True)
class RandomSplit:
    """Shuffle with ``seed`` and cut by the given shares; the test recordings are what remains."""

    seed: int = 42
    train: float = 0.70  # [-]
    validation: float = 0.15  # [-]

    def __post_init__(self) -> None:
        require(self, 0, 2**63, whole=True, seed=self.seed)
        require(self, 0.0, 1.0, train=self.train, validation=self.validation)
        if not (self.train > 0 and self.validation > 0 and self.train + self.validation < 1):
            raise InputError(
                f"data.split.train={self.train}, data.split.validation={self.validation}: both must be above "
                "0 and their sum below 1; set data.split.train and data.split.validation"
            )

    def divide(self, groups: np.ndarray) -> Split:
        """Divide recordings so that all members of a group fall on the same side.

        Args:
            groups: (recordings,) whole numbers; recordings of one machine and state share a number.

        Raises:
            InputError: Fewer than three groups, so that a side would be empty.
        """
        names, member = np.unique(np.asarray(groups), return_inverse=True)
        if len(names) < 3:
            raise InputError(
                f"{len(names)} independent recordings: at least 3 are needed to train, validate and test; "
                "set data to a larger set"
            )
        order = np.random.default_rng(self.seed).permutation(len(names))
        # Small sets: no side may be empty, whatever rounding says.
        train = min(max(1, round(self.train * len(names))), len(names) - 2)
        validation = min(max(1, round(self.validation * len(names))), len(names) - train - 1)
        rank = np.empty(len(names), dtype=np.int64)
        rank[order] = np.arange(len(names))
        place = rank[member]
        return Split(
            train=np.flatnonzero(place < train),
            validation=np.flatnonzero((place >= train) & (place < train + validation)),
            test=np.flatnonzero(place >= train + validation),
        )
