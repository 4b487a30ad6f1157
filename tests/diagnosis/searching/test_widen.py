"""Which hints are followed, and which of a channel's faults are fitted."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.widen import deafen, glaring, kinds, look
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.attempts import attempt


@pytest.mark.parametrize(
    ("loud", "scale", "expected"),
    [
        ({1: 10.0}, 1.0, "rod_c_axial"),
        ({1: 10.0, 2: 2.0}, 1.0, None),  # another one contradicts, too
        ({1: 1.2}, 1.0, None),
        ({1: 10.0}, 4.0, None),  # beside a smoothed path nothing is sure
    ],
)
def test_a_sensor_that_alone_contradicts_the_nominal_machine_glares(loud, scale, expected):
    residual = np.random.default_rng(0).normal(size=(60, 10, 3))
    for channel, factor in loud.items():
        residual[:, :, channel] *= factor
    measured = SimpleNamespace(channels=("rod_b_axial", "rod_c_axial", "slider_horizontal"))
    base = SimpleNamespace(
        scale=scale, fit=SimpleNamespace(passes=[SimpleNamespace(residual=residual)]),
        followers=[SimpleNamespace(measured=measured)],
    )  # fmt: skip
    assert glaring(base) == expected


@pytest.mark.parametrize(
    ("left", "expected"),
    [
        ([1.27, 1.37, 3.6], ["sensor_resonance", "sensor_delay"]),  # a damped resonance looks like a delay
        ([1.27, 1.60, 3.6], ["sensor_resonance"]),
    ],
)
def test_a_fault_that_explains_is_compared_with_those_that_look_alike(monkeypatch, left, expected):
    module = "clearance.diagnosis.searching.widen."
    explanation, refitted = Explanation(attempt([], 2.6)), []
    kinds = [SimpleNamespace(name=f"sensor_{kind}") for kind in ("resonance", "delay", "gain")]
    deaf = SimpleNamespace(misfit=0.8, followers=[])

    def refit(_, held, *more):
        refitted.append(held[0].name)
        explanation.attempts.append(attempt([held[0].name], 1.0))

    monkeypatch.setattr(module + "_deaf", lambda *_: deaf)
    monkeypatch.setattr(module + "beside", lambda base, held, values: (held, values))
    monkeypatch.setattr(
        module + "kinds", lambda *_: [(kind, np.ones(1), one) for kind, one in zip(kinds, left, strict=True)]
    )
    search = SimpleNamespace(report=lambda _: None, refit=refit, traces=[])
    deafen(search, explanation, explanation.nominal, "rod_c_transverse")
    assert refitted == expected


def test_a_signal_of_nothing_but_noise_is_clipped_by_no_limit(monkeypatch):
    effects = load_effects(["sensor_gain", "sensor_saturation"], [])
    channels = ("crank_a_transverse", "rod_c_axial")
    groups = gather(effects, Setting(SliderCrank(), "C").with_clearance(3e-4), "C", channels)
    ringing = np.sin(np.arange(4000) / 5.0)[:, None] * [0.1, 50.0]
    noise = 0.01 * np.random.default_rng(7).standard_normal(ringing.shape)
    for recorded, expected in ((noise, False), (np.clip(ringing, -30.0, 30.0) + noise, True)):
        measured = SimpleNamespace(
            values=recorded.reshape(-1, 10, 2),
            sigma=np.full(2, 0.01),
            channels=channels,
            chain=SimpleNamespace(rate=1e4),
            seen=lambda faultless, instrument: faultless,
        )
        base = SimpleNamespace(
            fit=SimpleNamespace(
                passes=[SimpleNamespace(predicted=ringing.reshape(-1, 10, 2))], values=np.zeros((1, 2))
            ),
            model=SimpleNamespace(instrument=lambda row: Instrument()),
        )
        channel = channels[int(expected)]
        found = kinds(SimpleNamespace(groups=groups), base, [SimpleNamespace(measured=measured)], channel)
        assert ("sensor_saturation" in [hypothesis.name for hypothesis, _, _ in found]) == expected


def test_a_hint_begins_where_the_balance_of_work_saw_a_load(monkeypatch):
    def hypothesis(label):
        return SimpleNamespace(label=label, name=label, fault=None)

    hints = [Hint((hypothesis(name),), np.zeros(3), gain) for name, gain in (("load", 5.0), ("spring", 3.0))]
    found = SimpleNamespace(singles=hints, pairs=[])
    monkeypatch.setattr("clearance.diagnosis.searching.widen.screen", lambda *_: found)
    base = attempt(["gravity"], 4.0)
    base.label = "gravity"
    seen = np.array([2.9, 0.09, 0.14])
    explanation = Explanation(attempt([], 40.0), pushes=[(hypothesis("load"), seen)])
    search = SimpleNamespace(
        others=lambda _: [], setting=SimpleNamespace(joint="C"), workers=1, report=lambda _: None
    )
    prospects = look(search, explanation, base)
    begun = {hint.label: hint.values for hint in [*prospects.promising, *prospects.unlikely]}
    np.testing.assert_array_equal(begun["load"], seen)
    np.testing.assert_array_equal(begun["spring"], np.zeros(3))
