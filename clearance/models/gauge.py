"""A trained estimator as an instrument: from a recording to one clearance, its interval and trust."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from clearance.errors import InputError
from clearance.mechanism.parameters import require
from clearance.models.estimator import Estimator
from clearance.models.familiarity import Familiarity
from clearance.models.interval import ConformalInterval, robust_mean, spread
from clearance.recording.chain import chain_differences, declared_chain
from clearance.whole_files import read_json, write_json
from clearance.windows.datamodule import WindowData
from clearance.windows.scaling import Scalers
from clearance.windows.window_set import WindowSet
from clearance.windows.windowing import RegularWindows


@dataclass(frozen=True)
class Estimate:
    """What a recording says about the clearance."""

    clearance_m: float
    low_m: float
    high_m: float
    spread_m: float  # robust standard deviation of the windows
    windows: int
    trusted: bool
    reason: str


@dataclass(frozen=True)
class Calibration:
    """What a calibration promises.

    Attributes:
        coverage: Share of recordings whose interval holds the clearance [-].
        false_rejection: Share of familiar recordings that may be called unfamiliar [-].
        limit: Largest clearance the gauge is made for [m].
    """

    coverage: float = 0.9
    false_rejection: float = 0.02
    limit: float = 1e-3

    def __post_init__(self) -> None:
        require(self, 0.01, 0.999, coverage=self.coverage)
        require(self, 0.001, 0.5, false_rejection=self.false_rejection)
        require(self, 0.0, 1.0, strict=True, limit=self.limit)


@dataclass
class Gauge:
    """An estimator with the scalers, interval and familiarity that belong to it."""

    estimator: Estimator
    scalers: Scalers
    interval: ConformalInterval
    familiarity: Familiarity
    chain: Mapping[str, Any]  # of measurement, in training

    @classmethod
    def calibrate(
        cls, estimator: Estimator, data: WindowData, coverage: float, false_rejection: float, limit: float
    ) -> "Gauge":
        """Calibrate on the test recordings, which neither the training nor the choice of an epoch has seen.

        Args:
            estimator: Trained on ``data``.
            data: Set up.
            coverage: Of the interval [-].
            false_rejection: Share of familiar recordings that may be called unfamiliar [-].
            limit: Largest clearance the gauge is made for [m].
        """
        scalers, recordings = data.scalers, data.recordings
        validation, test = (
            by_recording(estimate_windows(estimator, scalers, part), part, recordings.target)
            for part in (data.validation_windows(), data.test_windows())
        )
        familiarity = Familiarity.calibrate(
            data.channels,
            tuple(not constant for constant in scalers.signals.constant),
            recordings.rate,
            data.windows.length,
            [recordings.recording(int(i)) for i in data.parts.train],
            [recordings.recording(int(i)) for i in data.parts.test],
            false_rejection,
        )
        interval = ConformalInterval.calibrate(validation, test, coverage, limit)
        return cls(estimator, scalers, interval, familiarity, recordings.chain)

    def estimate(self, signals: np.ndarray, rate: float, chain: Mapping[str, Any] | None = None) -> Estimate:
        """Estimate the clearance from a recording.

        Args:
            signals: (samples, channels) in the order of ``channels`` [channels' units].
            rate: Its sampling rate [Hz].
            chain: Its measurement chain as it declares it.
        """
        known = self.familiarity
        if abs(rate / known.rate - 1) > 1e-3:  # clocks of real loggers are better than that
            raise InputError(
                f"sampled at {rate:g} Hz: the model reads {known.rate:g} Hz (within 0.1 %); resample the "
                "recording or train with its rate"
            )
        if len(signals) < known.length:
            raise InputError(
                f"{len(signals)} samples: at least {known.length} are needed "
                f"({known.length / known.rate:g} s); give a longer recording"
            )
        if not np.isfinite(signals).all():
            raise InputError("holds NaN or infinite samples: finite values are needed; repair the recording")
        scaled = self.scalers.signals.transform(signals)
        starts, place = RegularWindows(known.length, known.length).starts(
            np.array([len(scaled)]), np.random.default_rng(0)
        )
        windows = WindowSet(
            torch.from_numpy(scaled),
            torch.from_numpy(starts),
            torch.from_numpy(place),
            torch.zeros(len(starts)),
            known.length,
        )
        values = estimate_windows(self.estimator, self.scalers, windows)
        low, high = self.interval.bounds(values)
        trusted, reason = known.judge(scaled)
        if differences := chain_differences(declared_chain(chain), self.chain):
            trusted, reason = False, differences if trusted else f"{differences}; {reason}"
        point = max(robust_mean(values), 0.0)
        return Estimate(point, low, high, spread(values), len(values), trusted, reason)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that a recording must have."""
        return self.scalers.signals.channels

    def save(self, folder: Path) -> None:
        """Write the model's file, ``scalers.json`` and ``calibration.json``."""
        self.estimator.save(folder)
        write_json(folder / "scalers.json", self.scalers.to_json())
        write_json(
            folder / "calibration.json",
            {
                "interval": self.interval.to_json(),
                "familiarity": self.familiarity.to_json(),
                "chain": dict(self.chain),
            },
        )

    @classmethod
    def load(cls, estimator: Estimator, folder: Path) -> "Gauge":
        """Read what ``save`` wrote into an untrained ``estimator`` of the same configuration."""
        estimator.load(folder)
        calibration = read_json(folder / "calibration.json")
        try:
            return cls(
                estimator,
                Scalers.from_json(read_json(folder / "scalers.json")),
                ConformalInterval.from_json(calibration["interval"]),
                Familiarity.from_json(calibration["familiarity"]),
                declared_chain(calibration.get("chain")),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{folder}: not the calibration of a training ({error}); set checkpoint"
            ) from error


def estimate_windows(estimator: Estimator, scalers: Scalers, windows: WindowSet) -> np.ndarray:
    """Clearance (windows,) [m] that each window gives."""
    return scalers.target.inverse(estimator.predict(windows))


def by_recording(
    values: np.ndarray, windows: WindowSet, truth: np.ndarray
) -> Sequence[tuple[np.ndarray, float]]:
    """Estimates of each recording's windows with its true clearance [m]."""
    recording = windows.recording.numpy()
    return [(values[recording == index], float(truth[index])) for index in np.unique(recording)]
