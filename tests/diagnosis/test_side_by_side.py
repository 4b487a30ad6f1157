"""Several recordings at a time."""

import threading
import time

import pytest

from clearance.diagnosis.side_by_side import side_by_side


@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("sizes", [(), (1.0, 4.0, 2.0, 3.0)])
def test_results_come_in_the_order_of_the_jobs(workers, sizes):
    def one(job):
        time.sleep(0.01 * (4 - job))
        return 10 * job

    assert side_by_side(one, [0, 1, 2, 3], workers, sizes) == [0, 10, 20, 30]


def test_the_longest_job_begins_first():
    begun = []
    side_by_side(lambda job: (begun.append(job), time.sleep(0.05)), "abcd", 2, (1.0, 3.0, 4.0, 2.0))
    assert set(begun[:2]) == {"b", "c"}
    assert set(begun[2:]) == {"a", "d"}


def test_jobs_run_beside_each_other_and_an_error_is_told():
    together = threading.Barrier(2, timeout=10.0)
    side_by_side(lambda _: together.wait(), range(2), 2)

    def fails(job):
        if job == 1:
            raise ValueError("the second one")

    for workers in (1, 2):
        with pytest.raises(ValueError, match="the second one"):
            side_by_side(fails, range(3), workers)
    assert side_by_side(fails, [], 2, []) == []
