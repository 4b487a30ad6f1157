"""A table that explains is put to the test against names, however late it is."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.free_search import name_curve
from clearance.mechanism.applied_force import TabulatedForce
from tests.diagnosis.judging.test_verdict import attempt

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

    search = SimpleNamespace(report=lambda _: None, refit=refit, late=lambda: True, timed=timed)
    name_curve(search, explanation)
    assert clocks == [Rhythm(0.2, (0.01,))]  # the balance of work is asked by the table's own clock
    assert asked == tried
    assert explanation.best.hypotheses[0].name == best
