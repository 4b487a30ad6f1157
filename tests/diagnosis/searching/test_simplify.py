"""What an explanation can do without."""

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from clearance.diagnosis.judging import verdict
from clearance.diagnosis.judging.verdict import verdict_of, withdraw
from clearance.diagnosis.searching import simplify
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.significance import beats
from clearance.diagnosis.searching.simplify import prune, retry_nominal
from tests.diagnosis.attempts import attempt


def fitted(names, misfit, structural=False, first=0):
    one = attempt(names, misfit)
    for hypothesis in one.hypotheses:
        hypothesis.structural, hypothesis.shapes = lambda _: structural, np.array([False])
    one.fit.values = np.array([[3e-4, *range(1, 1 + len(names)), 700.0]])
    one.model.only = lambda free, row: row.copy()
    one.followers = [SimpleNamespace(measured=SimpleNamespace(name="one", first=first), segments=100)]
    one.label = " + ".join(names)
    return one


class Recorder:
    """A search whose fits have misfits that are known before."""

    setting = SimpleNamespace(with_clearance=lambda _: None, model=lambda: "nominal machine", joint="C")
    workers = 1
    groups: ClassVar = {}

    def __init__(self, misfits):
        self.misfits, self.asked = misfits, []
        self.finished = SimpleNamespace(attempt=lambda held, model, make, workers: make())

    def late(self):
        return False

    def report(self, message):
        pass

    def others(self, attempt):
        return []

    def refit(self, explanation, held, followers, values, scale, iterations=8, again=False):
        assert again  # though one with the same hypotheses explains, on a path of its own
        names = [h.name for h in held]
        self.asked.append((names, values.tolist()))
        explanation.attempts.append(fitted(names, self.misfits[tuple(names)]))


def test_of_two_the_one_that_explains_nothing_goes():
    explanation = Explanation(fitted([], 40.0), [fitted(["gravity", "restitution"], 1.0)])
    search = Recorder({("gravity",): 1.0, ("restitution",): 30.0})
    prune(search, explanation)
    assert [h.name for h in explanation.best.hypotheses] == ["gravity"]
    assert [asked[1] for asked in search.asked] == [[[3e-4, 2.0, 700.0]], [[3e-4, 1.0, 700.0]]]


def retried(monkeypatch, nominal, best, again, gain, promised=80.0, at_last=False):
    """An explanation whose nominal machine was fitted on the path of the best."""
    explanation = Explanation(fitted([], nominal), [best], [SimpleNamespace(gain=promised)])

    def settle(followers, model, values, *_):
        sizes.append(model[1])
        return SimpleNamespace(values=values)

    def refine(held, model, followers, values, *_):
        assert followers == ["its own paths"]
        assert values.tolist() == [[3e-4, 700.0]]
        assert sizes == pytest.approx([0.8, 0.6, 0.4, 0.2, 0.0])  # of 1: the path follows each
        return fitted([], again)

    sizes = []
    monkeypatch.setattr(simplify, "tightened", lambda followers: ["its own paths"])
    monkeypatch.setattr(simplify, "settle", settle)
    monkeypatch.setattr(simplify, "refine", refine)
    monkeypatch.setattr(simplify, "screen", lambda *_: SimpleNamespace(singles=[SimpleNamespace(gain=gain)]))
    retry_nominal(Recorder({}), explanation, at_last)
    return explanation


@pytest.mark.parametrize(("unsure", "expected"), [(2.0, 1.01), (0.1, 40.0)])
def test_a_nominal_machine_that_was_lost_is_fitted_where_an_effect_that_may_as_well_be_off_led(
    monkeypatch, unsure, expected
):
    """The effect's size is 1, and off is 0: with a small deviation it is there."""
    monkeypatch.setattr(simplify, "deviations", lambda fit: np.array([1e-6, unsure]))
    assert retried(monkeypatch, 40.0, fitted(["gravity"], 1.0), 1.01, 5.0).nominal.misfit == expected


@pytest.mark.parametrize(("promised", "expected"), [(5.0, 1.01), (80.0, 1.74)])
def test_a_nominal_machine_whose_path_is_torn_is_fitted_where_no_look_is_sure_of_anything(
    monkeypatch, promised, expected
):
    monkeypatch.setattr(simplify, "deviations", lambda fit: np.array([1e-6, 0.1]))
    found = retried(monkeypatch, 1.74, fitted(["gravity"], 1.0), 1.01, 5.0, promised)
    assert found.nominal.misfit == expected


def variant(*names):
    unknowns = tuple(SimpleNamespace(name=name, low=-1e6, high=1e6) for name in names)
    return SimpleNamespace(
        name="guide_friction", channel=None, unknowns=unknowns, off=np.zeros(len(names)),
        shapes=np.array([name.endswith("velocity") for name in names]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("spread", "expected"), [(0.5, [["coulomb"]]), (0.01, []), (2.0, [["coulomb"], ["viscous"]])]
)
def test_parameters_that_may_as_well_be_off_are_tried_without(monkeypatch, spread, expected):
    best = fitted(["guide_friction"], 1.0)
    best.hypotheses = (variant("coulomb", "viscous", "velocity"),)
    best.fit.values = np.array([[3e-4, 3.0, 0.1, 0.4, 700.0]])
    best.model.shared = 4
    monkeypatch.setattr(simplify, "deviations", lambda fit: np.full(4, spread))
    search, asked = Recorder({}), []
    search.groups = {n: [variant(n)] for n in ("coulomb", "viscous")} | {"gap": [variant("gap")]}

    def refit(explanation, held, followers, values, scale, again):
        asked.append([u.name for u in held[0].unknowns])
        assert values.tolist() == [[3e-4, 3.0 if asked[-1] == ["coulomb"] else 0.1, 700.0]]

    search.refit = refit
    prune(search, Explanation(fitted([], 40.0), [best]))
    assert asked == expected


@pytest.mark.parametrize(
    ("again", "expected"),
    [(1.0, "none"), (1.004, "none"), (1.06, "physics")],
)
def test_nothing_is_missing_where_the_nominal_machine_does_as_well_on_that_path(monkeypatch, again, expected):
    monkeypatch.setattr(verdict, "estimates", lambda best: [SimpleNamespace(low=1, high=2)] * 2)
    explanation = retried(monkeypatch, 1.1, fitted(["restitution"], 1.0), again, 9.0)
    assert explanation.nominal.misfit == again
    assert [hint.gain for hint in explanation.hints] == [9.0]  # the old path's promises are its errors
    withdraw(explanation)
    assert verdict_of(explanation) == expected


@pytest.mark.parametrize(
    ("nominal", "best"),
    [(40.0, fitted(["restitution"], 1.0)), (1.1, fitted(["second_clearance"], 1.0, structural=True))],
)
def test_the_nominal_machine_keeps_its_own_path_where_another_is_no_beginning(monkeypatch, nominal, best):
    monkeypatch.setattr(simplify, "deviations", lambda fit: np.array([1e-6, 0.1]))  # it is surely there
    explanation = retried(monkeypatch, nominal, best, 1.0, 9.0)
    assert explanation.nominal.misfit == nominal
    assert [hint.gain for hint in explanation.hints] == [80.0]


@pytest.mark.parametrize(
    ("again", "at_last", "expected"),
    [(1.01, True, 1.01), (1.01, False, 814.0), (30.0, True, 814.0)],  # unless it explains it is no other
)
def test_any_nominal_machine_that_was_lost_is_asked_at_last(monkeypatch, again, at_last, expected):
    """However sure the effect is: beside a machine that was lost any is asserted."""
    monkeypatch.setattr(simplify, "deviations", lambda fit: np.array([1e-6, 0.1]))
    found = retried(monkeypatch, 814.0, fitted(["restitution"], 1.0), again, 9.0, at_last=at_last)
    assert found.nominal.misfit == expected


@pytest.mark.parametrize("nominal", [1.0, 40.0])
def test_where_nothing_was_found_beside_the_nominal_machine_it_stands(nominal):
    explanation = Explanation(fitted([], nominal), [], [SimpleNamespace(gain=80.0)])
    retry_nominal(Recorder({}), explanation, at_last=True)
    assert explanation.nominal.misfit == nominal


@pytest.mark.parametrize(
    ("nominal", "best", "at_last", "expected"),
    [
        (814.0, 1.0, True, 1.01),
        (814.0, 1.0, False, 814.0),  # it takes time
        (814.0, 30.0, True, 814.0),  # a path that is lost, too, tells nothing
        (1.1, 1.0, True, 1.1),  # it has a path of its own
    ],
)
def test_a_nominal_machine_that_was_lost_is_followed_anew_from_where_other_coordinates_led(
    monkeypatch, nominal, best, at_last, expected
):
    explanation = Explanation(fitted([], nominal), [fitted(["flexible_base"], best, structural=True)])

    def followed(search, model, clearance):
        assert (model, clearance) == ("nominal machine", 3e-4)
        return fitted([], 1.01)

    monkeypatch.setattr(simplify, "follow_nominal", followed)
    monkeypatch.setattr(simplify, "screen", lambda *_: SimpleNamespace(singles=[]))
    retry_nominal(Recorder({}), explanation, at_last)
    assert explanation.nominal.misfit == expected


@pytest.mark.parametrize(
    ("first", "misfit", "expected"),
    [
        (0, 0.99, True),  # 100 less, of which 9 are the price
        (0, 0.995, False),
        (10, 0.99, False),  # on another stretch chance may bring that
        (10, 0.97, True),
    ],
)
def test_what_beats_the_nominal_machine_leaves_less_than_chance_would(first, misfit, expected):
    assert beats(fitted(["restitution"], misfit, first=first), Explanation(fitted([], 1.0))) == expected


def test_a_nominal_machine_that_does_not_explain_is_beaten_by_anything():
    assert beats(fitted(["restitution"], 1.0), Explanation(fitted([], 40.0)))
