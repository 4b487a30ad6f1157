"""Short stretches of a path: those that are followed tell what the machine is."""

import numpy as np
import pytest

from clearance.diagnosis.following.growth import AFTER, ISLAND
from clearance.diagnosis.following.stretches import stretches
from tests.diagnosis.following.test_growth import CLEARANCE, SETTING, begun


def test_stretches_that_are_followed_tell_the_clearance_the_best_one_first():
    start, model, values = begun(SETTING, 1.03 * CLEARANCE)
    found = stretches(start.trace, model, values, 1, lambda: False)
    doubts = [one.doubt for one, _ in found]
    assert len(found) > 10
    assert doubts == sorted(doubts)
    assert doubts[-1] < 2.0
    ends = start.trace.follower(0.15).segments - ISLAND - AFTER
    assert max(one.island for one, _ in found) <= ends  # an island is landed on there, too
    assert np.median([row[0] for _, row in found]) == pytest.approx(CLEARANCE, rel=0.01)
    assert all(row[1:] == pytest.approx(values[1:]) for _, row in found)


def test_the_rest_of_a_path_is_left_out_once_it_is_late():
    start, model, values = begun(SETTING, CLEARANCE)
    assert stretches(start.trace, model, values, 1, lambda: True) == []
