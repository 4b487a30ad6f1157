"""Let parameters and paths come to rest together: Gauss-Newton, damped where a step tore something apart.

One iteration (``_Descent.advance``) linearises every recording about its path, solves for paths and
parameters at once, and tries the step. A step that lowers nothing is tried again, shorter (``share``) and
held back: everywhere where it was bad as a whole (``damping``), or only where it tore single impacts apart
(``local``), so that these do not hold up the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from clearance.diagnosis.shooting.expectation import Expectation, stiffness, wrapped
from clearance.diagnosis.shooting.follow import Follower, alike
from clearance.diagnosis.shooting.looks import compare, observe, same_coordinates, solve
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.normal_equations import assemble, flatten, solve_bounded, spread
from clearance.diagnosis.shooting.stretch import Comparison, Pass, Path
from clearance.errors import InputError

_QUIET, _QUIET_MEAN = 0.9, 0.975  # share of segments, and what they cost where all cost 1 on average
_TURN = 0.5  # rad that an angle changes in one step
_RATIO = 0.3  # of its value that an unknown which counts by ratios changes in one step
_MANY = 0.3  # share of segments; a step that harms more is a bad step
_FALLING = 0.7  # of its cost that a correction of a step leaves at most, to be worth another one
_HOLD = 3.0  # damping of segments that a step harmed
_NEAR = 2  # segments around a harmed one that are held with it
_ROUNDING = 1.0 + 1e-9  # times its cost that a step may leave
_FIRST = 6  # segments of a stretch of which nothing before is known


@dataclass
class Settled:
    """Where a fit has come to rest.

    Attributes:
        model: what was fitted.
        values: (recordings, unknowns).
        cost: robust sum of squares.
        passes: each recording beside its path.
    """

    model: Model
    values: np.ndarray
    cost: float
    passes: Sequence[Comparison]

    @property
    def level(self) -> float:
        """Robust cost a sample over the quieter nine tenths of the segments; 1 for a perfect model.

        A few segments where an impact was put together wrongly say nothing about the model.
        """
        return _level(self.passes)

    @property
    def levels(self) -> list[float]:
        """The same for each recording."""
        return [_level([one]) for one in self.passes]


def _level(passes: Sequence[Comparison]) -> float:
    each = np.concatenate([p.each[(p.used > 0.0).any(axis=(1, 2))] for p in passes])
    return float(np.sort(each)[: max(1, round(_QUIET * len(each)))].mean() / _QUIET_MEAN)


def settle(
    followers: Sequence[Follower],
    model: Model,
    values: np.ndarray,
    iterations: int = 10,
    tolerance: float = 1e-3,
    workers: int = 2,
    goal: float = 0.0,
    tries: int = 4,
    home: np.ndarray | None = None,
    **options: Any,
) -> Settled:
    """Gauss-Newton with damping, from present paths and values.

    Args:
        followers: one a recording, with paths; moved to the solution.
        model: what to fit.
        values: (recordings, unknowns) start values.
        iterations: at most.
        tolerance: stop when the cost falls by less than this share.
        workers: threads.
        goal: cost a sample that is good enough.
        tries: of damping in one iteration.
        home: as of ``Expectation``.
        options: for ``Follower.look``.
    """
    descent = _Descent(followers, model, values, home, workers, options)
    for _ in range(iterations):
        if descent.here.cost < goal * descent.samples:
            break
        fall = descent.advance(tries)
        if fall is None:
            break
        if fall < tolerance * descent.here.cost and descent.damping == 0.0:
            break
        descent.ease()
    here, turning = descent.here, descent.expectation.turning
    here.values[:, turning] = wrapped(here.values[:, turning])
    return Settled(model, here.values, here.cost, here.seen)


def unsteady(segments: int, doubt: float = 1.0) -> np.ndarray:
    """(segments,) damping of the first ones, which only samples after them tell: far steps are wild."""
    held = np.zeros(segments)
    if doubt >= 1.0:
        held[:_FIRST] = 1.0
    return held


@dataclass
class _Place:
    """Values, the paths that go with them, the recordings beside these, and what all of it costs."""

    values: np.ndarray
    paths: list[Path]
    seen: list[Comparison]
    cost: float


class _Descent:
    """A fit on its way down; arguments as of ``settle``.

    Attributes:
        here: the best place so far; the followers are on its paths between two iterations.
        damping: of all segments in the next step.
        local: (segments,) of each recording: damping of single ones.
        share: of its value that an unknown which counts by ratios may change in the next step.
        samples: residuals with weight.
    """

    def __init__(
        self,
        followers: Sequence[Follower],
        model: Model,
        values: np.ndarray,
        home: np.ndarray | None,
        workers: int,
        options: dict[str, Any],
    ) -> None:
        self.followers, self.model, self.workers, self.options = followers, model, workers, options
        self.first = int(options.get("first", 0))
        self.low = np.array([u.low for u in model.unknowns])
        self.high = np.array([u.high for u in model.unknowns])
        self.ratio = np.array([u.log for u in model.unknowns], dtype=bool)
        self.expectation = Expectation(model, values, home)
        self.here = self._place(values.copy(), self._compared(values))
        self.samples = sum(one.samples for one in self.here.seen)
        self.damping, self.share = 0.0, _RATIO
        doubt = float(options.get("doubt", 1.0))
        self._least = [unsteady(len(one.local), doubt) for one in self.here.seen]
        self.local = [held.copy() for held in self._least]

    def advance(self, tries: int) -> float | None:
        """Go one step down; by how much the cost fell, or ``None`` where no step lowers it."""
        passes = observe(
            self.followers, self.model, self.here.values, self.workers, forces=False, **self.options
        )
        best: _Place | None = None
        trial: _Place | None = None
        for _ in range(tries):
            trial = self._tried(passes)
            lowest = min(self.here.cost * _ROUNDING, best.cost if best else np.inf)
            if trial is not None and trial.cost < lowest:
                best = trial
            torn = [] if trial is None else list(map(_harmed, passes, trial.seen))
            harm = np.mean(np.concatenate(torn)) if torn else 1.0
            if best is not None and (harm == 0.0 or trial is None or best.cost < trial.cost):
                break
            self.share *= 0.5
            if harm > _MANY and best is not None:
                break
            self._hold_back(torn, harm)
            self._go_to(self.here.paths)
        before, self.here = self.here, best or self.here
        self._go_to(self.here.paths)
        if trial is not best or best is None:  # the motion last computed was another path's
            self.here.seen = self._compared(self.here.values)
        return None if best is None else before.cost - best.cost

    def ease(self) -> None:
        """Be bolder after a step that was good."""
        self.share = min(4.0 * self.share, _RATIO)
        self.damping = self.damping / 10.0 if self.damping > 0.1 else 0.0
        self.local = [
            np.maximum(np.where(held > 0.1, held / 10.0, 0.0), floor)
            for held, floor in zip(self.local, self._least, strict=True)
        ]

    def _tried(self, passes: Sequence[Pass]) -> _Place | None:
        """Where a step leads, paths corrected; ``None``: nowhere a machine can be."""
        values = self.here.values
        moved = values + self._change(passes)
        seen = self._stepped(passes, moved)
        trial, last = None if seen is None else self._place(moved, seen), np.inf
        while (
            trial is not None and self.model.unknowns
            and self.here.cost <= trial.cost < _FALLING * last
            and same_coordinates(passes, trial.seen)
        ):  # fmt: skip
            last = trial.cost
            trial = self._place(moved, self._corrected(passes, trial))
        return trial

    def _change(self, passes: Sequence[Pass]) -> np.ndarray:
        """(recordings, unknowns) of the values in the next step, by the damped normal equations."""
        model, values, expectation = self.model, self.here.values, self.expectation
        self._solve(passes)
        information, score = assemble(passes, model, values)
        information += np.diag(self.damping * stiffness(model, values) + expectation.weight)
        score -= expectation.weight * expectation.distance(values)
        most = np.where(self.ratio, self.share * np.abs(values), np.inf)
        lows = np.where(expectation.turning, -_TURN, np.maximum(self.low - values, -most))
        highs = np.where(expectation.turning, _TURN, np.minimum(self.high - values, most))
        change = solve_bounded(information, score, flatten(lows, model), flatten(highs, model))
        return spread(change, model, len(self.followers))

    def _stepped(self, passes: Sequence[Pass], moved: np.ndarray) -> list[Comparison] | None:
        """Take the step and look again; ``None`` where it leads nowhere a machine can be."""
        model, values = self.model, self.here.values
        if not np.isfinite(moved).all():
            return None
        for r, (follower, one) in enumerate(zip(self.followers, passes, strict=True)):
            steps = np.array([model.step(values[r], i) for i in range(len(model.unknowns))])
            follower.move(one.change((moved - values)[r] / steps), one.chart, self.first)
        try:
            for row in moved:  # a step from which no derivatives can be taken leads to a dead end
                here, (around, _) = model.machine(row), model.columns(row)
                if not all(one is None or alike(one, here) for one in around):
                    return None
            return self._compared(moved)
        except InputError:  # a law does not take these values
            return None

    def _corrected(self, passes: Sequence[Pass], trial: _Place) -> list[Comparison]:
        """Let the paths follow parameters that have moved, before the move is judged.

        A contact's penetration depends on stiffness and force by a power; the linear step misses it by
        little in length and by much in force, and one more step of the path alone sets it right (second-order
        correction, by the derivatives before the step: Nocedal & Wright, Numerical Optimization, 2006,
        ch. 15.6).
        """
        chords = [
            follower.beside(one, seen, self.first)
            for follower, one, seen in zip(self.followers, passes, trial.seen, strict=True)
        ]
        self._solve(chords)
        for follower, one in zip(self.followers, chords, strict=True):
            follower.move(one.change(np.zeros(len(self.model.unknowns))), one.chart, self.first)
        return self._compared(trial.values)

    def _hold_back(self, torn: Sequence[np.ndarray], harm: float) -> None:
        """Damp the next step: everywhere if this one was bad as a whole, else where it tore impacts apart."""
        if harm > _MANY:
            self.damping = max(30.0 * self.damping, 0.3)
            return
        for held, mask in zip(self.local, torn, strict=True):
            near = np.convolve(mask, np.ones(2 * _NEAR + 1), "same")[: len(mask)] > 0.0
            held[near] = np.maximum(30.0 * held[near], _HOLD)

    def _solve(self, passes: Sequence[Pass]) -> None:
        damping = [np.maximum(self.damping, held) for held in self.local]
        solve(passes, damping, self.workers, judged=False)

    def _compared(self, values: np.ndarray) -> list[Comparison]:
        return compare(self.followers, self.model, values, self.workers, **self.options)

    def _place(self, values: np.ndarray, seen: list[Comparison]) -> _Place:
        cost = sum(one.cost for one in seen) + self.expectation.cost(values)
        return _Place(values, [follower.path.copy() for follower in self.followers], seen, cost)

    def _go_to(self, paths: Sequence[Path]) -> None:
        for follower, path in zip(self.followers, paths, strict=True):
            follower.path = path.copy()


def _harmed(before: Comparison, after: Comparison) -> np.ndarray:
    """(segments,) where a step did harm: an impact that it tore apart must not hold up all other segments."""
    rows = before.residual[0].size
    return ~(after.local < before.local + 0.5 * rows) & ~(after.local < 3.0 * rows)
