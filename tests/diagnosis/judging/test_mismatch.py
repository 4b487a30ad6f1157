"""Innovations as numbers that can be written, whatever became of the run."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.mismatch import (
    ANGLE_BINS,
    Innovations,
    by_angle,
    by_tone,
    innovations,
    interval,
    locate,
    root_mean_square,
    summary,
    too_large,
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
        innovation=values, spread=spread, contacts=np.zeros((SEGMENTS, SAMPLES, 4)), chart=chart,
        used=np.ones(values.shape),
    )  # fmt: skip
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
    rest[:100, 0] = np.nan  # unknown, which is not perfect
    cells = by_angle([rest[:8000], rest[8000:]], [angle[:8000], angle[8000:]])
    (loud,) = too_large([cells])
    assert loud[1, 12]
    assert loud.sum() <= 3  # of 72, one in twenty of those that are marked may be noise
    assert cells.level[1, 12] == pytest.approx(3.0, rel=0.1)
    assert cells.level[0, 0] == pytest.approx(1.0, abs=0.15)
    tone = rng.normal(size=(20_000, 1)) + np.sin(2.0 * np.pi * 1250.0 * np.arange(20_000) / rate)[:, None]
    for length in (20_000, 100):  # fewer samples than a spectrum has
        frequency, tones = by_tone([tone[:length]], rate)
        (loud,) = too_large([tones])
        assert frequency[tones.level[0].argmax()] == pytest.approx(1250.0, abs=rate / 100)
        assert 1 <= loud.sum() <= 5
        assert loud[0, tones.level[0].argmax()]
    assert np.median(tones.level) < 2.0


def test_of_all_cells_together_hardly_any_of_noise_is_marked():
    rng, marked = np.random.default_rng(4), 0
    for _ in range(40):
        rests = [rng.normal(size=(1500, 10)) for _ in range(2)]
        turns = [np.linspace(0.0, 16.0, 1500) for _ in rests]
        marked += any(one.any() for one in too_large([by_angle(rests, turns), by_tone(rests, 1e4)[1]]))
    assert marked <= 6  # of 40 one in twenty, within chance


def test_errors_count_over_what_a_perfect_model_s_are_at_that_moment_and_unknown_samples_do_not():
    shape = (SEGMENTS, SAMPLES, len(CHANNELS))
    spread = np.ones(shape)
    spread[::7] = 5.0  # at impacts more is not foreseen
    noise = spread * np.random.default_rng(3).normal(size=shape)
    noise[10:20, :, 0] = 0.0
    one = attempt(noise, spread)
    one.fit.passes[0].used[10:20, :, 0] = 0.0
    (found,) = innovations(one, "C")
    assert np.isnan(found.values[:, 0]).sum() == 10 * SAMPLES
    assert np.nanstd(found.values, axis=0) == pytest.approx([1.0, 1.0], abs=0.1)
    assert root_mean_square([found]) == pytest.approx(1.0, abs=0.1)
    other = innovations(one, "C", attempt(noise[:30], spread[:30]))  # followed on another stretch
    assert np.nanstd(other[0].values) > 1.5


def test_the_floor_is_one_however_few_channels_there_are():
    rng = np.random.default_rng(5)
    for channels in (1, 4, 10):
        errors = [SimpleNamespace(values=rng.normal(size=(50_000, channels)))]
        assert root_mean_square(errors) == pytest.approx(1.0, abs=0.01)


def test_the_tones_of_an_encoders_rounding_are_no_mismatch():
    rng, n = np.random.default_rng(6), 3000
    values = rng.normal(size=(n, 2)) + 2.0 * np.sin(2.0 * np.pi * 0.21 * np.arange(n))[:, None]
    turning, never = np.linspace(0.0, 30.0, n) % (2.0 * np.pi), np.zeros(n, dtype=bool)
    errors = [Innovations(values, turning, never, never, ("rod_b_axial", "crank_angle"), 1e4)]
    found = locate(errors, errors)
    assert any(found["significant_spectrum"]["rod_b_axial"])
    assert not any(found["significant_spectrum"]["crank_angle"])


def test_one_moment_at_which_a_path_is_lost_does_not_decide_where_something_is_missing():
    rng, n = np.random.default_rng(7), 3000
    values, never = rng.normal(size=(n, 2)), np.zeros(n, dtype=bool)
    values[:, 0] *= 3.0
    values[1500, 1] = 2000.0
    turning = np.linspace(0.0, 30.0, n) % (2.0 * np.pi)
    found = summary([Innovations(values, turning, never, never, ("rod_b_axial", "rod_c_axial"), 1e4)])
    assert found["channels"]["rod_b_axial"] > 0.9
