"""Least squares over whole recordings: one run from the start, every unknown a lane.

The noise of each channel is unknown and found with the rest, so that what is minimised is the sum over
channels of N log(RSS / N), minus twice the log-likelihood of independent normal noise up to a constant.
Steps are those of Gauss-Newton with several dampings tried at once (Levenberg 1944, Marquardt 1963).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from clearance.diagnosis.motion.model import Model, Unknown
from clearance.diagnosis.motion.prediction import Guess, predict
from clearance.diagnosis.motion.track import Track

OWN = 5  # unknowns of each recording
_DAMPING = (0.0, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
_SHARES = (1.0, 0.5, 0.2, 0.05)  # of a step
_ITERATIONS = 15
_ENOUGH = 0.05  # decrease of the cost that changes nothing any more
_HELD = 1e20  # weight of a prior from which on an unknown stays where it is
_TRIALS = len(_DAMPING) + len(_SHARES) - 1
_CORRECTIONS = 3  # of own unknowns beside each trial
_BLOCKS = 40  # parts of the recordings whose pulls are compared
_FIRST = 0.5  # s of the first stage; each later one is three times longer
_FEWEST = 24  # samples of it


def inverse_of(information: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix of very different units; directions without information stay without."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(
        np.linalg.pinv(information / np.outer(scale, scale), 1e-15, hermitian=True) / np.outer(scale, scale)
    )


@dataclass
class Fit:
    """A model at its best values.

    Attributes:
        model: the unknowns' meaning.
        shared: (S,) on the scale of the fit.
        own: (recordings, OWN).
        cost: minus twice the log-likelihood, priors included.
        sigma: (channels,) noise.
        residuals: for each recording (judged samples, channels), in its unit.
        information: (S + OWN recordings, same) of the unknowns.
        pulls: (blocks, same) gradient of each part of the recordings.
        samples: judged samples of all recordings and channels.
    """

    model: Model
    shared: np.ndarray
    own: np.ndarray
    cost: float
    sigma: np.ndarray
    residuals: list[np.ndarray]
    information: np.ndarray
    pulls: np.ndarray
    samples: int

    @property
    def values(self) -> np.ndarray:
        """(1, 1) the clearance [m]: what progress and events show of every fit."""
        return np.array([[self.model.clearance(self.shared)]])

    @property
    def covariance(self) -> np.ndarray:
        """Of all unknowns: of each direction the larger of the model's own and the block-robust variance.

        Reference: White 1982, Econometrica 50(1), 1-25; blocks, since at these rates neighbouring residuals
        are alike.
        """
        inverse = inverse_of(self.information)
        blocks = len(self.pulls)
        middle = self.pulls.T @ self.pulls * blocks / max(blocks - len(self.shared) - OWN, blocks // 2)
        robust = inverse @ middle @ inverse
        plain, other = np.sqrt(np.diag(inverse)), np.sqrt(np.maximum(np.diag(robust), 0.0))
        scale = np.maximum(1.0, other / np.maximum(plain, 1e-300))
        return np.asarray(inverse * np.outer(scale, scale))

    @property
    def deviations(self) -> np.ndarray:
        """(S,) standard deviations of shared unknowns on the scale of the fit."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0))[: len(self.shared)])


@dataclass
class _Point:
    """Residuals of one set of values, and their cost."""

    rests: list[np.ndarray]
    squares: np.ndarray
    cost: float


def fit(
    model: Model,
    tracks: Sequence[Track],
    shared: np.ndarray,
    own: np.ndarray,
    begin: np.ndarray,
    workers: int = 1,
    staged: bool = False,
    iterations: int = _ITERATIONS,
) -> Fit:
    """Fit a model.

    Args:
        model: what is unknown.
        tracks: recordings.
        shared: (S,) start, on the scale of the fit.
        own: (recordings, OWN) start.
        begin: (recordings, OWN) first guesses, which unknowns keep that nothing tells about.
        workers: threads.
        staged: from a poor start: first each recording's own unknowns to the crank's angle, which is nearly
            linear in them, then to all channels of the first moments and of ever longer parts.
        iterations: at most.
    """
    if staged:
        if all("crank_angle" in track.channels for track in tracks):
            turning = [t.only("crank_angle").turned(o[4]) for t, o in zip(tracks, own, strict=True)]
            turned = _fit(
                replace(model, with_zero=False),  # which is taken off before
                turning,
                shared,
                own,
                begin,
                workers,
                iterations,
                True,
            )
            own = turned.own
        seconds, longest = _FIRST, max(track.seconds for track in tracks)
        while seconds < 0.7 * longest:
            parts = [t.part(0, max(_FEWEST, round(seconds * t.rate))) for t in tracks]
            found = _fit(model, parts, shared, own, begin, workers, iterations, False)
            shared, own = found.shared, found.own
            seconds *= 3.0
    return _fit(model, tracks, shared, own, begin, workers, iterations, False)


def _fit(
    model: Model,
    tracks: Sequence[Track],
    shared: np.ndarray,
    own: np.ndarray,
    begin: np.ndarray,
    workers: int,
    iterations: int,
    held: bool,
) -> Fit:
    owns = [model.own(b) for b in begin]
    values = np.concatenate([shared, own.ravel()])
    problem = Problem(model, tracks, owns, workers)
    if held:
        problem.hold(shared)
    here = problem.points([values])[0]
    for _ in range(iterations):
        if not np.isfinite(here.cost):
            break
        jacobian = problem.jacobian(values, here)
        information, gradient = problem.normal(values, here, jacobian)
        trials = problem.trials(values, information, gradient)
        points = problem.points(trials)
        for _ in range(_CORRECTIONS):
            foreseen = float(gradient @ (trials[0] - values))
            if here.cost - points[0].cost > 0.5 * foreseen:  # the plain step does what it should
                break
            corrected = problem.corrected(trials[-_TRIALS:], points[-_TRIALS:], information, jacobian, here)
            trials += corrected
            points += problem.points(corrected)
        best = int(np.argmin([p.cost if np.isfinite(p.cost) else np.inf for p in points]))
        gain = here.cost - points[best].cost
        if not gain > 0.0:
            break
        values, here = trials[best], points[best]
        if gain < _ENOUGH:
            break
    return problem.finish(values, here)


class Problem:
    """What stays the same while values change."""

    def __init__(
        self, model: Model, tracks: Sequence[Track], owns: Sequence[tuple[Unknown, ...]], workers: int
    ) -> None:
        self.model, self.tracks, self.workers = model, tracks, workers
        self.count = len(model.shared)
        self.unknowns = [*model.shared, *(u for own in owns for u in own)]
        self.channels = tuple(dict.fromkeys(c for t in tracks for c in t.channels))
        self.counts = np.array(
            [sum(self._judged(t) for t in tracks if c in t.channels) for c in self.channels]
        )
        self.smallest = np.array(
            [max(t.smallest[t.channels.index(c)] for t in tracks if c in t.channels) for c in self.channels]
        )
        means = [u.prior[0] if u.prior else 0.0 for u in self.unknowns]
        self.mean = np.array(means)
        self.weight = np.array([1.0 / u.prior[1] ** 2 if u.prior else 0.0 for u in self.unknowns])
        self.low = np.array([u.inner(u.low) if np.isfinite(u.low) else u.low for u in self.unknowns])
        self.high = np.array([u.inner(u.high) if np.isfinite(u.high) else u.high for u in self.unknowns])

    def hold(self, shared: np.ndarray) -> None:
        """Keep the shared unknowns where they are."""
        self.mean[: self.count], self.weight[: self.count] = shared, _HELD

    @staticmethod
    def _judged(track: Track) -> int:
        part = track.judged
        return int(part.stop - part.start)

    def columns(self, track: Track) -> list[int]:
        """Which of all channels a recording's are."""
        return [self.channels.index(c) for c in track.channels]

    def predicted(self, r: int, guesses: Sequence[Guess | None]) -> np.ndarray:
        """(guesses, judged, channels); NaN for no guess."""
        track = self.tracks[r]
        real = [g for g in guesses if g is not None]
        found = np.full((len(guesses), self._judged(track), len(track.channels)), np.nan)
        if real:
            places = [i for i, g in enumerate(guesses) if g is not None]
            found[places] = predict(track, real, self.workers)[:, track.judged]
        return found

    def _guess(self, values: np.ndarray, r: int) -> Guess | None:
        place = self.count + r * OWN
        return self.model.guess(values[: self.count], values[place : place + OWN])

    def points(self, many: Sequence[np.ndarray]) -> list[_Point]:
        """Residuals and cost at each set of values."""
        rests: list[list[np.ndarray]] = [[] for _ in many]
        for r, track in enumerate(self.tracks):
            seen = self.predicted(r, [self._guess(v, r) for v in many])
            for i, rest in enumerate(track.values[track.judged] - seen):
                rests[i].append(rest)
        return [self._point(values, rest) for values, rest in zip(many, rests, strict=True)]

    def _point(self, values: np.ndarray, rests: list[np.ndarray]) -> _Point:
        squares = np.zeros(len(self.channels))
        with np.errstate(all="ignore"):
            for track, rest in zip(self.tracks, rests, strict=True):
                squares[self.columns(track)] += (rest**2).sum(axis=0)
            mean = np.maximum(squares / self.counts, self.smallest**2)
            cost = float((self.counts * np.log(mean)).sum() + (self.weight * (values - self.mean) ** 2).sum())
        if not np.isfinite(squares).all():
            cost = np.inf
        return _Point(rests, mean, cost)

    def jacobian(self, values: np.ndarray, here: _Point) -> list[np.ndarray]:
        """For each recording (judged, channels, S + OWN): derivative of its prediction."""
        found = []
        for r, track in enumerate(self.tracks):
            mine = [*range(self.count), *range(self.count + r * OWN, self.count + (r + 1) * OWN)]
            guesses, steps = [], []
            for i in mine:
                if self.weight[i] >= _HELD:
                    continue
                step = self.unknowns[i].step
                for change in (step, -step):
                    moved = values.copy()
                    moved[i] += change
                    guess = self._guess(moved, r) if self.low[i] <= moved[i] <= self.high[i] else None
                    if guess is not None:
                        break
                guesses.append(guess)
                steps.append((i, change))
            seen = self.predicted(r, guesses)
            base = track.values[track.judged] - here.rests[r]
            derivative = np.zeros((*base.shape, len(mine)))
            for (i, change), one in zip(steps, seen, strict=True):
                column = (one - base) / change
                if np.isfinite(column).all():
                    derivative[..., mine.index(i)] = column
            found.append(derivative)
        return found

    def normal(
        self, values: np.ndarray, here: _Point, jacobian: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information matrix and gradient of half the cost's decrease."""
        total = len(values)
        information = np.diag(self.weight)
        gradient = self.weight * (self.mean - values)
        for r, (track, derivative) in enumerate(zip(self.tracks, jacobian, strict=True)):
            mine = [*range(self.count), *range(self.count + r * OWN, self.count + (r + 1) * OWN)]
            sigma = np.sqrt(here.squares[self.columns(track)])
            rows = (derivative / sigma[:, None]).reshape(-1, len(mine))
            rest = (here.rests[r] / sigma).ravel()
            information[np.ix_(mine, mine)] += rows.T @ rows
            gradient[mine] += rows.T @ rest
        assert information.shape == (total, total)
        return information, gradient

    def trials(self, values: np.ndarray, information: np.ndarray, gradient: np.ndarray) -> list[np.ndarray]:
        """Values after steps of several dampings; an unknown at its bound that wants out stays there."""
        stuck = ((values <= self.low) & (gradient < 0.0)) | ((values >= self.high) & (gradient > 0.0))
        free = np.flatnonzero(~stuck & (np.diag(information) > 0.0))
        matrix, pull = information[np.ix_(free, free)], gradient[free]
        scale = np.sqrt(np.diag(matrix))
        found = []
        for damping in _DAMPING:
            damped = matrix / np.outer(scale, scale) + damping * np.eye(len(free))
            step = np.linalg.lstsq(damped, pull / scale, rcond=1e-13)[0] / scale
            for share in _SHARES if damping == 0.0 else (1.0,):
                moved = values.copy()
                moved[free] += share * step
                found.append(np.clip(moved, self.low, self.high))
        return found

    def corrected(
        self,
        trials: Sequence[np.ndarray],
        points: Sequence[_Point],
        information: np.ndarray,
        jacobian: Sequence[np.ndarray],
        here: _Point,
    ) -> list[np.ndarray]:
        """Trials whose own unknowns follow the shared ones.

        The crank's phase gathers every change of its mean speed. A change of friction and the change of the
        drive's speed that makes up for it lie on a curve, which a straight step leaves: each recording's own
        unknowns are therefore fitted anew beside every step, with the derivatives that are there.
        """
        found = []
        for values, point in zip(trials, points, strict=True):
            moved = values.copy()
            if np.isfinite(point.cost):
                for r, (track, derivative) in enumerate(zip(self.tracks, jacobian, strict=True)):
                    mine = range(self.count + r * OWN, self.count + (r + 1) * OWN)
                    sigma = np.sqrt(here.squares[self.columns(track)])
                    rows = (derivative[..., self.count :] / sigma[:, None]).reshape(-1, OWN)
                    pull = rows.T @ (point.rests[r] / sigma).ravel()
                    pull += self.weight[mine] * (self.mean[mine] - values[mine])
                    moved[mine] += inverse_of(information[np.ix_(mine, mine)]) @ pull
            found.append(np.clip(moved, self.low, self.high))
        return found

    def finish(self, values: np.ndarray, here: _Point) -> Fit:
        """The fit with its information and the pulls of its parts."""
        jacobian = self.jacobian(values, here)
        information, _ = self.normal(values, here, jacobian)
        pulls = []
        for r, (track, derivative) in enumerate(zip(self.tracks, jacobian, strict=True)):
            mine = [*range(self.count), *range(self.count + r * OWN, self.count + (r + 1) * OWN)]
            sigma = np.sqrt(here.squares[self.columns(track)])
            score = ((derivative / sigma[:, None]) * (here.rests[r] / sigma)[..., None]).sum(axis=1)
            share = max(4, round(_BLOCKS * len(track.values) / sum(len(t.values) for t in self.tracks)))
            for part in np.array_split(score, share):
                pull = np.zeros(len(values))
                pull[mine] = part.sum(axis=0)
                pulls.append(pull)
        return Fit(
            self.model, values[: self.count], values[self.count :].reshape(-1, OWN), here.cost,
            np.sqrt(here.squares), here.rests, information, np.array(pulls), int(self.counts.sum()),
        )  # fmt: skip
