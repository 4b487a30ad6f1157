"""A trained estimator as an instrument: from a recording to clearances, their intervals and trust."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clearance.errors import InputError
from clearance.mechanism.parameters import require
from clearance.models.estimator import Estimator
from clearance.models.familiarity import Familiarity
from clearance.models.interval import ConformalInterval, robust_mean, spread
from clearance.models.location import choose_threshold
from clearance.recording.bounds import require_single
from clearance.recording.chain import chain_differences, declared_chain
from clearance.recording.position import elsewhere
from clearance.recording.recording import SAME_RATE
from clearance.whole_files import read_json, write_json
from clearance.windows.datamodule import TARGETS, WindowData
from clearance.windows.scaling import Scalers
from clearance.windows.window_set import WindowSet

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Estimate:
    """What a recording says about the clearance of one joint."""

    joint: str  # B or C
    clearance_m: float
    low_m: float
    high_m: float
    spread_m: float  # robust standard deviation of the windows
    windows: int
    trusted: bool
    reason: str
    has_clearance: bool | None  # None: the model takes it for granted


@dataclass(frozen=True)
class Calibration:
    """What a calibration promises.

    Attributes:
        coverage: Share of recordings whose interval holds the clearance [-].
        false_rejection: Share of familiar recordings that may be called unfamiliar [-].
        limit: Largest clearance the gauge is made for [m]; that of its data where it is larger.
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
    """An estimator with what belongs to it.

    Attributes:
        estimator: gives the windows' clearances.
        scalers: of its inputs and outputs.
        targets: names of the clearances that it gives.
        intervals: one a target.
        thresholds: one a target, above which a joint is said to have clearance [m]; ``None`` of one target:
            where the clearance is was known.
        familiarity: with its training.
        chain: of measurement, in training.
        positions: of the accelerometers along their links, in training [m]; of others nobody knows.
    """

    estimator: Estimator
    scalers: Scalers
    targets: tuple[str, ...]
    intervals: tuple[ConformalInterval, ...]
    thresholds: tuple[float, ...] | None
    familiarity: Familiarity
    chain: Mapping[str, Any]
    positions: Mapping[str, float]

    def __post_init__(self) -> None:
        thresholds = self.targets if self.thresholds is None else self.thresholds
        each = (self.scalers.target.low, self.intervals, thresholds)
        if self.targets not in TARGETS or any(len(one) != len(self.targets) for one in each):
            raise ValueError(f"scalers, intervals and thresholds are not those of {self.targets}")

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
            limit: Largest clearance the gauge is made for [m]; that of the data where it is larger.
        """
        scalers, recordings, tests = data.scalers, data.recordings, np.sort(data.parts.test)
        machines = recordings.groups[tests]
        limit = max(limit, float(recordings.target.max()))
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
            [recordings.recording(int(i)) for i in tests],
            false_rejection,
            machines,
        )
        intervals, thresholds = [], []
        for place in range(len(data.targets)):
            own, others = (
                [(values[:, place], float(truth[place])) for values, truth in part]
                for part in (validation, test)
            )
            intervals.append(ConformalInterval.calibrate(own, others, coverage, limit, machines))
            points, loose = np.array([point(each) for each, _ in own]), np.array([t > 0.0 for _, t in own])
            thresholds.append(choose_threshold(points, loose, limit))
        if any(one.quantiles[-1] is None for one in intervals):
            log.warning(
                "%d recordings of %d machines are too few for an interval that holds %.0f %% of the time: it "
                "is the whole range; calibration.coverage=%.2f and less is possible",
                len(tests), len(np.unique(machines)), 100.0 * coverage,
                np.floor(100.0 * (1.0 - 1.0 / (len(np.unique(machines)) + 1))) / 100.0,
            )  # fmt: skip
        return cls(
            estimator, scalers, data.targets, tuple(intervals),
            tuple(thresholds) if len(thresholds) > 1 else None, familiarity, recordings.chain,
            {name: place for name, place in recordings.positions.items() if name in data.channels},
        )  # fmt: skip

    def estimate(
        self,
        signals: np.ndarray,
        rate: float,
        chain: Mapping[str, Any] | None = None,
        positions: Mapping[str, float] | None = None,
    ) -> tuple[Estimate, ...]:
        """Estimate the clearances from a recording, one a target.

        Args:
            signals: (samples, channels) in the order of ``channels`` [channels' units].
            rate: Its sampling rate [Hz].
            chain: Its measurement chain as it declares it.
            positions: Of its accelerometers along their links, as it declares them [m].
        """
        known = self.familiarity
        if abs(rate / known.rate - 1) > SAME_RATE:
            raise InputError(
                f"sampled at {rate:g} Hz: the model reads {known.rate:g} Hz (within {SAME_RATE:.1%}); "
                "resample the recording, or train with its rate: chain.decimation, chain.base_rate"
            )
        if len(signals) < known.length:
            raise InputError(
                f"{len(signals)} samples: at least {known.length} are needed "
                f"({known.length / known.rate:g} s); give a longer recording"
            )
        if not np.isfinite(signals).all():
            raise InputError("holds NaN or infinite samples: finite values are needed; repair the recording")
        with np.errstate(over="ignore"):
            scaled = self.scalers.signals.transform(signals)
        require_single(scaled, signals, self.channels)
        windows = WindowSet.side_by_side(scaled, np.array([len(scaled)]), known.length, len(self.targets))
        values = estimate_windows(self.estimator, self.scalers, windows)
        if not np.isfinite(values).all():
            worst = int(np.abs(scaled).max(axis=0).argmax())
            raise InputError(
                f"{self.channels[worst]} reaches {np.abs(signals[:, worst]).max():g}: so far from what the "
                "model was trained on that it answers with no number; repair the recording"
            )
        trusted, reason = known.judge(scaled)
        differences = [chain_differences(chain, self.chain, known.rate), *self._moved(positions or {})]
        if any(differences):
            trusted, reason = False, "; ".join(filter(None, [*differences, "" if trusted else reason]))
        loose = self.loose(np.array([point(own) for own in values.T]))
        return tuple(
            Estimate(
                joint, point(own), *interval.bounds(own), spread(own), len(own), trusted, reason,
                None if loose is None else bool(loose[place]),
            )
            for place, (joint, own, interval) in enumerate(
                zip(self.joints, values.T, self.intervals, strict=True)
            )
        )  # fmt: skip

    def _moved(self, positions: Mapping[str, float]) -> list[str]:
        return [
            f"sensor {name} is at {positions[name]:g} m, the model was trained with {self.positions[name]:g}"
            for name in elsewhere(positions, self.positions)
        ]

    def loose(self, points: np.ndarray) -> np.ndarray | None:
        """Which joints have clearance by their estimates (..., targets) [m]; ``None`` where it is known."""
        return None if self.thresholds is None else points > np.array(self.thresholds)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints whose clearances are estimated."""
        return tuple(name.removeprefix("clearance_").upper() for name in self.targets)

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
                "targets": self.targets,
                "intervals": [interval.to_json() for interval in self.intervals],
                "thresholds": self.thresholds,
                "familiarity": self.familiarity.to_json(),
                "chain": dict(self.chain),
                "positions": dict(self.positions),
            },
        )

    @classmethod
    def load(cls, estimator: Estimator, folder: Path) -> "Gauge":
        """Read what ``save`` wrote into an untrained ``estimator`` of the same configuration."""
        estimator.load(folder)
        calibration = read_json(folder / "calibration.json")
        try:
            thresholds = calibration["thresholds"]
            return cls(
                estimator,
                Scalers.from_json(read_json(folder / "scalers.json")),
                tuple(calibration["targets"]),
                tuple(ConformalInterval.from_json(one) for one in calibration["intervals"]),
                None if thresholds is None else tuple(map(float, thresholds)),
                Familiarity.from_json(calibration["familiarity"]),
                declared_chain(calibration.get("chain")),
                {name: float(place) for name, place in dict(calibration.get("positions", {})).items()},
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{folder}: not the calibration of a training ({error}); set checkpoint"
            ) from error


def estimate_windows(estimator: Estimator, scalers: Scalers, windows: WindowSet) -> np.ndarray:
    """Clearances (windows, targets) [m] that each window gives."""
    return scalers.target.inverse(estimator.predict(windows))


def by_recording(
    values: np.ndarray, windows: WindowSet, truth: np.ndarray
) -> Sequence[tuple[np.ndarray, np.ndarray]]:
    """Estimates (windows, targets) of each recording's windows with its true clearances (targets,) [m]."""
    recording = windows.recording.numpy()
    return [(values[recording == index], truth[index]) for index in np.unique(recording)]


def point(values: np.ndarray) -> float:
    """The clearance [m] that the windows' estimates (windows,) [m] of one joint give: never negative."""
    return max(robust_mean(values), 0.0)
