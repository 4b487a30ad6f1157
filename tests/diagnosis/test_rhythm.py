"""A force that repeats by a clock of its own: its period and where each recording begins in it."""

import numpy as np
import pytest

from clearance.diagnosis.regression import cost_of, regressed
from clearance.diagnosis.rhythm import Needed, find_rhythm

SCATTER = 0.01


def square(turns):
    return np.tanh(20.0 * np.sin(2.0 * np.pi * turns))


def sawtooth(turns):
    return 2.0 * (turns % 1.0) - 1.0


def needed(shape, period, begins, seed=1):
    """What recordings of half a second at two speeds lack; each begins elsewhere in the period."""
    noise, recordings = np.random.default_rng(seed), []
    for begin, speed in zip(begins, (73.0, 91.0), strict=True):
        time = 1e-3 * np.arange(500)
        lever = 0.05 * np.sin(speed * time)
        torque = 5.0 * shape((time + begin) / period) * lever + 0.3 + SCATTER * noise.normal(size=500)
        torque[noise.integers(0, 500, 25)] += 3.0  # impacts that were understood wrongly
        recordings.append(Needed(time, lever, torque, np.column_stack([np.ones(500), time])))
    return recordings


@pytest.mark.parametrize("shape", [square, sawtooth, lambda turns: np.sin(2.0 * np.pi * turns)])
@pytest.mark.parametrize("period", [0.021, 0.083, 0.24])
def test_the_period_of_a_force_and_the_clocks_of_recordings_are_found(shape, period):
    found = find_rhythm(needed(shape, period, (0.4 * period, 0.7 * period)), SCATTER)
    assert abs(found.period / period - 1.0) * 0.5 / period < 0.03  # of a turn, over half a second
    assert found.clocks[0] == 0.0
    away = (found.clocks[1] / period - 0.3 + 0.5) % 1.0 - 0.5
    assert abs(away) < 0.02


def test_a_fit_is_not_moved_by_bins_that_are_far_off():
    columns = np.column_stack([np.ones(200), np.linspace(-1.0, 1.0, 200)])
    clean = columns @ [2.0, -3.0] + SCATTER * np.random.default_rng(2).normal(size=200)
    wrong = clean.copy()
    wrong[::8] += 5.0
    found = regressed(columns, wrong, SCATTER)
    np.testing.assert_allclose(found, [2.0, -3.0], atol=0.01)
    assert abs(np.linalg.lstsq(columns, wrong, rcond=None)[0][0] - 2.0) > 0.5  # what would be moved
    assert cost_of(clean - columns @ found, SCATTER) < 1.5 < cost_of(wrong - columns @ found, SCATTER)
