"""Why a run became non-finite: when, in which state, by which law."""

from dataclasses import dataclass

import numpy as np

from clearance.mechanism.load import NoSpring
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Result, State
from clearance.simulation.stability import too_stiff
from clearance.simulation.trajectory import simulate_trajectory

_ABSURD = 1e8  # N or N m: a thousand times the hardest impact of the nominal machine


@dataclass(frozen=True)
class Failure:
    """A run that stopped.

    Attributes:
        time: when the first number ceased to be finite [s].
        law: whose force or which equation it was.
        state: the last finite state, by name.
    """

    time: float
    law: str
    state: dict[str, float]

    def __str__(self) -> str:
        names = ("crank_angle", "crank_speed", "rod_angle", "rod_speed", "slider_x", "slider_x_rate")
        shown = ", ".join(f"{name} = {self.state[name]:.4g}" for name in names)
        return (
            f"the run became non-finite at t = {self.time:.6f} s in {self.law} (last finite state: {shown}); "
            "a shorter integrator.step or more integrator.contact_refinement may help"
        )


def explain_failure(machine: SliderCrank, state: np.ndarray, integrator: Integrator, steps: int) -> Failure:
    """Repeat a failed run from its last finite state and name what failed first.

    Args:
        machine: what ran.
        state: (STATES,) finite.
        integrator: scheme and the steps in use.
        steps: within which it failed.
    """
    with np.errstate(all="ignore"):
        again = simulate_trajectory(machine, integrator, steps * integrator.step, state=state)
    states, results = again.states, again.results
    if again.finite:
        begun = {row.name.lower(): float(state[row]) for row in State}
        return Failure(float(state[State.TIME]), "a law that a second run from there does not show", begun)
    last = int(np.flatnonzero(np.isfinite(states[:, : State.TIME]).all(axis=1))[-1])
    named = {row.name.lower(): float(states[last, row]) for row in State}
    return Failure(float(states[-1, State.TIME]), _guilty_law(machine, integrator, results), named)


def _guilty_law(machine: SliderCrank, integrator: Integrator, results: np.ndarray) -> str:
    """The law whose force was the first to leave all reason; forces grow absurd before they overflow."""
    suspects = (
        (Result.NORMAL_FORCE_B, machine.joint_b.contact, "joint B"),
        (Result.NORMAL_FORCE_C, machine.joint_c.contact, "joint C"),
        (
            Result.LOAD,
            machine.process if isinstance(machine.spring, NoSpring) else machine.spring,
            "the slider",
        ),
        (Result.DRIVE_TORQUE, machine.drive, "the drive"),
        (Result.GUIDE_FRICTION, machine.guide_friction, "the guide"),
    )
    forces = np.nan_to_num(np.abs(results[:, [row for row, _, _ in suspects]]), nan=np.inf)
    absurd = np.flatnonzero((forces > _ABSURD).any(axis=1))
    for joint in too_stiff(machine, integrator.step):
        return f"the film of joint {joint}, too stiff for this step"
    if absurd.size == 0:
        return "the equations of motion"
    _, law, place = suspects[int(np.argmax(forces[absurd[0]]))]
    return f"{type(law).__name__} of {place}"
