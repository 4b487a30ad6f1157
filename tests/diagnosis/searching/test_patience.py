"""One recording that is followed, where nothing else did so, makes the others worth patience."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import one_by_one
from clearance.diagnosis.searching.one_by_one import follow_all

TRACE = SimpleNamespace(length=100)


@pytest.mark.parametrize("right", [0, 1, 2, 3])
def test_a_lost_recording_is_tried_from_several_islands_with_all_values_free(monkeypatch, right):
    """What another recording told may be off by as much as loses this one: the first island trusts it."""
    sure, away = SimpleNamespace(doubt=1.0, trace=TRACE), SimpleNamespace(doubt=66.0, trace=TRACE)
    islands = [SimpleNamespace(number=i, trace=SimpleNamespace(speed=97.0)) for i in range(5)]
    asked = []

    def grow(start, model, row, limit=np.inf):
        if start is sure:
            return "sure", row, 0.98
        if start is away:
            return None
        asked.append((start.number, len(row)))
        return ("found", row, 1.1) if start.number == right else ("lost", row, 30.0)

    monkeypatch.setattr(one_by_one, "grow", grow)
    model = SimpleNamespace(shared=1, only=lambda kept, row: None)
    base = SimpleNamespace(misfits=[12.9, 320.0], misfit=166.0)
    values = np.array([[6.4e-4, 65.0], [6.6e-4, 96.0]])
    followers, rows, _ = follow_all([sure, away], model, values, lambda r, row: islands, 1, base=base)
    assert asked == [(0, 1), (1, 2), (2, 2), (3, 2)][: right + 1]
    assert followers == ["sure", "found"]
    assert rows[1, -1] == 97.0


@pytest.mark.parametrize(
    ("first", "before", "lost", "expected"),
    [
        (0.98, 12.9, 240.0, True),
        (0.98, 12.9, None, True),  # it cannot be followed at all
        (0.98, 1.0, 240.0, False),  # the nominal machine was followed there, too
        (1.9, 12.9, 240.0, False),  # something else is missing
        (0.98, 12.9, 1.1, False),
    ],
)
def test_a_lost_recording_is_looked_for_with_what_another_tells(monkeypatch, first, before, lost, expected):
    asked, away, sure = [], SimpleNamespace(doubt=66.0, trace=TRACE), SimpleNamespace(doubt=1.0, trace=TRACE)
    found = {id(sure): first, id(away): lost}

    def grow(start, model, row, limit=np.inf, patient=False):
        misfit = found.get(id(start), 0.95)  # of a start that patience found
        return None if misfit is None else (f"{misfit}", row, misfit)

    def seek(r, row):
        asked.append((r, row[0]))
        return [SimpleNamespace(doubt=1.1, trace=SimpleNamespace(speed=97.0))]

    monkeypatch.setattr(one_by_one, "grow", grow)
    model = SimpleNamespace(shared=1, only=lambda kept, row: None)
    base = SimpleNamespace(misfits=[before, 320.0], misfit=166.0)
    values = np.array([[6.4e-4, 65.0], [6.6e-4, 96.0]])
    followed = follow_all([sure, away], model, values, seek, 1, base=base)
    assert asked == ([(1, 6.4e-4)] if expected else [])
    if lost is None and not expected:
        assert followed is None
    else:
        assert followed[0][1] == ("0.95" if expected else f"{lost}")
        assert followed[1][1, -1] == (97.0 if expected else 96.0)
