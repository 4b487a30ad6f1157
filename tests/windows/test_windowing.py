import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clearance.errors import InputError
from clearance.windows.windowing import RandomWindows, RegularWindows

RNG = np.random.default_rng(0)


def test_the_paper_cuts_fifty_windows():
    assert RegularWindows(length=200, stride=200).count(10_000) == 50


@given(samples=st.integers(0, 5000), length=st.integers(1, 400), stride=st.integers(1, 400))
def test_count_is_the_number_of_windows_that_fit(samples, length, stride):
    plan = RegularWindows(length, stride)
    by_hand = len([start for start in range(0, samples, stride) if start + length <= samples])
    assert plan.count(samples) == by_hand
    starts, recording = plan.starts(np.array([samples]), RNG)
    assert len(starts) == by_hand
    assert not recording.any()


@given(
    lengths=st.lists(st.integers(0, 3000), min_size=1, max_size=6),
    length=st.integers(1, 300),
    density=st.floats(0.1, 3),
)
def test_random_windows_stay_inside_their_recording(lengths, length, density):
    starts, recording = RandomWindows(length, density).starts(np.array(lengths), np.random.default_rng(1))
    assert np.all(starts >= 0)
    assert np.all(starts + length <= np.array(lengths)[recording])
    assert set(recording) == {i for i, samples in enumerate(lengths) if samples >= length}


def test_random_windows_are_as_dense_as_asked_for():
    _, recording = RandomWindows(10, 0.5).starts(np.array([100, 40, 9]), RNG)
    assert np.bincount(recording, minlength=3).tolist() == [5, 2, 0]


def test_windows_of_several_recordings_are_counted_from_each_start():
    starts, recording = RegularWindows(10, 5).starts(np.array([20, 9, 12]), RNG)
    assert starts.tolist() == [0, 5, 10, 0]
    assert recording.tolist() == [0, 0, 0, 2]


@pytest.mark.parametrize(
    "make", [lambda: RegularWindows(0, 1), lambda: RegularWindows(5, 0), lambda: RandomWindows(5, 0)]
)
def test_impossible_windows_name_the_key(make):
    with pytest.raises(InputError, match=r"Windows\.(length|stride|density) = 0 is outside"):
        make()
