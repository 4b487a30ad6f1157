"""The CUDA kernel: ``lockstep.run_lanes`` in every thread, with one lane."""

from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from clearance.simulation.gpu.thread import of_thread
from clearance.simulation.gpu.translation import translate
from clearance.simulation.integrator import WORKSPACE
from clearance.simulation.layout import STATES, Result
from clearance.simulation.lockstep import run_lanes

_STATE, _RESULT, _STAGES = (STATES, 1), (int(Result.FORCE_B_X), 1), (WORKSPACE, 1)


@cache
def make_kernel(codes: tuple[int, ...], scheme: int) -> Any:
    """The kernel for one choice of laws and one scheme, both constants in it; compiled where it is first run.

    What a step reads and writes again and again is the thread's own memory: registers where there are enough.

    Args:
        codes: (families,) chosen laws.
        scheme: a ``Scheme``.
    """
    run = translate(run_lanes, of_thread(codes))

    def simulate_runs(
        runs: int,
        p: Any,
        s: Any,
        saved: Any,
        work: Any,
        h: float,
        substeps: int,
        refinement: int,
        skipped: int,
        first: int,
        samples: int,
        filtered: Any,
        points: Any,
        weights: Any,
        decay: Any,
        residues: Any,
        rest: Any,
        direct: float,
        chunk: int,
        out: Any,
    ) -> None:
        """As ``run_lanes``; the first ``runs`` columns of ``p``, ``s``, ``saved`` and ``work`` run."""
        thread: int = cuda.grid(1)
        if thread < runs:
            state = cuda.local.array(_STATE, np.float64)
            for i in range(STATES):
                state[i, 0] = s[i, thread]
            run(
                0,
                p[:, thread : thread + 1],
                state,
                saved[:, thread : thread + 1],
                cuda.local.array(_RESULT, np.float64),
                cuda.local.array(_STAGES, np.float64),
                work[:, thread : thread + 1],
                scheme,
                h,
                substeps,
                refinement,
                skipped,
                first,
                samples,
                filtered,
                points,
                weights,
                decay,
                residues,
                rest,
                direct,
                chunk,
                out[thread : thread + 1],
            )

    return cuda.jit(simulate_runs)
