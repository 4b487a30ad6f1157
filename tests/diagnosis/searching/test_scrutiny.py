"""What is small, or hidden, beside a machine that explains the recordings."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.searching import scrutiny
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.scrutiny import _compare_orders, _misheard
from clearance.diagnosis.sensing.instrument import Instrument, respond
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.judging.test_verdict import attempt

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
        chain=SimpleNamespace(rate=RATE), seen=lambda faultless, instrument: faultless,
    )  # fmt: skip
    one = SimpleNamespace(predicted=impacts.reshape(400, 10, 3))
    return SimpleNamespace(
        followers=[SimpleNamespace(measured=measured)], hypotheses=(),
        fit=SimpleNamespace(passes=[one], values=np.zeros((1, 2))),
        model=SimpleNamespace(instrument=lambda row: Instrument()),
    )  # fmt: skip


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


def test_a_late_sensor_is_heard_beside_impacts_that_another_one_hears_wrongly():
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["sensor_delay", "sensor_gain"]), machine, "C", CHANNELS[:2])
    torn = base(2.2e-4)
    torn.followers[0].measured.values[100:120, :, 1] += 1e4  # a twentieth of the time, and loud
    torn.followers[0].measured.values[100:120, :, 0] -= 1e4
    (hint,) = _misheard(SimpleNamespace(groups=groups), torn)
    assert hint.label == "sensor_delay(rod_c_axial, delay)"
    assert hint.values == pytest.approx([2.2e-4], abs=3e-6)


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


def test_lobes_of_other_orders_that_promise_nearly_as_much_are_compared(monkeypatch):
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["worn_bearing"]), machine, "C", CHANNELS[:2])
    gains, refitted = {1: 0.4, 2: 1111.0, 3: 155.0, 4: 1372.0}, []

    def screen(_, asked, workers):
        (alike,) = asked
        (order,) = {h.start[1] for h in alike}
        values = np.array([2e-6, order, 3.0])
        return SimpleNamespace(singles=[Hint((alike[0],), values, gains[int(order)])])

    monkeypatch.setattr(scrutiny, "screen", screen)
    monkeypatch.setattr(scrutiny, "beside", lambda base, held, values: (held, values))
    nominal, worn = attempt([], 1.17), attempt(["worn_bearing"], 1.05)
    nominal.followers, nominal.scale = [], 1.0
    nominal.model, worn.fit.values = SimpleNamespace(shared=1), np.array([[3e-4, 5e-7, 4.0, 0.1]])
    search = SimpleNamespace(
        workers=1, others=lambda _: list(groups.values()), late=lambda: False, report=lambda _: None,
        refit=lambda explanation, held, followers, values, *more: refitted.append(values),
    )  # fmt: skip
    _compare_orders(search, Explanation(nominal, [worn]), nominal)
    assert [(one[0], one[1]) for one in refitted] == [(2e-6, 2.0)] * 4
    assert np.ptp([one[2] for one in refitted]) == pytest.approx(1.5 * np.pi)
    assert max(abs(one[2]) for one in refitted) <= np.pi
    _compare_orders(search, Explanation(nominal, [attempt(["gravity"], 1.0)]), nominal)
    assert len(refitted) == 4
