"""The motion: accelerations from equation (6), and the semi-implicit Euler formula of equations (7)-(8)."""

import math

import numpy as np

from clearance.compilation import entry
from clearance.simulation.natural_coordinates.forces import applied_forces, contacts, reference_speed_at
from clearance.simulation.natural_coordinates.links import (
    ROD_B_X,
    ROD_B_Y,
    ROD_C_X,
    ROD_C_Y,
    SLIDER_X,
)
from clearance.simulation.natural_coordinates.parameters import Constants
from clearance.simulation.natural_coordinates.positions import natural_positions
from clearance.simulation.natural_coordinates.sensors import CHANNELS, accelerometers
from clearance.simulation.natural_coordinates.velocities import velocity_transformation

# What a run stores at an instant; named and explained by `NaturalTrajectory`.
SAMPLE = np.dtype(
    [
        ("time", float),
        ("crank_angle", float),
        ("crank_speed", float),
        ("rod_angle", float),
        ("rod_speed", float),
        ("slider_position", float),
        ("slider_velocity", float),
        ("accelerations", float, len(CHANNELS)),
        ("contact_force", float, 2),
        ("penetration", float, 2),
        ("approach_speed", float, 2),
        ("drive_torque", float),
    ]
)


@entry
def independent_accelerations(
    mass_matrix: np.ndarray, transformation: np.ndarray, convective: np.ndarray, force: np.ndarray
) -> np.ndarray:
    """Equation (6) with its transpose: R^T M R z'' = R^T (Q - M R' z').

    Args:
        mass_matrix: M (8, 8) [kg].
        transformation: R (8, dof).
        convective: R' z' (8,) [m/s²].
        force: Q (8,) [N].

    Returns:
        (dof,) z''.
    """
    reduced_mass = transformation.T @ (mass_matrix @ transformation)
    reduced_force = transformation.T @ (force - mass_matrix @ convective)
    return np.linalg.solve(reduced_mass, reduced_force)


@entry
def integrate(
    constants: Constants,
    mass_matrix: np.ndarray,
    z: np.ndarray,
    z_dot: np.ndarray,
    drive_integral: float,
    memory: np.ndarray,
    step: float,
    steps: int,
    sample_every: int,
    samples: np.ndarray,
) -> tuple[int, float]:
    """Equations (7)-(8) on z; `z`, `z_dot` and `memory` are advanced in place, `samples` filled.

    Returns:
        The step at which a force or the motion was not finite, or -1; and the drive integral at the end.
    """
    p = constants
    for n in range(steps):
        time = n * step
        q = natural_positions(z, p)
        transformation, convective = velocity_transformation(q, z_dot, p)
        q_dot = transformation @ z_dot  # equation (4)

        penetrations, contact_force, normals = contacts(q, q_dot, memory, p)
        speed_error = reference_speed_at(time, p) - z_dot[0]
        drive_torque = p.proportional_gain * speed_error + p.integral_gain * drive_integral
        force = applied_forces(q, contact_force, normals, drive_torque, p)
        if not (np.all(np.isfinite(force)) and np.all(np.isfinite(convective))):
            return n, drive_integral

        z_ddot = independent_accelerations(mass_matrix, transformation, convective, force)
        q_ddot = transformation @ z_ddot + convective  # equation (5)

        if n % sample_every == 0:
            rod_x, rod_y = q[ROD_C_X] - q[ROD_B_X], q[ROD_C_Y] - q[ROD_B_Y]
            rod_x_dot, rod_y_dot = q_dot[ROD_C_X] - q_dot[ROD_B_X], q_dot[ROD_C_Y] - q_dot[ROD_B_Y]
            sample = samples[n // sample_every]
            sample.time = time
            sample.crank_angle, sample.crank_speed = z[0], z_dot[0]
            sample.rod_angle = z[1] if z.size > 1 else math.atan2(rod_y, rod_x)
            sample.rod_speed = (rod_x * rod_y_dot - rod_y * rod_x_dot) / p.rod_length**2
            sample.slider_position, sample.slider_velocity = q[SLIDER_X], q_dot[SLIDER_X]
            sample.accelerations[:] = accelerometers(q, q_ddot, p)
            sample.contact_force[:] = contact_force
            sample.penetration[:] = penetrations
            sample.approach_speed[:] = memory
            sample.drive_torque = drive_torque

        z_dot += step * z_ddot  # equation (7), on z
        z += step * z_dot  # equation (8), with the new speed
        drive_integral += step * speed_error
        if not np.all(np.isfinite(z)):
            return n, drive_integral
    return -1, drive_integral
