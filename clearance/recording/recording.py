"""One type for simulated and measured signals: named channels in SI units, sampled uniformly."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clearance.errors import InputError
from clearance.recording.bounds import listing, resembling
from clearance.recording.channels import CHANNELS, require_channel

SAME_RATE = 1e-3
"""Relative: clocks of real loggers are better than that."""

ONE_RATE = 1e-4
"""Relative: stamps of one clock differ by less, through rounding or where an end is counted twice."""

RATE_LIMITS = (
    20.0,
    1e6,
)  # Hz: below, no revolution is resolved; above, no accelerometer of this kind samples
SHORTEST = 2  # samples: fewer have no rate


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals of one run of one machine.

    Attributes:
        values: (samples, channels) float64, SI units, finite; seen as read-only.
        channels: the names of the columns, out of `clearance.recording.channels.CHANNELS`.
        rate: samples per second [Hz], 20 to 1e6.
        start_time: time of the first sample [s].
        metadata: what else is known: `chain` and `sensors` (declared measurement chain), true clearance,
            source, ...
    """

    values: NDArray[np.float64]
    channels: tuple[str, ...]
    rate: float
    start_time: float = 0.0
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = tuple(require_channel(name, "recording channels") for name in self.channels)
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(
                f"recording channels: {listing(twice)} occurs more than once; name each channel once"
            )
        low, high = RATE_LIMITS
        if not (math.isfinite(self.rate) and low <= self.rate <= high):
            raise InputError(
                f"rate: {self.rate:g} Hz is out of range; a recording has {low:g} to {high:g} Hz; "
                "correct the rate, or the unit of time"
            )
        if not math.isfinite(self.start_time):
            raise InputError(f"start_time: {self.start_time} is not a time; give a finite number of seconds")
        values = np.asarray(self.values, dtype=np.float64).view()
        if values.ndim != 2 or not names or values.shape[1] != len(names):
            raise InputError(
                f"recording values: shape {values.shape} does not fit {len(names)} channels; "
                "give (samples, channels) with at least one channel"
            )
        if len(values) < SHORTEST:
            raise InputError(f"recording: {len(values)} samples are too few; at least {SHORTEST} are needed")
        values.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "channels", names)
        object.__setattr__(self, "rate", float(self.rate))
        object.__setattr__(self, "start_time", float(self.start_time))
        object.__setattr__(self, "metadata", dict(self.metadata))
        self._require_finite()

    def _require_finite(self) -> None:
        # One pass over the usual, clean data; a sum would be faster but overflows for large finite values.
        bad = ~np.isfinite(self.values)
        if not bad.any():
            return
        column = int(np.flatnonzero(bad.any(axis=0))[0])
        row = int(np.flatnonzero(bad[:, column])[0])
        rest = int(np.count_nonzero(bad.any(axis=0))) - 1
        others = f"; so have {rest} other channels" if rest else ""
        raise InputError(
            f"channel {self.channels[column]!r} has {int(bad[:, column].sum())} values that are not finite, "
            f"the first ({self.values[row, column]}) in sample {row} at "
            f"{self.start_time + row / self.rate:.6g} s{others}; cut the recording or leave the channel out"
        )

    @property
    def time(self) -> NDArray[np.float64]:
        """(samples,) time of every sample [s]."""
        return self.start_time + np.arange(len(self.values)) / self.rate

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return (len(self.values) - 1) / self.rate

    def channel(self, name: str) -> NDArray[np.float64]:
        """Return the (samples,) values of one channel, read-only."""
        self._require([name])
        return self.values[:, self.channels.index(name)]

    def select(self, channels: Sequence[str]) -> "Recording":
        """Return the recording with these channels only, in this order."""
        self._require(channels)
        columns = [self.channels.index(name) for name in channels]
        chosen = np.ascontiguousarray(self.values[:, columns])
        return Recording(chosen, tuple(channels), self.rate, self.start_time, self.metadata)

    def _require(self, channels: Sequence[str]) -> None:
        missing = [name for name in channels if name not in self.channels]
        if not missing:
            return
        unknown = next((name for name in missing if name not in CHANNELS), None)
        hint = resembling(unknown, CHANNELS) if unknown else ""
        raise InputError(
            f"the recording has no channel {listing(missing)}{hint}; it has {listing(self.channels)}; "
            "choose `sensors` that it has, or name its columns under `columns:` in the YAML beside it"
        )


def at_one_rate(recordings: Mapping[str, Recording]) -> dict[str, Recording]:
    """Recordings by name, of one rate: their mean, where stamps differ by rounding alone.

    Raises:
        InputError: rates that differ by more than ``ONE_RATE``.
    """
    rates = {name: recording.rate for name, recording in recordings.items()}
    if len(set(rates.values())) < 2:
        return dict(recordings)
    mean = sum(rates.values()) / len(rates)
    if max(rates.values()) - min(rates.values()) > ONE_RATE * mean:
        listed = ", ".join(f"{name}: {rate:.9g} Hz" for name, rate in rates.items())
        raise InputError(
            f"recordings: their rates differ ({listed}); diagnose those of one rate together, or, where one "
            "clock made them, give `rate:` and `ignore: [time]` in a YAML beside each"
        )
    return {name: replace(recording, rate=mean) for name, recording in recordings.items()}
