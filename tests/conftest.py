"""What many tests need: recordings made in code, commands that must refuse, a finished training."""

import re

import numpy as np
import pytest

from clearance.windows.sources import FixedSource, LabelledRecordings, check_memory
from tests.command_line import TREES, call, launch


class Chirps(FixedSource):
    """Chirps whose frequency and level tell the clearance, of two or more channels.

    ``spoil`` may change the recordings once they are divided.
    """

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


@pytest.fixture
def refused(monkeypatch, capfd, tmp_path):
    """Call a command that must refuse, with one line that matches."""
    monkeypatch.chdir(tmp_path)

    def check(name, words, *overrides):
        code, error = call(monkeypatch, capfd, name, *overrides, "hydra.run.dir=run")
        assert code == 2, error
        # a simulation's bar is no part of the message
        lines = [line for line in error.splitlines() if line.strip() and not line.startswith("simulating")]
        assert len(lines) == 1, error
        assert lines[0].startswith("error: ")
        assert re.search(words, lines[0]), error

    return check


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """A folder with a finished training in ``run``, of ``TREES``; to be copied before it is changed."""
    home = tmp_path_factory.mktemp("trained")
    done = launch("train", *TREES, "hydra.run.dir=run", folder=home)
    assert done.returncode == 0, done.stderr
    return home
