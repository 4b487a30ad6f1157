"""One recording that is followed, where nothing else did so, makes the others worth patience."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.searching import one_by_one
from clearance.diagnosis.searching.one_by_one import follow_all


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
    asked, away, sure = [], SimpleNamespace(doubt=66.0), SimpleNamespace(doubt=1.0)
    found = {id(sure): first, id(away): lost}

    def grow(start, model, row, limit=np.inf, patient=False):
        misfit = found.get(id(start), 0.95)  # of a start that patience found
        return None if misfit is None else (f"{misfit}", row, misfit)

    def seek(r, row):
        asked.append((r, row[0]))
        return SimpleNamespace(doubt=1.1, trace=SimpleNamespace(speed=97.0))

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
