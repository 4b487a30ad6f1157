"""A shoe that rattles in its guide is followed from one island or another, back and on at its strikes."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.following import rattling
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
    np.testing.assert_allclose(tried[:, 1], 2e-5 * np.array(rattling.GAPS))
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
