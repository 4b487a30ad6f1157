"""A source of recordings made in code: chirps whose frequency and level tell the clearance."""

import numpy as np
import pytest

from clearance.windows.sources import FixedSource, LabelledRecordings, check_memory


class Chirps(FixedSource):
    """Two or more channels in memory; ``spoil`` may change the recordings once they are divided."""

    def __init__(self, runs=20, samples=300, seed=0, rate=1e4):
        self.runs, self.samples, self.seed, self.rate = runs, samples, seed, rate
        self.spoil = None

    def load(self, channels, targets, limit):
        check_memory(self.runs * self.samples * len(channels) * 4, limit)
        rng = np.random.default_rng(self.seed)
        clearance = rng.uniform(0, 1e-3, self.runs)
        speed = rng.uniform(52, 105, self.runs)
        time = np.arange(self.samples)[None, :, None] / self.rate
        phase = rng.uniform(0, 6, (self.runs, 1, len(channels)))
        frequency = 200 + 1.5e6 * clearance[:, None, None]
        signals = (5 + 5e4 * clearance[:, None, None]) * np.sin(2 * np.pi * frequency * time + phase)
        signals += rng.normal(0, 0.5, signals.shape)
        # Half of them have clearance in B, of which the signals say nothing.
        labels = {"clearance_c": clearance, "clearance_b": clearance[::-1] * (np.arange(self.runs) % 2)}
        return LabelledRecordings(
            channels=tuple(channels),
            rate=self.rate,
            signals=signals.astype(np.float32).reshape(-1, len(channels)),
            lengths=np.full(self.runs, self.samples),
            target=np.stack([labels[name] for name in targets], axis=1),
            speed=speed,
            groups=np.arange(self.runs),
            fingerprint=f"chirps-{self.runs}-{self.samples}-{self.seed}",
        )

    def divide(self, recordings, split):
        parts = super().divide(recordings, split)
        if self.spoil:
            self.spoil(recordings, parts)
        return parts


@pytest.fixture
def chirps():
    """The class, to make sources of any size."""
    return Chirps
