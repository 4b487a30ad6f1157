"""A shoe that rattles in its guide: islands are tried until one is followed."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import rattling
from clearance.diagnosis.searching.balance import Suggested
from clearance.diagnosis.searching.explanation import Explanation, Rails
from clearance.diagnosis.searching.geometry import Dimension
from clearance.diagnosis.searching.rattling import begin_guide
from clearance.diagnosis.searching.work import Balanced
from clearance.errors import InputError

LOST, HELD = None, ("follower", np.array([3e-4, 2e-5, 700.0]), 0.9)


def islands(monkeypatch, outcomes):
    """Recordings of which each has two islands; what comes of them, by speed and island."""
    asked = []

    def several(trace, model, looseness, count):
        return [SimpleNamespace(trace=trace, island=i, doubt=trace.doubts[i]) for i in range(2)]

    def grow(start, model, row, limit, patient, until):
        asked.append((row[-1], start.island))
        outcome = outcomes[start.trace.speed, start.island]
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    monkeypatch.setattr(rattling.Start, "several", staticmethod(several))
    monkeypatch.setattr(rattling, "_begun", lambda start, model, row, shares, reach: (start, row))
    monkeypatch.setattr(rattling, "stretches", lambda *_: [])
    monkeypatch.setattr(rattling, "grow", grow)
    monkeypatch.setattr(rattling, "refine", lambda held, model, followers, rows, *_: (followers, rows))
    return asked


TRACES = [SimpleNamespace(speed=700.0, doubts=[9.0, 2.0]), SimpleNamespace(speed=800.0, doubts=[1.0, 30.0])]
MODEL = SimpleNamespace(
    held=lambda row: None, machine=lambda row: None, instrument=lambda row: None, shared=2
)
ROWS = np.array([[3e-4, 2e-5, 0.0], [3e-4, 2e-5, 0.0]])


def test_likely_islands_of_all_recordings_are_tried_by_their_doubt(monkeypatch):
    asked = islands(monkeypatch, {(700.0, 0): LOST, (700.0, 1): HELD, (800.0, 0): LOST, (800.0, 1): LOST})
    search = SimpleNamespace(
        retrace=lambda r, machine, instrument: TRACES[r], report=lambda _: None, late=lambda: False
    )
    first, found = rattling._first(search, MODEL, ROWS, False, search.late)
    assert (first, found) == (0, HELD)
    assert asked == [(800.0, 0), (700.0, 1)]
    assert (ROWS[:, -1] == 0.0).all()


@pytest.mark.parametrize("false", [LOST, ("follower", np.zeros(3), 9.0), InputError("the gap has closed")])
def test_every_recording_must_be_followed_from_one_of_its_islands(monkeypatch, false):
    other = ("other", np.array([3.2e-4, 2.2e-5, 800.0]), 1.1)
    rows = np.array([[3e-4, 2e-5, one.speed] for one in TRACES])
    first = {(700.0, 0): HELD, (700.0, 1): LOST}  # from the more doubtful island
    islands(monkeypatch, first | {(800.0, 0): false, (800.0, 1): other})
    followers, found = rattling.fit_rattling(TRACES, MODEL, rows, 1, lambda: False, [], {})
    assert followers == ["follower", "other"]
    np.testing.assert_allclose(found, [[3.1e-4, 2.1e-5, 700.0], [3.1e-4, 2.1e-5, 800.0]])
    islands(monkeypatch, first | {(800.0, 0): false, (800.0, 1): false})
    assert rattling.fit_rattling(TRACES, MODEL, rows, 1, lambda: False, [], {}) is None


def test_where_a_frame_is_known_beside_it_only_the_gap_is_tried_otherwise(monkeypatch):
    islands(monkeypatch, dict.fromkeys([(700.0, 0), (700.0, 1)], LOST))
    seen = []
    model = SimpleNamespace(held=lambda row: seen.append(row.copy()), machine=lambda row: None, shared=5)
    row = np.array([3e-4, 2e-5, 54.0, 0.04, 12.0, 700.0])
    assert rattling.follow_rattling(TRACES[0], model, row, lambda: False) is None
    tried = np.array(seen)
    np.testing.assert_allclose(tried[:, 1], 2e-5 * np.array(rattling._GAPS))
    np.testing.assert_array_equal(np.delete(tried, 1, axis=1), np.repeat(np.delete(row, 1)[None], 5, axis=0))


def ways(segment, *found):
    return segment, iter(found)


def test_where_no_way_leads_on_the_place_before_is_gone_back_to():
    stack = [ways(10, "one"), ways(14, None, None)]
    assert rattling._next(stack, iter(range(9)), False) == (10, "one")
    assert len(stack) == 1
    assert rattling._next(stack, iter(range(9)), False) is None
    assert rattling._next([ways(10, "one"), ways(14, None)], iter(range(9)), True) is None
    assert rattling._next([ways(10, None, None, "late")], iter(range(2)), False) is None


def rails(monkeypatch, suggested):
    """Forces between rails that the motion shows, with which islands are followed; nothing is."""
    guide = Dimension(SimpleNamespace(name="guide_clearance"), 7e-5, 1e-4, 0.3)
    tried = []
    monkeypatch.setattr(rattling, "suggest_guide", lambda search, shown, most: guide)
    monkeypatch.setattr(rattling, "suggest_forces", lambda *_, named: suggested)
    monkeypatch.setattr(
        rattling, "_first", lambda search, model, rows, *_: tried.append((model, rows[0].tolist()))
    )
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
        ([6.0, 6.1, 6.2], 2, [""]),  # as much as strikes leave
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
    assert tried[0][1] == pytest.approx([1e-4, 7e-5, *([5.0] if expected[0] else []), 700.0])
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
