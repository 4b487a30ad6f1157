"""Counts of an encoder, and errors of rounding that stand still."""

import numpy as np
import pytest

from clearance.diagnosis.sensing.encoder import ENCODER_COUNTS, encoder_counts, rounding_noise

COUNT = 2.0 * np.pi / ENCODER_COUNTS
SAMPLES = 2048


def rounded(per_sample, generator, shaken=4.0):
    """An angle [rad] that begins anywhere within a count, and what rounding did to it [counts]."""
    k = np.arange(SAMPLES)
    phase, start = generator.uniform(0.0, 2.0 * np.pi), generator.uniform()
    angle = per_sample * k + shaken * np.sin(2.0 * np.pi * k / 700.0 + phase) + start
    return np.round(angle) * COUNT, np.round(angle) - angle


def test_an_encoder_is_known_by_its_counts():
    angle = np.linspace(0.3, 90.0, 700) ** 1.1
    assert encoder_counts(np.round(angle / (2.0 * np.pi) * 1024.0) * 2.0 * np.pi / 1024.0) == 1024
    assert encoder_counts(angle) is None


@pytest.mark.parametrize("per_sample", [0.62, 5.577, 6.713])
def test_rounding_is_white_noise_where_the_crank_turns_by_an_arbitrary_part_of_a_count(per_sample):
    angle, _ = rounded(per_sample, np.random.default_rng(0))
    assert rounding_noise(angle, ENCODER_COUNTS) == pytest.approx(COUNT / np.sqrt(12.0), rel=0.15)


@pytest.mark.parametrize("per_sample", [4.0, 4.004, 4.05])
def test_where_it_stands_still_it_is_as_uncertain_as_means_are_seen_to_be(per_sample):
    generator = np.random.default_rng(1)
    every = [rounded(per_sample, generator) for _ in range(300)]
    errors = np.array([error for _, error in every])
    seen = COUNT * max(
        np.sqrt(length * (errors.reshape(-1, length).mean(axis=1) ** 2).mean())
        for length in (4, 16, 64, 256, 1024)
    )
    said = np.median([rounding_noise(angle, ENCODER_COUNTS) for angle, _ in every[:40]])
    assert said > 1.5 * COUNT / np.sqrt(12.0)
    assert 0.8 * seen < said < 2.0 * seen


def test_a_recording_too_short_to_smooth_has_the_noise_of_a_count():
    assert rounding_noise(COUNT * np.array([0.0, 4.0, 8.0]), ENCODER_COUNTS) == pytest.approx(
        COUNT / np.sqrt(12.0)
    )
