import math
from pathlib import Path

import numpy as np
import pytest
from hydra.utils import instantiate
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from clearance.errors import InputError
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.recording import Recording
from clearance.recording.sensors import Sensor, SensorChain, declared_chain

CONF = Path(__file__).parents[2] / "conf" / "sensor_chain"
RATE = 10_000.0
SAMPLES = 4000
INSIDE = slice(400, -400)  # away from the ends, where the past is a mirror image


def smooth(frequencies=(37.0, 410.0, 1730.0)):
    """(samples,) a sum of sines well below the Nyquist frequency."""
    return wave(np.arange(SAMPLES) / RATE, frequencies)


def wave(time, frequencies=(37.0, 410.0, 1730.0)):
    return sum(np.sin(2 * np.pi * f * time + k) for k, f in enumerate(frequencies))


def record(**channels):
    return Recording(np.column_stack(list(channels.values())), tuple(channels), RATE, 0.5, {"run": 3})


def measure(recording, seed=0, **sensors):
    return SensorChain(sensors).apply(recording, np.random.default_rng(seed))


def test_the_null_chain_changes_no_bit_and_draws_nothing():
    values = np.random.default_rng(1).standard_normal((100, len(ACCELERATIONS)))
    recording = Recording(values, ACCELERATIONS, RATE)
    generator = np.random.default_rng(2)
    result = SensorChain().apply(recording, generator)
    assert result.values.tobytes() == values.tobytes()
    assert generator.random() == np.random.default_rng(2).random()


def test_a_channel_with_an_ideal_sensor_keeps_its_bits_beside_a_real_one():
    recording = record(rod_b_axial=smooth(), rod_c_axial=smooth() ** 2, crank_angle=smooth())
    result = measure(recording, rod_b_axial=Sensor(gain=1.1, noise=0.1, bandwidth=500.0))
    for name in ("rod_c_axial", "crank_angle"):
        assert result.channel(name).tobytes() == recording.channel(name).tobytes()
    assert (result.channels, result.rate, result.start_time, result.metadata) == (
        recording.channels,
        RATE,
        0.5,
        {"run": 3},
    )


@pytest.mark.parametrize("samples", [1, 2, 17])
def test_a_delay_of_whole_samples_shifts_by_exactly_that_many(samples):
    signal = np.random.default_rng(0).standard_normal(SAMPLES)  # nothing band-limited about it
    result = measure(record(rod_b_axial=signal), rod_b_axial=Sensor(delay=samples / RATE)).values[:, 0]
    np.testing.assert_array_equal(result[samples:], signal[:-samples])


@settings(deadline=None, max_examples=30)
@given(st.floats(0.0, 20.0))
def test_a_fractional_delay_is_the_signal_at_the_earlier_time(shift):
    result = measure(record(rod_b_axial=smooth()), rod_b_axial=Sensor(delay=shift / RATE)).values[:, 0]
    expected = wave((np.arange(SAMPLES) - shift) / RATE)
    # The mirror image has a kink at each end; what it rings falls off as the square of the distance.
    np.testing.assert_allclose(result[INSIDE], expected[INSIDE], atol=2e-4)


@pytest.mark.parametrize("frequency", [50.0, 500.0, 1500.0])
def test_the_bandwidth_is_that_of_a_first_order_low_pass(frequency):
    corner = 500.0
    response = 1.0 / (1.0 + 1j * frequency / corner)
    result = measure(record(rod_b_axial=smooth((frequency,))), rod_b_axial=Sensor(bandwidth=corner)).values[
        :, 0
    ]
    time = np.arange(SAMPLES) / RATE
    expected = abs(response) * np.sin(2 * np.pi * frequency * time + np.angle(response))
    np.testing.assert_allclose(result[INSIDE], expected[INSIDE], atol=2e-3 * abs(response))


def test_a_low_pass_leaves_a_constant_alone():
    result = measure(record(rod_b_axial=np.full(SAMPLES, 9.81)), rod_b_axial=Sensor(bandwidth=100.0))
    np.testing.assert_allclose(result.values, 9.81, rtol=1e-12)


def test_stated_noise_is_measured_noise():
    rng = np.random.default_rng(5)
    clean = record(rod_b_axial=smooth(), rod_c_axial=7.0 * rng.standard_normal(SAMPLES))
    noisy = measure(clean, rod_b_axial=Sensor(noise=0.05), rod_c_axial=Sensor(noise_density=0.02))
    error = noisy.values - clean.values
    # The standard deviation of 4000 samples is itself uncertain by 1.1 %; four of those.
    tolerance = 4.0 / math.sqrt(2 * SAMPLES)
    assert np.std(error[:, 0]) == pytest.approx(0.05 * np.std(clean.values[:, 0]), rel=tolerance)
    assert np.std(error[:, 1]) == pytest.approx(0.02 * math.sqrt(RATE / 2), rel=tolerance)
    assert abs(np.corrcoef(error.T)[0, 1]) < 4.0 / math.sqrt(SAMPLES)
    assert abs(np.corrcoef(error[1:, 0], error[:-1, 0])[0, 1]) < 4.0 / math.sqrt(SAMPLES)


def test_noise_depends_on_the_generator_alone():
    clean = record(rod_b_axial=smooth())
    first, again, other = (measure(clean, seed, rod_b_axial=Sensor(noise=0.1)).values for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_constant_channel_gets_no_relative_noise():
    zero = record(slider_vertical=np.zeros(SAMPLES))
    assert not measure(zero, slider_vertical=Sensor(noise=0.5)).values.any()


@given(st.floats(-180.0, 180.0))
@settings(deadline=None, max_examples=30)
def test_two_axes_turned_alike_measure_the_turned_vector(angle):
    axial, transverse = smooth(), smooth((90.0, 300.0))
    recording = record(rod_b_transverse=transverse, rod_b_axial=axial)
    sensor = Sensor(mounting_angle=angle)
    result = measure(recording, rod_b_transverse=sensor, rod_b_axial=sensor)
    turned = (axial + 1j * transverse) * np.exp(-1j * math.radians(angle))
    np.testing.assert_allclose(result.channel("rod_b_axial"), turned.real, atol=1e-12)
    np.testing.assert_allclose(result.channel("rod_b_transverse"), turned.imag, atol=1e-12)


def test_a_slider_sensor_turned_by_90_degrees_reads_the_other_axis():
    recording = record(slider_horizontal=smooth(), slider_vertical=smooth((55.0,)))
    result = measure(recording, slider_horizontal=Sensor(mounting_angle=90.0))
    np.testing.assert_allclose(
        result.channel("slider_horizontal"), recording.channel("slider_vertical"), atol=1e-12
    )
    np.testing.assert_array_equal(result.channel("slider_vertical"), recording.channel("slider_vertical"))


def test_a_mounting_angle_without_the_other_axis_says_which():
    with pytest.raises(InputError, match="mixes in rod_b_transverse, which the recording does not have"):
        measure(record(rod_b_axial=smooth()), rod_b_axial=Sensor(mounting_angle=2.0))


def test_the_order_is_gain_then_bias_then_saturation_then_resolution():
    recording = record(rod_b_axial=np.array([0.0, 1.0, 2.0, 3.0]))
    result = measure(recording, rod_b_axial=Sensor(gain=2.0, bias=0.4, saturation=4.9, resolution=0.5))
    np.testing.assert_allclose(result.values[:, 0], [0.5, 2.5, 4.5, 5.0])


def test_the_default_is_for_accelerations_and_names_override_it():
    recording = record(rod_b_axial=smooth(), rod_c_axial=smooth(), crank_angle=smooth())
    chain = SensorChain({"rod_c_axial": Sensor(gain=3.0)}, default=Sensor(gain=2.0))
    result = chain.apply(recording, np.random.default_rng(0))
    np.testing.assert_allclose(result.values, recording.values * [2.0, 3.0, 1.0])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"gain": 0.0}, "gain: 0 gives no signal"),
        ({"gain": "abc"}, "gain: 'abc' is not a number"),
        ({"noise": -0.1}, "noise: -0.1 .* from 0 to 10"),
        ({"noise": float("nan")}, "noise"),
        ({"bandwidth": 0.0}, "bandwidth: 0 Hz is out of range"),
        ({"delay": -0.1}, "delay"),
        ({"delay": 2.0}, "delay: 2 s is out of range"),
        ({"mounting_angle": 200.0}, "mounting_angle: 200 deg"),
        ({"saturation": 0.0}, "saturation"),
        ({"bias": None}, "bias: None is not a number"),
        ({"resolution": True}, "resolution: True is not a number"),
    ],
)
def test_an_impossible_sensor_is_refused(keys, message):
    with pytest.raises(InputError, match=message):
        Sensor(**keys)


def test_impossible_chains_are_refused():
    with pytest.raises(InputError, match="did you mean 'rod_b_axial'"):
        SensorChain({"rod_b_axil": Sensor()})
    with pytest.raises(InputError, match=r"sensors\.rod_b_axial: 2\.0 is no sensor; give a mapping"):
        SensorChain({"rod_b_axial": 2.0})
    with pytest.raises(InputError, match=r"sensor_chain\.default: unknown key noize; did you mean 'noise'"):
        SensorChain(default={"noize": 2.0})
    with pytest.raises(InputError, match="only accelerations have a mounting angle"):
        SensorChain({"crank_angle": Sensor(mounting_angle=1.0)})
    with pytest.raises(InputError, match="not shorter than the recording"):
        measure(record(rod_b_axial=np.arange(5.0)), rod_b_axial=Sensor(delay=0.01))


def test_the_declared_chain_is_that_of_the_metadata():
    declared = {"rod_b_axial": {"gain": 1.5, "position": 0.02}}
    recording = Recording(np.ones((5, 1)), ("rod_b_axial",), RATE, metadata={"sensors": declared})
    assert declared_chain(recording) == SensorChain({"rod_b_axial": Sensor(gain=1.5)})
    assert declared_chain(record(rod_b_axial=smooth())) == SensorChain()


def test_the_ideal_configuration_is_the_null_chain():
    assert instantiate(OmegaConf.load(CONF / "ideal.yaml")) == SensorChain()


def test_the_mems_configuration_reads_as_stated_and_changes_a_signal_a_little():
    chain = instantiate(OmegaConf.load(CONF / "mems.yaml"))
    counts = 2 * math.pi / chain.sensor("crank_angle").resolution
    assert counts == pytest.approx(4096, rel=1e-12)
    values = 300.0 * np.column_stack([smooth((20.0 + k, 200.0)) for k in range(len(ACCELERATIONS))])
    recording = Recording(values, ACCELERATIONS, RATE)
    result = chain.apply(recording, np.random.default_rng(0))
    error = np.std(result.values - values, axis=0) / np.std(values, axis=0)
    assert np.all((error > 0.005) & (error < 0.06))
