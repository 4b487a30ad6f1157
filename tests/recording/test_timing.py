import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from clearance.errors import InputError
from clearance.recording.timing import JITTER, TimeBase, stamp_resolution, uniform_time_base


def printed(times, form):
    return np.array([float(form % time) for time in times])


@pytest.mark.parametrize("form", ["%.4f", "%.5f", "%.9f", "%g", "%.6e", "%.17g"])
@pytest.mark.parametrize("rate", [20.0, 3000.0, 10_000.0])
def test_a_rate_survives_the_digits_it_was_printed_with(rate, form):
    times = 0.5 + np.arange(20_000) / rate
    assert uniform_time_base(printed(times, form)) == TimeBase(rate, 0.5)


@pytest.mark.parametrize("rate", [1234.5, 25_600.0, 48_000.0, 51_200.0, 1e6])
def test_a_rate_survives_a_32_bit_column(rate):
    times = (np.arange(30_000) / rate).astype(np.float32).astype(np.float64)
    assert uniform_time_base(times).rate == rate


@given(rate=st.floats(20.0, 1e6), start=st.floats(-1e3, 1e3), samples=st.integers(2, 3000))
@example(rate=541349.5171746545, start=0.5, samples=2)  # stamps that fifteen decimals happen to print
@settings(deadline=None, max_examples=200)
def test_any_exact_clock_is_uniform(rate, start, samples):
    times = start + np.arange(samples) / rate
    base = uniform_time_base(times)
    assert base.start_time == start
    # What 64-bit stamps, or fifteen decimals, resolve, over the length of the recording.
    resolution = max(4 * np.spacing(abs(start) + samples / rate), 2e-15)
    assert base.rate == pytest.approx(rate, rel=resolution * rate / (samples - 1))


@pytest.mark.parametrize("period", [0.003, 0.004, 0.008])
def test_two_stamps_mean_what_they_say(period):
    assert uniform_time_base(np.array([0.0, period])).rate == pytest.approx(1.0 / period, rel=1e-12)


def test_units_scale_the_clock():
    assert uniform_time_base(np.arange(0.0, 50.0, 0.5), unit=1e-3) == TimeBase(2000.0, 0.0)


@pytest.mark.parametrize(
    ("stamps", "resolution"),
    [
        ([0.0, 0.25, 10.125], [1e-3, 1e-3, 1e-3]),  # fixed decimals, trailing zeros lost
        ([0.000123457, 2.99988], [1e-9, 1e-5]),  # six significant digits
        ([0.0, 1.0, 2.0], [1.0, 1.0, 1.0]),  # counts
        ([0.0, 0.01, 0.02], [0.01, 0.01, 0.01]),  # zero has no leading digit
    ],
)
def test_the_resolution_is_read_off_the_stamps(stamps, resolution):
    np.testing.assert_allclose(stamp_resolution(np.array(stamps)), resolution, rtol=1e-6)


def test_a_jitter_within_the_tolerance_passes_and_beyond_it_is_located():
    times = np.arange(1000) / 1000.0
    times[500] += (
        0.9 * JITTER / 1000.0 + 1e-13
    )  # the last term: no decimal fraction, so no excuse of rounding
    assert uniform_time_base(times).rate == pytest.approx(1000.0, rel=1e-6)
    times[500] += 1.0 * JITTER / 1000.0
    with pytest.raises(InputError, match=r"not uniform: sample 500 at 0\.5"):
        uniform_time_base(times)


def test_a_drifting_clock_is_not_uniform():
    sample = np.arange(5000)
    with pytest.raises(InputError, match="not uniform"):
        uniform_time_base((sample + 1e-5 * sample**1.5) / 1000.0)


@pytest.mark.parametrize("lost", [1, 2, 50])
def test_a_gap_is_located(lost):
    times = np.delete(np.arange(200) / 100.0, slice(101, 101 + lost))
    with pytest.raises(
        InputError, match=r"time jumps by .* after 1 s \(sample 100\), the step is 0\.01 s; 1 such"
    ):
        uniform_time_base(times)


@pytest.mark.parametrize(
    ("rate", "decimals", "samples"),
    [
        (9999.5, 4, 60_000),  # every 20 000th step is two of the last digit
        (999.75, 3, 20_000),
        (7000.0, 4, 20_000),
        (25_600.0, 5, 50_000),
        (44_100.0, 5, 50_000),
        (48_000.0, 5, 50_000),
        (51_200.0, 6, 50_000),
    ],
)
@pytest.mark.parametrize("start", [0.0, 12.3456])
def test_steps_of_no_whole_number_of_last_digits_are_no_gaps(rate, decimals, samples, start):
    times = start + np.arange(samples) / rate
    base = uniform_time_base(printed(times, f"%.{decimals}f"))
    assert base.rate == pytest.approx(rate, rel=2.0 * 10.0**-decimals * rate / samples)


@pytest.mark.parametrize(
    ("rate", "decimals"),
    [(10_000.0, 4), (10_000.0, 5), (1000.0, 3), (7000.0, 4), (44_100.0, 5), (48_000.0, 5), (51_200.0, 6)],
)
@pytest.mark.parametrize("lost", [300, 2500, 4900])
def test_a_lost_sample_is_no_long_step(rate, decimals, lost):
    times = np.delete(np.arange(5000) / rate, lost)
    with pytest.raises(InputError, match=r"time (jumps|is not uniform)"):
        uniform_time_base(printed(times, f"%.{decimals}f"))


def test_lost_samples_are_out_of_turn_and_regular_ones_a_slower_clock():
    times = np.arange(6000) / 1000.0
    for lost in ([2000, 4000], [1000, 2900, 5002]):
        with pytest.raises(InputError, match=r"time jumps .* where no sample is missing, list time under"):
            uniform_time_base(printed(np.delete(times, lost), "%.3f"))
    slower = uniform_time_base(printed(np.delete(times, [1000, 3001, 5002]), "%.3f"))
    assert slower.rate == pytest.approx(999.5, abs=0.2)


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        ([0.0, 0.1, 0.2, 0.1, 0.2], r"goes back from 0\.2 s to 0\.1 s after sample 2 \(1 such"),
        ([0.0, 0.1, 0.1, 0.2], r"repeats 0\.1 s after sample 1 .*give `rate:`"),
        ([0.0, np.nan, 0.2], "1 values that are not finite, the first in sample 1"),
        ([0.0], "1 samples are too few"),
        ([0.0, 1e300], "time reaches 1e"),
    ],
)
def test_what_is_no_clock_is_refused(stamps, message):
    with pytest.raises(InputError, match=message):
        uniform_time_base(np.array(stamps))


def test_a_declared_rate_is_used_if_it_agrees_and_refused_if_not():
    times = printed(np.arange(1000) / 9999.0, "%.6f")
    assert uniform_time_base(times, declared_rate=9999.0).rate == 9999.0
    with pytest.raises(InputError, match="10000 Hz contradicts the column 'time', which gives 9999 Hz"):
        uniform_time_base(np.arange(1000) / 9999.0, declared_rate=10_000.0)
