"""Which recording leads: the others learn the machine from the one that is followed first."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import one_by_one
from clearance.diagnosis.searching import search as searching
from clearance.diagnosis.searching.one_by_one import follow_all
from clearance.diagnosis.searching.search import Search

SHARED, SURE = 2, 1  # the second recording's start is the surest
TRACE = SimpleNamespace(length=100)


@pytest.mark.parametrize(("insist", "leader"), [(0, None), (1, 0)])
def test_where_the_surest_recording_is_lost_another_leads_if_the_values_were_pointed_at(
    monkeypatch, insist, leader
):
    asked = []

    def grow(start, model, row, limit):
        asked.append(start.number)
        lost = start.number == SURE and len(model.unknowns) > 1  # with all unknowns, not with its speed alone
        return None if lost else (f"path {start.number}", np.full(len(row), 7.0), 0.9)

    monkeypatch.setattr(one_by_one, "grow", grow)
    monkeypatch.setattr(searching, "refine", lambda held, model, followers, rows, *_: (followers, rows))
    search = object.__new__(Search)
    search.workers = 1
    starts = [
        SimpleNamespace(number=0, doubt=2.0, trace=TRACE),
        SimpleNamespace(number=SURE, doubt=1.0, trace=TRACE),
    ]
    model = SimpleNamespace(
        shared=SHARED, unknowns="abc", only=lambda kept, row: SimpleNamespace(unknowns="abc"[: len(kept)])
    )
    found = search.grown((), np.zeros((2, 3)), starts, model=model, insist=insist)
    if leader is None:
        assert found is None
        assert asked == [SURE]
        return
    followers, rows = found
    assert asked == [SURE, leader, SURE]
    assert followers == ["path 0", "path 1"]
    np.testing.assert_array_equal(rows, 7.0)


def test_a_second_round_begins_with_a_little_more_clearance(monkeypatch):
    asked = []

    def grow(start, model, row, limit):
        asked.append((start.number, float(row[0])))
        return None

    monkeypatch.setattr(one_by_one, "grow", grow)
    starts = [
        SimpleNamespace(number=0, doubt=2.0, trace=TRACE),
        SimpleNamespace(number=SURE, doubt=1.0, trace=TRACE),
    ]
    model = SimpleNamespace(shared=SHARED, unknowns="abc")
    assert follow_all(starts, model, np.ones((2, 3)), lambda r, row: None, 1, insist=2) is None
    assert asked == [(SURE, 1.0), (0, 1.0), (SURE, pytest.approx(1.01)), (0, pytest.approx(1.01))]


@pytest.mark.parametrize(
    ("misfits", "again"),
    [
        ((1.0, 0.98, 1.1), []),  # all are followed: none waits for what another tells
        ((9.0, 0.98, 1.1), [0]),
        ((4.0, 3.0, 7.0), [2]),  # none is followed: one that leaves much more begins as the best one ended
    ],
)
def test_where_all_have_come_to_be_followed_each_tells_a_clearance_by_itself(monkeypatch, misfits, again):
    asked = []

    def grow(start, model, row, limit):
        asked.append((start.number, float(row[0]), len(row)))
        told = 0.1 * start.number + 5.0
        misfit = misfits[start.number] if row[0] == 1.0 else 1.2
        return f"path {start.number}", np.full(len(row), told), misfit

    monkeypatch.setattr(one_by_one, "grow", grow)
    starts = [SimpleNamespace(number=r, doubt=1.0, trace=TRACE) for r in range(3)]
    model = SimpleNamespace(shared=1, only=lambda kept, row: None)
    values = np.tile([1.0, 2.0], (3, 1))
    followers, rows, misfit = follow_all(starts, model, values, lambda r, row: (), 1)
    assert asked[:3] == [(0, 1.0, 2), (1, 1.0, 2), (2, 1.0, 2)]
    assert [number for number, *_ in asked[3:]] == again
    assert followers == ["path 0", "path 1", "path 2"]
    np.testing.assert_allclose(rows, [[5.1, 5.0], [5.1, 5.1], [5.1, 5.2]])  # the best one's clearance
    assert misfit == pytest.approx(np.mean([1.2 if r in again else misfits[r] for r in range(3)]))


def test_where_one_has_not_come_to_be_followed_the_surest_leads(monkeypatch):
    asked = []

    def grow(start, model, row, limit):
        asked.append(start.number)
        return f"path {start.number}", row, 1.0

    monkeypatch.setattr(one_by_one, "grow", grow)
    starts = [SimpleNamespace(number=r, doubt=d, trace=TRACE) for r, d in enumerate((4.0, 1.0, 1.1))]
    model = SimpleNamespace(shared=1, only=lambda kept, row: None)
    follow_all(starts, model, np.ones((3, 2)), lambda r, row: (), 1)
    assert asked[0] == 1
