"""Positions: q of z, the constraints Φ(q) = 0 of equation (3), and Φ_q of equation (2)."""

import math

import numpy as np

from clearance.compilation import entry
from clearance.simulation.natural_coordinates.links import (
    COORDINATES,
    CRANK_B_X,
    CRANK_B_Y,
    JOINTS,
    ROD_B_X,
    ROD_B_Y,
    ROD_C_X,
    ROD_C_Y,
    SLIDER_X,
    SLIDER_Y,
)
from clearance.simulation.natural_coordinates.parameters import Constants


@entry
def natural_positions(z: np.ndarray, constants: Constants) -> np.ndarray:
    """The position problem: (8,) natural coordinates q that satisfy equation (3) at given z.

    Args:
        z: (dof,) independent coordinates.
        constants: the mechanism.
    """
    p = constants
    q = np.zeros(COORDINATES)
    q[CRANK_B_X] = p.crank_length * math.cos(z[0])
    q[CRANK_B_Y] = p.crank_length * math.sin(z[0])
    q[SLIDER_Y] = p.guide_offset
    if not (p.open_b or p.open_c):
        rise = p.guide_offset - q[CRANK_B_Y]
        reach = math.sqrt(p.rod_length**2 - rise**2)
        q[ROD_B_X], q[ROD_B_Y] = q[CRANK_B_X], q[CRANK_B_Y]
        q[ROD_C_X], q[ROD_C_Y] = q[CRANK_B_X] + reach, p.guide_offset
        q[SLIDER_X] = q[ROD_C_X]
        return q
    rod_x = p.rod_length * math.cos(z[1])
    rod_y = p.rod_length * math.sin(z[1])
    q[SLIDER_X] = z[2]
    if p.open_b and p.open_c:
        q[ROD_B_X], q[ROD_B_Y] = z[3], z[4]
    elif p.open_c:
        q[ROD_B_X], q[ROD_B_Y] = q[CRANK_B_X], q[CRANK_B_Y]
    else:
        q[ROD_B_X], q[ROD_B_Y] = q[SLIDER_X] - rod_x, q[SLIDER_Y] - rod_y
    q[ROD_C_X], q[ROD_C_Y] = q[ROD_B_X] + rod_x, q[ROD_B_Y] + rod_y
    return q


@entry
def constraints(q: np.ndarray, constants: Constants) -> np.ndarray:
    """Φ(q) of equation (3): two rigid lengths, the guide, and the joints that are ideal.

    Args:
        q: (8,) natural coordinates [m].
        constants: the mechanism.

    Returns:
        (m,) with m = 7, 5 or 3; [m²] for lengths, [m] for the rest.
    """
    p = constants
    phi = np.zeros(7)
    phi[0] = q[CRANK_B_X] ** 2 + q[CRANK_B_Y] ** 2 - p.crank_length**2
    phi[1] = (q[ROD_C_X] - q[ROD_B_X]) ** 2 + (q[ROD_C_Y] - q[ROD_B_Y]) ** 2 - p.rod_length**2
    phi[2] = q[SLIDER_Y] - p.guide_offset
    row = 3
    for is_open, (journal, bearing) in zip((p.open_b, p.open_c), JOINTS):  # noqa: B905 (unknown to Numba)
        if not is_open:
            phi[row : row + 2] = q[journal : journal + 2] - q[bearing : bearing + 2]
            row += 2
    return phi[:row]


@entry
def constraint_jacobian(q: np.ndarray, constants: Constants) -> np.ndarray:
    """Φ_q of equation (2), shape (m, 8): the derivative of `constraints`, row by row.

    Args:
        q: (8,) natural coordinates [m].
        constants: the mechanism.
    """
    p = constants
    jacobian = np.zeros((7, COORDINATES))
    jacobian[0, CRANK_B_X] = 2.0 * q[CRANK_B_X]
    jacobian[0, CRANK_B_Y] = 2.0 * q[CRANK_B_Y]
    rod_x = q[ROD_C_X] - q[ROD_B_X]
    rod_y = q[ROD_C_Y] - q[ROD_B_Y]
    jacobian[1, ROD_C_X], jacobian[1, ROD_C_Y] = 2.0 * rod_x, 2.0 * rod_y
    jacobian[1, ROD_B_X], jacobian[1, ROD_B_Y] = -2.0 * rod_x, -2.0 * rod_y
    jacobian[2, SLIDER_Y] = 1.0
    row = 3
    for is_open, (journal, bearing) in zip((p.open_b, p.open_c), JOINTS):  # noqa: B905 (unknown to Numba)
        if not is_open:
            for axis in range(2):
                jacobian[row, journal + axis], jacobian[row, bearing + axis] = 1.0, -1.0
                row += 1
    return jacobian[:row]
