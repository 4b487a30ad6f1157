"""Where a model and the recordings differ: by channel, crank angle, contact and frequency."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
_FAR = 30.0  # standard deviations, beyond which more says no more of where
_LOST = 1e6  # standard deviations: how far off a run counts that ends in no number
_SLIDING = 0.02  # m/s of the journal along the bearing's surface
_STATES = ("contact", "flight", "sliding")  # of the joint
_ENOUGH = 20  # samples of a state that is worth a number
_QUIET = 0.9  # share of blocks that count
_OWN_NOISE = 0.15  # of the square of the noise: what its estimate errs by, beside models that are right


@dataclass(frozen=True)
class Innovations:
    """One-step prediction errors of a model, with where the machine was.

    Attributes:
        values: (samples, channels) in standard deviations of a perfect model's innovations; NaN where a
            channel does not say what it felt, as beyond its limit.
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
        total = max(sum(float(np.nansum(v[:, i] ** 2)) for v in scaled), 1e-12)
        correlation[channel] = [
            sum(float(np.nansum(v[:-lag, i] * v[lag:, i])) for v in scaled) / total for lag in range(1, 11)
        ]
    each = _block_squares(scaled)
    half = np.hypot(1.96 * np.sqrt(2.0 / (len(each) * len(channels))), _OWN_NOISE)
    return {
        "channels": list(channels),
        "whiteness": [correlation[c][0] for c in channels],
        "autocorrelation": correlation,
        "normalised_innovation_squared": {
            "value": _quiet_square(each, len(channels)), "low": 1.0 - half, "high": 1.0 + half,
        },
    }  # fmt: skip


def innovations(attempt: Attempt, joint: str, floor: Attempt | None = None) -> list[Innovations]:
    """Innovations of each recording, over what a perfect model's would be: that of ``floor``, or its own.

    Where ``floor`` was followed on another stretch it is the typical one of its.
    """
    found = []
    for r, (follower, one) in enumerate(zip(attempt.followers, attempt.fit.passes, strict=True)):
        inner = slice(EDGE + 1, -EDGE - 1)
        scale = attempt.scale if attempt.scale > 1.0 else 1.0
        spread = (floor.fit.passes[r] if floor is not None else one).spread
        if spread.shape != one.innovation.shape:
            spread = np.broadcast_to(np.median(spread[inner], axis=(0, 1)), one.innovation.shape)
        values = one.innovation[inner] * scale / spread[inner]
        values = np.clip(np.nan_to_num(values, nan=_LOST, posinf=_LOST, neginf=-_LOST), -_LOST, _LOST)
        # not what is infinitely far off, whose weight is none, too
        values[(one.used[inner] == 0.0) & np.isfinite(one.innovation[inner])] = np.nan
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
    values = _values(errors)
    return float(np.sqrt(_quiet_square(_block_squares(values), values[0].shape[1])))


def _block_squares(rests: Sequence[np.ndarray]) -> np.ndarray:
    """(blocks,) mean squares of blocks of a segment's length of (samples, channels) of each recording."""
    found = []
    for values in rests:
        blocks = values[: len(values) // SAMPLES * SAMPLES].reshape(-1, SAMPLES * values.shape[1])
        known = (~np.isnan(blocks)).sum(axis=1)
        found.append((np.nansum(blocks**2, axis=1) / np.maximum(known, 1))[known > 0])
    return np.concatenate(found)


def _quiet_square(each: np.ndarray, channels: int) -> float:
    """Mean of the quieter nine tenths of squares, 1 for noise: impacts that are met late are left out.

    Of noise a square of n numbers is chi-squared with n degrees of freedom over n, of which the mean below
    its quantile q is F(q; n + 2) over the share below (Johnson, Kotz & Balakrishnan 1994, ch. 18).
    """
    from scipy.stats import chi2

    n = SAMPLES * channels
    floor = chi2.cdf(chi2.ppf(_QUIET, n), n + 2) / _QUIET
    return float(np.sort(each)[: max(1, round(_QUIET * len(each)))].mean() / floor)


def interval(errors: Sequence[Innovations]) -> tuple[float, float]:
    """95 % interval of ``root_mean_square`` by resampling blocks of ten segments (Kuensch 1989).

    Of fewer where there are not ten such blocks, or a recording is shorter than one.
    """
    generator = np.random.default_rng(0)
    squares, channels = [_block_squares([one.values]) for one in errors], errors[0].values.shape[1]
    length = max(1, min(10, sum(map(len, squares)) // 10, *map(len, squares)))
    rows = np.concatenate([each[: len(each) // length * length].reshape(-1, length) for each in squares])
    found = [
        np.sqrt(_quiet_square(rows[generator.integers(0, len(rows), len(rows))].ravel(), channels))
        for _ in range(_DRAWS)
    ]
    low, high = np.quantile(found, [0.025, 0.975])
    return float(low), float(high)


def locate(before: Sequence[Innovations], after: Sequence[Innovations]) -> dict[str, Any]:
    """Maps of the mismatch for the report; a ratio of 1 is what a perfect model shows."""
    channels = before[0].channels
    first, second = (by_angle(_values(errors), _angles(errors)) for errors in (before, after))
    states, states_after = _by_state(before), _by_state(after)
    (frequency, tones), (_, tones_after) = _by_tone(before), _by_tone(after)
    # rounding comes again and again as a crank turns: an encoder has tones of its own
    rounded = np.array([[channel == "crank_angle"] for channel in channels])
    told = Cells(tones.square, np.where(rounded, 0.0, tones.count))
    angles, pressed, ringing = too_large([first, states, told], _ALIKE)
    return {
        "channels": list(channels),
        "crank_angle_deg": [(k + 0.5) * 360.0 / ANGLE_BINS for k in range(ANGLE_BINS)],
        "heat": first.level.tolist(),
        "heat_after": second.level.tolist(),
        "significant": angles.tolist(),
        "regimes": _named(states, channels),
        "regimes_after": _named(states_after, channels),
        "significant_regimes": {
            c: [name for j, name in enumerate(_STATES) if pressed[i, j]] for i, c in enumerate(channels)
        },
        "frequency_hz": frequency.tolist(),
        "spectrum": {c: tones.level[i].tolist() for i, c in enumerate(channels)},
        "spectrum_after": {c: tones_after.level[i].tolist() for i, c in enumerate(channels)},
        "significant_spectrum": {c: ringing[i].tolist() for i, c in enumerate(channels)},
    }


@dataclass(frozen=True)
class Cells:
    """What a model leaves in cells, channels by places.

    Attributes:
        square: (channels, places) sum of squares in units of the noise.
        count: (channels, places) numbers that were added up.
    """

    square: np.ndarray
    count: np.ndarray

    @property
    def level(self) -> np.ndarray:
        """(channels, places) root mean squares, 1 for a perfect model; 0 where nothing is known."""
        return np.sqrt(self.square / np.maximum(self.count, 1.0))


def too_large(panels: Sequence[Cells], alike: float = 1.0) -> list[np.ndarray]:
    """Of each panel (channels, places), where more is left than noise leaves; of all one in twenty is wrong.

    The noise's size is taken from the recordings themselves, so that it may be larger than it seems.

    Reference: Benjamini & Hochberg 1995, J. R. Stat. Soc. B 57(1), 289-300.

    Args:
        panels: of the same recordings.
        alike: neighbouring samples that count as one.
    """
    from scipy.stats import chi2

    each = alike * (1.0 + _OWN_NOISE)
    tails = [
        np.where(one.count > 0, chi2.sf(one.square / each, np.maximum(one.count / alike, 1e-9)), 1.0)
        for one in panels
    ]
    order = np.sort(np.concatenate([tail.ravel() for tail in tails]))
    passing = order <= _FALSE_DISCOVERIES * np.arange(1, order.size + 1) / order.size
    limit = order[passing].max() if passing.any() else -1.0
    return [tail <= limit for tail in tails]


def by_angle(rests: Sequence[np.ndarray], angles: Sequence[np.ndarray]) -> Cells:
    """Channels by ``ANGLE_BINS`` of the crank angle.

    Args:
        rests: (samples, channels) of each recording, what a model leaves in units of its noise.
        angles: (samples,) of the crank [rad].
    """
    shape = rests[0].shape[1], ANGLE_BINS
    square, count = np.zeros(shape), np.zeros(shape)
    for rest, angle in zip(rests, angles, strict=True):
        place = (np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi) * ANGLE_BINS).astype(int) % ANGLE_BINS
        for i, values in enumerate(rest.T):
            known = ~np.isnan(values)
            count[i] += np.bincount(place[known], minlength=ANGLE_BINS)
            square[i] += np.bincount(place[known], values[known] ** 2, minlength=ANGLE_BINS)
    return Cells(square, count)


def _by_state(errors: Sequence[Innovations]) -> Cells:
    """Channels by contact, flight and sliding."""
    values = np.concatenate(_values(errors))
    contact = np.concatenate([one.contact for one in errors])
    sliding = np.concatenate([one.sliding for one in errors])
    masks = np.stack([contact, ~contact, sliding]).astype(float)
    known = ~np.isnan(values)
    return Cells((masks @ np.where(known, values, 0.0) ** 2).T, (masks @ known).T)


def _named(states: Cells, channels: Sequence[str]) -> dict[str, dict[str, float]]:
    """Levels of the states of which enough is known."""
    return {
        channel: {
            name: float(states.level[i, j]) for j, name in enumerate(_STATES) if states.count[i, j] > _ENOUGH
        }
        for i, channel in enumerate(channels)
    }


def _by_tone(errors: Sequence[Innovations]) -> tuple[np.ndarray, Cells]:
    return by_tone(_values(errors), errors[0].rate)


def by_tone(rests: Sequence[np.ndarray], rate: float) -> tuple[np.ndarray, Cells]:
    """Frequencies [Hz], and channels by these (Welch 1967).

    Of noise the two parts of each block's amplitude are as one number each; at both ends of the range one.
    """
    size = min(_BLOCK, *(len(rest) for rest in rests))
    window = np.hanning(size)
    power = []
    for rest in rests:
        blocks = len(rest) // size
        frames = np.nan_to_num(rest[: blocks * size]).reshape(blocks, size, -1) * window[:, None]
        power.append(np.abs(np.fft.rfft(frames, axis=1)) ** 2 / (window**2).sum())
    each = np.concatenate(power)
    frequency = np.fft.rfftfreq(size, 1.0 / rate)
    parts = np.where((frequency == 0.0) | (frequency == 0.5 * rate), 1.0, 2.0) * len(each)
    count = np.broadcast_to(parts, (each.shape[2], len(frequency)))
    return frequency, Cells(each.mean(axis=0).T * count, count)


def _values(errors: Sequence[Innovations]) -> list[np.ndarray]:
    return [one.values for one in errors]


def _angles(errors: Sequence[Innovations]) -> list[np.ndarray]:
    return [one.angle for one in errors]


def noticed(shares: Mapping[str, float]) -> list[str]:
    """Channels that have enough of the mismatch to be worth a word, the loudest first.

    Args:
        shares: of the mismatch, by channel; as ``channels`` of ``summary``.
    """
    loud = [c for c, share in sorted(shares.items(), key=lambda each: -each[1]) if share > _NOTICED]
    return loud[:_MOST]


def summary(errors: Sequence[Innovations]) -> dict[str, Any]:
    """Channels' shares, the regime, and the ranges of angle and frequency that stand out.

    How far off a path is where it is lost says nothing of where something is missing.
    """
    errors = [replace(one, values=np.clip(one.values, -_FAR, _FAR)) for one in errors]
    channels = errors[0].channels
    stacked = np.concatenate(_values(errors))
    known = np.maximum((~np.isnan(stacked)).sum(axis=0), 1)
    excess = np.maximum(np.nansum(stacked**2, axis=0) / known - 1.0, 0.0)
    share = excess / max(excess.sum(), 1e-12)
    total = np.sqrt((by_angle(_values(errors), _angles(errors)).level ** 2).mean(axis=0))
    loud = total > max(1.3, 0.5 * total.max())
    width = 360.0 / ANGLE_BINS
    frequency, tones = _by_tone(errors)
    level = np.sqrt((tones.level**2).mean(axis=0))
    high = level > max(1.3, 0.3 * level.max())
    states, levels = {}, _named(_by_state(errors), channels)
    for name in _STATES:
        values = [v[name] for v in levels.values() if name in v]
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
