"""Several recordings at a time."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

Job = TypeVar("Job")
Result = TypeVar("Result")


def side_by_side(
    one: Callable[[Job], Result], jobs: Sequence[Job], workers: int, sizes: Sequence[float] = ()
) -> list[Result]:
    """What ``one`` makes of each job, in their order.

    Args:
        one: compiled for the most part, so that threads run beside each other.
        jobs: that do not depend on each other.
        workers: threads.
        sizes: of the jobs, if these differ: the longest one begins first, lest all wait for it at the end
            (Graham 1969, SIAM J. Appl. Math. 17(2), 416-429).
    """
    if workers == 1 or len(jobs) == 1:
        return [one(job) for job in jobs]
    order = np.argsort(-np.asarray(sizes), kind="stable") if len(sizes) else range(len(jobs))
    with ThreadPoolExecutor(workers) as pool:
        made = dict(zip(order, pool.map(one, [jobs[i] for i in order]), strict=True))
    return [made[i] for i in range(len(jobs))]
