"""Attempts beside recordings that they were not fitted to, and residuals in units of the noise."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.motion.attempt import Attempt, zeros_of
from clearance.diagnosis.motion.beginning import begin
from clearance.diagnosis.motion.fit import Fit, fit
from clearance.diagnosis.motion.model import Model
from clearance.diagnosis.motion.rest import Explained, explained
from clearance.diagnosis.motion.search import Search
from clearance.diagnosis.motion.track import Track

_DRAWS = 400  # of the interval
_BLOCKS = 20  # parts of the held-out recordings that are drawn


class Judged:
    """An attempt beside recordings that it was not fitted to.

    Only start, drive's speed and an encoder's zero are free, the zero within what is known of it: by the fit,
    where these are parts of the fitted recordings.
    """

    def __init__(
        self, attempt: Attempt, held_out: Sequence[Track], search: Search, speeds: tuple[float, float]
    ) -> None:
        model = attempt.fit.model
        machine, instrument = model.apply(attempt.fit.shared)
        self.tracks = [track.filtered(search.filtered) for track in search.cut(held_out)]
        zeros = zeros_of(attempt.fit, [track.name for track in search.tracks])
        known = all(track.name in zeros for track in self.tracks)
        deviation = max(one for _, one in zeros.values()) if known else model.zero_deviation
        fixed = Model(
            machine, model.joint, with_zero=model.with_zero, zero_deviation=deviation, instrument=instrument,
            known_clearance=model.clearance(attempt.fit.shared),
        )  # fmt: skip
        first = next(iter(zeros.values()))
        start = np.array([begin(track, speeds, zeros.get(track.name, first)[0]) for track in self.tracks])
        self.fit: Fit = fit(fixed, self.tracks, np.zeros(0), start, start, search.workers, staged=True)
        self.explained: Explained = explained(self.fit, self.tracks)

    def squares(self, noise: np.ndarray) -> np.ndarray:
        """(samples,) see ``squares``."""
        return squares(self.fit, self.tracks, self.explained, noise)

    def score(self, noise: np.ndarray) -> float:
        """Root mean square over the noise."""
        return float(np.sqrt(self.squares(noise).mean()))

    def interval(self, noise: np.ndarray) -> tuple[float, float]:
        """95 % interval of the score by drawing blocks (Kuensch 1989)."""
        generator = np.random.default_rng(0)
        squares = self.squares(noise)
        blocks = min(_BLOCKS, len(squares))
        means = np.array([part.mean() for part in np.array_split(squares, blocks)])
        drawn = means[generator.integers(0, blocks, (_DRAWS, blocks))].mean(axis=1)
        low, high = np.sqrt(np.quantile(drawn, [0.025, 0.975]))
        return float(low), float(high)


def scaled(found: Fit, tracks: Sequence[Track], about: Explained, noise: np.ndarray) -> list[np.ndarray]:
    """Residuals over the noise; channels that a recording lacks count as noise."""
    scaled, generator = [], np.random.default_rng(0)
    for track, rest in zip(tracks, found.residuals, strict=True):
        values = generator.standard_normal((len(rest), len(about.channels)))
        for i, channel in enumerate(about.channels):
            if channel in track.channels:
                values[:, i] = rest[:, track.channels.index(channel)] / noise[i]
        scaled.append(values)
    return scaled


def squares(found: Fit, tracks: Sequence[Track], about: Explained, noise: np.ndarray) -> np.ndarray:
    """(samples,) mean of squared residuals over noise, over the channels that each recording has."""
    means = []
    for track, rest in zip(tracks, scaled(found, tracks, about, noise), strict=True):
        present = [channel in track.channels for channel in about.channels]
        means.append((rest[:, present] ** 2).mean(axis=1))
    return np.concatenate(means)


def over(found: Fit, tracks: Sequence[Track], about: Explained) -> list[np.ndarray]:
    """Residuals over the noise that was found with them."""
    return scaled(found, tracks, about, about.noise)
