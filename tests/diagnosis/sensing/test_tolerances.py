"""What data sheets leave open: which sensor may do what, and recordings before and after calibration."""

import numpy as np
import pytest

from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import NO_FAULT, SAMPLES, Measured
from clearance.diagnosis.sensing.tolerances import NOTHING_LEFT_OPEN, Tolerances, instrument_of, values_of
from clearance.errors import InputError
from clearance.recording.chain import MeasurementChain
from clearance.recording.recording import Recording

CHANNELS = ("rod_b_transverse", "rod_b_axial", "slider_horizontal", "crank_angle")
TOLERANCES = Tolerances(gain=0.02, misalignment=2.0, delay=4e-5, bias=4.0)
CHAIN = MeasurementChain()


def measured(seed=0):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(40 * SAMPLES, 4)).cumsum(axis=0)
    values[:, 3] = 0.006 * np.arange(len(values))
    return Measured.of(Recording(values, CHANNELS, CHAIN.rate), CHAIN, "one")


def test_every_accelerometer_has_its_own_and_an_angle_needs_both_axes():
    found = {(one.fault, one.channel) for one in TOLERANCES.open(CHANNELS)}
    for fault in ("gain", "bias"):
        assert {c for f, c in found if f == fault} == set(CHANNELS[:3])
    assert {c for f, c in found if f == "delay"} == set(CHANNELS[:3])  # counted from the encoder
    without = [one for one in TOLERANCES.open(CHANNELS[:3]) if one.fault == "delay"]
    assert [one.channel for one in without] == [CHANNELS[1], CHANNELS[2]]  # or from one of them
    assert without[0].tolerance == pytest.approx(2.0**0.5 * TOLERANCES.delay)
    assert {c for f, c in found if f == "misalignment"} == set(CHANNELS[:3])  # the guide stands still across
    alone = Tolerances(misalignment=1.0).open(("rod_b_axial", "rod_c_axial"))
    assert alone == ()


def test_what_is_exact_is_not_open():
    assert NOTHING_LEFT_OPEN.open(CHANNELS) == ()
    assert {one.fault for one in Tolerances(gain=0.01).open(CHANNELS)} == {"gain"}


def test_values_and_instruments_are_the_same_thing():
    what = TOLERANCES.open(CHANNELS)
    values = [one.neutral + 0.3 * one.tolerance for one in what]
    assert values_of(what, instrument_of(what, values)) == pytest.approx(values)
    assert values_of(what, NO_FAULT) == [one.neutral for one in what]


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"gain": -0.1}, "tolerances.gain = -0.1 is not between 0 and 0.2"),
        ({"misalignment": 90}, "tolerances.misalignment = 90 is not between 0 and 15 deg"),
        ({"delay": "a bit"}, "tolerances.delay = 'a bit'"),
        ({"noise": 0.1}, "tolerances: noise is unknown; choose from gain, misalignment, delay, bias"),
    ],
)
def test_wrong_tolerances_are_named(given, named):
    with pytest.raises(InputError, match=r"change tolerances|choose from") as error:
        Tolerances.given(given)
    assert named in str(error.value)


def test_both_at_once_add_up_and_gains_multiply():
    one = Instrument(gain={"rod_b_axial": 1.01}, bias={"rod_b_axial": 0.5}, delay={"rod_b_axial": 1e-5})
    other = Instrument(gain={"rod_b_axial": 0.9}, misalignment={"rod_b_axial": 2.0}, saturation={"a": 1.0})
    both = one.beside(other)
    assert both.gain["rod_b_axial"] == pytest.approx(0.909)
    assert (both.bias, both.delay) == (one.bias, one.delay)
    assert (both.misalignment, both.saturation) == (other.misalignment, other.saturation)


def test_until_it_is_calibrated_what_a_sensor_may_be_off_by_is_noise():
    plain = measured()
    wide = plain.within(TOLERANCES)
    accelerations = slice(0, 3)
    size = plain.recorded.std(axis=0)
    assert (wide.sigma[accelerations] > 0.01 * size[accelerations]).all()
    assert wide.widened > 3.0
    back = wide.as_recorded()
    np.testing.assert_array_equal(back.sigma, plain.sigma)
    np.testing.assert_array_equal(back.values, plain.values)
    assert back.widened == 1.0
    assert plain.within(NOTHING_LEFT_OPEN) is plain
    assert NOTHING_LEFT_OPEN.open(("slider_velocity",)) == ()


def test_what_a_calibration_undoes_is_what_the_sensors_did():
    plain = measured()
    what = TOLERANCES.open(CHANNELS)
    sensors = instrument_of(what, [one.neutral + 0.5 * one.tolerance for one in what])
    seen = sensors.apply(plain.recorded, CHANNELS, CHAIN.rate)
    off = Measured.of(Recording(seen, CHANNELS, CHAIN.rate), CHAIN, "one").within(TOLERANCES)
    calibrated = off.calibrated(sensors)
    inside = slice(4, -4)  # undoing a delay looks at neighbours
    error = np.abs(calibrated.values - plain.values)[inside, :, :3].max(axis=(0, 1))
    before = np.abs(off.values - plain.values)[inside, :, :3].max(axis=(0, 1))
    assert (error < 0.02 * before).all()
    part = calibrated.part(5, 15)
    np.testing.assert_array_equal(part.as_recorded().values, off.values[5:15])
    np.testing.assert_array_equal(part.values, calibrated.values[5:15])
    assert part.calibrated(NO_FAULT).sensors == NO_FAULT
    assert part.judged(sensors).tolerances == NOTHING_LEFT_OPEN
