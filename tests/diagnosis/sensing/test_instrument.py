"""Faults of instruments: off by default, as their formulas say, smooth in their parameters."""

import pickle
from math import inf

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.sensing.instrument import (
    FAULTS,
    Instrument,
    amplify,
    misalign,
    offset,
    respond,
    saturate,
    sensitivity,
    stretch,
)
from clearance.errors import InputError
from clearance.recording.recording import Recording
from clearance.recording.sensors import Sensor, SensorChain

RATE = 1e4
CHANNELS = ("rod_b_axial", "rod_b_transverse", "slider_horizontal")
TIME = np.arange(4000) / RATE
INSIDE = slice(200, -200)  # the ends are continued by mirror images, which a shifted signal does not do


def tone(frequency, phase=0.0, time=TIME):
    return np.cos(2 * np.pi * frequency * time + phase)


def signals(time=TIME):
    return np.stack(
        [
            30 * tone(17.0, 0.3, time) + 5 * tone(230.0, 1.0, time),
            20 * tone(31.0, 0.1, time) + 3 * tone(900.0, 0.4, time),
            50 * tone(12.0, -0.7, time) + 9 * tone(150.0, 2.0, time),
        ],
        axis=1,
    )


def test_without_faults_signals_stay_what_they_are():
    np.testing.assert_array_equal(Instrument().apply(signals(), CHANNELS, RATE), signals())
    for effect in load_effects("instrument"):
        for variant in effect.variants(CHANNELS):
            off = {p.name: p.off for p in variant.free}
            seen = variant.instrument(Instrument(), off).apply(signals(), CHANNELS, RATE)
            np.testing.assert_array_equal(seen, signals())


def test_each_fault_of_an_effect_is_one_that_instruments_have():
    for effect in load_effects("instrument"):
        # the slider's other axis, which a turned sensor mixes in, is not among the channels
        for variant in effect.variants(CHANNELS[:2] if effect.name == "sensor_misalignment" else CHANNELS):
            start = {p.name: p.start for p in variant.free}
            if effect.name == "sensor_saturation":
                start = {"limit": 20.0}
            seen = variant.instrument(Instrument(), start).apply(signals(), CHANNELS, RATE)
            changed = np.abs(seen - signals()).max(axis=0) > 1e-3
            expected = [variant.channel in (None, name) for name in CHANNELS]
            assert changed.tolist() == expected, effect.name


def test_they_do_what_simulated_sensors_do():
    recording = Recording(signals(), CHANNELS, RATE)
    chain = SensorChain(
        {
            "rod_b_axial": Sensor(gain=1.1, bias=2.0, mounting_angle=7.0, delay=3.3e-4, saturation=31.0),
            "rod_b_transverse": Sensor(gain=0.9, mounting_angle=-4.0),
        }
    )
    expected = chain.apply(recording, np.random.default_rng(0)).values
    instrument = Instrument(
        gain={"rod_b_axial": 1.1, "rod_b_transverse": 0.9},
        bias={"rod_b_axial": 2.0},
        misalignment={"rod_b_axial": 7.0, "rod_b_transverse": -4.0},
        delay={"rod_b_axial": 3.3e-4},
        saturation={"rod_b_axial": 31.0},
    )
    np.testing.assert_allclose(instrument.apply(signals(), CHANNELS, RATE), expected, atol=1e-9)


@pytest.mark.parametrize("delay", [1e-4, 3.7e-5, -2.2e-4])
def test_a_delay_is_a_delay(delay):
    late = respond(signals(), RATE, delay=[0.0, delay, 0.0])
    np.testing.assert_allclose(late[INSIDE, 1], signals(TIME - delay)[INSIDE, 1], atol=2e-3)
    np.testing.assert_array_equal(late[:, [0, 2]], signals()[:, [0, 2]])


def test_a_resonance_amplifies_as_the_second_order_formula_says():
    natural, damping = 1000.0, 0.05
    for frequency in (100.0, 700.0, 1000.0, 2000.0):
        seen = respond(tone(frequency)[:, None], RATE, 0.0, natural, damping)[INSIDE, 0]
        ratio = frequency / natural
        response = 1.0 / (1.0 - ratio**2 + 2j * damping * ratio)
        expected = np.abs(response) * tone(frequency, np.angle(response))[INSIDE]
        # what the mirrored ends rang has died down to exp(-2 pi 0.05 20) = 0.2 %
        np.testing.assert_allclose(seen, expected, atol=4e-3 * max(1.0, np.abs(response)))


@pytest.mark.parametrize("rate_error", [0.003, -0.02])
def test_a_slow_clock_shows_what_was_later(rate_error):
    start = 1000.0
    true_time = start / RATE + (1.0 + rate_error) * (TIME - start / RATE)
    seen = stretch(signals(), rate_error, start)
    np.testing.assert_allclose(seen[INSIDE], signals(true_time)[INSIDE], atol=2e-3)
    np.testing.assert_allclose(stretch(np.ones((50, 1)), 0.01), 1.0, atol=1e-12)


def test_simple_faults_take_one_number_or_one_a_channel():
    np.testing.assert_array_equal(amplify(signals(), 2.0), 2.0 * signals())
    np.testing.assert_array_equal(amplify(signals(), [1.0, 2.0, 3.0]), signals() * [1.0, 2.0, 3.0])
    biases = np.array([1.0, 0.0, -1.0])
    np.testing.assert_array_equal(offset(signals(), biases), signals() + biases)
    assert np.abs(saturate(signals(), [5.0, inf, 7.0])).max(axis=0)[[0, 2]].tolist() == [5.0, 7.0]
    turned = misalign(signals(), CHANNELS, [90.0, 90.0, 0.0])
    np.testing.assert_allclose(turned[:, 0], signals()[:, 1], atol=1e-12)
    np.testing.assert_allclose(turned[:, 1], -signals()[:, 0], atol=1e-12)


def test_sensitivities_are_the_derivatives():
    slope = np.gradient(signals(), 1.0 / RATE, axis=0, edge_order=2)
    cases = {
        "gain": (1.0, 1e-3, signals()[:, 0], 1e-9),
        "bias": (0.0, 1e-2, np.ones(len(TIME)), 1e-9),
        "misalignment": (0.0, 1e-2, np.radians(1.0) * signals()[:, 1], 1e-6),
        "delay": (0.0, 1e-7, -slope[:, 0], 1e-2),
    }
    for fault, (value, step, expected, tolerance) in cases.items():
        found = sensitivity(Instrument(), fault, value, step, signals(), CHANNELS, RATE, "rod_b_axial")
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found[INSIDE, 0], expected[INSIDE], atol=tolerance * scale)
        np.testing.assert_array_equal(found[:, 1:], 0.0)
    found = sensitivity(Instrument(), "timebase", 0.0, 1e-5, signals(), CHANNELS, RATE)
    expected = TIME[:, None] * slope
    scale = np.abs(expected).max(axis=0)
    # the second difference that stands for the slope is 5 % off at 900 Hz, a part of the second channel only
    assert (np.abs(found - expected)[INSIDE] < [0.02, 0.1, 0.02] * scale).all()


@pytest.mark.parametrize(
    "faults",
    [
        Instrument(gain={"rod_b_axial": -2.0, "slider_horizontal": 0.8}),
        Instrument(delay={"rod_b_axial": 3.3e-5}),
        Instrument(misalignment={"rod_b_axial": 30.0, "rod_b_transverse": -20.0}),
        Instrument(
            resonance={"rod_b_axial": 2200.0, "slider_horizontal": 700.0},
            resonance_damping={"slider_horizontal": 0.4}, misalignment={"rod_b_axial": 10.0},
        ),
    ],
)  # fmt: skip
def test_white_noise_gets_as_loud_as_a_restoration_makes_it(faults):
    sigma = np.array([1.0, 0.3, 2.0])
    noise = sigma * np.random.default_rng(0).normal(size=(100_000, 3))
    restored, _ = faults.correct(noise, CHANNELS, RATE)
    np.testing.assert_allclose(faults.noise(sigma, CHANNELS, RATE), restored.std(axis=0), rtol=0.01)


def test_what_instruments_cannot_have_is_refused():
    with pytest.raises(InputError, match=r"rod_b_axial turned by 3 deg mixes in rod_b_transverse"):
        misalign(signals()[:, :1], CHANNELS[:1], 3.0)
    with pytest.raises(InputError, match=r"'warp' is not one of misalignment, .*timebase"):
        Instrument().changed("warp", 1.0)
    with pytest.raises(InputError, match="is not a channel"):
        Instrument().changed("gain", 1.0, "rod_b")
    with pytest.raises(InputError, match="is not a channel"):
        Instrument().changed("gain", 1.0)


def test_instruments_travel_to_other_processes():
    one = Instrument().changed("gain", 1.1, "rod_b_axial").changed("timebase", 0.1)
    assert pickle.loads(pickle.dumps(one)) == one
    assert set(FAULTS) >= {"gain", "timebase"}
