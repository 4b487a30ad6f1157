"""What engineers plot: a right model is a standard error away, a wrong one many; impacts by one rule."""

import json
import time
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from clearance.diagnosis.judging.impacts import count_impacts
from clearance.diagnosis.judging.revolutions import Running, phase_average, spectrum
from clearance.diagnosis.judging.signature import signatures
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import Measured
from clearance.mechanism.drive import Free, SpeedControl
from clearance.mechanism.guide import StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.recording import Recording
from clearance.simulation.batch import Sampling, simulate
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal

CHAIN = MeasurementChain()
RPM = 600.0
SPEED = RPM * np.pi / 30.0


def machine(clearance):
    return SliderCrank(joint_c=Joint(clearance), drive=SpeedControl(RPM, ramp=0.0))


@cache
def recorded(clearance, encoder=False, seconds=0.9):
    """Ten turns a second with 1 % of noise, far from where a free run begins; and the first angle."""
    sampling = Sampling(CHAIN.base_rate, CHAIN.filter(), 1.737, seconds)
    signals = simulate(machine(clearance), Integrator("runge_kutta_4", 1e-5, 2), sampling)
    rows = np.flatnonzero(signals[:, : Signal.CRANK_ANGLE].std(axis=0) > 1e-9)
    values = signals[:, rows] + 0.01 * signals[:, rows].std(axis=0) * np.random.default_rng(0).normal(
        size=(len(signals), len(rows))
    )
    channels = [Signal(int(i)).name.lower() for i in rows]
    if encoder:
        values = np.column_stack([values, signals[:, Signal.CRANK_ANGLE] + 1.3])  # of unknown zero
        channels.append("crank_angle")
    angle = signals[:, Signal.CRANK_ANGLE]
    line = np.polyfit(np.arange(len(angle)), angle, 1)[1]
    first = angle[0] if encoder else line
    measured = Measured.of(Recording(values, tuple(channels), CHAIN.rate), CHAIN, "one")
    return measured, float(np.mod(first, 2.0 * np.pi))


def distances(found, kind):
    return np.array([entry["distance"][kind] for entry in found["recordings"][0]["phase"]])


@pytest.mark.parametrize("encoder", [pytest.param(False, marks=pytest.mark.slow), True])
@pytest.mark.parametrize("clearance", [1e-4, 8e-4])  # periodic, chaotic
def test_the_right_model_is_about_one_standard_error_away_and_a_wrong_one_more(clearance, encoder):
    measured, angle = recorded(clearance, encoder)
    friction = replace(machine(clearance), guide_friction=StribeckGuide(coulomb_force=10.0))
    found = signatures([measured], [SPEED], [angle + 5e-3], [friction], [machine(clearance)], workers=1)
    after, before = distances(found, "after"), distances(found, "before")
    assert (after < 2.0).all()
    assert 0.3 < after.mean() < 1.6
    assert before.max() > 2.0 * after.max()
    names = [entry["channel"] for entry in found["recordings"][0]["phase"]]
    assert names == [c for c in measured.channels if c != "crank_angle"]


def test_an_instruments_fault_belongs_to_the_corrected_model():
    measured, angle = recorded(1e-4)
    column = measured.channels.index("slider_horizontal")
    values = measured.values.copy()
    values[..., column] *= 1.05
    faulty = replace(measured, values=values)
    gain = Instrument(gain={"slider_horizontal": 1.05})
    found = signatures([faulty], [SPEED], [angle], [machine(1e-4)], [machine(1e-4)], gain, workers=1)
    assert distances(found, "before")[column] > 3.0 * distances(found, "after")[column]
    assert distances(found, "after")[column] < 1.5


def test_it_is_quick_small_and_ready_for_json():
    measured, angle = recorded(8e-4, seconds=3.6)  # nine turns of chaos differ by two thirds from nine others
    both = [machine(8.2e-4)] * 2, [machine(8e-4)] * 2
    start = time.monotonic()
    found = signatures([measured] * 2, [SPEED] * 2, [angle] * 2, *both, workers=1)
    assert time.monotonic() - start < 10.0  # about one second where nothing else runs
    assert len(json.dumps(found, allow_nan=True)) < 2e5
    spectra = found["recordings"][0]["spectrum"]
    assert [entry["channel"] for entry in spectra] == list(measured.channels)
    assert len(spectra[0]["recorded"]) == len(found["recordings"][0]["frequency_hz"])
    middle = slice(len(spectra[0]["recorded"]) // 2, None)
    ratio = np.array(spectra[-1]["after"][middle]) / np.array(spectra[-1]["recorded"][middle])
    assert np.median(ratio) == pytest.approx(1.0, abs=0.2)


def test_a_rig_with_an_encoder_and_a_slow_recorder_has_a_phase_average_too():
    chain = MeasurementChain(base_rate=8e3, decimation=160)  # 50 Hz
    rate, rpm = CHAIN.rate, 613.0
    running = replace(machine(1e-4), drive=SpeedControl(rpm, ramp=0.0))
    sampling = Sampling(CHAIN.base_rate, CHAIN.filter(), 0.5, 8.0)
    signals = simulate(running, Integrator("runge_kutta_4", 1e-5, 2), sampling)[:: round(rate / chain.rate)]
    names = ("crank_angle", "slider_position")
    values = signals[:, [Signal[name.upper()] for name in names]]
    values = values + [0.0, 1e-4] * np.random.default_rng(0).normal(size=values.shape)
    measured = Measured.of(Recording(values, names, chain.rate), chain, "slow")
    longer = replace(running, rod=replace(running.rod, length=0.122))
    measured = replace(measured, sigma=np.array([1e-3, 1e-4]))
    found = signatures([measured], [rpm * np.pi / 30.0], [values[0, 0]], [longer], [running], workers=1)
    assert found["recordings"][0]["impacts"] is None
    assert [entry["channel"] for entry in found["recordings"][0]["phase"]] == ["slider_position"]
    assert distances(found, "after")[0] < 2.0 < 5.0 < distances(found, "before")[0]


@pytest.mark.parametrize("drive", [SpeedControl(RPM, proportional=1e9, ramp=0.0), Free()])
def test_a_model_that_cannot_run_is_left_out(drive):
    measured, angle = recorded(1e-4)
    broken = replace(machine(1e-4), drive=drive)
    found = signatures([measured], [SPEED], [angle], [broken], [machine(1e-4)], workers=1)["recordings"][0]
    assert "before" not in found["phase"][0]
    assert "before" not in found["impacts"]
    assert "after" in found["phase"][0]


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_phase_average_is_that_of_a_known_signal(sense):
    rng = np.random.default_rng(1)
    angle = 0.3 + sense * np.arange(20000) * 2.0 * np.pi / 611.3
    values = np.stack([np.cos(3 * angle) + 0.1 * rng.normal(size=angle.size), np.sin(angle)], axis=1)
    found = phase_average(Running(values[None], angle[None], 1e4), 60)
    centres = (np.arange(60) + 0.5) / 60 * 2.0 * np.pi
    np.testing.assert_allclose(found.mean[:, 1], np.sin(centres), atol=2e-3)
    error = found.spread[:, 0] / np.sqrt(found.revolutions)
    assert (((found.mean[:, 0] - np.cos(3 * centres)) / error) ** 2).mean() == pytest.approx(1.0, abs=0.6)
    np.testing.assert_allclose(np.median(found.spread[:, 0]), 0.1 / np.sqrt(10.2), rtol=0.15)
    np.testing.assert_allclose(found.slope[:, 1], np.cos(centres), atol=1e-2)


def test_a_part_of_a_revolution_leaves_bins_without_a_number():
    angle = np.linspace(0.0, np.pi, 500)
    found = phase_average(Running(np.sin(angle)[None, :, None], angle[None], 1e4), 36)
    assert np.isfinite(found.mean[:18]).all()
    assert np.isnan(found.mean[19:]).all()
    assert np.isnan(found.spread).all()


def test_a_spectrum_shows_a_tone_at_its_frequency_and_white_noise_at_its_level():
    rng = np.random.default_rng(2)
    time_s = np.arange(40000) / 1e4
    values = np.stack([np.sin(2 * np.pi * 800.0 * time_s), 3.0 * rng.normal(size=time_s.size)], axis=1)
    frequency, density = spectrum(Running(values[None], time_s[None], 1e4), 40000)
    assert frequency[np.argmax(density[:, 0])] == pytest.approx(800.0, rel=0.05)
    assert np.median(density[:, 1]) == pytest.approx(3.0 / np.sqrt(5e3), rel=0.05)


def test_impacts_are_counted_with_their_strength_by_the_recordings_rule():
    rate, rng = 1e4, np.random.default_rng(3)
    angle = np.arange(20000) / rate * SPEED
    noise = rng.normal(size=angle.size)
    ring = np.exp(-np.arange(60) / 2.5) * np.cos(2 * np.pi * 0.33 * np.arange(60))
    hit = 30.0 * np.sin(angle) + noise
    weak = hit.copy()
    for start in range(100, 19900, 500):  # two a revolution
        hit[start : start + 60] += 80.0 * ring
        weak[start : start + 60] += 40.0 * ring
    signals = {"recorded": hit, "before": weak, "after": 30.0 * np.sin(angle) + noise}
    signals = {kind: values[None] for kind, values in signals.items()}
    found = count_impacts(signals, dict.fromkeys(signals, angle[None]), rate)
    for kind in ("recorded", "before"):
        assert found[kind]["per_revolution"] == pytest.approx(2.0, abs=0.05)
        assert found[kind]["low"] <= 2.0 <= found[kind]["high"]
        assert found[kind]["high"] - found[kind]["low"] < 0.3  # two in every revolution
    assert found["recorded"]["median_strength"] == pytest.approx(
        2.0 * found["before"]["median_strength"], rel=0.05
    )
    assert found["after"] == {"per_revolution": 0.0, "low": 0.0, "high": 0.15, "median_strength": None}
