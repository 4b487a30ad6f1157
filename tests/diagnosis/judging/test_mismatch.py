"""Innovations as numbers that can be written, whatever became of the run."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.mismatch import (
    ANGLE_BINS,
    heat,
    innovations,
    interval,
    root_mean_square,
    spectrum,
)
from clearance.diagnosis.sensing.measured import SAMPLES
from clearance.diagnosis.shooting.chart import Chart
from clearance.diagnosis.shooting.follow import EDGE
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.layout import STATES

SEGMENTS, CHANNELS = 60, ("rod_b_axial", "rod_c_axial")


def attempt(values, spread):
    """What ``innovations`` reads of an attempt on one recording."""
    chain = SimpleNamespace(rate=1e4)
    measured = SimpleNamespace(segment=1e-3, channels=CHANNELS, chain=chain)
    follower = SimpleNamespace(path=SimpleNamespace(nodes=np.zeros((SEGMENTS, STATES))), measured=measured)
    chart = Chart.of(Setting(SliderCrank(), "C").with_clearance(1e-4))
    one = SimpleNamespace(
        innovation=values, spread=spread, contacts=np.zeros((SEGMENTS, SAMPLES, 4)), chart=chart
    )
    fit = SimpleNamespace(passes=[one], values=np.array([[1e-4, 700.0]]))
    return SimpleNamespace(followers=[follower], fit=fit, scale=1.0)


def test_a_perfect_model_scores_one_and_a_run_that_ends_in_no_number_very_much():
    shape = (SEGMENTS, SAMPLES, len(CHANNELS))
    noise = np.random.default_rng(1).normal(size=shape)
    (one,) = innovations(attempt(noise, np.ones(shape)), "C")
    assert len(one.values) == (SEGMENTS - 2 * EDGE - 2) * SAMPLES
    assert 0.9 < root_mean_square([one]) < 1.1
    noise[SEGMENTS // 2 :] = np.nan
    broken = innovations(attempt(noise, np.full(shape, np.nan)), "C")
    numbers = [root_mean_square(broken), *interval(broken)]
    assert min(numbers) > 1e5
    json.dumps(numbers, allow_nan=False)


def test_even_a_recording_of_few_segments_has_an_interval_around_its_error():
    generator = np.random.default_rng(2)
    few, many = (SimpleNamespace(values=generator.normal(size=(n * SAMPLES, 2))) for n in (7, 200))
    for errors in ([few], [few, many], [many]):
        low, high = interval(errors)
        assert 0.7 < low < root_mean_square(errors) < high < 1.3


@pytest.mark.parametrize(("joint", "journal"), [("B", 0), ("C", 1)])
def test_sliding_is_that_of_the_diagnosed_joint_where_both_are_loose(joint, journal):
    one = attempt(np.ones((SEGMENTS, SAMPLES, 2)), np.ones((SEGMENTS, SAMPLES, 2)))
    (found,), (follower,) = one.fit.passes, one.followers
    found.chart = Chart.of(SliderCrank(joint_b=Joint(2e-4), joint_c=Joint(1e-4)))
    found.contacts[:] = 1.0
    first, second = found.chart.rows[list(found.chart.journals[journal][:2])]
    follower.path.nodes[:, first] = 1.0
    follower.path.nodes[:, second + 10] = 1e4  # it goes around, along its bearing's wall
    assert innovations(one, joint)[0].sliding.all()
    assert not innovations(one, "C" if joint == "B" else "B")[0].sliding.any()


def test_what_is_too_much_at_an_angle_or_a_frequency_is_seen_there():
    rng, rate = np.random.default_rng(2), 1e4
    angle = np.linspace(0.0, 40.0 * np.pi, 20_000)
    rest = rng.normal(size=(20_000, 2))
    place = 2.0 * np.pi * 12.5 / ANGLE_BINS
    rest[np.abs(np.mod(angle, 2.0 * np.pi) - place) < 0.08, 1] *= 3.0
    level, loud = heat([rest[:8000], rest[8000:]], [angle[:8000], angle[8000:]])
    assert loud[1, 12]
    assert loud.sum() <= 3  # of 72, one in twenty of those that are marked may be noise
    assert level[1, 12] == pytest.approx(3.0, rel=0.1)
    tone = rng.normal(size=(20_000, 1)) + np.sin(2.0 * np.pi * 1250.0 * np.arange(20_000) / rate)[:, None]
    for length in (20_000, 100):  # fewer samples than a spectrum has
        frequency, amplitude = spectrum([tone[:length]], rate)
        assert frequency[amplitude[0].argmax()] == pytest.approx(1250.0, abs=rate / 100)
    assert np.median(amplitude) < 2.0
