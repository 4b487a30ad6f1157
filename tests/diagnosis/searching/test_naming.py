"""A table that explains is put to the test against names, however late it is."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.free_search import name_curve
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.widen import Prospects
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.slider_crank import SliderCrank
from tests.diagnosis.attempts import attempt

NAMES = "clearance.diagnosis.searching.free_search.suggest_names"


@pytest.mark.parametrize(
    ("misfits", "tried", "best"),
    [
        ({"gravity": 1.0, "process_load": 1.0}, ["gravity"], "gravity"),
        ({"gravity": 1.9, "process_load": 1.0}, ["gravity", "process_load"], "process_load"),
        ({"gravity": 1.9, "process_load": 1.9}, ["gravity", "process_load"], FREE_FORM),
    ],
)
def test_what_would_turn_the_crank_alike_is_tried_in_the_place_of_a_table(monkeypatch, misfits, tried, best):
    table = attempt([FREE_FORM], 1.02)
    table.hypotheses[0].body, table.hypotheses[0].direction = "slider", "x"
    table.fit.values = np.array([[3e-4, 5.0, 700.0]])
    force = TabulatedForce("slider", "x", "time", values=(5.0,), period=0.2)
    table.model.machine = lambda row: SimpleNamespace(force=force)
    table.followers = [SimpleNamespace(measured=SimpleNamespace(clock=0.01))]
    alike = [
        SimpleNamespace(label=name, values=np.ones(1), cost=0.1, hypotheses=attempt([name], 1.0).hypotheses)
        for name in misfits
    ]
    monkeypatch.setattr(NAMES, lambda *_: alike)
    explanation, asked, clocks = Explanation(attempt([], 40.0), [table]), [], []

    def refit(explanation, held, followers, values, scale):
        asked.append(held[0].name)
        explanation.attempts.append(attempt([held[0].name], misfits[held[0].name]))

    def timed(rhythm):
        clocks.append(rhythm)
        return nullcontext()

    search = SimpleNamespace(report=lambda _: None, refit=refit, late=lambda: True, timed=timed, most=1)
    name_curve(search, explanation)
    assert clocks == [Rhythm(0.2, (0.01,))]  # the balance of work is asked by the table's own clock
    assert asked == tried
    assert explanation.best.hypotheses[0].name == best


@pytest.mark.parametrize(("most", "tried"), [(2, ["rod_inertia + process_load"]), (1, [])])
def test_beside_a_name_too_a_table_gives_way_to_another_name(monkeypatch, most, tried):
    best = attempt([FREE_FORM, "rod_inertia"], 1.08)
    best.hypotheses[0].body, best.hypotheses[0].direction = "slider", "x"
    best.fit.values = np.array([[3e-4, 5.0, 1.1, 700.0], [3e-4, 5.0, 1.1, 800.0]])
    law = TabulatedForce("slider", "x", "slider_position", values=(5.0, 4.0), start=0.1, spacing=0.1)
    best.model.machine = lambda row: SimpleNamespace(force=law)
    nominal, asked, told = SliderCrank(), [], []

    def names(search, machine, clearance):
        told.append(machine)
        return [
            SimpleNamespace(
                label=name, values=np.array([6.4]), cost=0.1, hypotheses=attempt([name], 1.0).hypotheses
            )
            for name in ("rod_inertia", "process_load")
        ]

    def refit(explanation, held, followers, values, scale):
        asked.append(" + ".join(h.name for h in held))
        np.testing.assert_array_equal(values, [[3e-4, 1.1, 6.4, 700.0], [3e-4, 1.1, 6.4, 800.0]])

    monkeypatch.setattr(NAMES, names)
    search = SimpleNamespace(
        report=lambda _: None, refit=refit, late=lambda: True, timed=lambda _: nullcontext(), most=most,
        setting=SimpleNamespace(with_clearance=lambda _: nominal),
    )  # fmt: skip
    name_curve(search, Explanation(attempt([], 40.0), [best]))
    assert asked == tried
    assert told == [replace(nominal, force=law)]


def test_names_that_promise_little_are_tried_on_the_paths_of_a_table(monkeypatch):
    """Of a machine that lacks a force nothing promises much there: friction of 0.22 promised 0.9 %."""
    table = attempt([FREE_FORM], 2.9)
    table.hypotheses[0].body, table.hypotheses[0].direction = "joint_c", "normal"
    table.fit.values, table.followers = np.zeros((2, 3)), []
    hints = [Hint(tuple(attempt([name], 1.0).hypotheses), np.ones(1), 0.1) for name in "abcd"]
    module, asked = "clearance.diagnosis.searching.free_search.", []
    monkeypatch.setattr(module + "fit", lambda *_, **__: SimpleNamespace(level=40.0))
    monkeypatch.setattr(module + "look", lambda *_: Prospects([], [], hints[:1], hints[1:], []))
    monkeypatch.setattr(module + "beside", lambda base, held, values: (held, values))
    search = SimpleNamespace(
        late=lambda: False, setting=SimpleNamespace(model=lambda held: held), workers=1, most=1,
        refit=lambda explanation, held, *_: asked.append(held[0].name),
    )  # fmt: skip
    name_curve(search, Explanation(attempt([], 400.0), [table]))
    assert asked == ["a", "b", "c"]


@pytest.mark.parametrize(("most", "expected"), [(2, ["soft_drive"]), (1, [])])
def test_a_name_in_the_place_of_a_table_is_tried_beside_the_names_that_the_table_had(
    monkeypatch, most, expected
):
    best = attempt(["soft_drive", FREE_FORM], 2.9)
    best.hypotheses[1].body, best.hypotheses[1].direction = "joint_c", "normal"
    for one in best.hypotheses:
        one.unknowns = (None,)
    best.fit.values, best.followers = np.array([[3e-4, 60.0, 1.0, 700.0]]), []
    hint, asked = Hint(tuple(attempt(["friction"], 1.0).hypotheses), np.ones(1), 0.1), []
    module, rows = "clearance.diagnosis.searching.free_search.", []
    monkeypatch.setattr(
        module + "fit",
        lambda own, model, values, *_, **__: rows.append(values) or SimpleNamespace(level=40.0),
    )
    monkeypatch.setattr(module + "look", lambda _, __, base: Prospects([], [], [hint], [], []))
    monkeypatch.setattr(module + "beside", lambda base, held, values: (base.hypotheses, values))
    search = SimpleNamespace(
        late=lambda: False, setting=SimpleNamespace(model=lambda held: held), workers=1, most=most,
        refit=lambda explanation, held, *_: asked.extend(one.name for one in held),
    )  # fmt: skip
    name_curve(search, Explanation(attempt([], 400.0), [best]))
    assert asked == expected
    np.testing.assert_array_equal(rows[0], [[3e-4, 60.0, 700.0]])
