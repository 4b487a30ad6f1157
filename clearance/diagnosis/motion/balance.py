"""What the measured turning needs: forces that give the crank the acceleration which its encoder shows.

No run of the simulator is begun, so that nothing goes astray however much is missing: at each measured angle
and speed the laws say how fast the crank gains speed, and a mean over part of a turn is compared with that of
the recording. Integration by parts takes both derivatives off the recording and puts them on a smooth weight.
References: Shinbrot 1957, Trans. ASME 79, 547-552 (modulating functions); Preisig & Rippin 1993, Comput.
Chem. Eng. 17(1), 1-16.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import log

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from clearance.diagnosis.motion.model import Model, Term
from clearance.diagnosis.motion.track import Track
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.parameters import PARAMETERS
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import aligned
from clearance.simulation.ideal import accelerate
from clearance.simulation.layout import RESULTS, STATES

_MOTOR = "soft_drive(stall_torque)"
_USUAL = ("gravity", "guide_friction")  # effects of every rig that is no textbook's
_PLAIN = {"gravity_x", "gravity_y", "coulomb_force", "viscous_damping"}
_FINE = 4  # instants to a sample
_WINDOW, _FEWEST, _OVERLAP = 0.25, 6, 4  # turns and samples of a mean; means that share an instant
_SAMPLES = 4000  # of a recording that are looked at
_BAD = 1e6  # rad/s^2 of a machine that does not run
_SAGS, _FASTEST = 1.2, 2e4  # times the mean speed, where a motor's without load begins; rpm, its bound
_MEANS = 20  # fewer say nothing
_ALIKE, _MOST = 10.0, 4  # difference of prices up to which sets agree alike; how many of them are given
_LOOSE = 1e-2  # of the accelerations' size: what a prior's standard deviation weighs


@dataclass(frozen=True)
class Suggested:
    """Terms with which the measured turning agrees best.

    Attributes:
        terms: physics.
        values: of each, on the scale of the fit.
        uncertain: (fixed unknowns,) values of the machine.
        speeds: (recordings,) of the drive [rpm].
    """

    terms: tuple[Term, ...]
    values: tuple[np.ndarray, ...]
    uncertain: np.ndarray
    speeds: np.ndarray


class _Turning:
    """One recording: where the crank is and how fast it turns, and the means that are compared."""

    def __init__(self, track: Track, zero: float, turns: float) -> None:
        count = min(len(track.values), _SAMPLES)
        time = np.arange(count) / track.rate
        spline = CubicSpline(time, track.values[:count, track.channels.index("crank_angle")] - zero)
        size = max(_FEWEST, round(_WINDOW / turns * track.rate)) * _FINE
        fine = np.arange((count - 1) * _FINE + 1) / (track.rate * _FINE)
        self.angle, self.speed = spline(fine), spline(fine, 1)
        phase = np.arange(size + 1) / size
        length = size / (track.rate * _FINE)
        self.weight = np.sin(np.pi * phase) ** 4
        second = (
            4.0 * np.pi**2 * np.sin(np.pi * phase) ** 2 * (3.0 - 4.0 * np.sin(np.pi * phase) ** 2) / length**2
        )
        self.weight, second = self.weight / self.weight.sum(), second / self.weight.sum()
        self.first = np.arange(0, len(fine) - size, max(1, size // _OVERLAP))
        self.places = self.first[:, None] + np.arange(size + 1)
        self.shown = self.angle[self.places] @ second

    def mean(self, acceleration: np.ndarray) -> np.ndarray:
        """Weighted means of an acceleration at every instant."""
        return np.asarray(acceleration[self.places] @ self.weight)


def suggest(
    model: Model,
    tracks: Sequence[Track],
    zeros: Sequence[float],
    turns: Sequence[float],
    linked: Sequence[tuple[Term, np.ndarray]],
    terms: Sequence[Term],
    report: Callable[[str], None],
) -> list[Suggested]:
    """Of gravity, friction and a motor those with which the measured turning agrees best, by Schwarz 1978.

    All sets are fitted, none is built up: two forces that are large hide each other. Those that agree nearly
    as well as the best are given, too, the best first.

    Args:
        model: nominal, without terms.
        tracks: recordings; nothing is said where one has no crank_angle, or all are shorter than a few means.
        zeros: of each recording's encoder [rad].
        turns: of the crank in each [1/s].
        linked: terms that the linkage told, with their values.
        terms: that may be missing.
        report: called with progress.
    """
    if not all("crank_angle" in track.channels for track in tracks):
        return []
    turnings = [_Turning(*one) for one in zip(tracks, zeros, turns, strict=True)]
    if sum(len(one.shown) for one in turnings) < _MEANS:
        return []
    search = _Fitting(model, turnings, linked)
    given = {term.place for term, _ in linked}
    known = [term for term in terms if term.place not in given]
    motors = [term for term in known if term.label == _MOTOR]
    driven = isinstance(model.machine.drive, SpeedControl)
    if driven and not motors:
        return []
    variants = [[None, *(term for term in known if term.name == name and _is_plain(term))] for name in _USUAL]
    report("asking which forces give the measured turning")
    sets = [[*(motors if driven else ()), *filter(None, some)] for some in product(*variants)]
    found = sorted(((search.fitted(one), one) for one in sets), key=lambda one: one[0].price)
    fixed, cheapest = len(model.uncertain), found[0][0].price
    rest = [u.low for u in model.fixed_unknowns[fixed:]]  # a clearance, which begins closed
    suggested = []
    for fitted, some in found[:_MOST]:
        if fitted.price < cheapest + _ALIKE:
            ends = np.cumsum([fixed, *(len(term.unknowns) for term in some)])
            uncertain, *values, speeds = np.split(fitted.values, ends)
            suggested.append(Suggested(tuple(some), tuple(values), np.append(uncertain, rest), speeds))
    return suggested


def _is_plain(term: Term) -> bool:
    """Whether a variant has forces alone that are linear in its numbers."""
    return {u.name for u in term.unknowns} <= _PLAIN


@dataclass(frozen=True)
class _Fitted:
    """Values and what they cost."""

    values: np.ndarray
    price: float


class _Fitting:
    """Fits of terms to the means of all recordings."""

    def __init__(
        self, model: Model, turnings: Sequence[_Turning], linked: Sequence[tuple[Term, np.ndarray]]
    ) -> None:
        machine = model.machine
        for term, values in linked:
            machine = term.effect.machine(machine, term.joint, term.values(values))
        # of a clearance the crank's turning tells nothing, and a fit stumbles over what it does not feel
        self.model, self.turnings = replace(model, machine=machine, with_clearance=False), turnings
        self.shown = np.concatenate([one.shown for one in turnings])
        self.size = float(self.shown.std())

    def fitted(self, terms: Sequence[Term]) -> _Fitted:
        """The best fit of some terms."""
        model, tails = replace(self.model, terms=tuple(terms)), len(self.turnings)
        unknowns = model.shared
        start = np.concatenate([
            [u.prior[0] if u.prior else u.low for u in model.fixed_unknowns],
            *(term.starts[0] for term in terms),
            [_SAGS * one.speed.mean() * 30.0 / np.pi for one in self.turnings],
        ])  # fmt: skip
        low = np.array([*(u.inner(u.low) for u in unknowns), *[-_FASTEST] * tails])
        high = np.array([*(u.inner(u.high) for u in unknowns), *[_FASTEST] * tails])
        priors = [(i, *u.prior) for i, u in enumerate(unknowns) if u.prior]

        def rest(values: np.ndarray) -> np.ndarray:
            loose = [_LOOSE * self.size * (values[i] - middle) / width for i, middle, width in priors]
            return np.concatenate([self.shown - self._given(model, values), np.array(loose)])

        margin = 1e-9 * (high - low)
        start = np.clip(start, low + margin, high - margin)
        done = least_squares(rest, start, bounds=(low, high), x_scale="jac", max_nfev=150)
        samples = len(self.shown) / _OVERLAP
        squares = max(2.0 * float(done.cost) / len(self.shown), 1e-300)
        return _Fitted(done.x, samples * log(squares) + (len(start) - tails) * log(samples))

    def _given(self, model: Model, values: np.ndarray) -> np.ndarray:
        """Means of the acceleration that a machine gives, of all recordings."""
        shared, speeds = np.split(values, [len(model.shared)])
        found = []
        for one, speed in zip(self.turnings, speeds, strict=True):
            guess = model.guess(shared, np.array([0.0, 0.0, 0.0, speed, 0.0]))
            if guess is None:
                return np.full(len(self.shown), _BAD)
            found.append(one.mean(accelerations(guess.machine, one.angle, one.speed)))
        return np.nan_to_num(np.concatenate(found), nan=_BAD, posinf=_BAD, neginf=-_BAD)


def accelerations(machine: SliderCrank, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(instants,) how the laws of a machine with ideal joints accelerate its crank [rad/s²].

    Args:
        machine: of which a controller's integral stands at 0.
        angle: (instants,) of the crank [rad].
        speed: (instants,) [rad/s].
    """
    p, out, still = aligned(PARAMETERS), np.zeros(len(angle)), np.zeros(len(angle))
    p[:] = machine.parameters()[:, None]
    motion = np.stack([angle, speed, still, still])
    accelerate(machine.codes(), p, motion, aligned(RESULTS + STATES), out)
    return out
