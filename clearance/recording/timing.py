"""From a column of time stamps to a rate: a recording is uniform, or the place where it is not is named.

Time stamps are seldom exact: a CSV file prints four or six digits, HDF5 may hold 32-bit numbers. What the
stamps can resolve is read off the stamps themselves, and is what they are allowed to be wrong by, beyond
`JITTER`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clearance.errors import InputError

FloatArray = NDArray[np.float64]

# A sample taken ε steps early errs by 2πεf of its amplitude at f cycles a step: at the measurement chain's
# cut-off (0.4 cycles a step) 1e-3 steps make 0.25 %, below every other error of a recording.
JITTER = 1e-3
LATEST = 1e12  # s, thirty thousand years: what lies beyond is no time
GAP = 1.5  # steps: a lost sample makes two
# A rounded stamp is off by half its last digit; the fitted line takes up to half of that again with it.
ROUNDING = 0.75
_MOST_DECIMALS = 15


@dataclass(frozen=True)
class TimeBase:
    """Uniform sampling: samples per second [Hz] and the time of the first one [s]."""

    rate: float
    start_time: float


def stamp_resolution(stamps: FloatArray) -> FloatArray:
    """Return what each stamp can resolve, in its own unit: the last digit or bit that the column uses.

    Fixed decimals, a fixed number of significant digits, 32-bit and 64-bit numbers are told apart by the
    values.
    """
    magnitude = np.abs(stamps)
    binary = np.spacing(magnitude)
    single = stamps.astype(np.float32)
    if np.array_equal(single.astype(np.float64), stamps):
        binary = np.spacing(np.abs(single)).astype(np.float64)
    exponents = np.full(len(stamps), -400)  # zero has no leading digit: its last one is the column's
    nonzero = magnitude > 0.0
    exponents[nonzero] = np.floor(np.log10(magnitude[nonzero])).astype(int)
    finest, digits = 0, 1
    for exponent in np.unique(exponents[nonzero]):
        decade = stamps[nonzero & (exponents == exponent)]
        decimals = _decimals(decade)
        if decimals is None:
            return binary
        finest = max(finest, decimals)
        digits = max(digits, decimals + int(exponent) + 1)
    return np.maximum(np.maximum(10.0**-finest, 10.0 ** (exponents + 1.0 - digits)), binary)


def _decimals(values: FloatArray) -> int | None:
    """Return the fewest decimals that print every value exactly, or None where it takes too many."""
    for decimals in range(_MOST_DECIMALS + 1):
        if np.array_equal(np.round(values, decimals), values):
            return decimals
    return None


def uniform_time_base(stamps: FloatArray, unit: float = 1.0, declared_rate: float | None = None) -> TimeBase:
    """Return the rate and start of uniformly sampled time stamps.

    Args:
        stamps: (samples,) times as the file gives them.
        unit: seconds in the unit of `stamps`.
        declared_rate: the rate [Hz] that the user states; it must agree with the stamps, and is then used.

    Raises:
        InputError: the stamps are not finite, decrease, repeat, leave a gap, or are off a uniform grid.
    """
    if len(stamps) < 2:
        raise InputError(f"{len(stamps)} samples are too few; at least 2 are needed")
    bad = np.flatnonzero(~np.isfinite(stamps))
    if len(bad):
        raise InputError(
            f"column 'time' has {len(bad)} values that are not finite, the first in sample {bad[0]}"
        )
    times = stamps * unit
    latest = float(np.max(np.abs(times)))
    if latest > LATEST:
        raise InputError(f"time reaches {latest:g} s; give at most {LATEST:g} s, or its unit under `units:`")
    resolution = stamp_resolution(stamps) * unit
    # Subtract first: in seconds, a long clock (nanoseconds since 1970) has fewer digits than as it came.
    since = (stamps - stamps[0]) * unit
    _require_increasing(times, since)
    _require_uniform(times, since, resolution)
    span = float(since[-1])
    slack = 0.5 * float(resolution[0] + resolution[-1])
    steps = len(times) - 1
    if declared_rate is None:
        rate = _simplest_rate(steps, span, slack)
    elif abs(steps / declared_rate - span) <= slack + JITTER * span / steps:
        rate = declared_rate
    else:
        raise InputError(
            f"rate: {declared_rate:g} Hz contradicts the column 'time', which gives {steps / span:.6g} Hz; "
            "correct `rate`, the unit of time under `units:`, or list time under `ignore:`"
        )
    return TimeBase(rate, float(times[0]))


def _require_increasing(times: FloatArray, since: FloatArray) -> None:
    differences = np.diff(since)
    back = np.flatnonzero(differences <= 0.0)
    if not len(back):
        return
    row = int(back[0])
    if differences[row] < 0.0:
        raise InputError(
            f"time goes back from {times[row]:.9g} s to {times[row + 1]:.9g} s after sample {row} "
            f"({len(back)} such places); sort the file or cut it there"
        )
    raise InputError(
        f"time repeats {times[row]:.9g} s after sample {row} ({len(back)} such places); remove the double "
        "samples, or, where time is printed too coarsely, list it under `ignore:` and give `rate:` in the "
        "YAML beside the file"
    )


def _require_uniform(times: FloatArray, since: FloatArray, resolution: FloatArray) -> None:
    differences = np.diff(since)
    step = float(np.median(differences))
    longer = np.flatnonzero(differences > GAP * step)
    digits = 0.5 * (resolution[longer] + resolution[longer + 1])
    _require_no_gap(times, step, longer[differences[longer] > GAP * step + digits])
    sample = np.arange(len(times), dtype=np.float64) - 0.5 * (len(times) - 1)
    slope = float(sample @ since) / float(sample @ sample)
    residual = since - since.mean() - slope * sample
    excess = np.abs(residual) - (ROUNDING * resolution + JITTER * slope)
    row = int(np.argmax(excess))
    if excess[row] > 0.0:
        raise InputError(
            f"time is not uniform: sample {row} at {times[row]:.9g} s is {residual[row]:.3g} s off a uniform "
            f"clock, {abs(residual[row]) / slope:.3g} of a step (allowed: {JITTER:g}, and the last printed "
            "digit); resample the recording to a constant rate"
        )
    # A step of no whole number of last digits is printed longer at regular distances, a lost sample out of
    # turn. Of fewer than three longer steps nobody can tell which they are.
    regular = len(longer) > 2 and _narrowest(residual) <= float(resolution.max()) + 2.0 * JITTER * slope
    _require_no_gap(times, step, longer[:0] if regular else longer)


def _require_no_gap(times: FloatArray, step: float, gaps: NDArray[np.intp]) -> None:
    if len(gaps):
        row = int(gaps[0])
        raise InputError(
            f"time jumps by {times[row + 1] - times[row]:.6g} s after {times[row]:.9g} s (sample {row}), the "
            f"step is {step:.6g} s; {len(gaps)} such gaps; cut the recording there or fill them in; where no "
            "sample is missing, list time under `ignore:` and give `rate:` in the YAML beside the file"
        )


def _narrowest(residual: FloatArray) -> float:
    """Return the height of the narrowest strip, however inclined, that holds (samples,) residuals."""
    place = np.linspace(-0.5, 0.5, len(residual))
    inclined, high = residual, 2.0 * float(np.ptp(residual))
    low = -high
    for _ in range(40):  # the height is convex in the inclination: halve to where it stops falling
        middle = 0.5 * (low + high)
        inclined = residual - middle * place
        low, high = (middle, high) if inclined.argmax() > inclined.argmin() else (low, middle)
    return float(np.ptp(inclined))


def _simplest_rate(steps: int, span: float, slack: float) -> float:
    """Return the rate, or the inverse of the step, with the fewest digits that the stamps allow."""
    low, high = steps / (span + slack), steps / (span - slack) if slack < span else np.inf
    for digits in range(1, 16):
        rate = float(f"{steps / span:.{digits - 1}e}")
        period = float(f"{span / steps:.{digits - 1}e}")
        simple = [one for one in (rate, float(f"{1.0 / period:.15g}")) if low <= one <= high]
        if simple:  # two stamps, 0 and 0.004 s, allow 200 Hz as well as 250
            return min(simple, key=lambda one: abs(one - steps / span))
    return steps / span
