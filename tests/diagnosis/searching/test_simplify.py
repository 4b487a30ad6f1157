"""What an explanation can do without."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.simplify import prune
from tests.diagnosis.judging.test_verdict import attempt


def fitted(names, misfit, structural=False):
    one = attempt(names, misfit)
    for hypothesis in one.hypotheses:
        hypothesis.structural = lambda _: structural
    one.fit.values, one.followers = np.array([[3e-4, *range(len(names)), 700.0]]), "its paths"
    return one


class Recorder:
    """A search that refits with misfits that are known before."""

    setting = SimpleNamespace(with_clearance=lambda _: None)

    def __init__(self, misfits):
        self.misfits, self.asked = misfits, []

    def refit(self, explanation, held, followers, values, scale):
        assert followers == "its paths"
        names = [h.name for h in held]
        self.asked.append((names, values.tolist(), scale))
        explanation.attempts.append(fitted(names, self.misfits[tuple(names)]))


@pytest.mark.parametrize(("bare", "expected"), [(1.0, []), (1.005, []), (1.06, ["restitution"])])
def test_an_effect_goes_where_the_nominal_machine_does_as_well_on_its_path(bare, expected):
    explanation = Explanation(fitted([], 1.06), [fitted(["restitution"], 1.0)])
    search = Recorder({(): bare})
    prune(search, explanation)
    assert [h.name for h in explanation.best.hypotheses] == expected
    assert search.asked == [([], [[3e-4, 700.0]], 1.0)]
    assert explanation.nominal.misfit == bare
    assert all(one.hypotheses for one in explanation.attempts)
    assert all(one.withdrawn == (not expected) for one in explanation.attempts)


def test_one_effect_stays_where_the_nominal_machine_was_far():
    explanation = Explanation(fitted([], 40.0), [fitted(["restitution"], 1.0)])
    search = Recorder({})
    prune(search, explanation)
    assert search.asked == []
    assert explanation.best.hypotheses


def test_of_two_the_one_that_explains_nothing_goes():
    explanation = Explanation(fitted([], 40.0), [fitted(["gravity", "restitution"], 1.0)])
    search = Recorder({("gravity",): 1.0, ("restitution",): 30.0})
    prune(search, explanation)
    assert [h.name for h in explanation.best.hypotheses] == ["gravity"]
    assert [asked[1] for asked in search.asked] == [[[3e-4, 1.0, 700.0]], [[3e-4, 0.0, 700.0]]]


def test_a_path_with_other_coordinates_is_no_beginning_for_the_nominal_machine():
    explanation = Explanation(fitted([], 1.1), [fitted(["second_clearance"], 1.0, structural=True)])
    prune(Recorder({}), explanation)
    assert explanation.best.hypotheses
