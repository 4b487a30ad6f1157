"""One run: where it starts, `simulate`, and its samples by name."""

import math
from dataclasses import dataclass, field

import numpy as np

from clearance.errors import InputError
from clearance.simulation.natural_coordinates.links import ROD_B_X, ROD_B_Y, ROD_C_X, ROD_C_Y, SLIDER_X
from clearance.simulation.natural_coordinates.motion import SAMPLE, integrate
from clearance.simulation.natural_coordinates.parameters import NaturalParameters, require
from clearance.simulation.natural_coordinates.positions import natural_positions
from clearance.simulation.natural_coordinates.velocities import independent_rows, velocity_transformation


@dataclass(frozen=True)
class NaturalState:
    """Where a run starts.

    Attributes:
        coordinates: (dof,) z = the first of crank angle [rad], rod angle [rad], slider position [m],
            x and y of B on the rod [m].
        speeds: (dof,) time derivatives of the coordinates.
        drive_integral: integral of the speed error [rad].
        approach_speeds: memory of the contacts at B and C [m/s], 0 where the bodies are apart.
    """

    coordinates: np.ndarray
    speeds: np.ndarray
    drive_integral: float = 0.0
    approach_speeds: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class NaturalTrajectory:
    """Samples of one run; every quantity of a row belongs to the same instant.

    Attributes:
        time: (samples,) [s].
        crank_angle: (samples,) unwrapped [rad].
        crank_speed: (samples,) [rad/s].
        rod_angle: (samples,) from the x axis to B-C [rad].
        rod_speed: (samples,) [rad/s].
        slider_position: (samples,) x of the slider from A [m].
        slider_velocity: (samples,) [m/s].
        accelerations: (samples, 10) proper accelerations in body axes, in the order of `CHANNELS` [m/s²].
        contact_force: (samples, 2) normal force at B and C [N], 0 at an ideal joint.
        penetration: (samples, 2) δ = |e| - c at B and C [m], negative in flight, 0 at an ideal joint.
        approach_speed: (samples, 2) speed at first touch at B and C [m/s], 0 in flight.
        drive_torque: (samples,) [N m].
        end: state after the last step, one step beyond the last row where every step is sampled.
    """

    time: np.ndarray
    crank_angle: np.ndarray
    crank_speed: np.ndarray
    rod_angle: np.ndarray
    rod_speed: np.ndarray
    slider_position: np.ndarray
    slider_velocity: np.ndarray
    accelerations: np.ndarray
    contact_force: np.ndarray
    penetration: np.ndarray
    approach_speed: np.ndarray
    drive_torque: np.ndarray
    end: NaturalState = field(repr=False)


def start_at(
    parameters: NaturalParameters, crank_angle: float = 0.0, crank_speed: float = 0.0
) -> NaturalState:
    """State with centred journals that move with their bearings, as in the ideal mechanism.

    Args:
        parameters: the mechanism.
        crank_angle: [rad].
        crank_speed: [rad/s].
    """
    ideal = parameters.constants._replace(open_b=False, open_c=False)
    q = natural_positions(np.array([crank_angle]), ideal)
    transformation, _ = velocity_transformation(q, np.array([crank_speed]), ideal)
    q_dot = transformation[:, 0] * crank_speed
    rod_angle = math.atan2(q[ROD_C_Y] - q[ROD_B_Y], q[ROD_C_X] - q[ROD_B_X])
    coordinates = np.array([crank_angle, rod_angle, q[SLIDER_X], q[ROD_B_X], q[ROD_B_Y]])
    speeds = independent_rows(q, ideal) @ q_dot
    count = parameters.degrees_of_freedom
    return NaturalState(coordinates[:count], speeds[:count])


def simulate(
    parameters: NaturalParameters,
    step: float,
    duration: float,
    sample_every: int = 1,
    start: NaturalState | None = None,
) -> NaturalTrajectory:
    """Integrate one run with the semi-implicit Euler formula, equations (7)-(8).

    At step n the forces belong to (z_n, z'_n, drive integral at n, t_n = n h), after the contact memory has
    been brought up to date. Then z'_{n+1} = z'_n + h z''_n, z_{n+1} = z_n + h z'_{n+1}, and the drive
    integral grows by h (ω_ref(t_n) - ω_n). A stored row holds the values at t_n.

    Args:
        parameters: the mechanism, its contacts and its drive.
        step: h [s].
        duration: simulated time [s], rounded to whole steps.
        sample_every: store steps 0, k, 2k, ... (k = `sample_every`), the state after the last step excluded.
        start: where to start; at rest, crank angle 0 and journals centred when left out. Time starts at 0.

    Raises:
        InputError: a step, duration, sampling or start that cannot be used.
        FloatingPointError: the motion became non-finite.
    """
    require("step", step, "> 0 s", 0.0 < step < math.inf)
    require("duration", duration, ">= one step", step <= duration < math.inf)
    require("sample_every", sample_every, ">= 1", sample_every >= 1)
    start = start_at(parameters) if start is None else start
    z, z_dot = (np.array(values, dtype=float) for values in (start.coordinates, start.speeds))
    expected = (parameters.degrees_of_freedom,)
    if z.shape != expected or z_dot.shape != expected:
        raise InputError(f"start has shapes {z.shape} and {z_dot.shape}: must be {expected}")

    steps = round(duration / step)
    samples = (steps - 1) // sample_every + 1
    stored = np.zeros(samples, SAMPLE)
    memory = np.array(start.approach_speeds, dtype=float)
    failed, drive_integral = integrate(
        parameters.constants,
        parameters.mass_matrix,
        z,
        z_dot,
        float(start.drive_integral),
        memory,
        step,
        steps,
        sample_every,
        stored,
    )
    if failed >= 0:
        raise FloatingPointError(
            f"non-finite force or motion at t = {failed * step:.9g} s, z = {z.tolist()}, "
            f"z' = {z_dot.tolist()}; step {step} s, hysteresis factor {parameters.hysteresis_factor}"
        )
    end = NaturalState(z, z_dot, drive_integral, (memory[0], memory[1]))
    return NaturalTrajectory(**{name: stored[name] for name in SAMPLE.fields or ()}, end=end)
