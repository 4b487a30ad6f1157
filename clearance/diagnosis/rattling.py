"""Play of the slider in its guide: a shoe that rattles between rails is lost at many strikes.

Which side it strikes next is hardly to be seen where it hangs between them. A path that looks right on an
island may be false; then no step from there comes to follow, while from another island the whole recording is
followed. So islands are tried until a first fit follows: a right one leaves a misfit of 1 to 8, a false one
of a hundred.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from clearance.diagnosis.explain import Explanation, Rails, Search, beside
from clearance.diagnosis.fit import Model
from clearance.diagnosis.geometry import suggest_guide
from clearance.diagnosis.growth import Followed, Start, grow, scale_of
from clearance.diagnosis.hypothesis import Hypothesis
from clearance.diagnosis.search import LOOSENESS, POOR, Attempt, refine
from clearance.diagnosis.trace import Trace
from clearance.errors import InputError

_GAPS = (1.0, 0.95, 1.05, 1.1, 0.9)  # times that which the motion shows: rattling is followed within 3 %
_ISLANDS = 8  # of a recording that are tried
_HOPELESS = 30.0  # misfit of the first fit from a false island


def begin_guide(search: Search, explanation: Explanation) -> None:
    """Fit play of the slider in its guide, from the gap that the motion shows.

    The clearance is fitted first: from 1.6 % off it was found on two machines, once the gap was nearly right.
    """
    try:
        one = suggest_guide(search)
    except np.linalg.LinAlgError:
        return
    if one is None:
        return
    explanation.rails = Rails(one.value, one.clearance)
    held, values = beside(explanation.nominal, [one.hypothesis], np.array([one.value]))
    model = search.setting.model(held)
    values[:, 0] = one.clearance
    for factor in _GAPS:
        tried = values.copy()
        tried[:, 1] *= factor
        found = _first(search, model, tried)
        if found is not None or search.late():
            break
    if found is not None:
        first, followed = found
        search.keep(explanation, held, lambda: _everywhere(search, held, model, first, followed))


def fit_rattling(
    traces: Sequence[Trace],
    model: Model,
    rows: np.ndarray,
    workers: int,
    hypotheses: Sequence[Hypothesis] = (),
    known: Mapping[int, Followed] | None = None,
) -> Attempt | None:
    """Fit a machine to recordings that are each followed from one of their islands, if all are.

    Args:
        traces: of the recordings.
        model: of the machine.
        rows: (recordings, unknowns) to begin with.
        workers: threads.
        hypotheses: that the model is of.
        known: recordings that were followed before.
    """
    each = dict(known or {})
    for r, trace in enumerate(traces):
        found = each.get(r) or _followed(trace, model, rows[r])
        if found is None:
            return None
        each[r] = found
    order = range(len(traces))
    values, misfit = np.stack([each[r][1] for r in order]), float(np.mean([each[r][2] for r in order]))
    values[:, : model.shared] = values[:, : model.shared].mean(axis=0)
    return refine(hypotheses, model, [each[r][0] for r in order], values, scale_of(misfit), 8, workers)


def _followed(trace: Trace, model: Model, row: np.ndarray) -> Followed | None:
    for start in Start.several(trace, model.held(row), LOOSENESS, _ISLANDS):
        found = _grown(start, model, row)
        if found is not None:
            return found
    return None


def _grown(start: Start, model: Model, row: np.ndarray) -> Followed | None:
    try:
        found = grow(start, model, row, _HOPELESS, patient=True)
    except (InputError, np.linalg.LinAlgError):  # the gap has closed
        return None
    return found if found is not None and found[2] < POOR else None


def _first(search: Search, model: Model, rows: np.ndarray) -> tuple[int, Followed] | None:
    """The recording that is followed first, of islands on all recordings, and how."""
    starts = []
    rows = rows.copy()
    for r, row in enumerate(rows):
        trace = search.retrace(r, model.machine(row))
        row[-1] = trace.speed
        starts += [
            (start.doubt, r, start) for start in Start.several(trace, model.held(row), LOOSENESS, _ISLANDS)
        ]
    for _, r, start in sorted(starts, key=lambda one: one[0]):
        found = _grown(start, model, rows[r])
        if found is not None:
            gap, misfit = found[1][1] * 1e6, found[2]
            search.report(f"  between rails that leave {gap:.4g} um: misfit {misfit:.3g} on one recording")
            return r, found
        if search.late():
            return None
    return None


def _everywhere(
    search: Search, held: Sequence[Hypothesis], model: Model, first: int, followed: Followed
) -> Attempt | None:
    """Fit to all recordings what the first one tells."""
    traces = [search.retrace(r, model.machine(followed[1])) for r in range(len(search.recordings))]
    rows = np.repeat(followed[1][None], len(traces), axis=0)
    rows[:, -1] = [trace.speed for trace in traces]
    return fit_rattling(traces, model, rows, search.workers, held, {first: followed})
