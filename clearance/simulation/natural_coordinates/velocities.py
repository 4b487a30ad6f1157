"""Velocities: q' = R z' of equation (4), and R' z' of equation (5)."""

import numpy as np

from clearance.compilation import entry
from clearance.simulation.natural_coordinates.links import (
    COORDINATES,
    CRANK_B_X,
    CRANK_B_Y,
    ROD_B_X,
    ROD_B_Y,
    ROD_C_X,
    ROD_C_Y,
    SLIDER_X,
)
from clearance.simulation.natural_coordinates.parameters import Constants
from clearance.simulation.natural_coordinates.positions import constraint_jacobian


@entry
def independent_rows(q: np.ndarray, constants: Constants) -> np.ndarray:
    """B in z' = B(q) q', shape (5, 8): the angular speeds of both links, then plain selections.

    B' q' = 0: the rows of the angular speeds give the cross product of a velocity with itself.

    Args:
        q: (8,) natural coordinates [m].
        constants: the mechanism.
    """
    p = constants
    rows = np.zeros((5, COORDINATES))
    rows[0, CRANK_B_X] = -q[CRANK_B_Y] / p.crank_length**2
    rows[0, CRANK_B_Y] = q[CRANK_B_X] / p.crank_length**2
    turn_x = -(q[ROD_C_Y] - q[ROD_B_Y]) / p.rod_length**2
    turn_y = (q[ROD_C_X] - q[ROD_B_X]) / p.rod_length**2
    rows[1, ROD_C_X], rows[1, ROD_C_Y] = turn_x, turn_y
    rows[1, ROD_B_X], rows[1, ROD_B_Y] = -turn_x, -turn_y
    rows[2, SLIDER_X] = 1.0
    rows[3, ROD_B_X] = 1.0
    rows[4, ROD_B_Y] = 1.0
    return rows


@entry
def velocity_transformation(
    q: np.ndarray, z_dot: np.ndarray, constants: Constants
) -> tuple[np.ndarray, np.ndarray]:
    """R of equation (4) and R' z' of equation (5).

    Velocities satisfy Φ_q q' = 0 and B q' = z', accelerations Φ_q q'' = -Φ'_q q' and B q'' = z''. One inverse
    of the stacked matrix, [S R] = [Φ_q; B]⁻¹, answers both: q' = R z' and q'' = R z'' - S Φ'_q q'.

    Args:
        q: (8,) natural coordinates [m].
        z_dot: (dof,) independent speeds.
        constants: the mechanism.

    Returns:
        R (8, dof) and R' z' (8,) [m/s²].
    """
    jacobian = constraint_jacobian(q, constants)
    dependent = jacobian.shape[0]
    stacked = np.zeros((COORDINATES, COORDINATES))
    stacked[:dependent] = jacobian
    stacked[dependent:] = independent_rows(q, constants)[: COORDINATES - dependent]
    inverse = np.linalg.inv(stacked)
    particular = np.ascontiguousarray(inverse[:, :dependent])
    transformation = np.ascontiguousarray(inverse[:, dependent:])

    q_dot = transformation @ z_dot
    jacobian_rate_times_velocity = np.zeros(dependent)
    jacobian_rate_times_velocity[0] = 2.0 * (q_dot[CRANK_B_X] ** 2 + q_dot[CRANK_B_Y] ** 2)
    jacobian_rate_times_velocity[1] = 2.0 * (
        (q_dot[ROD_C_X] - q_dot[ROD_B_X]) ** 2 + (q_dot[ROD_C_Y] - q_dot[ROD_B_Y]) ** 2
    )
    return transformation, -(particular @ jacobian_rate_times_velocity)
