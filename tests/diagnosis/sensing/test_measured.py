"""A recording as the estimator sees it: its filter as weights, and its noise."""

from dataclasses import replace

import numpy as np
import pytest

from clearance.diagnosis.sensing.encoder import ENCODER_COUNTS
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import (
    REACH,
    SAMPLES,
    Measured,
    chain_of,
    filter_weights,
)
from clearance.diagnosis.sensing.noise import limit, noise_level
from clearance.errors import InputError
from clearance.recording.chain import MeasurementChain
from clearance.recording.recording import Recording
from clearance.simulation.layout import Signal

CHAIN = MeasurementChain()
CHAINS = [
    CHAIN,
    MeasurementChain(decimation=5, filter_order=4, ripple_db=0.5),
    MeasurementChain(decimation=20, cutoff=0.6),
    MeasurementChain(decimation=1),
]


def predicted(chain, weights, motion, samples, reach):
    """Filtered samples from the base samples, segment by segment."""
    segments = len(motion) // (samples * chain.decimation)
    blocks = motion.reshape(segments, samples * chain.decimation, -1)
    total = np.zeros((segments + 2 * reach, samples, motion.shape[1]))
    for shift in range(2 * reach + 1):
        total[shift : shift + segments] += weights[shift * samples : (shift + 1) * samples] @ blocks
    return total[reach:-reach].reshape(segments * samples, -1)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("reach", [1, 2, REACH])
def test_weights_are_the_chain(chain, reach):
    motion = np.random.default_rng(0).normal(size=(24 * SAMPLES * chain.decimation, 3))
    found = predicted(chain, filter_weights(chain, SAMPLES, reach), motion, SAMPLES, reach)
    expected = chain.apply(motion)
    inside = slice(8 * SAMPLES, -8 * SAMPLES)  # chain.apply rings at the ends
    # what is left out has decayed like the filter's slowest pole; seen: 0.25 to 0.8 of that
    decay = np.abs(chain.filter().decay[0] + 1j * chain.filter().decay[1]).max(initial=0.0)
    assert np.abs(found - expected)[inside].max() <= (decay ** (reach * SAMPLES) + 1e-12) * expected.std()


def test_weights_keep_what_does_not_change():
    motion = np.full((24 * SAMPLES * CHAIN.decimation, 1), 3.0)
    found = predicted(CHAIN, filter_weights(CHAIN, SAMPLES, REACH), motion, SAMPLES, REACH)
    np.testing.assert_allclose(found[8 * SAMPLES : -8 * SAMPLES], 3.0, rtol=1e-3)


def filtered(rng, samples, chain=CHAIN, size=100.0):
    """A signal with impacts that went through the chain: (samples,)."""
    motion = size * np.sin(2.0 * np.pi * 11.7 / chain.base_rate * np.arange(samples * chain.decimation))
    for place in rng.integers(0, len(motion), samples // 150):
        motion[place : place + 20] += size * rng.normal()
    return chain.apply(motion[:, None])[:samples, 0]


@pytest.mark.parametrize("noise", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("seed", range(3))
def test_noise_level_is_that_of_white_noise_after_the_filter(noise, seed):
    rng = np.random.default_rng(seed)
    values = filtered(rng, 3000) + noise * rng.normal(size=3000)
    assert noise_level(values, Signal.ROD_C_AXIAL) == pytest.approx(noise, rel=0.15)


@pytest.mark.parametrize("signal", [Signal.CRANK_SPEED, Signal.SLIDER_POSITION, Signal.DRIVE_TORQUE])
def test_noise_level_of_a_channel_that_passed_no_filter(signal):
    rng = np.random.default_rng(3)
    values = np.sin(2.0 * np.pi * 11.7e-4 * np.arange(3000)) + 0.01 * rng.normal(size=3000)
    assert noise_level(values, signal) == pytest.approx(0.01, rel=0.15)


def test_an_encoder_has_at_least_the_noise_of_its_counts():
    count = 2.0 * np.pi / ENCODER_COUNTS
    angle = 70.0 * np.arange(3000) / 1e4
    least = count / np.sqrt(12.0)
    assert noise_level(angle, Signal.CRANK_ANGLE) == pytest.approx(least)
    assert noise_level(np.round(angle / count) * count, Signal.CRANK_ANGLE) >= least
    still = np.round(4.004 * np.arange(3000)) * count  # its errors stand still for many samples
    assert noise_level(still, Signal.CRANK_ANGLE) > 3.0 * least
    jitter = np.round(5.577 * np.arange(3000) + np.random.default_rng(5).normal(size=3000)) * count
    assert noise_level(jitter, Signal.CRANK_ANGLE) == pytest.approx(np.hypot(count, least), rel=0.15)
    noisy = angle + 10.0 * count * np.random.default_rng(6).normal(size=3000)
    assert noise_level(noisy, Signal.CRANK_ANGLE) == pytest.approx(10.0 * count, rel=0.15)


def test_a_signal_without_noise_has_a_positive_level():
    for signal in (Signal.ROD_C_AXIAL, Signal.CRANK_SPEED):
        assert noise_level(np.zeros(1000), signal) > 0.0
        assert noise_level(np.full(1000, 3.0), signal) > 0.0


@pytest.mark.parametrize("step", [0.0, 0.5])
@pytest.mark.parametrize("seed", range(3))
def test_a_limit_is_where_the_largest_value_comes_again_and_again(step, seed):
    rng = np.random.default_rng(seed)
    values = filtered(rng, 3000) + 3.0 * rng.normal(size=3000)
    values = np.round(values / step) * step if step else values
    assert limit(values) == np.inf
    assert limit(np.clip(values, -50.0, 50.0)) == 50.0
    few = np.sort(np.abs(values))[-2]
    assert limit(np.clip(values, -few, few)) == np.inf, "once is no limit"


@pytest.mark.parametrize(("low", "expected"), [(-50.0, 46.0), (-48.0, 46.0), (-80.0, np.inf)])
def test_of_a_sensor_whose_zero_lies_aside_both_limits_are_one(low, expected):
    """One that goes far beyond on the other side has no limit there."""
    values = 40.0 * np.sin(np.linspace(0.0, 90.0, 3000)) + 12.0 * np.random.default_rng(0).normal(size=3000)
    assert limit(np.clip(values, low, 46.0)) == expected


def test_what_rests_on_one_of_two_coarse_levels_does_not_stop_there():
    values = np.where(np.random.default_rng(0).random(3000) < 0.05, -9.5, -10.0)
    assert limit(values) == np.inf


@pytest.mark.parametrize("levels", [1, 2, 3, 6])
def test_a_coarse_converter_is_not_one_that_clips(levels):
    values = np.random.default_rng(levels).normal(size=3000)
    step = 3.0 / levels
    assert limit(np.round(values / step) * step) == np.inf


def test_noise_is_not_looked_for_where_a_sensor_stands_at_its_limit():
    rng = np.random.default_rng(5)
    values = np.clip(filtered(rng, 3000) + rng.normal(size=3000), -50.0, 50.0)
    assert (np.abs(values) == 50.0).mean() > 0.3
    assert noise_level(values, Signal.ROD_C_AXIAL) < 0.5
    assert noise_level(values, Signal.ROD_C_AXIAL, 50.0) == pytest.approx(1.0, rel=0.2)
    always = np.clip(1e3 * values, -50.0, 50.0)
    assert noise_level(always, Signal.ROD_C_AXIAL, 50.0) == 50.0


def test_values_at_a_limit_are_told_from_others():
    source = recording(2000)
    values = source.values.copy()
    values[:, 2] = np.clip(values[:, 2], -1.0, 1.0)
    measured = Measured.of(replace(source, values=values), CHAIN, "one").part(20, 60)
    place = measured.channels.index("slider_horizontal")
    assert np.isfinite(measured.limits).sum() == 1
    assert measured.limits[place] == 1.0
    np.testing.assert_array_equal(measured.clipped, np.abs(measured.values) >= measured.limits)
    assert measured.clipped[..., place].any()


@pytest.mark.parametrize("timebase", [0.0, 0.05])
def test_what_instruments_make_of_a_signal_is_restored(timebase):
    measured = Measured.of(recording(), CHAIN, "one")
    faults = Instrument(gain={"rod_c_axial": 1.2}, bias={"slider_horizontal": 3.0}, timebase=timebase)
    restored = measured.restored(faults)[0]
    np.testing.assert_allclose(measured.seen(restored, faults), measured.values, rtol=1e-9, atol=1e-9)
    assert np.abs(restored - measured.values).max() > 0.1


def recording(samples=400, channels=("crank_angle", "rod_c_axial", "slider_horizontal"), rate=1e4):
    values = np.random.default_rng(8).normal(size=(samples, len(channels)))
    return Recording(values, tuple(channels), rate)


@pytest.mark.parametrize(("noise", "expected"), [(0.0, True), (5e-4, False)])
def test_a_recording_without_noise_gets_some(noise, expected):
    """The same as often as it is asked for; what a sensor has, and what an encoder says, stay as they are."""
    turns = 12.0 * np.arange(4000) / CHAIN.rate
    smooth = np.column_stack([np.sin(2.0 * np.pi * turns), 50.0 * np.cos(6.0 * np.pi * turns), turns])
    given = smooth * (1.0 + noise * np.random.default_rng(1).normal(size=smooth.shape))
    source = Recording(given, ("rod_b_axial", "rod_c_axial", "crank_angle"), CHAIN.rate)
    measured = Measured.of(source, CHAIN, "one").part(5, 40)
    found = measured.noised()
    assert found.noiseless is expected
    added = (found.values - measured.values).std(axis=(0, 1))
    assert (added[:2] > 0.15).all() == expected  # a hundredth of 18 at least, between 0.7 and 35
    assert added[2] == 0.0
    assert (found.sigma > measured.sigma)[:2].all() == expected
    assert np.array_equal(found.values, measured.noised().values)


def test_a_recording_is_cut_into_segments_accelerations_first():
    source = recording(407)
    measured = Measured.of(source, CHAIN, "one")
    assert measured.values.shape == (40, SAMPLES, 3)
    assert "crank_angle" not in measured.channels[:2]
    assert measured.filtered == 2
    assert set(measured.channels) == set(source.channels)
    for place, (channel, signal) in enumerate(zip(measured.channels, measured.signals, strict=True)):
        np.testing.assert_array_equal(measured.values[..., place].ravel(), source.channel(channel)[:400])
        assert Signal(signal).name.lower() == channel
    assert measured.segment == pytest.approx(SAMPLES / 1e4)
    np.testing.assert_array_equal(measured.part(3, 9).values, measured.values[3:9])


def test_a_constant_channel_is_left_out_and_told():
    values = np.random.default_rng(9).normal(size=(400, 3))
    values[:, 1], values[:, 2] = 0.0, 7.0
    names = ("rod_c_axial", "slider_vertical", "drive_torque")
    measured = Measured.of(Recording(values, names, 1e4), CHAIN, "one")
    assert measured.channels == ("rod_c_axial",)
    assert measured.silent == ("slider_vertical", "drive_torque")
    np.testing.assert_array_equal(measured.values[..., 0].ravel(), values[:, 0])
    with pytest.raises(InputError, match="one: every channel is constant"):
        Measured.of(Recording(np.zeros((400, 3)), names, 1e4), CHAIN, "one")


def test_an_undeclared_chain_is_the_usual_one_at_the_recordings_rate():
    assert chain_of(recording(), "one") == MeasurementChain()
    fast = chain_of(recording(rate=2e5), "one")
    assert (fast.rate, fast.decimation) == (2e5, 1)
    slow = chain_of(recording(rate=4e3), "one")
    assert slow.rate == pytest.approx(4e3)
    assert slow.decimation == 25


def test_a_declared_chain_must_end_at_the_recordings_rate():
    declared = {"chain": {"base_rate": 5e4, "decimation": 5, "cutoff": 0.7}}
    source = recording()
    kept = Recording(source.values, source.channels, 1e4, metadata=declared)
    assert chain_of(kept, "one") == MeasurementChain(base_rate=5e4, decimation=5, cutoff=0.7)
    wrong = Recording(source.values, source.channels, 2e4, metadata=declared)
    with pytest.raises(InputError, match="one: declares a chain that ends at 10000 Hz, but has 20000 Hz"):
        chain_of(wrong, "one")


@pytest.mark.parametrize(
    ("declared", "rate", "expected"),
    [
        ({"base_rate": 1e5, "decimation": 10}, 9999.7, (99997.0, 10, 0.8)),  # its clock is measured
        ({"cutoff": 0.7}, 2e4, (1e5, 5, 0.7)),
        ({"decimation": 4}, 2e4, (8e4, 4, 0.8)),
        ({"base_rate": 8e4}, 2e4, (8e4, 4, 0.8)),
    ],
)
def test_what_a_declared_chain_leaves_open_follows_from_the_recordings_rate(declared, rate, expected):
    source = recording()
    kept = Recording(source.values, source.channels, rate, metadata={"chain": declared})
    chain = chain_of(kept, "one")
    assert (chain.base_rate, chain.decimation, chain.cutoff) == pytest.approx(expected)


@pytest.mark.parametrize("resolution", [0.01, 0.05, 0.1])
def test_a_channel_of_coarse_counts_has_the_noise_of_its_resolution(resolution):
    time = np.arange(5000) * 1e-4
    speed = 73.0 + 0.3 * np.sin(2.0 * np.pi * 11.0 * time)
    counted = resolution * np.round(speed / resolution)
    found = noise_level(counted, Signal.CRANK_SPEED)
    assert found == pytest.approx((counted - speed).std(), rel=0.3)


def test_too_short_a_recording_is_refused():
    least = (2 * REACH + 8) * SAMPLES
    assert len(Measured.of(recording(least), CHAIN, "one").values) == 2 * REACH + 8
    with pytest.raises(InputError, match=f"one: {least - 1} samples.*at least {least}"):
        Measured.of(recording(least - 1), CHAIN, "one")


@pytest.mark.parametrize(
    ("fault", "value", "channel"),
    [
        ("gain", 1.1, "rod_b_axial"),
        ("misalignment", 3.0, "rod_b_transverse"),
        ("delay", 3e-5, "rod_b_axial"),
        ("bias", 2.0, "rod_b_transverse"),
        ("timebase", 0.01, None),
    ],
)
def test_what_moves_between_two_instruments_is_the_difference_of_what_they_restore(fault, value, channel):
    names = ("rod_b_transverse", "rod_b_axial", "slider_horizontal")
    values = np.random.default_rng(0).normal(size=(40 * SAMPLES, 3)).cumsum(axis=0)
    one = Measured.of(Recording(values, names, CHAIN.rate), CHAIN, "one").part(5, 30)
    before = Instrument(gain={"rod_b_axial": 1.02}, delay={"slider_horizontal": 2e-5})
    after = before.changed(fault, value, channel)
    expected = one.restored(after)[0] - one.restored(before)[0]
    moved, unmoved = one.moved(before, [after, before])
    np.testing.assert_array_equal(moved, expected)
    assert not unmoved.any()
    # where everything is off the response is not undone anew for what comes behind it
    off = {"rod_b_axial": 1e-5, "rod_b_transverse": -2e-5, "slider_horizontal": 2e-5}
    before = replace(
        before, delay=off, bias={"rod_b_axial": 3.0}, misalignment={"rod_b_axial": 1.0},
        resonance={"rod_b_transverse": 2e4},
    )  # fmt: skip
    after = before.changed(fault, value, channel)
    expected = one.restored(after)[0] - one.restored(before)[0]
    (moved,) = one.moved(before, [after])
    np.testing.assert_allclose(moved, expected, rtol=1e-9, atol=1e-11 * np.abs(one.values).max())
