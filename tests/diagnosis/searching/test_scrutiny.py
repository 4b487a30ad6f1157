"""What is small, or hidden, beside a machine that explains the recordings."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.effect_files import load_effects
from clearance.diagnosis.hypotheses.hypothesis import Setting, gather
from clearance.diagnosis.searching import scrutiny
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.scrutiny import (
    _compare_orders,
    compare_kinds,
    look_beside_nominal,
    scrutinise,
)
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.attempts import attempt


def test_lobes_of_other_orders_that_promise_nearly_as_much_are_compared(monkeypatch):
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    groups = gather(load_effects(["worn_bearing"]), machine, "C", ("rod_c_axial", "rod_c_transverse"))
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


def test_the_look_beside_the_nominal_machine_is_taken_once(monkeypatch):
    looked = []
    monkeypatch.setattr(
        scrutiny, "screen", lambda base, *_: looked.append(base) or SimpleNamespace(singles=["a hint"])
    )
    nominal = attempt([], 1.0)
    explanation, search = Explanation(nominal), SimpleNamespace(others=lambda _: [], workers=1)
    look_beside_nominal(search, explanation)
    look_beside_nominal(search, explanation)
    assert (looked, explanation.hints) == ([nominal], ["a hint"])
    other = Explanation(nominal)
    look_beside_nominal(search, other, SimpleNamespace(singles=["another"]))
    assert (looked, other.hints) == ([nominal], ["another"])


@pytest.mark.parametrize(("gain", "expected"), [(34.0, [0.999, 0.9]), (25.0, [])])
def test_beside_a_nominal_machine_what_promises_more_than_nothing_missing_does_is_fitted(
    monkeypatch, gain, expected
):
    """Begun where it has hardly begun, and whole where that gains little; a named one needs more."""
    refitted = []
    machine = Setting(SliderCrank(), "C").with_clearance(3e-4)
    (group,) = gather(load_effects(["contact_stiffness"]), machine, "C", ("rod_c_axial",)).values()
    hint = Hint((group[0],), np.array([0.9]), gain)
    monkeypatch.setattr(scrutiny, "screen", lambda *_: SimpleNamespace(singles=[hint]))
    monkeypatch.setattr(scrutiny, "beside", lambda base, held, values: (held, values))
    for name in ("misheard", "rejoin_impacts"):
        monkeypatch.setattr(scrutiny, name, lambda *_: [])
    search = SimpleNamespace(
        workers=1, most=2, others=lambda _: [group], late=lambda: False, report=lambda _: None,
        refit=lambda explanation, held, followers, values, *more: refitted.append(float(values[0])),
    )  # fmt: skip
    nominal, heavy = attempt([], 1.0), attempt(["gravity"], 1.0)
    for one in (nominal, heavy):
        one.followers, one.scale = [], 1.0
    scrutinise(search, Explanation(nominal))
    assert refitted == pytest.approx(expected)
    refitted.clear()
    scrutinise(search, Explanation(attempt([], 9.0), [heavy]))
    assert refitted == []


def test_other_kinds_of_a_sensors_fault_are_fitted_where_they_leave_nearly_as_little(monkeypatch):
    refitted = []
    both = attempt(["gravity", "sensor_resonance"], 1.0)
    both.followers, both.scale = [], 1.0
    both.fit.values = np.array([[1e-4, -9.0, 3700.0, 0.7, 70.0], [1e-4, -9.0, 3700.0, 0.7, 80.0]])
    both.hypotheses[0].unknowns, both.hypotheses[1].unknowns = [None], [None, None]
    kinds = zip(("resonance", "delay", "gain"), (1.0, 1.1, 1.3), strict=True)
    kinds = [(SimpleNamespace(name=f"sensor_{kind}"), np.array([6e-5]), left) for kind, left in kinds]
    monkeypatch.setattr(scrutiny, "kinds", lambda *_: kinds)
    search = SimpleNamespace(
        late=lambda: False, refit=lambda _, held, followers, rows, *more: refitted.append((held, rows))
    )
    compare_kinds(search, Explanation(attempt([], 9.0), [both]))
    assert refitted == []  # no sensor's fault
    both.hypotheses[1].channel = "rod_c_axial"
    compare_kinds(search, Explanation(attempt([], 9.0), [both]))
    ((held, rows),) = refitted
    assert [one.name for one in held] == ["gravity", "sensor_delay"]
    assert rows.tolist() == [[1e-4, -9.0, 6e-5, 70.0], [1e-4, -9.0, 6e-5, 80.0]]
