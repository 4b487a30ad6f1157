"""Where a slider that is loose in its guide was: its height between the rails, from its own acceleration.

Integrated twice, the acceleration across the guide tells the height but for a drift. The rails end the drift:
the slider is on the side towards which it is pressed, and never beyond. A gap that is too small is overrun,
one that is too large is not, so the smallest that is hardly overrun is close to the true one. That the shoe
tilts, and strikes with one end while its middle is still short of the rail, does not change that.

Reference: least squares over a stretch with what ends its drift reweighted, as in ``reconstruction``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from clearance.diagnosis.sensing.measured import SAMPLES

GAPS = np.geomspace(5e-6, 2e-3, 100)
"""Gaps [m] that are compared."""
_ITERATIONS = 12
_SMEAR = 0.02  # of the local acceleration
_STRUCK = 0.2  # of the 99th percentile of the force: the slider touches
_TILTED = 0.2  # of the gap: doubt of the height where it touches
_FREE = 3.0  # gaps: how far it may be before anything is known
_BEYOND = 0.03  # of the gap: how far it may be beyond
_SETTLED = 3  # iterations after which what contradicts weighs less
_OUTLIER = 3.0  # doubts beyond which it does
_CORRELATED = 20.0  # samples that say one thing
_DRIFT = 1e-3  # of a gap's weight: holds a stretch in which nothing touches
_OVERRUN = 0.0075  # share of samples beyond, strikes apart, at a gap that is about large enough
_SMALL = (
    0.84  # of the true gap: where that share is reached (0.80 where the shoe tilts, 0.87 where it does not)
)
_STRIKE = 5  # samples around one in contact whose depth in the rail the filter hides
_LOST, _HALF_ASTRAY = 0.05, 0.1  # shares beyond and astray of one whose height is lost somewhere
_ASTRAY = 0.2  # share of samples in contact on the wrong side: no rail holds the slider


@dataclass(frozen=True)
class Across:
    """What sensors tell of a slider's motion across its guide, on the slider itself or on what carries it.

    Attributes:
        acceleration: (samples,) where the sensor is [m/s^2].
        push: (samples,) force of the guide on the slider [N].
        doubt: standard deviation of the acceleration's noise [m/s^2].
        aside: (3, samples) how far above the slider that place is [m], its rate and its acceleration.
        told: (samples,) whether that is known; where it is not, nothing but the joint's gap is between them.
    """

    acceleration: np.ndarray
    push: np.ndarray
    doubt: float
    aside: np.ndarray
    told: np.ndarray

    @staticmethod
    def own(acceleration: np.ndarray, push: np.ndarray, doubt: float) -> "Across":
        """Of a sensor that moves as the slider does."""
        count = len(acceleration)
        return Across(acceleration, push, doubt, np.zeros((3, count)), np.ones(count, dtype=bool))

    @property
    def slider(self) -> np.ndarray:
        """(samples,) acceleration of the slider [m/s^2]."""
        moved: np.ndarray = self.acceleration - self.aside[2]
        return moved


@dataclass(frozen=True)
class Lift:
    """The slider's motion across its guide.

    Attributes:
        height: (samples,) above the guide line [m].
        rate: (samples,) [m/s].
        acceleration: (samples,) [m/s^2].
        beyond: share of samples beyond the gap, strikes apart.
        astray: share of the samples in contact on the side away from which the slider is pressed.
    """

    height: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    beyond: float
    astray: float


def lift(across: Across, gap: float, stiffness: float, period: float) -> Lift:
    """The height that suits an acceleration, a force and a gap best.

    Args:
        across: what is seen of the motion.
        gap: free travel on each side [m].
        stiffness: of one end of the shoe against the guide [N/m].
        period: of the samples [s].

    Raises:
        LinAlgError: a motion that no linkage makes: it is not finite.
    """
    push, told, aside = across.push, across.told, across.aside[0]
    if not (np.isfinite(across.acceleration).all() and np.isfinite(push).all()):
        raise np.linalg.LinAlgError("the motion across the guide is not finite")
    banded, right = _integrated(across.acceleration, across.doubt, period)
    size, side = np.abs(push), -np.sign(push)
    touching = _touching(across)
    most = gap + 0.5 * size / stiffness  # of both ends
    height = rate = np.zeros(len(push))
    for iteration in range(_ITERATIONS):
        target = np.where(touching, gap * side, 0.0)
        weight = np.where(touching, 1.0 / (_TILTED * gap), 0.0)
        if iteration == 0:
            weight[~touching] = 1.0 / (_FREE * gap)
        else:
            outside = (np.abs(height) > most) & told
            target[outside] = (np.sign(height) * most)[outside]
            weight[outside] = 1.0 / (_BEYOND * gap)
        if iteration >= _SETTLED:
            weight /= np.sqrt(1.0 + ((height - target) * weight / _OUTLIER) ** 2)
        known = weight**2 / _CORRELATED + (_DRIFT / gap) ** 2
        matrix, vector = banded.copy(), right.copy()
        matrix[-1, ::2] += known
        vector[::2] += known * (target + aside)
        height, rate = solveh_banded(matrix, vector).reshape(-1, 2).T
        height = height - aside
    apart = ~maximum_filter1d(touching.astype(np.uint8), _STRIKE).astype(bool) & told
    beyond = float(((np.abs(height) > most + _BEYOND * gap) & apart).mean())
    astray = float((height * side < 0.0)[touching].mean()) if touching.any() else 1.0
    rate = rate - across.aside[1]
    if told.any() and not told.all():  # a slider that nothing carries flies straight
        time = np.arange(len(push))
        height, rate = (np.interp(time, time[told], one[told]) for one in (height, rate))
        height = np.clip(height, -most, most)
    return Lift(height, rate, across.slider, beyond, astray)


def _touching(across: Across) -> np.ndarray:
    """(samples,) whether the slider surely touches a rail."""
    size = np.abs(across.push)
    return (size > _STRUCK * np.quantile(size, 0.99)) & across.told


def suggest_gap(across: Across, stiffness: float, period: float) -> float | None:
    """The gap [m] in which a slider moves; ``None`` where nothing speaks of rails.

    Args:
        across: what is seen of the motion.
        stiffness: of one end of the shoe against the guide [N/m].
        period: of the samples [s].
    """
    shares: list[float] = []
    for gap in GAPS:
        one = lift(across, float(gap), stiffness, period)
        shares.append(one.beyond)
        if one.beyond < _OVERRUN:
            break
    if one.beyond >= _OVERRUN or one.astray > _ASTRAY:
        return None
    last = GAPS[: len(shares)][-2:]
    return float(np.interp(-_OVERRUN, np.negative(shares[-2:]), last)) / _SMALL


def gaps(seen: Sequence[Across], stiffness: float, period: float) -> list[float]:
    """What recordings show of the gap [m]; nothing where one of them speaks against rails.

    A motion whose height is lost somewhere overruns any gap; it need not where another recording shows one.

    Args:
        seen: what is seen of each motion.
        stiffness: of one end of the shoe against the guide [N/m].
        period: of the samples [s].
    """
    each = [suggest_gap(one, stiffness, period) for one in seen]
    shown = [gap for gap in each if gap is not None]
    if not shown:
        return []
    silent = [
        lift(s, max(shown), stiffness, period) for s, gap in zip(seen, each, strict=True) if gap is None
    ]
    within = all(one.beyond < _LOST and one.astray < _HALF_ASTRAY for one in silent)
    return shown if within else []


def measure_gap(across: Across, gap: float, period: float) -> tuple[float, float]:
    """The gap [m] with which height and touched rails agree best, and its standard deviation [m].

    Beside the heights it is one more unknown of the same least squares: one that is pressed lies on a rail.

    Args:
        across: what is seen of the motion.
        gap: about as wide [m].
        period: of the samples [s].
    """
    banded, right = _integrated(across.acceleration, across.doubt, period)
    side, touching, aside = -np.sign(across.push), _touching(across), across.aside[0]
    found, miss = gap, np.zeros(len(side))
    for iteration in range(_ITERATIONS):
        weight = np.where(touching, 1.0 / (_TILTED * gap), 0.0 if iteration else 1.0 / (_FREE * gap))
        if iteration >= _SETTLED:
            weight = weight / np.sqrt(1.0 + (miss * weight / _OUTLIER) ** 2)
        known = weight**2 / _CORRELATED
        matrix, vector, rails = banded.copy(), right.copy(), np.zeros_like(right)
        matrix[-1, ::2] += known + (_DRIFT / gap) ** 2
        vector[::2] += (known + (_DRIFT / gap) ** 2) * aside
        rails[::2] = np.where(touching, known, 0.0) * side
        free, beside = solveh_banded(matrix, np.stack([vector, rails], axis=1)).T
        free = free[::2] - aside
        information = known[touching].sum() - rails @ beside
        found = float(rails[::2] @ free / information)
        miss = free + found * beside[::2] - found * side
    return found, float(information**-0.5)


def _integrated(acceleration: np.ndarray, sigma: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of height and rate, in turn: a banded (4, 2 samples) matrix and its right side."""
    count = len(acceleration)
    local = uniform_filter1d(acceleration**2, 2 * SAMPLES)
    doubt = np.sqrt(sigma**2 + _SMEAR**2 * local)[:-1] * period
    rows = np.array([[-1.0, -period, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])
    before, after = acceleration[:-1], acceleration[1:]
    seen = np.stack([period**2 * (before / 3.0 + after / 6.0), 0.5 * period * (before + after)])
    weight = 1.0 / np.stack([doubt * period / np.sqrt(12.0), doubt]) ** 2
    matrix, vector = np.zeros((4, 2 * count)), np.zeros(2 * count)
    for i in range(4):
        vector[i : i + 2 * count - 2 : 2] += (rows[:, i, None] * seen * weight).sum(axis=0)
        for j in range(i, 4):
            matrix[3 + i - j, j : j + 2 * count - 2 : 2] += (rows[:, i] * rows[:, j]) @ weight
    return matrix, vector
