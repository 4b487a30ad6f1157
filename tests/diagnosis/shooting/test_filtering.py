"""Filtered samples are those of the recording's own filter, and unknown motion stays as it is."""

import numpy as np

from clearance.diagnosis.sensing.measured import REACH, SAMPLES, filter_weights
from clearance.diagnosis.shooting.filtering import pass_filter
from clearance.recording.chain import MeasurementChain

CHAIN = MeasurementChain()
PERIODS = SAMPLES * CHAIN.decimation
ROWS = np.array([3, 1])
WEIGHTS = np.ascontiguousarray(filter_weights(CHAIN, SAMPLES, REACH).T)


def predicted(signals, first, last):
    out = np.zeros((len(ROWS), (last - first) * SAMPLES))
    pass_filter(signals, ROWS, WEIGHTS, SAMPLES, first, last, out)
    return out


def motion(segments=30):
    """Three harmonics well below the filter's edge, other ones in each row."""
    time = np.arange(segments * PERIODS) / CHAIN.base_rate
    rows = [np.sin(2.0 * np.pi * (20.0 + 30.0 * row) * time + row) for row in range(4)]
    return np.stack(rows, axis=1).reshape(segments, PERIODS, 4)


def test_it_is_the_chain_that_recordings_pass():
    signals = motion()
    expected = CHAIN.apply(signals.reshape(-1, 4)[:, ROWS])[10 * SAMPLES : 20 * SAMPLES]
    # the weights end after four segments to each side: 1e-3 of the filter's response is cut off
    np.testing.assert_allclose(predicted(signals, 10, 20), expected.T, atol=2e-3)


def test_a_part_is_predicted_as_in_the_whole():
    signals = motion()
    np.testing.assert_array_equal(
        predicted(signals, 8, 12), predicted(signals, 5, 20)[:, 3 * SAMPLES : 7 * SAMPLES]
    )


def test_motion_stays_where_knowledge_ends():
    signals = motion()
    known = signals.copy()
    known[:6], known[15:] = known[6, 0], known[14, -1]
    signals[:6], signals[15:] = np.nan, np.nan
    np.testing.assert_array_equal(predicted(signals, 6, 15), predicted(known, 6, 15))


def test_a_gap_is_filled_from_its_nearer_side():
    signals = motion()
    filled = signals.copy()
    filled[10], filled[11] = filled[9, -1], filled[12, 0]
    signals[10:12] = np.nan
    np.testing.assert_array_equal(predicted(signals, 8, 14), predicted(filled, 8, 14))


def test_beyond_the_ends_it_stays_as_it_is():
    signals = motion(12)
    before, after = np.repeat(signals[:1, :1], 8, axis=0), np.repeat(signals[-1:, -1:], 8, axis=0)
    longer = np.concatenate([np.repeat(before, PERIODS, axis=1), signals, np.repeat(after, PERIODS, axis=1)])
    np.testing.assert_array_equal(predicted(signals, 0, 12), predicted(longer, 8, 20))


def test_nothing_known_predicts_nothing():
    assert np.isnan(predicted(np.full((20, PERIODS, 4), np.nan), 5, 10)).all()
