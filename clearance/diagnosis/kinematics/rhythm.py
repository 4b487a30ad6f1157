"""A force that repeats by a clock of its own: its period, and where in it each recording begins.

What a fan beside the machine, a press next door or an uneven supply does to it knows nothing of the crank. In
the balance of work (``searching.balance``) such a force is linear in its Fourier series once the period is
known. All periods are tried, each recording with a series of its own, since nobody knows when it began;
recordings at different speeds agree on the period alone where the crank is not the clock. Then one series is
shared, and each recording's clock is set by where its own series lies in it.

Reference: epoch folding and harmonic fits, Schwarzenberg-Czerny 1996, ApJ 460, L107-L110.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from clearance.diagnosis.kinematics.regression import cost_of, regressed

_FASTEST, _RESOLVED = 120.0, 0.33  # Hz, and of the rate of the bins
_WITHIN, _LONGER = 1000, 3000  # bins of each recording that find the period, and that settle it
_LONGEST = 0.5  # of the longest recording: what comes once is no rhythm
_COARSE, _FINE, _SHARED = 3, 6, 12  # harmonics that find the period, tell it from others, and settle it
_FINER = 12.0  # steps of the frequency in one over the longest recording
_CLOSER = 6  # frequencies that are looked at closely
_PARTS = np.array([1.0, 2.0, 3.0])  # and of them, since few harmonics may show a part of the period best
_MULTIPLE, _NO_WORSE = 4, 1.2  # times the frequency that leave no more than that share are the period's own
_TURNS = 240  # places in a period at which series are compared


@dataclass(frozen=True)
class Needed:
    """What one recording lacks, and through which lever the force sought would give it.

    Attributes:
        time: (bins,) by the recording's own clock [s].
        lever: (bins,) generalised force for a unit of the force sought.
        torque: (bins,) needed [N m].
        offsets: (bins, offsets) torques that are not known anyway.
    """

    time: np.ndarray
    lever: np.ndarray
    torque: np.ndarray
    offsets: np.ndarray

    def part(self, bins: int) -> "Needed":
        """Its first bins alone."""
        return Needed(self.time[:bins], self.lever[:bins], self.torque[:bins], self.offsets[:bins])


@dataclass(frozen=True)
class Rhythm:
    """A period [s], and what a clock shared by all recordings shows where each begins [s]."""

    period: float
    clocks: tuple[float, ...]


def find_rhythm(recordings: Sequence[Needed], scatter: float) -> Rhythm | None:
    """The period with which a force explains most of what recordings lack, and their clocks.

    ``None`` where they are too short for any.

    Args:
        recordings: what each lacks.
        scatter: of a bin [N m].
    """
    settling = [one.part(_LONGER) for one in recordings]
    recordings = [one.part(_WITHIN) for one in recordings]
    longest = max(float(np.ptp(one.time)) for one in recordings)
    apart_from = float(np.diff(recordings[0].time[:2])[0])

    def apart(frequency: float, harmonics: int) -> float:
        left = [one.torque - columns @ found for one, columns, found in _each(frequency, harmonics)]
        return cost_of(np.concatenate(left), scatter)

    def _each(frequency: float, harmonics: int) -> list[tuple[Needed, np.ndarray, np.ndarray]]:
        each = []
        resolved = min(harmonics, int(0.5 / (frequency * apart_from)))
        for one in recordings:
            series = _series(frequency * one.time, resolved)
            columns = np.column_stack([series * one.lever[:, None], one.lever, one.offsets])
            each.append((one, columns, regressed(columns, one.torque, scatter)))
        return each

    step = 1.0 / (_FINER * longest)
    fastest = min(_FASTEST, _RESOLVED / apart_from)
    frequencies = np.arange(1.0 / (_LONGEST * longest), fastest, step)
    if not len(frequencies):
        return None
    costs = np.array([apart(f, _COARSE) for f in frequencies])
    dips = [i for i in np.argsort(costs) if costs[i] <= costs[max(i - 1, 0) : i + 2].min()][:_CLOSER]
    looked = (frequencies[dips][:, None] / _PARTS).ravel()
    near = looked[looked >= frequencies[0]][:, None] + step * np.linspace(-1.0, 1.0, 9)
    closer = {float(f): apart(f, _FINE) for f in near.ravel()}
    best = min(closer, key=lambda f: closer[f])
    for multiple in range(_MULTIPLE, 1, -1):
        if multiple * best < fastest and apart(multiple * best, _FINE) < _NO_WORSE * closer[best]:
            best *= multiple
            break
    # each recording's own series, against that of the first one
    places = np.arange(_TURNS) / _TURNS
    profiles = []
    for one, columns, found in _each(best, _FINE):
        count = columns.shape[1] - 1 - one.offsets.shape[1]
        profiles.append(_series(places, count // 2) @ found[:count])
    ahead = [
        int(np.argmax([np.roll(profile, k) @ profiles[0] for k in range(_TURNS)])) / _TURNS
        for profile in profiles[1:]
    ]

    def together(frequency: float, ahead: np.ndarray) -> float:
        return cost_of(_left(settling, frequency, [0.0, *ahead], scatter), scatter)

    scale = np.array([step, *[1.0 / _TURNS] * len(ahead)])
    begun = np.array([best, *ahead])
    found = minimize(
        lambda x: together(best + scale[0] * x[0], begun[1:] + scale[1:] * x[1:]), np.zeros(len(begun)),
        method="Nelder-Mead",
        options={
            "maxfev": 60 * len(begun), "xatol": 0.02, "fatol": 1e-4,
            "initial_simplex": np.vstack([np.zeros(len(begun)), np.eye(len(begun))]),
        },
    )  # fmt: skip
    frequency, *ahead = begun + scale * found.x
    return Rhythm(float(1.0 / frequency), (0.0, *(float(one % 1.0 / frequency) for one in ahead)))


def _left(
    recordings: Sequence[Needed], frequency: float, ahead: Sequence[float], scatter: float
) -> np.ndarray:
    """(bins of all recordings,) left by one series that all share, some of a period ahead in each."""
    own = 1 + sum(one.offsets.shape[1] for one in recordings)
    rows, begin = [], 1
    resolved = int(0.5 / (frequency * max(one.time[1] - one.time[0] for one in recordings)))
    for one, lead in zip(recordings, ahead, strict=True):
        offsets = np.zeros((len(one.time), own))
        offsets[:, 0] = one.lever
        offsets[:, begin : begin + one.offsets.shape[1]] = one.offsets
        begin += one.offsets.shape[1]
        series = _series(frequency * one.time + lead, min(_SHARED, resolved)) * one.lever[:, None]
        rows.append(np.column_stack([series, offsets]))
    columns, torque = np.concatenate(rows), np.concatenate([one.torque for one in recordings])
    return torque - columns @ regressed(columns, torque, scatter)


def _series(turns: np.ndarray, harmonics: int) -> np.ndarray:
    """(places, 2 harmonics) cosines and sines at places in a period."""
    angle = 2.0 * np.pi * turns[:, None] * np.arange(1, harmonics + 1)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
