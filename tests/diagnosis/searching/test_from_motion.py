"""What the motion alone points at: which dimensions and lobes are followed, and until when."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.searching import from_motion
from clearance.diagnosis.searching.balance import Suggested
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.from_motion import begin_dimensions, begin_displaced, begin_wear
from clearance.diagnosis.searching.geometry import Dimension
from clearance.diagnosis.searching.wear import Wear
from tests.diagnosis.attempts import attempt
from tests.diagnosis.searching.test_from_work import pair


def dimension(name, share=0.2):
    """What the motion says of one that moves no link."""
    hypothesis = SimpleNamespace(
        name=name,
        label=name,
        fault=None,
        channel=None,
        unknowns=(None,),
        apply=lambda machine, sizes: machine,
    )
    return Dimension(hypothesis, 2e-3, 2.6e-4, share)


@pytest.mark.parametrize(
    ("share", "force", "follows", "most", "expected"),
    [
        (0.15, "process_load", True, 2, [["slider_offset", "process_load"]]),
        (0.15, "process_load", False, 2, [["slider_offset", "process_load"], ["slider_offset"]]),
        (0.15, "process_load", True, 1, [["slider_offset"]]),
        (0.15, None, True, 2, [["slider_offset"]]),
        (0.5, "process_load", True, 2, []),
    ],
)
def test_a_dimension_without_which_the_motion_hardly_agrees_comes_with_what_is_lacking_then(
    monkeypatch, share, force, follows, most, expected
):
    def fit(search, explanation, base, hypotheses, values, clearance, anew):
        tried.append([h.name for h in hypotheses])
        assert clearance == pytest.approx(2.6e-4)
        return attempt(["slider_offset"], 1.0 if follows else 90.0)

    tried = []
    forces = [] if force is None else [replace(pair(force), clearance=2.6e-4)]
    monkeypatch.setattr(from_motion, "suggest_forces", lambda *_, named: Suggested(forces, not forces))
    monkeypatch.setattr(from_motion, "settle_in", lambda search, setting, one: one)
    monkeypatch.setattr(from_motion, "fit_from", fit)
    search = SimpleNamespace(setting=Setting("machine", "B"), late=lambda: False)
    gain = Dimension(SimpleNamespace(fault="gain"), 1.1, 3e-4, 0.1)  # a sensor's fault moves no link
    one = dimension("slider_offset", share)
    search.most = most
    found = begin_displaced(search, Explanation(attempt([], 1000.0)), [gain, one])
    assert tried == expected
    assert found is (one if expected else None)


def test_a_dimension_that_was_tried_is_fitted_beside_what_was_found_since_alone(monkeypatch):
    def fit(search, explanation, base, hypotheses, *more, **other):
        tried.append([h.name for h in hypotheses])
        return attempt(["both"], 30.0)

    tried, first, other = [], dimension("slider_offset"), dimension("second_clearance")
    part = attempt(["gravity"], 20.0)
    part.fit.values = np.array([[3e-4, -9.9, 700.0]])
    monkeypatch.setattr(from_motion, "suggest_forces", lambda *_, named: Suggested([], True))
    monkeypatch.setattr(from_motion, "fit_from", fit)
    search = SimpleNamespace(
        setting=Setting("machine", "B"), late=lambda: False, timed=lambda rhythm: nullcontext()
    )
    nominal = attempt([], 1000.0)
    search.most = 2
    begin_dimensions(search, Explanation(nominal, [part]), [first, other], first)
    assert tried == [["slider_offset", "gravity"], ["second_clearance"], ["second_clearance", "gravity"]]
    tried.clear()
    search.most = 2
    begin_dimensions(search, Explanation(nominal), [first], first)
    assert tried == []


@pytest.mark.parametrize(
    ("follows", "expected"), [(None, [2.6e-4, 2.444e-4, 2.288e-4]), (1, [2.6e-4, 2.444e-4])]
)
def test_a_dimension_is_tried_with_less_clearance_where_it_is_not_followed(monkeypatch, follows, expected):
    def fit(search, explanation, base, hypotheses, values, clearance, anew):
        tried.append(clearance)
        return attempt(["slider_offset"], 1.0) if len(tried) - 1 == follows else None

    tried = []
    monkeypatch.setattr(from_motion, "suggest_forces", lambda *_, named: None)
    monkeypatch.setattr(from_motion, "fit_from", fit)
    search = SimpleNamespace(setting=Setting("machine", "B"), late=lambda: False)
    search.most = 2
    begin_displaced(search, Explanation(attempt([], 1000.0)), [dimension("slider_offset")])
    assert tried == pytest.approx(expected)


@pytest.mark.parametrize(("most", "expected"), [(0.95, 4), (0.85, 0)])
def test_beside_a_force_lobes_are_fitted_with_it_where_the_motion_agrees_clearly_better(
    monkeypatch, most, expected
):
    tried, explanation = [], Explanation(attempt([], 1000.0))
    explanation.nominal.fit.values = np.array([[5e-4, 700.0]])
    wear = Wear(SimpleNamespace(label="worn_bearing"), np.array([4e-5, 3.0, -1.9]), 5e-4, 0.9)
    monkeypatch.setattr(
        from_motion,
        "suggest_wear",
        lambda _, held, sizes: wear if (held, [*sizes]) == ([force], [890.0]) else 0,
    )
    monkeypatch.setattr(
        from_motion, "fit_from", lambda *of, anew: tried.append(([h for h in of[3]], of[4].tolist()))
    )
    force = SimpleNamespace(label="slider_spring")
    search = SimpleNamespace(report=lambda _: None, late=lambda: False)
    begin_wear(search, explanation, explanation.nominal, [force], np.array([890.0]), most)
    assert len(tried) == expected
    assert all(held == [force, wear.hypothesis] and sizes[0] == 890.0 for held, sizes in tried)


def test_lobes_are_tried_larger_than_the_motion_shows_them(monkeypatch):
    def fit(search, explanation, base, hypotheses, values, clearance, anew):
        tried.append([*values, clearance])
        if len(tried) == 3:
            explanation.attempts.append(attempt(["worn_bearing"], 1.0))

    tried, explanation = [], Explanation(attempt([], 1000.0))
    explanation.nominal.fit.values = np.array([[5e-4, 700.0]])
    wear = Wear(SimpleNamespace(label="worn_bearing"), np.array([4e-5, 3.0, -1.9]), 5e-4, 0.9)
    monkeypatch.setattr(from_motion, "suggest_wear", lambda *_: wear)
    monkeypatch.setattr(from_motion, "fit_from", fit)
    search = SimpleNamespace(report=lambda _: None, late=lambda: False)
    begin_wear(search, explanation, explanation.nominal)
    assert [one[1:3] for one in tried] == [[3.0, -1.9]] * 3
    # the gap that is seen is that beside the lobes
    assert [one[3] - one[0] for one in tried] == pytest.approx([4.6e-4] * 3)
    assert tried[0][0] == pytest.approx(4e-5)
    assert tried[0][0] < tried[1][0] < tried[2][0]
