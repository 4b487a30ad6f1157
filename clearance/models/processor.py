"""Settings of the processor that cost or save an order of magnitude."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch

log = logging.getLogger(__name__)


@contextmanager
def efficient_processor(threads: int | None = None) -> Iterator[None]:
    """Flush denormals and set the number of threads, for the time of a training or a prediction.

    Backpropagation through 200 steps from the last state alone makes gradients so small that they are
    denormal, which this kind of processor handles in microcode: 10 times slower. They are flushed to zero
    only here, so that a simulation in the same process keeps the arithmetic that its results are defined by.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(threads or min(len(os.sched_getaffinity(0)), _MOST_THREADS))
    flushes = torch.set_flush_denormal(True)
    if flushes and not denormals_flushed():
        log.warning(
            "some threads keep denormal numbers: training a recurrent network may be many times slower"
        )
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
        torch.set_num_threads(before)


def denormals_flushed() -> bool:
    """Whether every thread that shares a large operation flushes denormals."""
    # Large enough that PyTorch divides it among all its threads (32768 elements is its smallest share).
    numbers = torch.full((32768 * 4 * torch.get_num_threads(),), 1e-39)
    return not bool((numbers * 1.0).any())


# Windows and batches are small: more threads wait for one another longer than they work.
_MOST_THREADS = 8
