"""What each term promises beside a fitted model: one linear look, all of them at once."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from clearance.diagnosis.motion.attempt import Attempt
from clearance.diagnosis.motion.fit import OWN, Problem, inverse_of
from clearance.diagnosis.motion.model import Term
from clearance.diagnosis.motion.track import Track


def screen(
    base: Attempt, candidates: Sequence[Term], tracks: Sequence[Track], begin: np.ndarray, workers: int
) -> dict[str, tuple[float, np.ndarray]]:
    """Linearised decrease of the cost by each term, and where to begin with it, from one look around.

    Args:
        base: beside which to look.
        candidates: terms; those that are far from linear are passed over.
        tracks: of the recordings.
        begin: (recordings, own unknowns) at the beginning of each.
        workers: threads.
    """
    model = base.fit.model
    problem = Problem(model, tracks, [model.own(b) for b in begin], workers)
    values = np.concatenate([base.fit.shared, base.fit.own.ravel()])
    here = problem.points([values])[0]
    jacobian = problem.jacobian(values, here)
    information, gradient = problem.normal(values, here, jacobian)
    found: dict[str, tuple[float, np.ndarray]] = {}
    for term in candidates:
        if not term.linear:
            continue
        sides = list(chain.from_iterable(_sides(term, start) for start in term.starts))
        guesses = [
            [
                replace(model, terms=(*base.terms, term)).guess(
                    np.concatenate([base.fit.shared, side]), base.fit.own[r]
                )
                for side, _, _ in sides
            ]
            for r in range(len(tracks))
        ]
        columns = [problem.predicted(r, guesses[r]) for r in range(len(tracks))]
        best: tuple[float, np.ndarray] | None = None
        place = 0
        for start in term.starts:
            count = len(term.sizes)
            group = range(place, place + count)
            place += count
            cross = np.zeros((count, len(values)))
            square, pull = np.zeros((count, count)), np.zeros(count)
            for r, track in enumerate(tracks):
                mine = [
                    *range(problem.count),
                    *range(problem.count + r * OWN, problem.count + (r + 1) * OWN),
                ]
                sigma = np.sqrt(here.squares[problem.columns(track)])
                plain = track.values[track.judged] - here.rests[r]
                rows = np.stack(
                    [((columns[r][k] - plain) / sides[k][2] / sigma).ravel() for k in group], axis=1
                )
                if not np.isfinite(rows).all():
                    rows = np.zeros_like(rows)
                other = (jacobian[r] / sigma[:, None]).reshape(len(rows), -1)
                cross[:, mine] += rows.T @ other
                square += rows.T @ rows
                pull += rows.T @ (here.rests[r] / sigma).ravel()
            inverse = inverse_of(information)
            rest = square - cross @ inverse @ cross.T
            left = pull - cross @ inverse @ gradient
            step = np.linalg.pinv(rest + 1e-9 * np.diag(np.diag(square)), hermitian=True) @ left
            gain = float(left @ step)
            begun = start.copy()
            for k, i in enumerate(term.sizes):
                unknown = term.unknowns[i]
                begun[i] = unknown.inner(unknown.outer(term.off[i] + step[k]))
            if best is None or gain > best[0]:
                best = gain, begun
        if best is not None:
            found[term.label] = best
    return found


def _sides(term: Term, start: np.ndarray) -> list[tuple[np.ndarray, int, float]]:
    """For each size of a term: values with that size a little on, which it is, and by how much."""
    found = []
    for i in term.sizes:
        side = start.copy()
        side[term.sizes] = term.off[term.sizes]
        unknown = term.unknowns[i]
        step = unknown.step
        inside = unknown.inner(unknown.outer(term.off[i] + step))
        if abs(inside - (term.off[i] + step)) > 0.5 * step:
            step = -step
        side[i] = term.off[i] + step
        found.append((side, i, step))
    return found
