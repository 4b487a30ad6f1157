"""One recording that is followed, where nothing else did so, makes the others worth patience."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import search as searching
from clearance.diagnosis.searching.search import PATIENCE, Search


@pytest.mark.parametrize(
    ("first", "before", "lost", "expected"),
    [
        (0.98, 12.9, 240.0, PATIENCE),
        (0.98, 12.9, None, PATIENCE),  # it cannot be followed at all
        (0.98, 1.0, 240.0, 0),  # the nominal machine was followed there, too
        (1.9, 12.9, 240.0, 0),  # something else is missing
        (0.98, 12.9, 1.1, 0),
    ],
)
def test_a_lost_recording_is_looked_for_with_what_another_tells(monkeypatch, first, before, lost, expected):
    asked, away, sure = [], SimpleNamespace(doubt=66.0), SimpleNamespace(doubt=1.0)
    found = {id(sure): first, id(away): lost}

    def grow(start, model, row, limit=np.inf, patient=False):
        misfit = found.get(id(start), 0.95)  # of a start that patience found
        return None if misfit is None else (f"{misfit}", row, misfit)

    def sought(r, model, row, patience):
        asked.append((r, patience, row[0]))
        return SimpleNamespace(doubt=1.1, trace=SimpleNamespace(speed=97.0))

    monkeypatch.setattr(searching, "grow", grow)
    one = SimpleNamespace(workers=1, late=lambda: False, sought=sought)
    model = SimpleNamespace(shared=1, only=lambda kept, row: None)
    base = SimpleNamespace(misfits=[before, 320.0], misfit=166.0)
    values = np.array([[6.4e-4, 65.0], [6.6e-4, 96.0]])
    followed = Search._grown(one, [sure, away], model, values, np.inf, base, False, 0)
    assert asked == ([(1, expected, 6.4e-4)] if expected else [])
    if lost is None and not expected:
        assert followed is None
    else:
        assert followed[0][1] == ("0.95" if expected else f"{lost}")
        assert followed[1][1, -1] == (97.0 if expected else 96.0)
