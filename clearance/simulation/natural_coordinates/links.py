"""The basic points of the links, and the constant mass matrix M of equation (2)."""

import numpy as np

CRANK_B_X, CRANK_B_Y, ROD_B_X, ROD_B_Y, ROD_C_X, ROD_C_Y, SLIDER_X, SLIDER_Y = range(8)
COORDINATES = 8
JOINTS = ((CRANK_B_X, ROD_B_X), (ROD_C_X, SLIDER_X))  # x of (journal, bearing) at B and at C


def link_mass_matrix(mass: float, inertia: float, length: float, centre: float) -> np.ndarray:
    """Constant mass matrix of a link described by its two end points i and j.

    Any point of the link's axis moves with (1 - ξ) v_i + ξ v_j, ξ = 0 at i and 1 at j, so the kinetic energy
    needs only ∫dm = m, ∫ξ dm = m s and ∫ξ² dm = (I + m (s L)²)/L². I is free: not that of a thin rod.

    Args:
        mass: m [kg].
        inertia: I about the centre of mass [kg m²].
        length: L from i to j [m].
        centre: s, place of the centre of mass on the axis, 0 at i and 1 at j [-].

    Returns:
        (4, 4) mass matrix [kg] for (x_i, y_i, x_j, y_j).
    """
    first = mass * centre
    second = mass * centre**2 + inertia / length**2
    along = np.array([[mass - 2.0 * first + second, first - second], [first - second, second]])
    return np.kron(along, np.eye(2))


def assembled_mass_matrix(crank: np.ndarray, rod: np.ndarray, slider_mass: float) -> np.ndarray:
    """M of equation (2), (8, 8) [kg].

    Args:
        crank: (4, 4) mass matrix of the link A-B [kg].
        rod: (4, 4) mass matrix of the link B-C [kg].
        slider_mass: [kg].
    """
    matrix = np.zeros((COORDINATES, COORDINATES))
    # A stands still: of the crank only the block of its moving end takes part.
    matrix[CRANK_B_X : CRANK_B_Y + 1, CRANK_B_X : CRANK_B_Y + 1] = crank[2:, 2:]
    matrix[ROD_B_X : ROD_C_Y + 1, ROD_B_X : ROD_C_Y + 1] = rod
    matrix[SLIDER_X, SLIDER_X] = matrix[SLIDER_Y, SLIDER_Y] = slider_mass
    return matrix
