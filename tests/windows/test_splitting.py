import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clearance.errors import InputError
from clearance.windows.splitting import RandomSplit


@given(groups=st.lists(st.integers(0, 20), min_size=3, max_size=80), seed=st.sampled_from([42, 98, 1024]))
def test_every_recording_is_on_one_side_and_groups_stay_together(groups, seed):
    groups = np.array(groups)
    if len(set(groups.tolist())) < 3:
        return
    split = RandomSplit(seed).divide(groups)
    together = np.concatenate([split.train, split.validation, split.test])
    assert sorted(together) == list(range(len(groups)))
    sides = [set(groups[part]) for part in (split.train, split.validation, split.test)]
    assert all(sides)
    assert not (sides[0] & sides[1])
    assert not (sides[0] & sides[2])
    assert not (sides[1] & sides[2])


def test_the_paper_splits_a_thousand_runs():
    split = RandomSplit(42).divide(np.arange(1000))
    assert [len(part) for part in (split.train, split.validation, split.test)] == [700, 150, 150]


def test_the_seed_decides():
    one, same, other = (RandomSplit(seed).divide(np.arange(100)).test for seed in (42, 42, 98))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_too_few_recordings_are_refused():
    with pytest.raises(InputError, match="at least 3"):
        RandomSplit().divide(np.array([0, 0, 1, 1]))


def test_shares_must_leave_something_for_the_test():
    with pytest.raises(InputError, match=r"split\.train"):
        RandomSplit(train=0.9, validation=0.1)
