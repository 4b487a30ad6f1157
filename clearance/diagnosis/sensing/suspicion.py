"""First guesses: what fault of one sensor would turn its predicted signal into the recorded one.

Between a prediction that owes nothing to the channel and the fit of a whole hypothesis: each kind of fault is
fitted to one channel by least squares, from the best point of a coarse scan, so that the fit begins near its
end. Residuals are weighed by soft L1, since samples near impacts may be predicted badly.

A resonance or a delay carries a badly predicted sample to its neighbours, where the weights cannot help:
after 3 % of samples 10 sigma off, a damping ratio came out twice too large, its frequency 2 % off.

References: soft L1: Triggs et al. 2000, Bundle Adjustment - A Modern Synthesis, sec. 3.1. Comparing kinds
with different numbers of parameters: Schwarz 1978, Annals of Statistics 6(2), 461-464.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from clearance.diagnosis.sensing.instrument import OTHER_AXIS, amplify, misalign, offset, respond, saturate
from clearance.errors import InputError

FloatArray = NDArray[np.float64]

_OUTLIER = 3.0  # sigma from which a residual counts linearly
_STEADY = 0.9  # of the segments
_LATEST = 1e-3  # s scanned on both sides of no delay
_LOWEST = 300.0  # Hz, first resonance scanned
_DAMPING = (0.02, 0.05, 0.12, 0.3, 0.7)  # ratios scanned
_SCANNED = 60  # resonances, and limits
_AT_ONCE = 2_000_000  # samples of candidates that are held in memory: some 150 MiB


@dataclass(frozen=True)
class Suspicion:
    """One kind of fault, as well as it explains a channel.

    Attributes:
        effect: name as in ``conf/effect``.
        channel: whose.
        parameters: name as in the effect to value, in its unit there.
        misfit: robust root mean square of what remains [sigma].
    """

    effect: str
    channel: str
    parameters: Mapping[str, float]
    misfit: float


@dataclass(frozen=True)
class _Kind:
    """A kind of fault of one channel.

    Attributes:
        effect: its name.
        names: (parameters,) their names.
        seen: (samples, candidates) the faulty signal for (candidates, parameters) values.
        scan: (candidates, parameters) values to begin at.
        low: (parameters,) bounds.
        high: (parameters,) bounds.
    """

    effect: str
    names: tuple[str, ...]
    seen: Callable[[FloatArray], FloatArray]
    scan: FloatArray
    low: tuple[float, ...]
    high: tuple[float, ...]


def suspect(
    measured: FloatArray,
    predicted: FloatArray,
    channels: Sequence[str],
    rate: float,
    sigma: FloatArray,
    channel: str,
    kept: NDArray[np.bool_] | slice = slice(None),
) -> list[Suspicion]:
    """Each kind of fault of one channel with the values that explain it best, best kind first.

    Kinds are ordered by the Bayesian information criterion of an unknown size of error, ``n log(misfit²) + k
    log n``: a second parameter must earn its place. A turned axis is left out where the other axis of its
    point is not among the channels, or where it stands still: there it is a gain.

    Args:
        measured: (samples, channels) recorded.
        predicted: (samples, channels) of faultless instruments, trustworthy in that channel.
        channels: names of the columns.
        rate: [Hz].
        sigma: (channels,) standard deviation of the noise.
        channel: the suspected one.
        kept: (samples,) whether a sample is compared, as of ``steady``; all if left out.

    Raises:
        InputError: the channel is not among the channels.
    """
    names = list(channels)
    if channel not in names:
        raise InputError(f"channel {channel!r} is not recorded; choose from {', '.join(names)}")
    column = names.index(channel)
    recorded, scale = measured[:, column], float(sigma[column])
    found = []
    for kind in _kinds(recorded, predicted, names, rate, column):
        values, misfit = _fit(kind, recorded, scale, kept)
        count = len(recorded[kept])
        penalty = len(kind.names) * np.log(count)
        criterion = 2.0 * count * np.log(max(misfit, np.finfo(float).tiny)) + penalty
        parameters = dict(zip(kind.names, map(float, values), strict=True))
        found.append((criterion, Suspicion(kind.effect, channel, parameters, misfit)))
    return [suspicion for _, suspicion in sorted(found, key=lambda pair: pair[0])]


def disagreement(residuals: FloatArray) -> FloatArray:
    """(channels,) robust root mean square of (samples, channels) residuals [sigma]."""
    mean: FloatArray = np.mean(2.0 * (np.sqrt(1.0 + (residuals / _OUTLIER) ** 2) - 1.0), axis=0)
    return _OUTLIER * np.sqrt(mean)


def steady(residuals: FloatArray, suspected: Sequence[int]) -> NDArray[np.bool_]:
    """(segments,) whether the other channels are not among the loudest tenth there.

    Where an impact was met wrongly every channel is off, and what a sensor does to its signal is not seen.

    Args:
        residuals: (segments, samples, channels) [sigma].
        suspected: indices of channels that have no say.
    """
    others = np.delete(residuals, list(suspected), axis=2).transpose(1, 0, 2)
    loud = disagreement(others.reshape(len(others), -1)).reshape(len(residuals), -1).sum(axis=1)
    calm: NDArray[np.bool_] = loud <= np.quantile(loud, _STEADY)
    return calm


def _kinds(
    recorded: FloatArray, predicted: FloatArray, names: list[str], rate: float, column: int
) -> list[_Kind]:
    signal = predicted[:, [column]]
    nyquist = 0.5 * rate
    largest = float(np.abs(recorded).max())
    frequencies = np.geomspace(_LOWEST, nyquist, _SCANNED)
    # at half a sample's distance the highest frequency has turned by a quarter
    delays = np.linspace(-_LATEST, _LATEST, 2 * int(np.ceil(2.0 * _LATEST * rate)) + 1)
    limits = np.linspace(1.0, 0.3, _SCANNED) * largest

    def several(count: int) -> FloatArray:
        return np.repeat(signal, count, axis=1)

    kinds = [
        _Kind(
            "sensor_gain",
            ("gain",),
            lambda v: amplify(signal, v[:, 0]),
            np.ones((1, 1)),
            (-np.inf,),
            (np.inf,),
        ),
        _Kind(
            "sensor_bias",
            ("bias",),
            lambda v: offset(signal, v[:, 0]),
            np.zeros((1, 1)),
            (-np.inf,),
            (np.inf,),
        ),
        _Kind(
            "sensor_delay",
            ("delay",),
            lambda v: respond(several(len(v)), rate, v[:, 0]),
            delays[:, None],
            (-2.0 * _LATEST,),
            (2.0 * _LATEST,),
        ),
        _Kind(
            "sensor_resonance",
            ("frequency", "damping_ratio"),
            lambda v: respond(several(len(v)), rate, 0.0, v[:, 0], v[:, 1]),
            np.array(list(product(frequencies, _DAMPING))),
            (0.5 * _LOWEST, 1e-3),
            (2.0 * nyquist, 1.0),  # an overdamped one would smooth what is badly predicted
        ),
        _Kind(
            "sensor_saturation",
            ("limit",),
            lambda v: saturate(several(len(v)), v[:, 0]),
            limits[:, None],
            (0.0,),
            (np.inf,),
        ),
    ]
    other, _ = OTHER_AXIS.get(names[column], ("", 0.0))
    if other in names and predicted[:, names.index(other)].any():
        angles = np.where(np.arange(len(names)) == column, 90.0, 0.0)
        across = misalign(predicted, names, angles)[:, [column]]
        kinds.append(
            _Kind(
                "sensor_misalignment",
                ("angle",),
                lambda v: np.cos(np.radians(v[:, 0])) * signal + np.sin(np.radians(v[:, 0])) * across,
                np.linspace(-45.0, 45.0, 19)[:, None],
                (-45.0,),
                (45.0,),
            )
        )
    return kinds


def _fit(
    kind: _Kind, recorded: FloatArray, scale: float, kept: NDArray[np.bool_] | slice
) -> tuple[FloatArray, float]:
    """(parameters,) that explain a channel best, and the robust root mean square of what remains [sigma]."""

    def misfit(values: FloatArray) -> FloatArray:
        return disagreement((kind.seen(values) - recorded[:, None])[kept] / scale)

    parts = np.array_split(kind.scan, -(-len(kind.scan) * len(recorded) // _AT_ONCE))
    start = kind.scan[int(np.argmin(np.concatenate([misfit(part) for part in parts if len(part)])))]
    low, high = np.array(kind.low), np.array(kind.high)
    fit = least_squares(
        lambda values: (kind.seen(values[None])[:, 0] - recorded)[kept] / scale,
        np.clip(start, low, high),
        bounds=(low, high),
        loss="soft_l1",
        f_scale=_OUTLIER,
        x_scale="jac",
    )
    return fit.x, float(misfit(fit.x[None])[0])
