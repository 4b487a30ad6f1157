"""What CUDA's compiler makes of the kernel, without a GPU: ``python -m tests.simulation.gpu_compilation``
prints PTX."""

import sys
from types import SimpleNamespace

import numpy as np
from numba import cuda, typeof, types
from numba.cuda import dispatcher

from clearance.recording.chain import MeasurementChain
from clearance.simulation.batch import Sampling, loop_arguments
from clearance.simulation.gpu.kernel import make_kernel
from clearance.simulation.integrator import Integrator
from tests.simulation.gpu_cases import MACHINES

ARCHITECTURE = (9, 0)


def ptx(machine, integrator):
    """For one machine's laws, with the arguments of the paper's measurement chain."""
    chain = MeasurementChain()
    matrix, cube = types.float64[:, ::1], types.float64[:, :, ::1]
    shared = loop_arguments(integrator, Sampling(chain.base_rate, chain.filter(), 2.0, 1.0), set())
    arguments = [types.float64 if isinstance(one, np.floating) else typeof(one) for one in shared]
    kernel = make_kernel(tuple(int(code) for code in machine.codes()), integrator.code)
    signature = types.void(types.int64, matrix, matrix, matrix, matrix, *arguments, cube)
    return cuda.compile_ptx(kernel.py_func, signature, device=False, cc=ARCHITECTURE)[0]


if __name__ == "__main__":
    # Numba asks the GPU at hand what functions that a kernel calls are compiled for.
    dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=ARCHITECTURE)
    sys.stdout.write(ptx(MACHINES[0], Integrator()))
