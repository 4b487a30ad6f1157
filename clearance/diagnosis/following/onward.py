"""Follow what was held out: from its surest place, from the fitted stretch on, or from other places."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from clearance.diagnosis.following.attempt import (
    COARSE,
    LOOSENESS,
    TIGHT,
    Attempt,
    explained,
    integrator_at,
    refine,
)
from clearance.diagnosis.following.growth import ISLAND, Start, grow, scale_of
from clearance.diagnosis.following.horizon import TORN
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.follow import EDGE, Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError

_PLACES = 4  # from which a recording that was lost is followed again
_FURTHEST = 3000  # segments from there on to what was held out: each is followed, and costs memory
_BACK = 4  # segments before the end of the fitted stretch, which the end's samples hardly know
_MOST = 0.5  # of what was held out: a stretch that is shorter says too little of a machine
_NOTHING = np.zeros((1, 0))


@dataclass(frozen=True)
class Way:
    """How a recording was followed.

    Attributes:
        follower: with its path.
        row: (1,) speed [rpm].
        misfit: with it.
        share: of what was to be followed; below 1 where the path was lost for the rest.
    """

    follower: Follower
    row: np.ndarray
    misfit: float
    share: float = 1.0


def ways_to_follow(
    trace: Trace, model: Model, row: np.ndarray, patience: int, until: float
) -> Iterator[Callable[[], Way]]:
    """Ways to follow a recording: from where its path is surest, then from other places.

    Near chaos a machine that is right is lost at one impact and not at another.

    Args:
        trace: of the recording.
        model: of the machine, its speed unknown.
        row: (1,) speed to begin with [rpm].
        patience: as of ``Start.of``; without any it is followed once.
        until: as of ``grow``; from then on places are not looked for with patience either.
    """
    held, tried = model.held(row), list[int]()

    def surest() -> Way:
        start = Start.of(trace, held, LOOSENESS, patience if time.monotonic() < until else 0)
        tried.append(start.island)
        return _grown(start, model, row, patience > 0, until)

    @cache
    def others() -> list[Start]:
        several = Start.several(trace, held, LOOSENESS, _PLACES)
        return [start for start in several if start.island not in tried]

    def another(place: int) -> Way | None:
        return _grown(others()[place], model, row, True, until) if place < len(others()) else None

    yield surest
    if patience > 0:
        for place in range(_PLACES):
            yield partial(another, place)  # type: ignore[misc]


def go_on(attempt: Attempt, trace: Trace, model: Model, until: float) -> Way | None:
    """Follow what was held out from where the fitted stretch ends; ``None`` where it is not soon after that.

    Which states are possible when nothing before is known may be lost among many: a shoe that hangs between
    its rails shows nothing of where. Whoever was on the way there knows. A path that was lost on the way and
    found again later is followed over the longest stretch, if that is most of what was held out.

    Args:
        attempt: that explains the fitted stretches.
        trace: of what was held out.
        model: of the attempt's machine, its speed unknown.
        until: as of ``grow``.
    """
    known = _before(attempt, trace.measured)
    if known is None:
        return None
    before, speed = known
    own, end = trace.measured.first, trace.measured.first + trace.length
    whole = _joined(before.measured, end).judged(attempt.sensors)
    follower = Follower(whole, COARSE, TIGHT.copy())
    follower.path.nodes[: before.segments] = before.path.nodes
    start = Start(trace, follower, before.segments - ISLAND - _BACK, 0.0)
    way = _grown(start, model, np.array([speed]), True, until, start.follower.segments)
    skipped = own - way.follower.measured.first
    return _longest(way.follower.part(skipped, way.follower.segments), model, way.row)


def best_of(ways: Iterable[Callable[[], Way | None]], model: Model, until: float) -> Attempt:
    """The first way on which a recording is explained, or the one that leaves least.

    One on which a part alone was followed counts less than any that explains the whole.

    Args:
        ways: to follow one recording; taken one after another. One may lead nowhere, or fail.
        model: of the machine, its speed unknown.
        until: when ``time.monotonic`` says that, another is taken only where none has led anywhere.

    Raises:
        InputError: a law does not take the values on any way.
        LinAlgError: no way is followed at all.
    """
    best: Attempt | None = None
    failed: Exception | None = None
    for way in ways:
        if best is not None and (time.monotonic() > until or _rank(best)[:2] == (False, False)):
            break
        try:
            found = way()
            if found is None:
                continue
            other = refine((), model, [found.follower], found.row[None], scale_of(found.misfit), 8)
        except (InputError, np.linalg.LinAlgError) as error:
            failed = error
            continue
        other.shares = (found.share,) if found.share < 1.0 else ()
        best = other if best is None or _rank(other) < _rank(best) else best
    if best is None:
        assert failed is not None
        raise failed
    return best


def together(each: Sequence[Attempt], workers: int) -> Attempt:
    """Recordings that were followed one by one, each with a speed of its own, as one attempt.

    Where one is explained all are looked at without annealing: what is left of one that was lost is then told
    beside what is left of the others.
    """
    scale = 1.0 if any(explained(one) for one in each) else max(one.scale for one in each)
    followers = [one.followers[0] for one in each]
    for follower in followers:
        follower.integrator = integrator_at(scale)
    values = np.concatenate([one.fit.values for one in each])
    found = fit(followers, each[0].model, values, 0, 1.0, workers, scale=scale)
    shares = tuple(one.shares[0] if one.shares else 1.0 for one in each)
    return Attempt(
        (), each[0].model, found, scale, found.level, followers, shares=shares if min(shares) < 1.0 else ()
    )  # fmt: skip


def _rank(attempt: Attempt) -> tuple[bool, bool, float]:
    """What of two ways is better comes first: explained, of the whole, little left."""
    return not explained(attempt), bool(attempt.shares), attempt.misfit


def _longest(follower: Follower, model: Model, row: np.ndarray) -> Way:
    """The longest stretch on which a path is not lost, if that is most of it; or all of it."""
    held = model.held(row)
    seen = settle([follower], held, _NOTHING, 0)
    several = np.convolve(seen.passes[0].each[EDGE:-EDGE], np.full(ISLAND, 1.0 / ISLAND), "valid")
    lost = np.flatnonzero(~(several < TORN))
    if len(lost) > 0:
        bounds = np.concatenate([[-1], lost, [follower.segments - 2 * EDGE]])
        widest = int(np.argmax(np.diff(bounds)))
        begin, end = EDGE + int(bounds[widest]) + 1, EDGE + int(bounds[widest + 1])
        share = (end - begin) / follower.segments
        if share >= _MOST:
            part = follower.part(begin, end)
            return Way(part, row, settle([part], held, _NOTHING, 0).level, share)
    return Way(follower, row, seen.level)


def _grown(
    start: Start, model: Model, row: np.ndarray, patient: bool, until: float, most: int | None = None
) -> Way:
    found = grow(start, model, row, most=most, patient=patient, until=until)
    assert found is not None  # without a limit none is given up
    return Way(*found)


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
