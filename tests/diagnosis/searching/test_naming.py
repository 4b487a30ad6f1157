"""A table that explains is put to the test against names, however late it is."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.free_search import name_curve
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
    table.model.machine = lambda row: row
    alike = [
        SimpleNamespace(label=name, values=np.ones(1), cost=0.1, hypotheses=attempt([name], 1.0).hypotheses)
        for name in misfits
    ]
    monkeypatch.setattr(NAMES, lambda *_: alike)
    explanation, asked = Explanation(attempt([], 40.0), [table]), []

    def refit(explanation, held, followers, values, scale):
        asked.append(held[0].name)
        explanation.attempts.append(attempt([held[0].name], misfits[held[0].name]))

    name_curve(SimpleNamespace(report=lambda _: None, refit=refit, late=lambda: True), explanation)
    assert asked == tried
    assert explanation.best.hypotheses[0].name == best
