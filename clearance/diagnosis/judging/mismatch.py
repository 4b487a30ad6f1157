"""Where a model and the recordings differ: by channel, crank angle, contact and frequency."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.sensing.measured import SAMPLES
from clearance.diagnosis.shooting.follow import EDGE
from clearance.simulation.layout import COORDINATES, State

ANGLE_BINS = 36
_NOTICED, _MOST = 0.1, 3  # of the mismatch that is worth a word; channels that are named
_DRAWS = 400  # of blocks, for an interval
_BLOCK = 128  # samples of a spectrum, fewer where there are fewer
_ALIKE = 3.0  # neighbouring samples share what the state did not foresee: as many count as one
_FALSE_DISCOVERIES = 0.05
_LOST = 1e6  # standard deviations: how far off a run counts that ends in no number
_SLIDING = 0.02  # m/s of the journal along the bearing's surface
_QUIET, _QUIET_SQUARE = 0.9, 0.975  # share of blocks that count, and their mean square where that of all is 1
_OWN_NOISE = 0.15  # of the square of the noise: what its estimate errs by, beside models that are right


@dataclass(frozen=True)
class Innovations:
    """One-step prediction errors of a model, with where the machine was.

    Attributes:
        values: (samples, channels) in standard deviations of a perfect model's innovations.
        angle: (samples,) crank angle [rad, 0 to 2 pi).
        contact: (samples,) whether the journal touches.
        sliding: (samples,) whether it touches and moves along the surface.
        channels: names.
        rate: [Hz].
    """

    values: np.ndarray
    angle: np.ndarray
    contact: np.ndarray
    sliding: np.ndarray
    channels: tuple[str, ...]
    rate: float


def whiteness(channels: Sequence[str], scaled: Sequence[np.ndarray]) -> dict[str, Any]:
    """Autocorrelation at ten lags and normalised innovation squared (Bar-Shalom et al. 2001, ch. 5).

    The square is of the quieter nine tenths of the blocks of ten samples, as is the held-out error; where a
    right model's lies, within 95 %, allows for what ten samples share and for the noise, whose size is taken
    from the recordings themselves.

    Args:
        channels: names.
        scaled: (samples, channels) of each recording, what a model leaves in units of its noise.
    """
    correlation: dict[str, list[float]] = {}
    for i, channel in enumerate(channels):
        total = max(sum(float((v[:, i] ** 2).sum()) for v in scaled), 1e-12)
        correlation[channel] = [
            sum(float((v[:-lag, i] * v[lag:, i]).sum()) for v in scaled) / total for lag in range(1, 11)
        ]
    each = np.concatenate([_block_squares(v) for v in scaled])
    half = np.hypot(1.96 * np.sqrt(2.0 / (len(each) * len(channels))), _OWN_NOISE)
    return {
        "channels": list(channels),
        "whiteness": [correlation[c][0] for c in channels],
        "autocorrelation": correlation,
        "normalised_innovation_squared": {
            "value": _quiet_square(each), "low": 1.0 - half, "high": 1.0 + half,
        },
    }  # fmt: skip


def innovations(attempt: Attempt, joint: str, floor: Attempt | None = None) -> list[Innovations]:
    """Innovations of each recording, over what a perfect model's would be: that of ``floor``, or its own."""
    found = []
    for r, (follower, one) in enumerate(zip(attempt.followers, attempt.fit.passes, strict=True)):
        inner = slice(EDGE + 1, -EDGE - 1)
        scale = attempt.scale if attempt.scale > 1.0 else 1.0
        spread = (floor.fit.passes[r] if floor is not None else one).spread
        typical = np.median(spread[inner], axis=(0, 1))
        values = one.innovation[inner] * scale / typical
        values = np.clip(np.nan_to_num(values, nan=_LOST, posinf=_LOST, neginf=-_LOST), -_LOST, _LOST)
        n, m, channels = values.shape
        nodes = follower.path.nodes[inner]
        steps = np.arange(m) / m * follower.measured.segment
        angle = nodes[:, State.CRANK_ANGLE, None] + nodes[:, State.CRANK_SPEED, None] * steps
        touching = one.contacts[inner][..., 0 if joint == "B" else 2] > 0.0
        pair = one.chart.journals[0 if joint == "B" else -1]  # C's is the last, where both are loose
        first, second = one.chart.rows[[pair[0], pair[1]]]
        ex, ey = nodes[:, first], nodes[:, second]
        vx, vy = nodes[:, COORDINATES + first], nodes[:, COORDINATES + second]
        gap = attempt.fit.values[r, 0]
        along = np.abs(ex * vy - ey * vx) / np.maximum(np.hypot(ex, ey), 1e-9) * gap
        sliding = touching & (along[:, None] > _SLIDING)
        found.append(
            Innovations(
                values.reshape(n * m, channels), np.mod(angle.ravel(), 2.0 * np.pi), touching.ravel(),
                sliding.ravel(), follower.measured.channels, follower.measured.chain.rate,
            )
        )  # fmt: skip
    return found


def root_mean_square(errors: Sequence[Innovations]) -> float:
    """Of all innovations but the tenth of the blocks that are worst in it: 1 for a perfect model."""
    return float(np.sqrt(_quiet_square(np.concatenate([_block_squares(one.values) for one in errors]))))


def _block_squares(values: np.ndarray) -> np.ndarray:
    """(blocks,) mean squares of blocks of a segment's length of (samples, channels)."""
    blocks = values[: len(values) // SAMPLES * SAMPLES].reshape(-1, SAMPLES * values.shape[1])
    squares: np.ndarray = (blocks**2).mean(axis=1)
    return squares


def _quiet_square(each: np.ndarray) -> float:
    """Mean of the quieter nine tenths of squares, 1 for noise: impacts that are met late are left out."""
    return float(np.sort(each)[: max(1, round(_QUIET * len(each)))].mean() / _QUIET_SQUARE)


def interval(errors: Sequence[Innovations]) -> tuple[float, float]:
    """95 % interval of ``root_mean_square`` by resampling blocks of ten segments (Kuensch 1989).

    Of fewer where there are not ten such blocks, or a recording is shorter than one.
    """
    generator = np.random.default_rng(0)
    squares = [_block_squares(one.values) for one in errors]
    length = max(1, min(10, sum(map(len, squares)) // 10, *map(len, squares)))
    rows = np.concatenate([each[: len(each) // length * length].reshape(-1, length) for each in squares])
    found = [
        np.sqrt(_quiet_square(rows[generator.integers(0, len(rows), len(rows))].ravel()))
        for _ in range(_DRAWS)
    ]
    low, high = np.quantile(found, [0.025, 0.975])
    return float(low), float(high)


def locate(before: Sequence[Innovations], after: Sequence[Innovations]) -> dict[str, Any]:
    """Maps of the mismatch for the report; a ratio of 1 is what a perfect model shows."""
    channels = before[0].channels
    first, significant = _heat(before)
    second, _ = _heat(after)
    frequency, level = _spectrum(before)
    _, level_after = _spectrum(after)
    return {
        "channels": list(channels),
        "crank_angle_deg": [(k + 0.5) * 360.0 / ANGLE_BINS for k in range(ANGLE_BINS)],
        "heat": first.tolist(),
        "heat_after": second.tolist(),
        "significant": significant.tolist(),
        "regimes": _regimes(before, channels),
        "regimes_after": _regimes(after, channels),
        "frequency_hz": frequency.tolist(),
        "spectrum": {c: level[i].tolist() for i, c in enumerate(channels)},
        "spectrum_after": {c: level_after[i].tolist() for i, c in enumerate(channels)},
    }


def _heat(errors: Sequence[Innovations]) -> tuple[np.ndarray, np.ndarray]:
    return heat([one.values for one in errors], [one.angle for one in errors], _ALIKE)


def heat(
    rests: Sequence[np.ndarray], angles: Sequence[np.ndarray], alike: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """(channels, ANGLE_BINS) root mean squares by crank angle, and which are too large for noise.

    Reference: Benjamini & Hochberg 1995, J. R. Stat. Soc. B 57(1), 289-300.

    Args:
        rests: (samples, channels) of each recording, what a model leaves in units of its noise.
        angles: (samples,) of the crank [rad].
        alike: neighbouring samples that count as one.
    """
    from scipy.stats import chi2

    channels = rests[0].shape[1]
    square, count = np.zeros((channels, ANGLE_BINS)), np.zeros(ANGLE_BINS)
    for rest, angle in zip(rests, angles, strict=True):
        place = (np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi) * ANGLE_BINS).astype(int) % ANGLE_BINS
        count += np.bincount(place, minlength=ANGLE_BINS)
        for i in range(channels):
            square[i] += np.bincount(place, rest[:, i] ** 2, minlength=ANGLE_BINS)
    tail = chi2.sf(square / alike, np.maximum(count / alike, 1e-9))
    order = np.sort(tail.ravel())
    passing = order <= _FALSE_DISCOVERIES * np.arange(1, order.size + 1) / order.size
    limit = order[passing].max() if passing.any() else -1.0
    return np.sqrt(square / np.maximum(count, 1.0)), tail <= limit


def _regimes(errors: Sequence[Innovations], channels: Sequence[str]) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    for i, channel in enumerate(channels):
        found[channel] = {}
        for name in ("contact", "flight", "sliding"):
            parts = []
            for one in errors:
                mask = {"contact": one.contact, "flight": ~one.contact, "sliding": one.sliding}[name]
                parts.append(one.values[mask, i] ** 2)
            joined = np.concatenate(parts)
            if len(joined) > 20:
                found[channel][name] = float(np.sqrt(joined.mean()))
    return found


def _spectrum(errors: Sequence[Innovations]) -> tuple[np.ndarray, np.ndarray]:
    return spectrum([one.values for one in errors], errors[0].rate)


def spectrum(rests: Sequence[np.ndarray], rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and (channels, frequencies) amplitude over that of the noise (Welch 1967)."""
    size = min(_BLOCK, *(len(rest) for rest in rests))
    window = np.hanning(size)
    power = []
    for rest in rests:
        blocks = len(rest) // size
        frames = rest[: blocks * size].reshape(blocks, size, -1) * window[:, None]
        power.append(np.abs(np.fft.rfft(frames, axis=1)) ** 2 / (window**2).sum())
    return np.fft.rfftfreq(size, 1.0 / rate), np.sqrt(np.concatenate(power).mean(axis=0).T)


def noticed(shares: Mapping[str, float]) -> list[str]:
    """Channels that have enough of the mismatch to be worth a word, the loudest first.

    Args:
        shares: of the mismatch, by channel; as ``channels`` of ``summary``.
    """
    loud = [c for c, share in sorted(shares.items(), key=lambda each: -each[1]) if share > _NOTICED]
    return loud[:_MOST]


def summary(errors: Sequence[Innovations]) -> dict[str, Any]:
    """Channels' shares, the regime, and the ranges of angle and frequency that stand out."""
    channels = errors[0].channels
    stacked = np.concatenate([one.values for one in errors])
    excess = np.maximum((stacked**2).mean(axis=0) - 1.0, 0.0)
    share = excess / max(excess.sum(), 1e-12)
    by_angle, _ = _heat(errors)
    total = np.sqrt((by_angle**2).mean(axis=0))
    loud = total > max(1.3, 0.5 * total.max())
    width = 360.0 / ANGLE_BINS
    frequency, amplitude = _spectrum(errors)
    level = np.sqrt((amplitude**2).mean(axis=0))
    high = level > max(1.3, 0.3 * level.max())
    states = {}
    for name in ("contact", "flight", "sliding"):
        values = [v[name] for v in _regimes(errors, channels).values() if name in v]
        if values:
            states[name] = float(np.sqrt(np.mean(np.square(values))))
    loudest = max(states, key=lambda s: states[s]) if states else "all"
    everywhere = "all" if "flight" in states else "contact"  # of a joint that never opened
    spread = max(states.values()) / max(min(states.values()), 1e-9) if states else 1.0
    return {
        "channels": {c: round(float(s), 4) for c, s in zip(channels, share, strict=True) if s > 0.005},
        "regime": loudest if spread > 2.0 else everywhere,
        "crank_angle_deg": [[a * width, b * width] for a, b in ranges(loud)],
        "frequency_hz": [
            [float(frequency[a]), float(frequency[min(b, len(frequency) - 1)])] for a, b in ranges(high)
        ],
    }


def ranges(mask: np.ndarray) -> list[tuple[int, int]]:
    """Where a mask is true: the first of each run, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
