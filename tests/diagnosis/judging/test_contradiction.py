"""Recordings of machines that differ."""

from types import SimpleNamespace

import numpy as np
import pytest

from clearance.diagnosis.judging import contradiction
from clearance.diagnosis.judging.contradiction import contradictions
from clearance.diagnosis.kinematics.agreement import Profile

CLEARANCES = np.geomspace(1e-5, 1e-3, 41)


def at(clearance, width=0.2, floor=1.0):
    """A profile whose least misfit is at a clearance [m]."""
    return Profile(CLEARANCES, floor + (np.log(CLEARANCES / clearance) / width) ** 2)


def told(monkeypatch, *profiles):
    left = list(profiles)
    monkeypatch.setattr(contradiction, "profile", lambda *_: left.pop(0))
    names = [f"{r}.csv" for r in range(len(profiles))]
    search = SimpleNamespace(
        recordings=[SimpleNamespace(name=name) for name in names], alignments=[None] * len(names), workers=1,
        setting=SimpleNamespace(joint="C", with_clearance=None),
    )  # fmt: skip
    return contradictions(search)


def test_recordings_that_each_show_another_clearance_contradict_each_other(monkeypatch):
    (line,) = told(monkeypatch, at(4e-4), at(3e-4), at(2e-4))
    assert "2.csv 0.200 mm and 0.csv 0.400 mm" in line


@pytest.mark.parametrize(
    "profiles",
    [
        [at(2e-4)],
        [at(2e-4), at(2.2e-4)],
        [at(2e-4, width=3.0), at(4e-4, width=3.0)],  # neither says much
        [at(2e-4), at(4e-4, width=3.0)],  # one does not
    ],
)
def test_others_do_not(monkeypatch, profiles):
    assert told(monkeypatch, *profiles) == []
