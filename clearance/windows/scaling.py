"""Scales of the network's inputs and output, fitted on training recordings only (paper, Section 4.2)."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from torch import Tensor

from clearance.errors import InputError

# Below this standard deviation [channel's unit] a channel is constant: the round-off of a channel whose
# value is zero by construction, not a signal. Accelerometers resolve nothing under 1e-6 m/s².
CONSTANT = 1e-6
_BLOCK = 1 << 18  # samples at a time: bounds the memory of double-precision sums


@dataclass(frozen=True)
class StandardScaler:
    """Zero mean and unit standard deviation per channel; a constant channel is only centred."""

    channels: tuple[str, ...]
    mean: tuple[float, ...]  # (channels,) [channel's unit]
    deviation: tuple[float, ...]  # (channels,) [channel's unit], 1 where constant
    constant: tuple[bool, ...]  # (channels,)

    def __post_init__(self) -> None:
        numbers = np.array([self.mean, self.deviation, self.constant], dtype=np.float64)
        if numbers.shape != (3, len(self.channels)) or not np.isfinite(numbers).all():
            raise ValueError("the scaler of the signals has not three finite numbers a channel")

    @classmethod
    def fit(cls, channels: tuple[str, ...], recordings: list[np.ndarray]) -> "StandardScaler":
        """Fit on recordings, each (samples, channels)."""
        samples, total = 0, np.zeros(len(channels))
        for block in _blocks(recordings):
            samples += len(block)
            total += block.sum(axis=0, dtype=np.float64)
        mean = total / max(samples, 1)
        square = np.zeros(len(channels))
        for block in _blocks(recordings):
            square += np.square(block - mean, dtype=np.float64).sum(axis=0)
        deviation = np.sqrt(square / max(samples, 1))
        if not np.all(np.isfinite(deviation)):
            bad = [name for name, value in zip(channels, deviation, strict=True) if not np.isfinite(value)]
            raise InputError(
                f"channels {bad} hold NaN or infinite samples: finite values are needed; check data"
            )
        constant = deviation < CONSTANT
        return cls(
            channels,
            tuple(mean.tolist()),
            tuple(np.where(constant, 1.0, deviation).tolist()),
            tuple(constant.tolist()),
        )

    def apply(self, signals: np.ndarray) -> None:
        """Scale (samples, channels) in place: a second copy of the data set would double the memory."""
        signals -= np.asarray(self.mean, dtype=signals.dtype)
        signals /= np.asarray(self.deviation, dtype=signals.dtype)

    def transform(self, signals: np.ndarray) -> np.ndarray:
        """Scaled copy of (samples, channels)."""
        scaled = np.array(signals, dtype=np.float32)
        self.apply(scaled)
        return scaled


@dataclass(frozen=True)
class MinMaxScaler:
    """Each target's training range mapped to 0 ... 1."""

    low: tuple[float, ...]  # (targets,) [m]
    high: tuple[float, ...]  # (targets,) [m]

    def __post_init__(self) -> None:
        numbers = np.array([self.low, self.high], dtype=np.float64)
        if numbers.ndim != 2 or not np.isfinite(numbers).all():
            raise ValueError("the scaler of the targets has not two finite numbers a target")

    @classmethod
    def fit(cls, values: np.ndarray) -> "MinMaxScaler":
        """Fit on the training labels (recordings, targets) [m]."""
        low, high = values.min(axis=0), values.max(axis=0)
        if not np.all(high > low):
            raise InputError(
                f"all training clearances of a joint are {low[high <= low][0]:g} m: at least two different "
                "values are needed; train on more recordings (runs), or on others (joint, data)"
            )
        return cls(tuple(low.tolist()), tuple(high.tolist()))

    def transform(self, values: np.ndarray) -> np.ndarray:
        """Metres (..., targets) to 0 ... 1 on the training range."""
        return (values - self._low) / self._range

    def inverse(self, values: np.ndarray) -> np.ndarray:
        """0 ... 1 to metres (..., targets)."""
        return self._low + values * self._range

    def metres(self, scaled: Tensor) -> Tensor:
        """``inverse`` of a network's outputs, in their precision and on their device."""
        return scaled.new_tensor(self._low) + scaled * scaled.new_tensor(self._range)

    @property
    def _low(self) -> np.ndarray:
        return np.array(self.low)

    @property
    def _range(self) -> np.ndarray:
        return np.array(self.high) - np.array(self.low)


@dataclass(frozen=True)
class Scalers:
    """Both scalers of a model, as plain numbers that survive JSON exactly."""

    signals: StandardScaler
    target: MinMaxScaler

    def to_json(self) -> dict[str, Any]:
        """Plain lists and numbers."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> "Scalers":
        """Inverse of ``to_json``."""
        signals, target = (
            {key: tuple(value) for key, value in content[part].items()} for part in ("signals", "target")
        )
        return cls(StandardScaler(**signals), MinMaxScaler(**target))


def _blocks(recordings: list[np.ndarray]) -> list[np.ndarray]:
    return [r[i : i + _BLOCK] for r in recordings for i in range(0, len(r), _BLOCK)]
