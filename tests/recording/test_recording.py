import pickle

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.recording.recording import Recording, at_one_rate

NAMES = ("rod_b_axial", "rod_c_axial", "crank_angle")


def make(values=None, channels=NAMES, rate=1000.0, **more):
    if values is None:
        values = np.arange(30.0).reshape(10, 3)
    return Recording(values, channels, rate, **more)


def test_time_and_duration_follow_from_rate_and_start():
    recording = make(rate=100.0, start_time=2.5)
    np.testing.assert_array_equal(recording.time, 2.5 + np.arange(10) / 100.0)
    assert recording.duration == pytest.approx(0.09)


def test_rates_that_differ_by_rounding_are_one():
    some = {"a": make(rate=9999.0), "b": make(rate=9999.5)}
    assert {name: one.rate for name, one in at_one_rate(some).items()} == {"a": 9999.25, "b": 9999.25}
    with pytest.raises(InputError, match=r"differ \(a: 9999 Hz, c: 9990 Hz\).*`ignore: \[time\]`"):
        at_one_rate({"a": some["a"], "c": make(rate=9990.0)})


def test_channel_and_select_return_the_named_columns():
    recording = make(metadata={"speed": 60.0})
    np.testing.assert_array_equal(recording.channel("rod_c_axial"), recording.values[:, 1])
    chosen = recording.select(["crank_angle", "rod_b_axial"])
    assert chosen.channels == ("crank_angle", "rod_b_axial")
    np.testing.assert_array_equal(chosen.values, recording.values[:, [2, 0]])
    assert (chosen.rate, chosen.start_time, chosen.metadata) == (1000.0, 0.0, {"speed": 60.0})


def test_a_missing_channel_is_named_with_what_there_is():
    with pytest.raises(InputError, match="no channel slider_vertical, crank_speed; it has rod_b_axial"):
        make().select(["rod_b_axial", "slider_vertical", "crank_speed"])
    with pytest.raises(InputError, match="did you mean 'rod_c_axial'"):
        make().channel("rod_c_axl")


def test_values_cannot_be_changed_through_the_recording_and_the_array_of_the_caller_can():
    mine = np.zeros((4, 3))
    recording = make(mine)
    with pytest.raises(ValueError, match="read-only"):
        recording.values[0, 0] = 1.0
    mine[0, 0] = 1.0


def test_it_survives_a_process_boundary():
    recording = make(metadata={"chain": {"decimation": 10}})
    copy = pickle.loads(pickle.dumps(recording))
    np.testing.assert_array_equal(copy.values, recording.values)
    assert (copy.channels, copy.rate, copy.metadata) == (NAMES, 1000.0, {"chain": {"decimation": 10}})


def test_float32_becomes_float64():
    assert make(np.zeros((4, 3), dtype=np.float32)).values.dtype == np.float64


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_is_located(bad):
    values = np.zeros((10, 3))
    values[[4, 7], 1] = bad
    values[9, 2] = np.nan
    with pytest.raises(
        InputError, match=r"'rod_c_axial' has 2 values .* sample 4 at 0\.504 s; so have 1 other"
    ):
        make(values, start_time=0.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 0.0}, "rate: 0 Hz is out of range; .* 20 to 1e"),
        ({"rate": -1.0}, "rate"),
        ({"rate": 19.9}, "rate"),
        ({"rate": 2e6}, "rate"),
        ({"rate": float("nan")}, "rate"),
        ({"start_time": float("inf")}, "start_time"),
        ({"channels": ("rod_b_axial", "rod_b_axial", "crank_angle")}, "rod_b_axial occurs more than once"),
        ({"channels": ("rod_b_axial", "rod_c_axial", "crank_angel")}, "did you mean 'crank_angle'"),
        ({"channels": ("rod_b_axial",)}, r"shape \(10, 3\) does not fit 1 channels"),
        ({"values": np.zeros(10)}, "shape"),
        ({"values": np.zeros((1, 3))}, "1 samples are too few"),
        ({"values": np.zeros((4, 0)), "channels": ()}, "at least one channel"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(change, message):
    with pytest.raises(InputError, match=message) as caught:
        make(**change)
    assert "\n" not in str(caught.value)
