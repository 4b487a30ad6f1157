"""What sensors did and a recording declares is undone."""

import numpy as np
import pytest

from clearance.errors import InputError
from clearance.recording.correction import corrected
from clearance.recording.recording import Recording
from clearance.recording.sensors import Sensor, SensorChain

RATE, INSIDE = 1e4, slice(400, -400)
PAIR = ("rod_c_transverse", "rod_c_axial")


def truth(channels=PAIR, metadata=None):
    time = np.arange(4000) / RATE
    values = np.stack(
        [np.sin(2 * np.pi * (97 + 310 * i) * time + i) * 40 for i in range(len(channels))], axis=1
    )
    return Recording(values, channels, RATE, 0.0, metadata or {})


def test_declared_bias_gain_delay_and_mounting_are_taken_out():
    declared = {
        "rod_c_transverse": {"gain": 1.05, "bias": 0.7, "mounting_angle": 4.0, "delay": 2.3e-4},
        "rod_c_axial": {"gain": -0.98, "mounting_angle": -3.0, "delay": 2.3e-4},
    }
    chain = SensorChain({name: Sensor(**entry) for name, entry in declared.items()})
    measured = chain.apply(truth(metadata={"sensors": declared}), np.random.default_rng(0))
    assert np.abs(measured.values - truth().values)[INSIDE].max() > 5.0
    found = corrected(measured)
    np.testing.assert_allclose(found.values[INSIDE], truth().values[INSIDE], atol=0.05)


@pytest.mark.parametrize(("corner", "undone"), [(1e4, True), (3e3, True), (1e3, False)])
def test_a_wide_bandwidth_is_undone_and_a_narrow_one_stays(corner, undone):
    declared = {"rod_c_axial": {"bandwidth": corner, "delay": 2.3e-4}}
    chain = SensorChain({name: Sensor(**entry) for name, entry in declared.items()})
    measured = chain.apply(truth(metadata={"sensors": declared}), np.random.default_rng(0))
    error = np.abs(corrected(measured).values - truth().values)[INSIDE].max()
    assert (error < 0.1) == undone


def test_a_delay_longer_than_the_recording_is_refused():
    with pytest.raises(InputError, match=r"0\.5 s is not shorter than the recording \(0\.4 s\)"):
        corrected(truth(metadata={"sensors": {"rod_c_axial": {"delay": 0.5}}}))


def test_nothing_declared_changes_nothing():
    recording = truth()
    assert corrected(recording) is recording


@pytest.mark.parametrize("speed", [60.0, -60.0])
@pytest.mark.parametrize("around", [0.0, np.pi])
@pytest.mark.parametrize("turns", [1, 2, 3])
def test_an_encoder_that_begins_again_after_some_turns_is_counted_on(speed, around, turns):
    onward = 1.0 + speed * np.arange(8000) / RATE
    wrapped = (onward + around) % (turns * 2.0 * np.pi) - around
    values = np.stack([wrapped, np.sin(onward)], axis=1)
    found = corrected(Recording(values, ("crank_angle", "rod_c_axial"), RATE, 0.0, {}))
    turns = (found.values[:, 0] - onward) / (2.0 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-9)
    np.testing.assert_array_equal(found.values[:, 1], values[:, 1])


def test_a_slow_encoder_that_does_not_tell_its_sense_is_refused():
    onward = 0.45 * 2.0 * np.pi * np.arange(50)
    one = Recording((onward % (2.0 * np.pi))[:, None], ("crank_angle",), 20.0, 0.0, {})
    with pytest.raises(InputError, match=r"0\.45 turns from sample to sample"):
        corrected(one)
    whole = Recording(onward[:, None], ("crank_angle",), 20.0, 0.0, {})
    assert corrected(whole) is whole


def test_an_encoder_that_begins_again_out_of_turn_is_refused():
    onward = 60.0 * np.arange(4000) / RATE
    reset = np.where(np.arange(4000) < 2000, onward % (4.0 * np.pi), onward % (2.0 * np.pi))
    with pytest.raises(InputError, match=r"covers 1\.91 turns and jumps back by others than 2 turns"):
        corrected(Recording(reset[:, None], ("crank_angle",), RATE, 0.0, {}))


def test_a_counted_angle_of_a_slow_recorder_is_left_as_it_is():
    # from rest to 0.8 turns a sample, with noise
    steps = 2.0 * np.pi * np.minimum(np.arange(60) / 20.0, 0.8)
    counted = np.cumsum(steps) + np.random.default_rng(0).normal(0.0, 0.01, 60)
    one = Recording(counted[:, None], ("crank_angle",), 20.0, 0.0, {})
    assert corrected(one) is one


def test_axes_along_one_direction_are_refused():
    turned = truth(metadata={"sensors": {"rod_c_axial": {"mounting_angle": 90.0}}})
    with pytest.raises(InputError, match=r"mounting_angle = 90 of rod_c_axial and 0 of rod_c_transverse"):
        corrected(turned)


def test_a_mounting_angle_needs_both_axes():
    alone = truth(PAIR[:1], {"sensors": {"rod_c_transverse": {"mounting_angle": 4.0}}})
    with pytest.raises(InputError, match="rod_c_axial is not recorded"):
        corrected(alone)


@pytest.mark.parametrize(("recorded", "turned"), [PAIR, PAIR[::-1]])
def test_an_angle_of_an_axis_that_is_not_recorded_is_not_needed(recorded, turned):
    alone = truth((recorded,), {"sensors": {turned: {"mounting_angle": 4.0}}})
    np.testing.assert_array_equal(corrected(alone).values, alone.values)


def test_what_is_wrong_with_a_channel_that_nobody_asks_for_does_no_harm():
    declared = {"rod_c_axial": {"bias": 0.7}, "rod_b_axial": {"mounting_angle": 4.0}}
    channels = ("rod_c_axial", "rod_b_axial", "rod_c_transverse")
    alone = corrected(truth(channels, {"sensors": declared}), ("rod_c_transverse", "rod_c_axial"))
    assert alone.channels == ("rod_c_transverse", "rod_c_axial")
    np.testing.assert_allclose(alone.values[:, 1], truth(channels).values[:, 0] - 0.7)
    with pytest.raises(InputError, match="rod_b_transverse is not recorded"):
        corrected(truth(channels, {"sensors": declared}))


def test_a_partner_that_nobody_asks_for_still_undoes_an_angle():
    declared = {name: {"mounting_angle": 4.0} for name in PAIR}
    recording = truth(metadata={"sensors": declared})
    np.testing.assert_array_equal(
        corrected(recording, PAIR[1:]).values, corrected(recording).select(PAIR[1:]).values
    )
