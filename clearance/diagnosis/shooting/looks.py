"""Look at all recordings at once: beside their paths, linearised about these, the states eliminated."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.stretch import Comparison, Pass
from clearance.diagnosis.side_by_side import side_by_side


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

    jobs = list(zip(followers, values, strict=True))
    return side_by_side(one, jobs, workers, [follower.segments for follower in followers])


def compare(
    followers: Sequence[Follower], model: Model, values: np.ndarray, workers: int = 2, **options: object
) -> list[Comparison]:
    """Set all recordings beside their present paths."""

    def one(job: tuple[Follower, np.ndarray]) -> Comparison:
        follower, own = job
        return follower.compare(model.machine(own), model.instrument(own), **options)  # type: ignore[arg-type]

    jobs = list(zip(followers, values, strict=True))
    return side_by_side(one, jobs, workers, [follower.segments for follower in followers])


def solve(
    passes: Sequence[Pass], damping: Sequence[float | np.ndarray], workers: int = 2, judged: bool = True
) -> None:
    """Eliminate the states of all recordings, each with its damping; ``judged``: as of ``Pass.solve``."""

    def one(job: tuple[Pass, float | np.ndarray]) -> None:
        job[0].solve(job[1], judged)

    jobs = list(zip(passes, damping, strict=True))
    side_by_side(one, jobs, workers, [len(each.local) for each in passes])


def same_coordinates(passes: Sequence[Pass], seen: Sequence[Comparison]) -> bool:
    """Whether derivatives serve there: an effect that a step has switched off took its coordinates along."""
    return all(np.array_equal(a.chart.rows, b.chart.rows) for a, b in zip(passes, seen, strict=True))
