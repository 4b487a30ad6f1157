"""Settings of the processor that cost or save an order of magnitude."""

import ctypes
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
    _keep_freed_memory()
    before = torch.get_num_threads()
    torch.set_num_threads(used_threads(threads))
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


def used_threads(asked: int | None) -> int:
    """As many threads as were asked for; otherwise all that this process may use, up to some."""
    return asked or min(len(os.sched_getaffinity(0)), _MOST_THREADS)


def _keep_freed_memory() -> None:
    """Let the C library keep what it frees, where it is glibc, instead of asking the kernel for it again.

    A step of the paper's LSTM frees and takes 470 MB in pieces large enough to go back to the kernel: 115 000
    page faults. Measured on two virtual cores, with and without them: 665 and 335 ms a step on one thread,
    6964 and 208 ms on two, which wait for each other in the kernel.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):  # another C library: nothing to set
        return
    mallopt(_MMAP_THRESHOLD, 2**30)
    mallopt(_TRIM_THRESHOLD, 2**31 - 1)


_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h


def denormals_flushed() -> bool:
    """Whether every thread that shares a large operation flushes denormals."""
    # Large enough that PyTorch divides it among all its threads (32768 elements is its smallest share).
    numbers = torch.full((32768 * 4 * torch.get_num_threads(),), 1e-39)
    return not bool((numbers * 1.0).any())


# Windows and batches are small: more threads wait for one another longer than they work.
_MOST_THREADS = 8
