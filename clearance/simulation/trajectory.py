"""One run with everything kept: states, forces, signals at full rate, and its energy."""

from dataclasses import dataclass

import numpy as np

from clearance.mechanism.parameters import JOINT_STRIDE, PARAMETERS, Family, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import RESULTS, SIGNALS, STATES, Result, State
from clearance.simulation.lockstep import trace


def rest_state(machine: SliderCrank) -> np.ndarray:
    """(STATES,) crank at rest at angle zero, rod aligned with A and C, journals centred."""
    state = np.zeros(STATES)
    rise = machine.guide_offset / machine.rod.length
    angle = np.arcsin(rise)
    arm = machine.rod.center_of_mass * machine.rod.length
    state[State.ROD_ANGLE] = angle
    state[State.ROD_X] = machine.crank.length + arm * np.cos(angle)
    state[State.ROD_Y] = arm * rise
    state[State.SLIDER_X] = machine.crank.length + machine.rod.length * np.cos(angle)
    state[State.SLIDER_Y] = machine.guide_offset
    return state


@dataclass(frozen=True)
class Trajectory:
    """A run at full rate.

    Attributes:
        machine: what ran.
        states: (samples, STATES).
        results: (samples, RESULTS), accelerations and forces.
        signals: (samples, SIGNALS), unfiltered.
        finite: whether the run reached its end with finite numbers; if not, the last sample holds the first
            number that is not.
    """

    machine: SliderCrank
    states: np.ndarray
    results: np.ndarray
    signals: np.ndarray
    finite: bool

    @property
    def time(self) -> np.ndarray:
        """(samples,) [s]."""
        return self.states[:, State.TIME]

    def kinetic_energy(self) -> np.ndarray:
        """(samples,) of all bodies [J]; the rod's bending is not counted."""
        p, s = self.machine.parameters(), self.states
        crank = s[:, State.CRANK_SPEED] ** 2 / p[Parameter.CRANK_INVERSE_INERTIA]
        rod = p[Parameter.ROD_MASS] * (s[:, State.ROD_X_RATE] ** 2 + s[:, State.ROD_Y_RATE] ** 2)
        rod = rod + s[:, State.ROD_SPEED] ** 2 / p[Parameter.ROD_INVERSE_INERTIA]
        slider = self.machine.slider.mass * (s[:, State.SLIDER_X_RATE] ** 2 + s[:, State.SLIDER_Y_RATE] ** 2)
        slider = slider + self.machine.slider.inertia * s[:, State.SLIDER_SPEED] ** 2
        return 0.5 * (crank + rod + slider)

    def contact_energy(self) -> np.ndarray:
        """(samples,) stored in the contacts, 2/5 K d^2.5 [J]."""
        p = self.machine.parameters()
        energy = np.zeros(len(self.states))
        for block, row in ((0, Result.PENETRATION_B), (JOINT_STRIDE, Result.PENETRATION_C)):
            depth = np.maximum(self.results[:, row], 0.0)
            energy += 0.4 * p[Parameter.JOINT_STIFFNESS + block] * depth**2.5
        return energy

    def contact_loss_power(self) -> np.ndarray:
        """(samples,) dissipated by the contacts' hysteresis [W]."""
        p = self.machine.parameters()
        power = np.zeros(len(self.states))
        for block, first in ((0, Result.PENETRATION_B), (JOINT_STRIDE, Result.PENETRATION_C)):
            depth = np.maximum(self.results[:, first], 0.0)
            elastic = p[Parameter.JOINT_STIFFNESS + block] * depth**1.5
            power += (self.results[:, first + 2] - elastic) * self.results[:, first + 1]
        return power

    def drive_power(self) -> np.ndarray:
        """(samples,) of the drive's torque [W]."""
        return self.results[:, Result.DRIVE_TORQUE] * self.states[:, State.CRANK_SPEED]


def simulate_trajectory(
    machine: SliderCrank,
    integrator: Integrator,
    duration: float,
    every: int = 1,
    state: np.ndarray | None = None,
) -> Trajectory:
    """Simulate one run and keep every ``every``-th step.

    Args:
        machine: what runs.
        integrator: scheme and steps.
        duration: [s].
        every: steps from one kept sample to the next.
        state: (STATES,) start; at rest at outer dead centre if ``None``.
    """
    samples = round(duration / integrator.step / every)
    states, results = np.zeros((samples, STATES)), np.zeros((samples, RESULTS))
    signals = np.zeros((samples, SIGNALS))
    start = rest_state(machine) if state is None else np.array(state, dtype=float)
    parameters = machine.parameters()
    assert parameters.shape == (PARAMETERS,)
    done = trace(
        machine.codes(),
        parameters,
        start,
        integrator.code,
        integrator.step,
        integrator.contact_refinement,
        every,
        states,
        results,
        signals,
    )
    finite = bool(np.isfinite(states[done - 1, : State.TIME]).all() and np.isfinite(results[done - 1]).all())
    return Trajectory(machine, states[:done], results[:done], signals[:done], finite)


def contact_state(trajectory: Trajectory, family: Family) -> np.ndarray:
    """(samples,) whether a loose joint touches; ``family`` is ``JOINT_B`` or ``JOINT_C``."""
    row = Result.PENETRATION_B if family == Family.JOINT_B else Result.PENETRATION_C
    return trajectory.results[:, row] > 0.0
