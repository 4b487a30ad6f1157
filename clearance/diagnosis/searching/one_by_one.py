"""Recordings are followed one after the other: the surest first, the others with what it tells."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from clearance.diagnosis.following.attempt import EXPLAINED, FOLLOWED, POOR, Attempt
from clearance.diagnosis.following.growth import Followed, Start, grow
from clearance.diagnosis.searching.beside import enough
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.side_by_side import side_by_side

_LOST = 2.0  # of what is left of the recording that is followed best: one that leaves more is sought anew
_MORE = 1.01  # times the clearance: enough to meet impacts otherwise


def follow_all(
    starts: Sequence[Start],
    model: Model,
    values: np.ndarray,
    seek: Callable[[int, np.ndarray], Iterable[Start]],
    workers: int,
    limit: float = np.inf,
    base: Attempt | None = None,
    insist: int = 0,
) -> tuple[list[Follower], np.ndarray, float] | None:
    """Follow each recording; one that is explained, as ``base`` does not, makes others worth being sought.

    Args:
        starts: where the recordings are followed from.
        model: with which.
        values: (recordings, unknowns) to begin with.
        seek: where a recording that is lost may be followed from, the likeliest first, by a machine of values
            that another one told, (unknowns,).
        workers: threads.
        limit: as of ``Search.grown``, like the following.
        base: an attempt that the first one must be followed clearly better with than it is.
        insist: times that each recording may be the first one.

    Returns:
        Followers, (recordings, unknowns) values, and the mean misfit; ``None`` where one is given up.
    """
    order = [int(r) for r in np.argsort([start.doubt for start in starts])]
    rows, shared, lost = values.copy(), model.shared, dict[int, Followed]()
    if shared == 1 and base is None and max(start.doubt for start in starts) < FOLLOWED:
        grown = _alone(starts, model, values, workers, limit)
        first = min(grown, key=lambda r: grown[r][2], default=0)
    else:
        first, grown = _leader(starts, model, values, order * insist or order[:1], limit, base)
    if not grown:
        return None
    found = grown[first]
    lost = {r: grown.pop(r) for r in order if r in grown and grown[r][2] >= max(FOLLOWED, _LOST * found[2])}
    order = [r for r in order if r not in grown]
    rows[:, :shared] = found[1][:shared]
    # what one recording tells of the machine holds for the others, if it followed
    kept = list(range(shared if found[2] < FOLLOWED else 0, rows.shape[1]))
    told = base is not None and found[2] < EXPLAINED <= base.misfits[first]

    def followed(start: Start, row: np.ndarray) -> Followed | None:
        other = grow(start, model.only(kept, row), row[kept], limit)
        return None if other is None else (other[0], np.append(row[: kept[0]], other[1]), other[2])

    def one(r: int) -> Followed | None:
        best = followed(starts[r], rows[r])
        if not told or (best is not None and best[2] <= POOR):
            return best
        for way, start in zip((followed, freely, freely, freely), seek(r, rows[r]), strict=False):
            other = way(start, np.append(rows[r, :-1], start.trace.speed))
            ways = [one for one in (best, other) if one is not None]
            best = min(ways, key=lambda one: one[2], default=None)
            if best is not None and best[2] <= POOR:
                break
        return best

    def freely(start: Start, row: np.ndarray) -> Followed | None:
        """What one recording tells by much noise may be off by as much as loses another one."""
        return grow(start, model, row, limit)

    order.sort(key=lambda r: -starts[r].trace.length)  # lest all wait for a long one at the end
    with ThreadPoolExecutor(workers) as pool:
        for r, other in zip(order, pool.map(one, order), strict=True):
            if other is None and r not in lost:
                return None
            grown[r] = min(filter(None, (other, lost.get(r))), key=lambda one: one[2])
    for r, each in grown.items():
        rows[r, shared:] = each[1][shared:]
    return [grown[r][0] for r in range(len(starts))], rows, float(np.mean([g[2] for g in grown.values()]))


def _alone(
    starts: Sequence[Start], model: Model, values: np.ndarray, workers: int, limit: float
) -> dict[int, Followed]:
    """All recordings at a time: where all have come to be followed each tells a clearance by itself.

    None where one is given up.
    """
    lengths = [start.trace.length for start in starts]
    each = side_by_side(
        lambda r: grow(starts[r], model, values[r], limit), range(len(starts)), workers, lengths
    )
    followed = {r: one for r, one in enumerate(each) if one is not None}
    return followed if len(followed) == len(starts) else {}


def _leader(
    starts: Sequence[Start],
    model: Model,
    values: np.ndarray,
    order: Sequence[int],
    limit: float,
    base: Attempt | None,
) -> tuple[int, dict[int, Followed]]:
    """The first recording in an order that is followed clearly better than by ``base``, if one is."""
    for k, first in enumerate(order):
        row = values[first].copy()
        row[0] *= _MORE ** (k // len(starts))
        found = grow(starts[first], model, row, limit)
        if found is not None and (base is None or found[2] <= enough(base, first)):
            return first, {first: found}
    return 0, {}
