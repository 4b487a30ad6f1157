"""Fit a model's parameters to recordings, together with the path of the simulator on each of them."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from clearance.diagnosis.shooting.calibration import calibration_of
from clearance.diagnosis.shooting.follow import Follower, alike
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.normal_equations import assemble, flatten, solve_bounded, spread
from clearance.diagnosis.shooting.stretch import Comparison, Pass, Path
from clearance.errors import InputError

Job = TypeVar("Job")
Result = TypeVar("Result")


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


@dataclass
class Fit(Settled):
    """Parameters found, and how well they are known.

    Attributes:
        passes: the linearisation of each recording.
        information: (P, P) of all parameters: shared ones, then each recording's own [1/unit^2].
        covariance: of what the accelerometers were found to do, as ``Tolerances.open`` lists it; ``None``
            where they are exact.
    """

    passes: Sequence[Pass]
    information: np.ndarray
    covariance: np.ndarray | None = None

    def deviations(self) -> np.ndarray:
        """(P,) standard deviations of all parameters."""
        return np.sqrt(np.diag(np.linalg.pinv(self.information)))


def observe(
    followers: Sequence[Follower],
    model: Model,
    values: np.ndarray,
    workers: int = 2,
    forces: bool = True,
    **options: object,
) -> list[Pass]:
    """Linearise all recordings about their present paths; ``forces``: in small unknown forces, too."""

    def one(job: tuple[Follower, np.ndarray]) -> Pass:
        follower, own = job
        machines, faults = model.columns(own)
        return follower.look(
            model.machine(own),
            machines,
            model.instrument(own),
            faults,
            forces=forces or follower.forced,
            **options,  # type: ignore[arg-type]
        )

    return _in_parallel(one, list(zip(followers, values, strict=True)), workers)


def compare(
    followers: Sequence[Follower], model: Model, values: np.ndarray, workers: int = 2, **options: object
) -> list[Comparison]:
    """Set all recordings beside their present paths."""

    def one(job: tuple[Follower, np.ndarray]) -> Comparison:
        follower, own = job
        return follower.compare(model.machine(own), model.instrument(own), **options)  # type: ignore[arg-type]

    return _in_parallel(one, list(zip(followers, values, strict=True)), workers)


def _in_parallel(one: Callable[[Job], Result], jobs: list[Job], workers: int) -> list[Result]:
    if workers == 1 or len(jobs) == 1:
        return [one(job) for job in jobs]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(one, jobs))


def solve(
    passes: Sequence[Pass], damping: Sequence[float | np.ndarray], workers: int = 2, judged: bool = True
) -> None:
    """Eliminate the states of all recordings, each with its damping; ``judged``: as of ``Pass.solve``."""

    def one(job: tuple[Pass, float | np.ndarray]) -> None:
        job[0].solve(job[1], judged)

    _in_parallel(one, list(zip(passes, damping, strict=True)), workers)


def fit(
    followers: Sequence[Follower],
    model: Model,
    values: np.ndarray,
    iterations: int = 10,
    tolerance: float = 1e-3,
    workers: int = 2,
    **options: Any,
) -> Fit:
    """Settle, and say how well the parameters are known; arguments as of ``settle``.

    What accelerometers may do within their tolerances is found as well, and undone in the recordings.
    """
    about = {key: value for key, value in options.items() if key not in _SETTLING}

    def look(whole: Model, row: np.ndarray) -> tuple[list[Pass], np.ndarray]:
        passes = observe(followers, whole, row, workers, **about)
        solve(passes, [0.0] * len(passes), workers)
        return passes, assemble(passes, whole, row)[0]

    calibration = calibration_of(followers, model)
    if calibration is None:
        found = settle(followers, model, values, iterations, tolerance, workers, **options)
        passes, information = look(model, found.values)
        return Fit(model, found.values, found.cost, passes, information)
    kept, whole = [one.measured for one in followers], calibration.model
    sensors, scale = kept[0].sensors, float(about.get("scale", 1.0))
    begun, home = calibration.beside(values, sensors), options.get("home")
    if home is not None:
        options = options | {"home": calibration.beside(home, sensors)}
    try:
        for follower in followers:
            follower.measured = follower.measured.as_recorded().around()
        for coarse in _scales(scale, scale * max(one.widened for one in kept)):
            coarsely = options | {"scale": coarse}
            begun = settle(followers, whole, begun, iterations, _COARSELY, workers, **coarsely).values
        found = settle(followers, whole, begun, iterations, tolerance, workers, **options)
        information, covariance = calibration.known(look(whole, found.values)[1])
    finally:
        for follower, measured in zip(followers, kept, strict=True):
            follower.measured = measured
    sensors, values = calibration.sensors(found.values[0]), calibration.without(found.values)
    for follower, measured in zip(followers, kept, strict=True):
        follower.measured = measured.calibrated(sensors)
    passes = look(model, values)[0]
    return Fit(model, values, sum(one.cost for one in passes), passes, information, covariance)


def _scales(finest: float, coarsest: float) -> list[float]:
    """Factors on the noise from a coarse one down to, but not including, the finest."""
    steps = int(np.ceil(np.log(max(coarsest / finest, 1.0)) / np.log(_CLOSER) - _ALIKE))
    return [finest * _CLOSER**step for step in range(steps, 0, -1)]


def settle(
    followers: Sequence[Follower],
    model: Model,
    values: np.ndarray,
    iterations: int = 10,
    tolerance: float = 1e-3,
    workers: int = 2,
    report: Callable[[int, float, np.ndarray], None] | None = None,
    goal: float = 0.0,
    tries: int = 4,
    home: np.ndarray | None = None,
    **options: object,
) -> Settled:
    """Gauss-Newton with step halving from present paths and values.

    Args:
        followers: one a recording, with paths; moved to the solution.
        model: what to fit.
        values: (recordings, unknowns) start values.
        iterations: at most.
        tolerance: stop when the cost falls by less than this share.
        workers: threads.
        report: called with the iteration, cost and values.
        goal: cost a sample that is good enough.
        tries: of damping in one iteration.
        home: (recordings, unknowns) values near which the unknowns are expected, within a few times what
            their linearisation bears: what a short stretch does not show must not run away.
        options: for ``Follower.look``.
    """
    values = values.copy()
    low = np.array([u.low for u in model.unknowns])
    high = np.array([u.high for u in model.unknowns])
    ratio = np.array([u.log for u in model.unknowns], dtype=bool)
    turning = np.array([u.turns for u in model.unknowns], dtype=bool)
    seen = compare(followers, model, values, workers, **options)
    away = _Leash(model, values, home)
    cost = sum(c.cost for c in seen) + away.cost(values)
    first = int(options.get("first", 0))  # type: ignore[call-overload]
    samples = sum(c.samples for c in seen)
    damping, share = 0.0, _RATIO
    doubt = float(options.get("doubt", 1.0))  # type: ignore[arg-type]
    least = [unsteady(len(c.local), doubt) for c in seen]
    local = [held.copy() for held in least]
    for iteration in range(iterations):
        if cost < goal * samples:
            break
        passes = observe(followers, model, values, workers, forces=False, **options)
        paths = [f.path.copy() for f in followers]
        best: tuple[float, list[Path], list[Comparison], np.ndarray] | None = None
        for _ in range(tries):
            solve(passes, [np.maximum(damping, held) for held in local], workers, judged=False)
            information, score = assemble(passes, model, values)
            information += np.diag(damping * _stiffness(model, values) + away.weight)
            score -= away.weight * away.distance(values)
            most = np.where(ratio, share * np.abs(values), np.inf)
            lows = flatten(np.where(turning, -_TURN, np.maximum(low - values, -most)), model)
            highs = flatten(np.where(turning, _TURN, np.minimum(high - values, most)), model)
            change = spread(solve_bounded(information, score, lows, highs), model, len(followers))
            moved = values + change
            trial = _step(followers, model, values, moved, passes, first, workers, options)
            new = sum(c.cost for c in trial) + away.cost(moved) if trial is not None else np.inf
            last = np.inf
            while (
                trial is not None and model.unknowns and cost <= new < _FALLING * last
                and same_coordinates(passes, trial)
            ):  # fmt: skip
                last = new
                trial = _corrected(
                    followers, model, moved, passes, trial, damping, local, first, workers, options
                )
                new = sum(c.cost for c in trial) + away.cost(moved)
            if trial is not None and new < min(cost * (1.0 + 1e-9), best[0] if best else np.inf):
                best = new, [f.path.copy() for f in followers], trial, moved
            torn = [_harmed(p, t) for p, t in zip(passes, trial, strict=True)] if trial is not None else []
            harm = np.mean(np.concatenate(torn)) if torn else 1.0
            if best is not None and (harm == 0.0 or best[0] < new):
                break
            share *= 0.5
            if harm > _MANY:  # a bad step as a whole
                if best is not None:
                    break
                damping = max(30.0 * damping, 0.3)
            else:  # hold what it tore apart where it was, and let the rest go on
                for held, mask in zip(local, torn, strict=True):
                    near = np.convolve(mask, np.ones(2 * _NEAR + 1), "same")[: len(mask)] > 0.0
                    held[near] = np.maximum(30.0 * held[near], _HOLD)
            for follower, path in zip(followers, paths, strict=True):
                follower.path = path.copy()
        for follower, path in zip(followers, paths if best is None else best[1], strict=True):
            follower.path = path
        if best is None or trial is not best[2]:  # the motion last computed was another path's
            seen = compare(followers, model, values if best is None else best[3], workers, **options)
        if best is None:
            break
        fall, cost, seen, values = cost - best[0], best[0], best[2], best[3]
        settled, share = damping == 0.0, min(4.0 * share, _RATIO)
        damping = damping / 10.0 if damping > 0.1 else 0.0
        local = [
            np.maximum(np.where(held > 0.1, held / 10.0, 0.0), floor)
            for held, floor in zip(local, least, strict=True)
        ]
        if report is not None:
            report(iteration, cost, values)
        if fall < tolerance * cost and settled:
            break
    values[:, turning] = wrapped(values[:, turning])
    return Settled(model, values, cost, seen)


def wrapped(angles: np.ndarray) -> np.ndarray:
    """Angles [rad] between -π and π."""
    turned: np.ndarray = np.mod(angles + np.pi, 2.0 * np.pi) - np.pi
    return turned


def unsteady(segments: int, doubt: float = 1.0) -> np.ndarray:
    """(segments,) damping of the first ones, which only samples after them tell: far steps are wild."""
    held = np.zeros(segments)
    if doubt >= 1.0:
        held[:_FIRST] = 1.0
    return held


def _step(
    followers: Sequence[Follower],
    model: Model,
    values: np.ndarray,
    moved: np.ndarray,
    passes: Sequence[Pass],
    first: int,
    workers: int,
    options: dict[str, object],
) -> list[Comparison] | None:
    """Take a Gauss-Newton step and look again; ``None`` where it leads nowhere a machine can be."""
    if not np.isfinite(moved).all():
        return None
    for r, (follower, one) in enumerate(zip(followers, passes, strict=True)):
        steps = np.array([model.step(values[r], i) for i in range(len(model.unknowns))])
        follower.move(one.change((moved - values)[r] / steps), one.chart, first)
    try:
        for row in moved:  # a step from which no derivatives can be taken leads to a dead end
            here, (around, _) = model.machine(row), model.columns(row)
            if not all(one is None or alike(one, here) for one in around):
                return None
        return compare(followers, model, moved, workers, **options)
    except InputError:  # a law does not take these values
        return None


def same_coordinates(passes: Sequence[Pass], seen: Sequence[Comparison]) -> bool:
    """Whether derivatives serve there: an effect that a step has switched off took its coordinates along."""
    return all(np.array_equal(a.chart.rows, b.chart.rows) for a, b in zip(passes, seen, strict=True))


def _corrected(
    followers: Sequence[Follower],
    model: Model,
    moved: np.ndarray,
    passes: Sequence[Pass],
    trial: Sequence[Comparison],
    damping: float,
    local: Sequence[np.ndarray],
    first: int,
    workers: int,
    options: dict[str, object],
) -> list[Comparison]:
    """Let the paths follow parameters that have moved, before the move is judged.

    A contact's penetration depends on stiffness and force by a power; the linear step misses it by little in
    length and by much in force, and one more step of the path alone sets it right (second-order correction,
    by the derivatives before the step: Nocedal & Wright, Numerical Optimization, 2006, ch. 15.6).
    """
    chords = [
        follower.beside(one, seen, first)
        for follower, one, seen in zip(followers, passes, trial, strict=True)
    ]
    solve(chords, [np.maximum(damping, held) for held in local], workers, judged=False)
    for follower, one in zip(followers, chords, strict=True):
        follower.move(one.change(np.zeros(len(model.unknowns))), one.chart, first)
    return compare(followers, model, moved, workers, **options)


def _harmed(before: Comparison, after: Comparison) -> np.ndarray:
    """(segments,) where a step did harm: an impact that it tore apart must not hold up all other segments."""
    rows = before.residual[0].size
    return ~(after.local < before.local + 0.5 * rows) & ~(after.local < 3.0 * rows)


_CLOSER = np.sqrt(10.0)  # times as large is the scale of the noise before
_ALIKE = 0.1  # of such a step: scales that differ by less are one
_COARSELY = 1e-2  # share of the cost whose fall ends a coarse fit
_SETTLING = ("report", "goal", "tries", "home")  # what only ``settle`` wants to know
_QUIET, _QUIET_MEAN = 0.9, 0.975  # share of segments, and what they cost where all cost 1 on average
_MANY = 0.3  # share of segments; a step that harms more is a bad step
_FALLING = 0.7  # of its cost that a correction of a step leaves at most, to be worth another one
_HOLD = 3.0  # damping of segments that a step harmed
_FIRST = 6  # segments of a stretch of which nothing before is known
_NEAR = 2  # segments around a harmed one that are held with it


def _stiffness(model: Model, values: np.ndarray) -> np.ndarray:
    """(P,) inverse squares of the changes that the parameters surely bear."""
    shared = model.shared
    reach = np.array(
        [u.reach or _REACH * max(abs(v), u.step) for u, v in zip(model.unknowns, values[0], strict=True)]
    )
    own = np.tile(reach[shared:], len(values))
    return 1.0 / np.concatenate([reach[:shared], own]) ** 2


class _Leash:
    """What is expected of the unknowns before a stretch is looked at, as a sum of squares."""

    def __init__(self, model: Model, values: np.ndarray, home: np.ndarray | None) -> None:
        self.model = model
        within = flatten(np.tile([u.within for u in model.unknowns], (len(values), 1)), model)
        far = np.zeros(len(within)) if home is None else _stiffness(model, home) / _EXPECTED**2
        self.weight = np.where(np.isfinite(within), within**-2.0, far)
        known = np.array([np.isfinite(u.within) for u in model.unknowns], dtype=bool)
        expected = np.array([u.expected for u in model.unknowns])
        self.home = np.where(known, expected, values if home is None else home)
        self.turning = np.array([u.turns for u in model.unknowns], dtype=bool)

    def distance(self, values: np.ndarray) -> np.ndarray:
        """(P,) from home; of shared unknowns that of the first recording."""
        apart = values - self.home
        return flatten(np.where(self.turning, wrapped(apart), apart), self.model)

    def cost(self, values: np.ndarray) -> float:
        """Sum of squares of the unknowns' distances, each in units of what is expected."""
        return float((self.weight * self.distance(values) ** 2).sum())


_EXPECTED = 3.0  # times what the linearisation bears: standard deviation of an unknown from what is expected
_TURN = 0.5  # rad that an angle changes in one step
_RATIO = 0.3  # of its value that an unknown which counts by ratios changes in one step
_REACH = 0.05  # of a parameter's value, where nothing else is said
