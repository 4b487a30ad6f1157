"""One run with everything kept: states, forces, signals at full rate, and its energy."""

from dataclasses import dataclass

import numpy as np

from clearance.mechanism.frame import FlexibleFrame
from clearance.mechanism.guide import LooseGuide
from clearance.mechanism.parameters import JOINT_STRIDE, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import RESULTS, SIGNALS, STATES, Result, State
from clearance.simulation.lockstep import trace


def rest_state(machine: SliderCrank) -> np.ndarray:
    """(STATES,) crank at rest at angle zero, rod aligned with A and C, journals centred."""
    return turning_state(machine, 0.0, 0.0)


def turning_state(machine: SliderCrank, angle: float, speed: float) -> np.ndarray:
    """(STATES,) of a machine whose journals are centred, from its crank's angle [rad] and speed [rad/s]."""
    state = np.zeros(STATES)
    crank, length = machine.crank.length, machine.rod.length
    sine, cosine = np.sin(angle), np.cos(angle)
    rise = (machine.guide_offset - crank * sine) / length
    run = np.sqrt(1.0 - rise * rise)
    turn = -crank * cosine * speed / (length * run)
    arm = machine.rod.center_of_mass * length
    state[State.CRANK_ANGLE], state[State.CRANK_SPEED] = angle, speed
    state[State.ROD_ANGLE], state[State.ROD_SPEED] = np.arcsin(rise), turn
    state[State.ROD_X], state[State.ROD_Y] = crank * cosine + arm * run, crank * sine + arm * rise
    state[State.ROD_X_RATE] = -crank * sine * speed - arm * rise * turn
    state[State.ROD_Y_RATE] = crank * cosine * speed + arm * run * turn
    state[State.SLIDER_X] = crank * cosine + length * run
    state[State.SLIDER_X_RATE] = -crank * sine * speed - length * rise * turn
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
        finite: whether the run reached its end with finite numbers; if not, its samples end where the first
            number that is not came about, which none of them needs to hold.
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
        """(samples,) of all bodies [J]; the rod's rotation is counted as if it were straight."""
        machine, p, s = self.machine, self.machine.parameters(), self.states
        frame_x, frame_y = s[:, State.FRAME_X_RATE], s[:, State.FRAME_Y_RATE]
        crank_speed, rod_speed = s[:, State.CRANK_SPEED], s[:, State.ROD_SPEED]
        across = s[:, State.CRANK_COSINE] * frame_y - s[:, State.CRANK_SINE] * frame_x
        energy = 0.5 * crank_speed**2 / p[Parameter.CRANK_INVERSE_INERTIA]
        energy += p[Parameter.CRANK_MOMENT] * crank_speed * across
        if isinstance(machine.frame, FlexibleFrame):
            energy += 0.5 * (machine.frame.mass + machine.crank.mass) * (frame_x**2 + frame_y**2)
        rod_x, rod_y = s[:, State.ROD_X_RATE], s[:, State.ROD_Y_RATE]
        energy += 0.5 * machine.rod.mass * (rod_x**2 + rod_y**2) + 0.5 * machine.rod.inertia * rod_speed**2
        across = s[:, State.ROD_COSINE] * rod_y - s[:, State.ROD_SINE] * rod_x
        bending = s[:, State.ROD_MODE_RATE]
        coupling = p[Parameter.ROD_MODE_COUPLING]
        energy += machine.rod.mass * bending * (0.25 * bending + coupling * across)
        slider = machine.slider
        energy += 0.5 * slider.mass * (s[:, State.SLIDER_X_RATE] ** 2 + s[:, State.SLIDER_Y_RATE] ** 2)
        return energy + 0.5 * slider.inertia * s[:, State.SLIDER_SPEED] ** 2

    def stored_energy(self) -> np.ndarray:
        """(samples,) in contacts (2/5 K d^2.5), springs, bending, and height [J]."""
        machine, p, s = self.machine, self.machine.parameters(), self.states
        energy = np.zeros(len(s))
        for block, row in ((0, Result.PENETRATION_B), (JOINT_STRIDE, Result.PENETRATION_C)):
            depth = np.maximum(self.results[:, row], 0.0)
            energy += 0.4 * p[Parameter.JOINT_STIFFNESS + block] * depth**2.5
        stretch = s[:, State.SLIDER_X] - s[:, State.FRAME_X] - p[Parameter.SPRING_FREE]
        energy += 0.5 * p[Parameter.SPRING_STIFFNESS] * stretch**2
        frame_x, frame_y = s[:, State.FRAME_X], s[:, State.FRAME_Y]
        energy += 0.5 * p[Parameter.FRAME_STIFFNESS] * (frame_x**2 + frame_y**2)
        if isinstance(machine.guide, LooseGuide):
            height = s[:, State.SLIDER_Y] - frame_y - machine.guide_offset
            tilt = machine.guide.shoe_half_length * np.sin(s[:, State.SLIDER_ANGLE])
            for end in (height + tilt, height - tilt):
                depth = np.maximum(np.abs(end) - machine.guide.gap, 0.0)
                energy += 0.5 * machine.guide.stiffness * depth**2
        energy += 0.25 * machine.rod.mass * p[Parameter.ROD_MODE_STIFFNESS] * s[:, State.ROD_MODE] ** 2
        arm = p[Parameter.CRANK_MOMENT]
        moment_x = machine.crank.mass * frame_x + arm * s[:, State.CRANK_COSINE]
        moment_y = machine.crank.mass * frame_y + arm * s[:, State.CRANK_SINE]
        bent = machine.rod.mass * p[Parameter.ROD_MODE_COUPLING] * s[:, State.ROD_MODE]
        moment_x += machine.rod.mass * s[:, State.ROD_X] - bent * s[:, State.ROD_SINE]
        moment_y += machine.rod.mass * s[:, State.ROD_Y] + bent * s[:, State.ROD_COSINE]
        moment_x += machine.slider.mass * s[:, State.SLIDER_X]
        moment_y += machine.slider.mass * s[:, State.SLIDER_Y]
        return energy - machine.gravity[0] * moment_x - machine.gravity[1] * moment_y

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
    done = trace(
        machine.codes(),
        machine.parameters(),
        start,
        integrator.code,
        integrator.step,
        integrator.contact_refinement,
        every,
        states,
        results,
        signals,
    )
    # what stopped it is the state after the last one that is kept
    finite = done == samples and bool(
        np.isfinite(states[-1, : State.TIME]).all() and np.isfinite(results[-1]).all()
    )
    return Trajectory(machine, states[:done], results[:done], signals[:done], finite)
