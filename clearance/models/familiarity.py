"""Does a recording look like those the model was trained on? Levels and spectra, against the nearest of them.

A network answers whatever it is shown. Trust is refused to a recording that lies farther from the training
recordings than almost all recordings of the same kind do; how rarely that happens to a good one is stated.
"""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import signal

from clearance.models.interval import conformal_quantile

_BANDS = 8
_NEIGHBOURS = 5
_MOST_REFERENCES = 500  # bounds the file; more bring the nearest ones hardly nearer
_FLOOR = 1e-8  # scaled units squared: a band without energy
_STILL = 1e-3  # of a channel that was constant in training, in its unit: more is another constant, or none


@dataclass(frozen=True)
class Familiarity:
    """Distance in the space of features to the nearest training recordings, and how far is too far.

    Attributes:
        channels: Names of the channels.
        varying: Whether each channel varied in training (channels,).
        rate: Sampling rate [Hz].
        length: Time steps of a window, the shortest recording that can be judged.
        scale: Standard deviation of each feature over the training recordings (features,).
        references: Features of training recordings (recordings, features).
        windows: Lengths of recording in windows for which a limit is known.
        limits: Largest distance of a familiar recording at each.
        false_rejection: Share of recordings like the calibration ones that are refused [-].
    """

    channels: tuple[str, ...]
    varying: tuple[bool, ...]
    rate: float
    length: int
    scale: np.ndarray
    references: np.ndarray
    windows: tuple[int, ...]
    limits: tuple[float, ...]
    false_rejection: float

    def __post_init__(self) -> None:
        features = len(self.channels) * (_BANDS + 2)
        if self.scale.shape != (features,) or self.references.shape[1:] != (features,):
            raise ValueError(f"the references have not {features} features")

    @classmethod
    def calibrate(
        cls,
        channels: tuple[str, ...],
        varying: tuple[bool, ...],
        rate: float,
        length: int,
        training: Sequence[np.ndarray],
        calibration: Sequence[np.ndarray],
        false_rejection: float = 0.02,
        machines: np.ndarray | None = None,
    ) -> "Familiarity":
        """Take references from training recordings, limits from others; each (samples, channels) scaled.

        Of ``calibration`` (recordings,) ``machines`` says whose each is; ``None``: each of another one.
        """
        step = -(-len(training) // _MOST_REFERENCES)
        references = np.array([features(r, length, rate) for r in training[::step]])
        # A feature that hardly varies in training must not turn round-off into distance.
        scale = np.maximum(references.std(axis=0), 0.02)
        most = min(len(r) for r in calibration) // length
        table = [2**k for k in range(most.bit_length()) if 2**k < most] + [most]
        # With few machines the wanted share cannot be promised: the largest distance gives 1/(n + 1).
        count_of_machines = len(calibration) if machines is None else len(np.unique(machines))
        share = max(false_rejection, 1 / (count_of_machines + 1))
        draft = cls(
            channels, varying, rate, length, scale, references, tuple(table), (np.inf,) * len(table), share
        )
        limits = []
        for count in table:
            scores = [draft._distance(features(r[: count * length], length, rate))[0] for r in calibration]
            limit = conformal_quantile(np.array(scores), 1 - share, machines)
            limits.append(max(scores) if limit is None else limit)
        return cls(channels, varying, rate, length, scale, references, tuple(table), tuple(limits), share)

    def judge(self, recording: np.ndarray) -> tuple[bool, str]:
        """Whether to trust (samples, channels) scaled samples, and why not in plain words."""
        if not np.isfinite(recording).all():
            return False, "holds NaN or infinite samples"
        levels, deviations = recording.mean(axis=0), recording.std(axis=0)
        for name, varies, level, value in zip(
            self.channels, self.varying, levels, deviations, strict=True
        ):  # a constant channel is centred and not divided: [channel's unit]
            if not varies and value > _STILL:
                return (
                    False,
                    f"{name} was constant in training and varies here (standard deviation {value:.3g})",
                )
            if not varies and abs(level) > _STILL:
                return False, f"{name} was constant in training and lies {level:+.3g} from there here"
        place = max(int(np.searchsorted(self.windows, len(recording) // self.length, side="right")) - 1, 0)
        distance, gap = self._distance(features(recording, self.length, self.rate))
        if distance <= self.limits[place]:
            return True, "looks like the training recordings"
        worst = int(np.argmax(np.abs(gap)))
        return False, self._explain(worst, float(gap[worst]) * float(self.scale[worst]))

    def to_json(self) -> dict[str, Any]:
        """Plain numbers; features to five digits, far below their scatter."""
        return {
            **asdict(self),
            "scale": [float(f"{v:.5g}") for v in self.scale],
            "references": [[float(f"{v:.5g}") for v in row] for row in self.references],
        }

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> "Familiarity":
        """Inverse of ``to_json``."""
        plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in content.items()}
        return cls(
            **{**plain, "scale": np.array(content["scale"]), "references": np.array(content["references"])}
        )

    def _distance(self, feature: np.ndarray) -> tuple[float, np.ndarray]:
        """Root mean square gap to the mean of the nearest references, in training deviations, and the gap."""
        relevant = np.repeat(np.array(self.varying), _BANDS + 2)
        gaps = np.where(relevant, (feature - self.references) / self.scale, 0.0)
        squares = np.square(gaps).sum(axis=1)
        nearest = np.argsort(squares)[:_NEIGHBOURS]
        gap = gaps[nearest].mean(axis=0)
        return float(np.sqrt(np.square(gap).sum() / max(relevant.sum(), 1))), gap

    def _explain(self, feature: int, gap: float) -> str:
        channel, kind = divmod(feature, _BANDS + 2)
        name = self.channels[channel]
        if kind == 0:
            return (
                f"{name} has another mean level than the nearest training recordings ({gap:+.2g} deviations)"
            )
        more = "more" if gap > 0 else "less"
        if kind == 1:
            word = "stronger" if gap > 0 else "weaker"
            return f"{name} is {abs(gap) * 10:.1f} dB {word} than the nearest training recordings"
        edges = _edges(self.length // 2 + 1) * self.rate / self.length
        low, high = edges[kind - 2], edges[kind - 1]
        return (
            f"{name} carries {abs(gap) * 10:.1f} dB {more} energy at {low:.0f}-{high:.0f} Hz "
            "than the nearest training recordings"
        )


def features(recording: np.ndarray, length: int, rate: float) -> np.ndarray:
    """Mean, log10 power and log10 band powers of each channel: (samples, channels) -> (channels * 10,)."""
    _, density = signal.welch(recording, rate, nperseg=length, axis=0, detrend="constant")
    edges = _edges(len(density))
    bands = np.stack([density[a:b].sum(axis=0) for a, b in itertools.pairwise(edges)])
    bands *= rate / length  # density to power
    power = recording.var(axis=0)
    logs = np.log10(np.vstack([power[None], bands]) + _FLOOR)
    return np.vstack([recording.mean(axis=0)[None], logs]).T.ravel()


def _edges(lines: int) -> np.ndarray:
    """Boundaries of the bands among ``lines`` spectral lines, about equally wide on a logarithmic axis."""
    edges = np.geomspace(1, lines, _BANDS + 1).round().astype(int)
    return np.maximum.accumulate(np.maximum(edges, np.arange(1, _BANDS + 2)))
