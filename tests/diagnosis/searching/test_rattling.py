"""A shoe that rattles in its guide: islands are tried until one is followed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import rattling
from clearance.diagnosis.searching.balance import Suggested
from clearance.diagnosis.searching.explanation import Explanation, Rails
from clearance.diagnosis.searching.geometry import Dimension
from clearance.diagnosis.searching.rattling import begin_guide
from clearance.diagnosis.searching.work import Balanced
from tests.diagnosis.following.test_rattling import HELD, LOST, MODEL, ROWS, TRACES, islands


def test_likely_islands_of_all_recordings_are_tried_by_their_doubt(monkeypatch):
    asked = islands(monkeypatch, {(700.0, 0): LOST, (700.0, 1): HELD, (800.0, 0): LOST, (800.0, 1): LOST})
    search = SimpleNamespace(
        retrace=lambda r, machine, instrument: TRACES[r], report=lambda _: None, late=lambda: False
    )
    monkeypatch.setattr(rattling, "stretches", lambda *_: [])
    first, found = rattling._first(search, MODEL, ROWS, False, search.late)
    assert (first, found) == (0, HELD)
    assert asked == [(800.0, 0), (700.0, 1)]
    assert (ROWS[:, -1] == 0.0).all()


def rails(monkeypatch, suggested):
    """Forces between rails that the motion shows, with which islands are followed; nothing is."""
    guide = Dimension(SimpleNamespace(name="guide_clearance"), 7e-5, 1e-4, 0.3)
    tried = []
    monkeypatch.setattr(rattling, "suggest_guide", lambda search, shown, most: guide)
    monkeypatch.setattr(rattling, "suggest_forces", lambda *_, named: suggested)
    monkeypatch.setattr(
        rattling, "_first", lambda search, model, rows, *_: tried.append((model, rows[0].tolist()))
    )
    monkeypatch.setattr(rattling, "settle_in", lambda search, setting, one: replace(one, clearance=9e-5))
    setting = SimpleNamespace(
        added=lambda held, sizes: None, model=lambda held: tuple(one.name for one in held)
    )  # fmt: skip
    nominal = SimpleNamespace(
        hypotheses=(), model=SimpleNamespace(shared=1), fit=SimpleNamespace(values=np.array([[2e-4, 700.0]]))
    )
    search = SimpleNamespace(
        setting=setting,
        profile=SimpleNamespace(best=1.2e-4),
        groups={},
        recordings=[SimpleNamespace(channels=())],
        late=lambda: False,
        most=2,
        deadline=np.inf,
    )
    return search, SimpleNamespace(nominal=nominal, rails=None), tried


def force(name, cost):
    gain = SimpleNamespace(turns=False)
    return Balanced((SimpleNamespace(name=name, unknowns=(gain,)),), np.array([5.0]), cost, 1e-4)


@pytest.mark.parametrize(
    ("costs", "most", "expected"),
    [
        ([3.3, 3.8, 3.9], 2, ["soft_drive", "rod_inertia", ""]),
        ([8.0, 8.1, 8.2], 2, [""]),  # as much as strikes leave
        ([2.0, 3.8, 3.9], 2, ["soft_drive"]),  # beyond doubt
        ([3.3, 3.8, 3.9], 1, [""]),
    ],
)
def test_between_rails_recordings_are_followed_with_the_forces_that_go_with_these(
    monkeypatch, costs, most, expected
):
    named = zip(["soft_drive", "rod_inertia", "rod_inertia"], costs, strict=True)
    suggested = Suggested([force(*one) for one in named], balanced=False, lacking=10.0)
    search, explanation, tried = rails(monkeypatch, suggested)
    search.most = most
    assert begin_guide(search, explanation)
    names = [tuple(["guide_clearance", *([one] if one else [])]) for one in expected]
    assert [one for one, _ in tried[: len(names)]] == names
    sizes, clearance = ([5.0], 9e-5) if expected[0] else ([], 1e-4)
    assert tried[0][1] == pytest.approx([clearance, 7e-5, *sizes, 700.0])
    assert tried[len(names) - 1][1][0] == (1e-4 if expected[-1] == "" else 9e-5)
    assert len(tried) == len(names) * len(rattling._TRIES)


@pytest.mark.parametrize(("costs", "named"), [([2.0, 3.8, 3.9], True), ([3.3, 3.8, 3.9], False)])
def test_a_force_beyond_doubt_is_known_though_no_path_is_found(monkeypatch, costs, named):
    each = zip(["soft_drive", "rod_inertia", "rod_inertia"], costs, strict=True)
    suggested = Suggested([force(*one) for one in each], balanced=False, lacking=10.0)
    search, explanation, _ = rails(monkeypatch, suggested)
    search.recordings[0].channels = ("slider_vertical",)
    seen = Rails(1e-4, 7e-5, np.array([1e-5, 7e-6]))
    monkeypatch.setattr(rattling, "measure_rails", lambda *_: seen)
    begin_guide(search, explanation)
    assert [one.name for one in explanation.rails.beside] == (["soft_drive"] if named else [])
    np.testing.assert_allclose(explanation.rails.sizes, [5.0] if named else [])
    assert explanation.rails.clearance == (9e-5 if named else 1e-4)  # what goes with the force
    np.testing.assert_allclose(explanation.rails.deviations, [1e-5, 7e-6, *([0.25] if named else [])])


@pytest.mark.parametrize(
    ("joint", "channel", "misfit", "gap"),
    [
        ("B", "rod_c_axial", 2.4, True),
        ("B", "rod_c_axial", 90.0, False),
        ("B", "rod_c_axial", None, False),  # follows no better
        ("B", "slider_vertical", 2.4, False),  # no other play moves the slider so
        ("C", "rod_c_axial", 2.4, False),
    ],
)
def test_what_looks_like_rails_may_be_play_in_the_other_joint(monkeypatch, joint, channel, misfit, gap):
    search, explanation, tried = rails(monkeypatch, None)
    search.setting.joint, explanation.nominal.misfit, asked = joint, 114.0, []
    explanation.rattles = np.inf
    search.groups["second"] = [SimpleNamespace(name="second_clearance")]
    search.recordings[0].channels = (channel,)
    monkeypatch.setattr(rattling, "measure_rails", lambda *_: None)

    def fitted(search, explanation, base, held, sizes, clearance, anew):
        asked.append((held[0].name, sizes.tolist(), clearance))
        return None if misfit is None else SimpleNamespace(misfit=misfit)

    monkeypatch.setattr(rattling, "fit_from", fitted)
    assert begin_guide(search, explanation)
    assert asked == ([("second_clearance", [7e-5], 1.2e-4)] if (joint, channel[:3]) == ("B", "rod") else [])
    assert (tried == []) == gap
    assert (explanation.rattles == np.inf) == gap


def test_forces_that_are_known_are_not_asked_for(monkeypatch):
    search, explanation, tried = rails(monkeypatch, None)
    known = [SimpleNamespace(name="torque_ripple")]
    assert begin_guide(search, explanation, None, known, np.array([0.5]))
    assert {one for one, _ in tried} == {("guide_clearance", "torque_ripple")}
    search.most = 1
    other = Explanation(explanation.nominal)
    assert not begin_guide(search, other, None, known, np.array([0.5]))
    assert explanation.rattles < 1.0
    assert other.rattles == np.inf


@pytest.mark.parametrize(
    ("misfits", "told", "expected"),
    [
        ([0.97], False, [7e-5]),  # explained at once
        ([12.1, 0.97], False, [7e-5, 7.1e-5]),  # the path was torn somewhere
        ([12.1] * 9, False, [7e-5, 7.1e-5, 7.2e-5]),
        ([12.1] * 9, True, [7e-5]),  # one recording tells of rails, whatever is lost in others
    ],
)
def test_what_one_recording_tells_begins_another_round_until_all_are_explained(
    monkeypatch, misfits, told, expected
):
    search, explanation, _ = rails(monkeypatch, None)
    left, begun = iter(misfits), []

    def first(search, model, rows, shortly, late):
        begun.append(rows[0, 1])
        return 0, (None, np.array([1e-4, rows[0, 1] + 1e-6, 700.0]), 1.8)

    def keep(explanation, held, make):
        assert make.args[-1][1][1] == begun[-1] + 1e-6  # on what was followed this time
        misfit = next(left)
        explanation.best = SimpleNamespace(scale=1.0, level=misfit, misfits=[misfit])

    monkeypatch.setattr(rattling, "_first", first)
    monkeypatch.setattr(rattling, "_told", lambda *_: "rails" if told else None)
    search.keep = keep
    search.setting.model = lambda held: SimpleNamespace(shared=2)
    assert begin_guide(search, explanation)
    assert begun == pytest.approx(expected)
    assert explanation.rails == ("rails" if told else None)
