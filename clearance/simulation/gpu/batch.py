"""Many runs on a GPU, one a thread, as many at a time as its memory holds."""

import logging
import os
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from importlib.util import find_spec

import numpy as np

from clearance.errors import InputError
from clearance.mechanism.parameters import PARAMETERS
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import (
    Sampling,
    Sink,
    by_laws,
    hand_over,
    loop_arguments,
    require_sample,
    scratch_rows,
    silent_signals,
)
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import SIGNALS, STATES
from clearance.simulation.trajectory import rest_state

_THREADS = 64  # of a block: small, so that the last blocks leave little of the GPU idle
_MOST = 1 << 18  # runs at a time, more than a GPU holds threads
_SHARE = 0.8  # of the free memory; the driver needs some for what spills from registers
_AT_HOST = 64  # runs that are copied to the host at a time


def require_gpu(
    asked: str = "device = cuda", instead: str = "change the key that ends in 'device' to cpu"
) -> None:
    """Check that simulations can run on a GPU here.

    Args:
        asked: the key and value that ask for one.
        instead: what else could be done.

    Raises:
        InputError: if a package or the GPU is missing.
    """
    simulated = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"  # by Numba itself, for tests: Python for a GPU
    if not simulated and find_spec("numba_cuda") is None:
        raise InputError(
            f"{asked} needs numba-cuda, which is not installed: pip install '.[cuda]', or {instead}"
        )
    from numba import cuda

    # Hydra shows INFO, by which Numba's driver says each piece of memory that it takes and frees.
    logging.getLogger("numba").setLevel(logging.WARNING)
    if not cuda.is_available():
        raise InputError(
            f"{asked} needs an NVIDIA GPU with its driver, and CUDA's compiler, which comes with "
            f"pip install '.[cuda]'; one of them was not found: {instead}"
        )


def run_batch_on_gpu(
    machines: Sequence[SliderCrank],
    integrator: Integrator,
    sampling: Sampling,
    sink: Sink,
    workers: int | None = None,
    states: np.ndarray | None = None,
) -> None:
    """As ``run_batch``, on the first GPU: a run's signals differ by rounding, and what chaos makes of it.

    Args:
        machines: one a run.
        integrator: scheme and steps.
        sampling: which samples are wanted.
        sink: called from the worker threads, after many runs have ended together.
        workers: threads that call ``sink``; all cores if ``None``.
        states: (runs, STATES) start states; at rest at outer dead centre if ``None``.

    Raises:
        InputError: if there is no GPU, or too little memory on it for one run.
    """
    require_sample(sampling)
    require_gpu()
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        for codes, alike in by_laws(machines).items():
            _run_alike(codes, alike, machines, integrator, sampling, sink, pool, states)


def _run_alike(
    codes: tuple[int, ...],
    alike: list[int],
    machines: Sequence[SliderCrank],
    integrator: Integrator,
    sampling: Sampling,
    sink: Sink,
    pool: ThreadPoolExecutor,
    states: np.ndarray | None,
) -> None:
    """Run machines of the same laws."""
    from numba import cuda
    from numba.cuda.cudadrv.driver import device_memset

    from clearance.simulation.gpu.kernel import make_kernel

    parameters = np.stack([machines[run].parameters() for run in alike], axis=1)
    silent = silent_signals(codes, parameters)
    rows = scratch_rows(sampling, silent)
    size = min(len(alike), _runs_at_a_time(rows, sampling.samples))
    kernel = make_kernel(codes, integrator.code)
    arguments = [
        cuda.to_device(one) if isinstance(one, np.ndarray) else one
        for one in loop_arguments(integrator, sampling, silent)
    ]
    saved, work = cuda.device_array((STATES, size)), cuda.device_array((rows, size))
    out = cuda.device_array((size, sampling.samples, SIGNALS))
    device_memset(out, 0, out.nbytes)  # the kernel leaves silent signals out
    # Memory that the GPU reaches by itself, used again and again: a fresh page costs more than its transfer.
    host = [cuda.pinned_array((min(size, _AT_HOST), sampling.samples, SIGNALS)) for _ in range(2)]
    when = (integrator, sampling)
    for begin in range(0, len(alike), size):
        runs = alike[begin : begin + size]
        p, s = np.zeros((PARAMETERS, size)), np.zeros((STATES, size))
        p[:, : len(runs)] = parameters[:, begin : begin + size]
        for column, run in enumerate(runs):
            s[:, column] = rest_state(machines[run]) if states is None else states[run]
        blocks = -(-len(runs) // _THREADS)
        kernel[blocks, _THREADS](
            len(runs), cuda.to_device(p), cuda.to_device(s), saved, work, *arguments, out
        )
        last = saved.copy_to_host()
        given: list[Future[None]] = []
        for there in range(0, len(runs), _AT_HOST):
            signals, ahead = host[0][: min(_AT_HOST, len(runs) - there)], given
            out[there : there + len(signals)].copy_to_host(signals)
            given = [
                pool.submit(hand_over, sink, run, machines[run], signals[i], last[:, there + i].copy(), *when)
                for i, run in enumerate(runs[there : there + len(signals)])
            ]
            for future in ahead:  # while the other memory was filled
                future.result()
            host.reverse()
        for future in given:
            future.result()


def _runs_at_a_time(rows: int, samples: int) -> int:
    """How many runs the GPU's free memory holds."""
    from numba import cuda

    each = 8 * (PARAMETERS + 2 * STATES + rows + samples * SIGNALS)
    free = cuda.current_context().get_memory_info().free
    if each > _SHARE * free:
        raise InputError(
            f"device = cuda: a run needs {each / 2**20:.0f} MiB on the GPU, and {free / 2**20:.0f} MiB are "
            "free; shorten the recording, or change device to cpu"
        )
    return min(_MOST, int(min(_SHARE * free, 1e15)) // each)
