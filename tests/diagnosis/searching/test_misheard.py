"""What a sensor made of what it felt, beside a path that the other ones tell."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.searching.misheard import misheard
from clearance.diagnosis.sensing.instrument import Instrument, respond
from clearance.mechanism.slider_crank import SliderCrank

CHANNELS, RATE, NOISE = ("rod_c_axial", "rod_c_transverse", "crank_angle"), 1e4, 3.0


def base(delay, resonance=np.inf):
    """An attempt whose predictions are impacts; the first channel was recorded late or rings, with noise."""
    rng = np.random.default_rng(5)
    impacts = np.zeros((4000, 3))
    at = rng.integers(0, 4000, 200)
    impacts[at, 0], impacts[at, 1] = 200.0 * rng.normal(size=200), 200.0 * rng.normal(size=200)
    recorded = impacts.copy()
    recorded[:, [0]] = respond(impacts[:, [0]], RATE, np.array([delay]), np.array([resonance]))
    recorded += NOISE * rng.normal(size=recorded.shape)
    measured = SimpleNamespace(
        channels=CHANNELS, sigma=np.full(3, NOISE), filtered=2, values=recorded.reshape(400, 10, 3),
        chain=SimpleNamespace(rate=RATE), seen=lambda faultless, instrument: faultless,
    )  # fmt: skip
    one = SimpleNamespace(predicted=impacts.reshape(400, 10, 3))
    return SimpleNamespace(
        followers=[SimpleNamespace(measured=measured)], hypotheses=(), scale=1.0,
        fit=SimpleNamespace(passes=[one], values=np.zeros((1, 2))),
        model=SimpleNamespace(instrument=lambda row: Instrument()),
    )  # fmt: skip


@pytest.mark.parametrize("delay", [0.0, 2.2e-4])
def test_impacts_that_one_sensor_shows_late_are_its_delay(delay):
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["sensor_delay", "sensor_gain"]), machine, "C", CHANNELS[:2])
    found = misheard(SimpleNamespace(groups=groups), base(delay))
    if delay == 0.0:
        assert found == []
        return
    (hint,) = found
    assert hint.label == "sensor_delay(rod_c_axial, delay)"
    assert hint.values == pytest.approx([delay], abs=2e-6)


def test_a_late_sensor_is_heard_beside_impacts_that_another_one_hears_wrongly():
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["sensor_delay", "sensor_gain"]), machine, "C", CHANNELS[:2])
    torn = base(2.2e-4)
    torn.followers[0].measured.values[100:120, :, 1] += 1e4  # a twentieth of the time, and loud
    torn.followers[0].measured.values[100:120, :, 0] -= 1e4
    (hint,) = misheard(SimpleNamespace(groups=groups), torn)
    assert hint.label == "sensor_delay(rod_c_axial, delay)"
    assert hint.values == pytest.approx([2.2e-4], abs=3e-6)


def test_a_sensor_that_rings_is_heard_though_it_has_bent_the_path():
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["sensor_resonance", "sensor_gain"]), machine, "C", CHANNELS[:2])
    rings, rng = base(0.0, resonance=1200.0), np.random.default_rng(6)
    (one,) = rings.fit.passes
    one.predicted = one.predicted + 4.0 * NOISE * rng.normal(
        size=one.predicted.shape
    )  # what it made of the path
    (hint,) = misheard(SimpleNamespace(groups=groups), rings)
    assert hint.label == "sensor_resonance(rod_c_axial, frequency, damping_ratio)"
    assert hint.values == pytest.approx([1200.0, 0.05], rel=0.05)


def test_a_path_that_is_smoothed_accuses_no_sensor():
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["sensor_delay"]), machine, "C", CHANNELS[:2])
    late = base(2.2e-4)
    assert misheard(SimpleNamespace(groups=groups), late)
    late.scale = 3.16
    assert misheard(SimpleNamespace(groups=groups), late) == []


def test_what_a_bad_impact_leaves_is_no_fault():
    groups = gather(
        load_effects(["sensor_saturation", "sensor_gain"]), Setting(SliderCrank(), "C").with_clearance(3e-4),
        "C", CHANNELS[:2],
    )  # fmt: skip
    torn = base(0.0)
    values = torn.followers[0].measured.values.reshape(-1, 3)
    values[1000:1100, 0] *= 0.5  # a few impacts are met too hard: a limit would take up some of it
    assert misheard(SimpleNamespace(groups=groups), torn) == []


def test_a_fault_is_not_found_twice():
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["sensor_delay"]), machine, "C", CHANNELS[:2])
    late = base(2.2e-4)
    late.hypotheses = (SimpleNamespace(channel=CHANNELS[0]),)
    assert misheard(SimpleNamespace(groups=groups), late) == []
