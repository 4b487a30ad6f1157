"""Attempts beside recordings that they were not fitted to, and residuals in units of the noise."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.motion.attempt import Attempt
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

    Only start, drive's speed and an encoder's zero that is not known are free.
    """

    def __init__(
        self, attempt: Attempt, held_out: Sequence[Track], search: Search, speeds: tuple[float, float]
    ) -> None:
        model = attempt.fit.model
        machine, instrument = model.apply(attempt.fit.shared)
        fixed = Model(
            machine, model.joint, with_zero=model.with_zero, instrument=instrument,
            known_clearance=model.clearance(attempt.fit.shared),
        )  # fmt: skip
        self.tracks = [track.filtered(search.filtered) for track in search.cut(held_out)]
        zeros = {track.name: own[4] for track, own in zip(search.tracks, attempt.fit.own, strict=True)}
        start = np.array(
            [begin(track, speeds, zeros.get(track.name, attempt.fit.own[0, 4])) for track in self.tracks]
        )
        self.fit: Fit = fit(fixed, self.tracks, np.zeros(0), start, start, search.workers, staged=True)
        self.explained: Explained = explained(self.fit, self.tracks)

    def squares(self, noise: np.ndarray) -> np.ndarray:
        """(samples,) mean over channels of squared residuals over noise."""
        return np.concatenate(
            [(r**2).mean(axis=1) for r in scaled(self.fit, self.tracks, self.explained, noise)]
        )

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
    scaled = []
    for track, rest in zip(tracks, found.residuals, strict=True):
        values = np.ones((len(rest), len(about.channels)))
        for i, channel in enumerate(about.channels):
            if channel in track.channels:
                values[:, i] = rest[:, track.channels.index(channel)] / noise[i]
        scaled.append(values)
    return scaled


def over(found: Fit, tracks: Sequence[Track], about: Explained) -> list[np.ndarray]:
    """Residuals over the noise that was found with them."""
    return scaled(found, tracks, about, about.noise)
