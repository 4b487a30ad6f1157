"""Where a load on a part of the stroke begins and ends is looked for along the stroke."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following.attempt import ANNEALING, ROOM, refine
from clearance.diagnosis.searching.edges import place_edges
from clearance.diagnosis.searching.explanation import Explanation
from clearance.mechanism.load import ConstantProcess
from tests.diagnosis.attempts import attempt
from tests.diagnosis.searching.test_search import search

TRUTH = ConstantProcess(4.0, 0.086, 0.146)


@pytest.mark.slow
def test_an_edge_that_no_slope_leads_to_is_found_along_the_stroke():
    found, explanation = search(5e-4, ("process_load",), process=TRUTH)
    load, nominal = found.groups["process_load(force, start, end)"][0], explanation.nominal
    speed = nominal.fit.values[0, -1]
    values = np.array([[5e-4, 4.3, 0.1145, 0.150, speed]])
    astray = refine([load], found.setting.model([load]), nominal.followers, values, ANNEALING[3], 8)
    assert astray.misfit > ROOM
    assert abs(astray.fit.values[0, 2] - TRUTH.start) > 0.01, "a minimum that is not the truth"
    explanation = Explanation(nominal, [astray])
    place_edges(found, explanation)
    best = explanation.best
    assert best.misfit < 1.05  # an impact of it may be torn
    clearance, force, start, end = best.fit.values[0, :-1]
    assert clearance == pytest.approx(5e-4, rel=5e-4)
    assert force == pytest.approx(TRUTH.force, rel=0.02)
    assert [start, end] == pytest.approx([TRUTH.start, TRUTH.end], abs=5e-5)


@pytest.mark.parametrize(("name", "misfit"), [("process_load", 1.02), ("slider_spring", 1.3)])
def test_what_leaves_nothing_and_what_has_no_edges_is_left_alone(name, misfit):
    explanation = Explanation(attempt([], 5.0), [attempt([name], misfit)])
    place_edges(SimpleNamespace(late=lambda: False), explanation)
    assert [one.misfit for one in explanation.attempts] == [misfit]
