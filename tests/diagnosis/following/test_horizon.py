"""How long a lost path is looked for."""

import time

import numpy as np

from clearance.diagnosis.following import horizon
from clearance.diagnosis.following.horizon import Patience, advance


def looks(monkeypatch, lost, patience, found=lambda segment: False):
    """Segments at which a path that is lost there is looked for, and whether widely."""
    limits, sought = [], []

    def step(follower, fixed, segment, end, limit, *_):
        limits.append(limit)
        return segment if segment in lost and limit < np.inf else None

    def rejoin(place, fixed, limit, wide):
        sought.append((place, wide))
        return found(place)

    monkeypatch.setattr(horizon, "_step", step)
    monkeypatch.setattr(horizon, "rejoin", rejoin)
    for segment in range(40):
        advance(None, None, segment, 40, patience)
    return sought, limits


def test_after_each_look_in_vain_it_is_looked_for_more_seldom(monkeypatch):
    sought, _ = looks(monkeypatch, range(5, 25), Patience(100))
    assert sought == [(5, False), (6, True), (9, False), (16, True)]


def test_where_it_was_followed_in_between_it_is_looked_for_at_once(monkeypatch):
    sought, _ = looks(monkeypatch, [5, 6, 7, 20, 21], Patience(100))
    assert sought == [(5, False), (6, True), (20, False), (21, True)]
    sought, _ = looks(monkeypatch, range(5, 10), Patience(100), lambda segment: segment == 6)
    assert sought == [(5, False), (6, True), (7, False), (8, True)]


def test_it_is_no_longer_looked_for_when_it_was_lost_too_often(monkeypatch):
    sought, limits = looks(monkeypatch, range(40), Patience(6))
    assert sought == [(0, False), (1, True), (4, False)]
    assert limits == [horizon.TORN] * 6 + [np.inf] * 34
    found, limits = looks(monkeypatch, range(40), Patience(6), lambda segment: True)
    assert found == [(segment, False) for segment in range(40)]  # what is found costs no patience


def test_it_is_not_looked_for_when_there_is_no_time(monkeypatch):
    sought, limits = looks(monkeypatch, range(40), Patience(6, until=time.monotonic() - 1.0))
    assert not sought
    assert limits == [np.inf] * 40
