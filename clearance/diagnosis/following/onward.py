"""Follow what was held out where a first try lost it: from the fitted stretch on, or from other places."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from clearance.diagnosis.following.attempt import COARSE, EXPLAINED, LOOSENESS, TIGHT, Attempt, refine
from clearance.diagnosis.following.growth import ISLAND, Followed, Start, grow, scale_of
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model

_PLACES = 4  # from which a recording that was lost is followed again
_FURTHEST = 3000  # segments from there on to what was held out: each is followed, and costs memory
_BACK = 4  # segments before the end of the fitted stretch, which the end's samples hardly know


def go_on(attempt: Attempt, traces: Sequence[Trace], model: Model, workers: int) -> Attempt | None:
    """Follow what was held out from where the fitted stretches end; ``None`` where it is not soon after that.

    Which states are possible when nothing before is known may be lost among many: a shoe that hangs between
    its rails shows nothing of where. Whoever was on the way there knows.

    Args:
        attempt: that explains the fitted stretches.
        traces: of what was held out.
        model: of the attempt's machine, its speed unknown.
        workers: threads.
    """
    pairs = [(trace, _before(attempt, trace.measured)) for trace in traces]

    def one(pair: tuple[Trace, tuple[Follower, float] | None]) -> Followed:
        trace, known = pair
        assert known is not None
        before, speed = known
        own, end = trace.measured.first, trace.measured.first + trace.length
        follower = Follower(_joined(before.measured, end), COARSE, TIGHT.copy())
        follower.path.nodes[: before.segments] = before.path.nodes
        start = Start(trace, follower, before.segments - ISLAND - _BACK, 0.0)
        found, row, misfit = _grown(start, model, np.array([speed]))
        skipped = own - found.measured.first
        return found.part(skipped, found.segments), row, misfit

    if any(known is None for _, known in pairs):
        return None
    with ThreadPoolExecutor(workers) as pool:
        return _together(list(pool.map(one, pairs)), model, workers)


def follow_again(
    found: Attempt, traces: Sequence[Trace], model: Model, workers: int, late: Callable[[], bool]
) -> Attempt:
    """Follow recordings that were lost from other places, where their path is sure too.

    Near chaos a machine that is right is lost at one impact and not at another.

    Args:
        found: with the recordings, some lost; returned where nothing is better.
        traces: of the recordings.
        model: of a machine that explains others, its speed unknown.
        workers: threads.
        late: whether the time is over: one other place is then enough.
    """

    def one(r: int) -> Followed:
        row = found.fit.values[r]
        best: Followed = (found.followers[r], row, found.misfits[r])
        if best[2] < EXPLAINED:
            return best
        places = 1 if late() else _PLACES
        for start in Start.several(traces[r], model.held(row), LOOSENESS, places):
            other = grow(start, model, row, patient=True)
            assert other is not None  # without a limit none is given up
            best = other if other[2] < best[2] else best
            if best[2] < EXPLAINED or late():
                break
        return best

    with ThreadPoolExecutor(workers) as pool:
        each = list(pool.map(one, range(len(traces))))
    if all(follower is before for (follower, _, _), before in zip(each, found.followers, strict=True)):
        return found
    again = _together(each, model, workers)
    return again if again.misfit < found.misfit else found


def _together(each: Sequence[Followed], model: Model, workers: int) -> Attempt:
    """Recordings that were followed one by one, as one attempt."""
    rows, misfit = np.stack([row for _, row, _ in each]), float(np.mean([m for _, _, m in each]))
    return refine((), model, [follower for follower, _, _ in each], rows, scale_of(misfit), 8, workers)


def _grown(start: Start, model: Model, row: np.ndarray) -> Followed:
    found = grow(start, model, row, most=start.follower.segments, patient=True)
    assert found is not None  # without a limit none is given up
    return found


def _before(attempt: Attempt, measured: Measured) -> tuple[Follower, float] | None:
    """The follower of the same recording's stretch that ends soon before a part, and its speed [rpm]."""
    for follower, row in zip(attempt.followers, attempt.fit.values, strict=True):
        own = follower.measured
        same = own.name == measured.name and len(own.recorded) == len(measured.recorded)
        end = own.first + follower.segments
        if same and end <= measured.first <= end + _FURTHEST:
            return follower, float(row[-1])
    return None


def _joined(measured: Measured, end: int) -> Measured:
    """The recording from where a part of it begins up to a segment of the whole."""
    part = measured.recorded[measured.first * SAMPLES : end * SAMPLES]
    return replace(measured, values=part.reshape(-1, SAMPLES, part.shape[1]))
