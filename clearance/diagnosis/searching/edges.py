"""Where a load on a part of the stroke begins and ends: no slope leads from one place to another far off.

An edge is felt only where the path crosses it. So each is tried all along the stroke, clearance, path and
sizes following for a few steps, and the load is fitted from where least is left.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, ROOM, Attempt, tightened
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError
from clearance.simulation.layout import Signal

EDGED = "process_load"
"""The effect that has them."""
EDGES = ("start", "end")
_PLACES = 9  # along the stroke where an edge is tried
_CLOSER = (4.0, 4.0, 16.0)  # looks at places nearby, so much closer: what one edge hides the other one shows
_STEPS = 4  # in which clearance, path and sizes follow


def place_edges(search: Search, explanation: Explanation) -> None:
    """Fit the load of the best attempt, if it has one and leaves something, from edges along the stroke."""
    best = explanation.best
    if best.misfit <= ROOM or best.scale > ANNEALING[3] or search.late():
        return
    place = 1
    for hypothesis in best.hypotheses:
        if hypothesis.name == EDGED:
            columns = list(_columns(hypothesis, place))
            followers, values = _placed(search, best, columns)
            if (values[0] != best.fit.values[0]).any():
                where = ", ".join(f"{value:.4g}" for value in values[0, columns])
                search.report(f"  {hypothesis.label}: less is left with edges at {where}")
                search.refit(explanation, best.hypotheses, followers, values, ANNEALING[3], again=True)
            return
        place += len(hypothesis.unknowns)


def _placed(search: Search, best: Attempt, columns: Sequence[int]) -> tuple[Sequence[Follower], np.ndarray]:
    """Paths and (recordings, unknowns) values with the edges of which least is left, one after the other."""
    along = np.concatenate([one.signals[..., Signal.SLIDER_POSITION].ravel() for one in best.fit.passes])
    step = (along.max() - along.min()) / (_PLACES - 1)
    followers, values, least = best.followers, best.fit.values, best.fit.cost
    for closer in (1.0, *_CLOSER):
        for column in columns:
            kept = [i for i in range(values.shape[1]) if i != column]
            edges = along.min() + step * np.arange(_PLACES)
            if closer > 1.0:
                edges = values[0, column] + step / closer * np.delete(np.arange(-3, 4), 3)
            begun, start = followers, values
            for edge in edges:
                if search.late():
                    return followers, values
                row, own = start[0].copy(), tightened(begun)
                row[column] = edge
                try:
                    tried = settle(
                        own, best.model.only(kept, row), start[:, kept], _STEPS, 1e-3, search.workers,
                        scale=best.scale,
                    )  # fmt: skip
                except (InputError, np.linalg.LinAlgError):  # it would end before it begins
                    continue
                if tried.cost < least:
                    followers, values, least = own, np.insert(tried.values, column, edge, axis=1), tried.cost
    return followers, values


def _columns(hypothesis: Hypothesis, place: int) -> Iterator[int]:
    """Of the edges among an attempt's unknowns."""
    names = [unknown.name for unknown in hypothesis.unknowns]
    return (place + names.index(edge) for edge in EDGES)
