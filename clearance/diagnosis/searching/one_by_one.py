"""Recordings are followed one after the other: the surest first, the others with what it tells."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from clearance.diagnosis.following.attempt import EXPLAINED, FOLLOWED, POOR, Attempt
from clearance.diagnosis.following.growth import Followed, Start, grow
from clearance.diagnosis.searching.beside import enough
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model

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
    rows, shared = values.copy(), model.shared
    for k, first in enumerate(order * insist or order[:1]):
        rows[first, 0] = values[first, 0] * _MORE ** (k // len(order))
        found = grow(starts[first], model, rows[first], limit)
        if found is not None and (base is None or found[2] <= enough(base, first)):
            break
    else:
        return None
    order.remove(first)
    grown = {first: found}
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
            if other is None:
                return None
            grown[r] = other
    for r, each in grown.items():
        rows[r, shared:] = each[1][shared:]
    return [grown[r][0] for r in range(len(starts))], rows, float(np.mean([g[2] for g in grown.values()]))
