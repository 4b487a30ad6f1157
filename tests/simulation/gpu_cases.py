"""Short simulations in which much happens, for any simulator: ``python -m tests.simulation.gpu_cases FILE``
runs them by the GPU's."""

import sys
from dataclasses import replace

import numpy as np

from clearance.mechanism.contact import Flores
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.film import SqueezeFilm
from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.friction import Coulomb
from clearance.mechanism.guide import LooseGuide, StribeckGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import Sampling
from clearance.simulation.decimation import Decimation
from clearance.simulation.failure import Failure
from clearance.simulation.gpu.batch import run_batch_on_gpu
from clearance.simulation.integrator import Integrator
from clearance.simulation.trajectory import turning_state

SAMPLING = Sampling(1e5, Decimation.chebyshev(2, 2, 0.05, 0.8), 0.0, 5e-4)
DRIVE = SpeedControl(600.0, ramp=0.0)
TIGHT = Joint(2e-6, contact=Flores(0.8))  # touches within half a millisecond
EULER = Integrator()
MACHINES = (
    SliderCrank(joint_c=TIGHT, drive=DRIVE),
    SliderCrank(
        joint_b=replace(TIGHT, friction=Coulomb(0.1), film=SqueezeFilm(5.0)),
        guide=LooseGuide(gap=1e-7),
        frame=FlexibleFrame(),
        drive=DRIVE,
    ),
    SliderCrank(drive=DRIVE, guide_friction=StribeckGuide(2.0, 1.0, 1.0, friction_coefficient=0.1)),
    replace(SliderCrank(joint_c=TIGHT, drive=DRIVE), gravity=(0.0, -9.81)),
)
STATES = np.array([turning_state(machine, 4.0, 60.0) for machine in MACHINES])
CASES = {
    "euler": (MACHINES, STATES, EULER),
    "runge_kutta": (MACHINES[:1], STATES[:1], Integrator("runge_kutta_4", 1e-5, 2)),
    "not_finite": (MACHINES[:1], turning_state(MACHINES[0], 4.0, 1e200)[None], EULER),
}


def simulate_cases(batch, names=tuple(CASES), **options):
    """Signals of each run of each case, (samples, SIGNALS), or what its failure says."""
    found = {}
    for name in names:
        machines, states, integrator = CASES[name]

        def keep(run, outcome, name=name):
            failed = isinstance(outcome, Failure)
            found[f"{name} {run}"] = np.array(str(outcome)) if failed else outcome.copy()

        batch(machines, integrator, SAMPLING, keep, 1, states, **options)
    return found


if __name__ == "__main__":
    np.savez(sys.argv[1], **simulate_cases(run_batch_on_gpu))
