"""What a path's motion looks like behind the filter of the recording."""

import numpy as np

from clearance.compilation import entry, kernel


@entry
def pass_filter(
    signals: np.ndarray,
    rows: np.ndarray,
    weights: np.ndarray,
    samples: int,
    first: int,
    last: int,
    predicted: np.ndarray,
) -> None:
    """Sum up the shares of all segments in the filtered samples of some.

    Motion that is not known stays as it is where knowledge ends.

    Args:
        signals: (segments, periods, SIGNALS) at the base rate; NaN where the motion is not known.
        rows: (filtered,) of ``Signal``.
        weights: (periods, (2 reach + 1) samples) of a segment's base samples in the filtered ones around it.
        samples: of a segment.
        first: first segment that is predicted.
        last: one beyond the last.
        predicted: (filtered, (last - first) samples) added to; NaN where no motion is known.
    """
    segments, periods = signals.shape[0], signals.shape[1]
    around, length = weights.shape[1], predicted.shape[1]
    reach = (around // samples - 1) // 2
    for k in range(first - reach, last + reach):
        near = _nearest(signals, rows, k, max(first - reach, 0), min(last + reach, segments))
        place = (k - reach - first) * samples
        begin, end = max(0, -place), min(around, length - place)
        for c in range(rows.size):
            around_k = predicted[c, place + begin : place + end]
            for t in range(periods):
                value = np.nan
                if near >= 0:
                    value = signals[near, t if near == k else (periods - 1 if near < k else 0), rows[c]]
                weight = weights[t, begin:end]
                for j in range(end - begin):
                    around_k[j] += weight[j] * value


@kernel
def _nearest(signals: np.ndarray, rows: np.ndarray, k: int, low: int, high: int) -> int:
    """The segment of known motion from ``low`` to ``high`` that is nearest to ``k``; -1 if there is none."""
    for away in range(high - low + abs(k) + 1):
        for near in (k - away, k + away):
            if low <= near < high and rows.size and np.isfinite(signals[near, 0, rows[0]]):
                return near
    return -1
