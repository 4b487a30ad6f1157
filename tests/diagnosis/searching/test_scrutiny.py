"""What is small, or hidden, beside a machine that explains the recordings."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.searching.scrutiny import _misheard
from clearance.diagnosis.sensing.instrument import respond
from clearance.mechanism.slider_crank import SliderCrank

CHANNELS, RATE, NOISE = ("rod_c_axial", "rod_c_transverse", "crank_angle"), 1e4, 3.0


def base(delay):
    """An attempt whose predictions are impacts; the first channel was recorded late, with noise."""
    rng = np.random.default_rng(5)
    impacts = np.zeros((4000, 3))
    at = rng.integers(0, 4000, 200)
    impacts[at, 0], impacts[at, 1] = 200.0 * rng.normal(size=200), 200.0 * rng.normal(size=200)
    recorded = impacts.copy()
    recorded[:, [0]] = respond(impacts[:, [0]], RATE, np.array([delay]))
    recorded += NOISE * rng.normal(size=recorded.shape)
    measured = SimpleNamespace(
        channels=CHANNELS, sigma=np.full(3, NOISE), filtered=2, values=recorded.reshape(400, 10, 3),
        chain=SimpleNamespace(rate=RATE),
    )  # fmt: skip
    one = SimpleNamespace(predicted=impacts.reshape(400, 10, 3))
    return SimpleNamespace(
        followers=[SimpleNamespace(measured=measured)], fit=SimpleNamespace(passes=[one]), hypotheses=()
    )


@pytest.mark.parametrize("delay", [0.0, 2.2e-4])
def test_impacts_that_one_sensor_shows_late_are_its_delay(delay):
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["sensor_delay", "sensor_gain"]), machine, "C", CHANNELS[:2])
    found = _misheard(SimpleNamespace(groups=groups), base(delay))
    if delay == 0.0:
        assert found == []
        return
    (hint,) = found
    assert hint.label == "sensor_delay(rod_c_axial, delay)"
    assert hint.values == pytest.approx([delay], abs=2e-6)


def test_what_a_bad_impact_leaves_is_no_fault():
    groups = gather(
        load_effects(["sensor_saturation", "sensor_gain"]), Setting(SliderCrank(), "C").with_clearance(3e-4),
        "C", CHANNELS[:2],
    )  # fmt: skip
    torn = base(0.0)
    values = torn.followers[0].measured.values.reshape(-1, 3)
    values[1000:1100, 0] *= 0.5  # a few impacts are met too hard: a limit would take up some of it
    assert _misheard(SimpleNamespace(groups=groups), torn) == []


def test_a_fault_is_not_found_twice():
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["sensor_delay"]), machine, "C", CHANNELS[:2])
    late = base(2.2e-4)
    late.hypotheses = (SimpleNamespace(channel=CHANNELS[0]),)
    assert _misheard(SimpleNamespace(groups=groups), late) == []
