"""Where nothing is followed: effects with patience on one recording, then what follows it on all."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import patient
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.patient import begin_patiently
from tests.diagnosis.attempts import attempt

NOMINAL = 300.0


class Bench:
    """Two recordings, and what is left of each with which effects; an effect that is not listed is lost."""

    def __init__(self, monkeypatch, left, names, doubts=((1.0,), (2.0,)), best=None):
        self.dimensions, self.begun = [], []
        self.left, self.doubts, self.grown, self.told, self.limits = left, doubts, [], [], {}
        traces = [SimpleNamespace(number=r, speed=700.0) for r in range(2)]
        self.search = SimpleNamespace(
            groups={name: [hypothesis(name)] for name in names}, clearance=3e-4, traces=traces,
            most=2, workers=1,
            starts=[SimpleNamespace(doubt=min(each)) for each in doubts],
            recordings=[SimpleNamespace(raw=None)] * 2,
            late=lambda: False, report=lambda _: None, keep=self.keep, retrace=lambda r, *_: traces[r],
            setting=SimpleNamespace(model=self.model, with_clearance=lambda _: None, joint="C"),
            finished=SimpleNamespace(followed=lambda label, make: make()),
        )  # fmt: skip
        self.explanation = Explanation(attempt([], NOMINAL, each=[NOMINAL] * 2), [best] if best else [])
        monkeypatch.setattr(patient.Start, "several", staticmethod(self.several))
        monkeypatch.setattr(patient, "grow", self.grow)
        monkeypatch.setattr(patient, "refine", self.refine)
        monkeypatch.setattr(patient._OneRecording, "_tables", lambda _: [])
        monkeypatch.setattr(patient, "suggest_wear", lambda *_: None)
        monkeypatch.setattr(patient, "same", lambda one, other: one.name == other.name)

    def model(self, held):
        names = " + ".join(one.name for one in held) or "nominal"
        return SimpleNamespace(
            names=names, shared=1 + len(held), held=lambda row: names, machine=lambda _: None,
            instrument=lambda _: None,
        )  # fmt: skip

    def several(self, trace, model, looseness, count):
        each = self.doubts[trace.number][:count]
        return [SimpleNamespace(trace=trace, island=i, doubt=doubt) for i, doubt in enumerate(each)]

    def grow(self, start, model, row, limit, patient):
        assert patient
        if model.names != "nominal":
            self.grown.append((start.trace.number, model.names, start.island))
            self.begun.append(row)
        self.limits.setdefault(model.names, limit)
        left = self.left.get(model.names, (None, None))[start.trace.number]
        return None if left is None or left > limit else (model.names, row, left)

    def refine(self, held, model, followers, rows, scale, *_):
        if len(followers) == 1:
            misfit = self.left[model.names][0]
            return SimpleNamespace(followers=followers, fit=SimpleNamespace(values=rows), misfit=misfit)
        return attempt([one.name for one in held], max(self.left[model.names]))

    def keep(self, explanation, held, make):
        found = make()
        self.told.append((" + ".join(one.name for one in held), found is not None))
        if found is not None:
            explanation.attempts.append(found)
        return found


def hypothesis(name):
    return SimpleNamespace(
        name=name, label=name, fault=None, shapes=np.array([False]), start=np.array([1.0]),
        structural=lambda _: False, body="slider", direction="x",
    )  # fmt: skip


def test_the_effect_that_follows_one_recording_is_fitted_to_all_and_ends_the_search(monkeypatch):
    left = {"friction": (1.1, 1.2), "gravity": (43.0, None)}
    bench = Bench(monkeypatch, left, ["gravity", "friction", "spring"])
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert bench.told == [("friction", True)]
    assert [names for _, names, _ in bench.grown] == ["gravity", "friction", "friction"]
    assert bench.limits["friction"] == 43.0  # no worse than gravity does
    assert bench.explanation.best.label == "friction"


def test_the_other_of_two_is_looked_for_beside_what_leaves_least(monkeypatch):
    left = {"bending": (50.0, None), "bending + mass": (0.9, 1.0), "mass": (59.0, None)}
    bench = Bench(monkeypatch, left, ["mass", "bending", "spring"])
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert bench.told == [("bending + mass", True)]
    assert bench.limits["bending + mass"] == pytest.approx(15.0)


def test_a_part_that_stays_one_is_fitted_to_all_at_last(monkeypatch):
    bench = Bench(monkeypatch, {"bending": (50.0, 55.0)}, ["mass", "bending"])
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert bench.told == [("bending", True)]
    assert {r for r, names, _ in bench.grown if names == "mass"} == {0}  # one recording was enough


def test_beside_an_effect_that_follows_the_recording_no_other_is_looked_for(monkeypatch):
    bench = Bench(
        monkeypatch, {"friction": (1.2, None), "friction + spring": (1.2, None)}, ["friction", "spring"]
    )
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert bench.told[0] == ("friction", False)
    assert "friction + spring" not in [names for _, names, _ in bench.grown]


def test_the_next_recording_is_asked_where_one_is_followed_with_nothing(monkeypatch):
    bench = Bench(monkeypatch, {"friction": (None, 1.0)}, ["friction"])
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert bench.told == [("friction", False)]  # the first recording is lost with it
    assert [r for r, _, _ in bench.grown] == [0, 1, 0]


@pytest.mark.parametrize("explains", [True, False])
def test_a_nominal_machine_that_was_lost_is_found_at_another_clearance_before_anything_is_added(
    monkeypatch, explains
):
    bench, traced = Bench(monkeypatch, {"nominal": (0.9, None)}, ["friction"]), []

    def retrace_all(clearance):
        traced.append(clearance)
        bench.search.clearance = 9.9

    def find_nominal(search, explanation):
        if explains:
            explanation.nominal = attempt([], 1.0)

    bench.search.retrace_all = retrace_all
    monkeypatch.setattr(patient, "find_nominal", find_nominal)
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert traced[0] == 3e-4
    assert bench.search.clearance == (9.9 if explains else 3e-4)
    assert bool(bench.grown) != explains


@pytest.mark.parametrize(("share", "expected"), [(0.9, [0, 0, 1, 1]), (0.96, [])])
def test_lobes_at_which_the_motion_points_come_first_and_larger_in_less_clearance(
    monkeypatch, share, expected
):
    """By the rod's four sensors it shows 21 um of 36, in 0.284 mm of 0.223."""
    bench, made = Bench(monkeypatch, {"friction": (1.0, 1.0)}, ["friction"]), []
    traces = bench.search.traces
    bench.search.retrace = lambda r, *_: made.append(r) or traces[r]
    shown = SimpleNamespace(
        hypothesis=hypothesis("worn_bearing"), values=np.array([2e-5, 3.0, -2.4]), clearance=3e-4, share=share
    )
    monkeypatch.setattr(patient, "suggest_wear", lambda *_: shown)
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert [r for r, names, _ in bench.grown if names == "worn_bearing"] == expected
    assert made == [*expected, 1]  # a worn bore shows another path; the other recording is told of friction
    assert [names for _, names, _ in bench.grown][len(expected) :] == ["friction", "friction"]
    if expected:
        np.testing.assert_allclose(bench.begun[0], [3e-4, 2e-5, 3.0, -2.4, 700.0])
        np.testing.assert_allclose(bench.begun[1], [2.64e-4, 2.9e-5, 3.0, -2.4, 700.0])


def test_a_dimension_at_which_the_motion_points_comes_first_with_its_clearance(monkeypatch):
    bench = Bench(monkeypatch, {"gap": (40.0, None), "gap + bending": (1.0, 1.0)}, ["bending"])
    bench.dimensions = [
        SimpleNamespace(hypothesis=hypothesis("gap"), value=3e-4, clearance=5e-4),
        SimpleNamespace(hypothesis=hypothesis("gain"), value=0.9, clearance=6e-4),
    ]
    bench.dimensions[1].hypothesis.fault = "gain"
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert [names for _, names, _ in bench.grown] == [
        "gap",
        "gap",
        "bending",
        "gap + bending",
        "gap + bending",
    ]
    np.testing.assert_allclose(bench.begun[0], [5e-4, 3e-4, 700.0])


@pytest.mark.parametrize(
    ("doubts", "expected"),
    [([10.0, 25.0], [0, 1]), ([10.0, 31.0], [0]), ([0.5, 7.0], [0, 1]), ([0.5, 8.0], [0])],
)
def test_islands_that_are_doubted_much_more_than_the_surest_are_left_out(monkeypatch, doubts, expected):
    bench = Bench(monkeypatch, {}, ["friction"], doubts=(doubts, [99.0]))
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert [island for r, _, island in bench.grown if r == 0] == expected


@pytest.mark.parametrize(
    ("left", "fault", "first"),
    [(100.0, None, "load + friction"), (250.0, None, "load"), (100.0, "channel", "load")],
)
def test_what_else_acts_beside_a_named_part_is_asked_first(monkeypatch, left, fault, first):
    part = attempt(["load"], left, each=[left] * 2)
    part.followers, part.fit.values = ["load"] * 2, np.array([[3e-4, 9.0, 700.0]] * 2)
    part.hypotheses = (hypothesis("load"),)
    part.hypotheses[0].fault = fault
    bench = Bench(monkeypatch, {"load + friction": (1.0, 1.0)}, ["load", "friction"], best=part)
    begin_patiently(bench.search, bench.explanation, bench.dimensions)
    assert bench.grown[0][1] == first
