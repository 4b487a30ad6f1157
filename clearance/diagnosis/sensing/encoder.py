"""An encoder's counts: how many a turn has, and how much an angle that was rounded to them can be trusted."""

import numpy as np
from scipy.signal import savgol_filter

ENCODER_COUNTS = 4096
"""Counts of a turn where a recording shows none and nothing else is declared."""
_ARC = 0.125  # of a turn, over which the angle is smoothed: long beside a count, short beside what shakes it
_LEAST = 21  # samples of it at least, over which no crank does anything but turn
_BLOCKS = (4, 16, 64, 256, 1024)  # samples over which rounding errors are followed


def encoder_counts(angle: np.ndarray) -> int | None:
    """Counts a turn of the encoder that an angle [rad] was read from; ``None`` where it shows none.

    Encoders have a power of two, or a multiple of 90 or 100.
    """
    turns = (angle - angle[0]) / (2.0 * np.pi)
    for counts in sorted(
        {*(2**k for k in range(6, 17)), *(90 * k for k in range(1, 101)), *(100 * k for k in range(1, 101))}
    ):
        place = turns * counts
        if np.abs(place - np.round(place)).max() < 1e-3 + 1e-12 * counts * np.abs(turns).max():
            return int(counts)
    return None


def rounding_noise(angle: np.ndarray, counts: int) -> float:
    """Standard deviation of white noise [rad] that tells as little of slow motion as the rounding does.

    Errors of rounding are white only where the crank turns by an arbitrary part of a count from sample to
    sample. Near a whole number of counts they stand still for many samples, and all these are worth one. Of a
    crank that begins anywhere within a count, two errors whose angles are ``d`` counts apart have the
    covariance (1/12 - f (1 - f) / 2) counts squared, f being the fraction of ``d``: the second Bernoulli
    polynomial. Summed over blocks this tells how far off their means are; the length of block at which they
    are worst counts. An angle that scatters by more than rounding would is as noisy as it scatters.

    Args:
        angle: (samples,) unwrapped, in whole counts [rad].
        counts: of a turn.

    Returns:
        At least a count / sqrt(12), which is right for errors that are independent (Widrow 1956, IRE
        Transactions on Circuit Theory 3(4), 266-276).
    """
    count = 2.0 * np.pi / counts
    each = count / np.sqrt(12.0)
    if len(angle) < _LEAST:
        return float(each)
    turn = 2.0 * np.pi * (len(angle) - 1) / max(abs(angle[-1] - angle[0]), count)
    window = int(np.clip(_ARC * turn, _LEAST, max(len(angle) // 4, 5))) // 2 * 2 + 1
    places = savgol_filter(angle / count, window, 3)
    worst = 1.0
    for length in _BLOCKS:
        whole = len(places) // length
        if whole == 0:
            break
        shares = []
        for block in places[: whole * length].reshape(whole, length):
            fraction = np.mod(block[:, None] - block, 1.0)
            shares.append(length * (1.0 - 6.0 * fraction * (1.0 - fraction)).mean())
        worst = max(worst, float(np.mean(shares)))
    scatter = np.std(angle / count - savgol_filter(angle / count, _LEAST, 3))
    return float(max(each * np.sqrt(worst), count * scatter))
