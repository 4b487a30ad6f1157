"""A force that repeats by a clock of its own: its period and where each recording begins in it."""

import numpy as np
import pytest

from clearance.diagnosis.kinematics.regression import cost_of, regressed
from clearance.diagnosis.kinematics.rhythm import Needed, find_rhythm

SCATTER = 0.01


def square(turns):
    return np.tanh(20.0 * np.sin(2.0 * np.pi * turns))


def sawtooth(turns):
    return 2.0 * (turns % 1.0) - 1.0


def uneven(turns):
    """Half a period resembles the other half: few harmonics show that, and not the period."""
    sizes = (0.05, 0.6, 0.05, 1.0, 0.6, 1.0)
    return sum(a * np.sin(2.0 * np.pi * (k + 1) * turns + k) for k, a in enumerate(sizes))


def needed(shape, period, begins, mean=0.0, bin_width=1e-3, seconds=0.5):
    """What recordings at two speeds lack; each begins elsewhere in the period."""
    noise, recordings, bins = np.random.default_rng(1), [], round(seconds / bin_width)
    for begin, speed in zip(begins, (73.0, 91.0), strict=True):
        time = bin_width * np.arange(bins)
        lever = 0.05 * np.sin(speed * time)
        force = 5.0 * shape((time + begin) / period) + mean
        torque = force * lever + 0.3 + SCATTER * noise.normal(size=bins)
        torque[noise.integers(0, bins, bins // 20)] += 3.0  # impacts that were understood wrongly
        recordings.append(Needed(time, lever, torque, np.column_stack([np.ones(bins), time])))
    return recordings


@pytest.mark.parametrize("shape", [square, sawtooth, lambda turns: np.sin(2.0 * np.pi * turns), uneven])
@pytest.mark.parametrize(("period", "mean"), [(0.021, 0.0), (0.083, 5.0), (0.24, 10.0)])
def test_the_period_of_a_force_and_the_clocks_of_recordings_are_found(shape, period, mean):
    found = find_rhythm(needed(shape, period, (0.4 * period, 0.7 * period), mean), SCATTER)
    assert abs(found.period / period - 1.0) * 0.5 / period < 0.03  # of a turn, over half a second
    assert found.clocks[0] == 0.0
    away = (found.clocks[1] / period - 0.3 + 0.5) % 1.0 - 0.5
    assert abs(away) < max(0.02, 7e-4 / period)  # less than a bin


def test_bins_of_five_milliseconds_tell_no_period_that_they_cannot_resolve():
    recordings = needed(np.cos, 0.1 / (2.0 * np.pi), (0.0, 0.004), bin_width=5e-3, seconds=2.0)
    assert find_rhythm(recordings, SCATTER).period > 2.0 * 5e-3
    slow = needed(square, 0.083, (0.0, 0.02), bin_width=5e-3, seconds=2.0)
    assert find_rhythm(slow, SCATTER).period == pytest.approx(0.083, rel=2e-3)


def test_recordings_that_are_too_short_have_no_rhythm():
    assert find_rhythm(needed(square, 0.02, (0.0, 0.01), bin_width=2e-4, seconds=0.0132), SCATTER) is None


def test_a_fit_is_not_moved_by_bins_that_are_far_off():
    columns = np.column_stack([np.ones(200), np.linspace(-1.0, 1.0, 200)])
    clean = columns @ [2.0, -3.0] + SCATTER * np.random.default_rng(2).normal(size=200)
    wrong = clean.copy()
    wrong[::8] += 5.0
    found = regressed(columns, wrong, SCATTER)
    np.testing.assert_allclose(found, [2.0, -3.0], atol=0.01)
    assert abs(np.linalg.lstsq(columns, wrong, rcond=None)[0][0] - 2.0) > 0.5  # what would be moved
    assert cost_of(clean - columns @ found, SCATTER) < 1.5 < cost_of(wrong - columns @ found, SCATTER)
