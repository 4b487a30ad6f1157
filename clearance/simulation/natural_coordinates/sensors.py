"""What ten ideal accelerometers on the bodies read."""

import numpy as np

from clearance.compilation import subroutine
from clearance.simulation.natural_coordinates.links import (
    CRANK_B_X,
    CRANK_B_Y,
    ROD_B_X,
    ROD_B_Y,
    ROD_C_X,
    ROD_C_Y,
    SLIDER_X,
    SLIDER_Y,
)
from clearance.simulation.natural_coordinates.parameters import Constants

CHANNELS = (
    *("crank_a_transverse", "crank_a_axial", "crank_b_transverse", "crank_b_axial"),
    *("rod_b_transverse", "rod_b_axial", "rod_c_transverse", "rod_c_axial"),
    *("slider_vertical", "slider_horizontal"),
)


@subroutine
def accelerometers(q: np.ndarray, q_ddot: np.ndarray, constants: Constants) -> np.ndarray:
    """(10,) proper accelerations a - g at A, B, B, C and the slider, along the axes of each body [m/s²].

    Args:
        q: (8,) natural coordinates [m].
        q_ddot: (8,) their second derivatives [m/s²].
        constants: the mechanism.
    """
    p = constants
    crank_x, crank_y = q[CRANK_B_X] / p.crank_length, q[CRANK_B_Y] / p.crank_length
    rod_x = (q[ROD_C_X] - q[ROD_B_X]) / p.rod_length
    rod_y = (q[ROD_C_Y] - q[ROD_B_Y]) / p.rod_length
    sensors = np.zeros(10)
    sensors[0] = p.gravity_x * crank_y - p.gravity_y * crank_x
    sensors[1] = -p.gravity_x * crank_x - p.gravity_y * crank_y
    for point, channel, axial_x, axial_y in (
        (CRANK_B_X, 2, crank_x, crank_y),
        (ROD_B_X, 4, rod_x, rod_y),
        (ROD_C_X, 6, rod_x, rod_y),
    ):
        proper_x = q_ddot[point] - p.gravity_x
        proper_y = q_ddot[point + 1] - p.gravity_y
        sensors[channel] = proper_y * axial_x - proper_x * axial_y
        sensors[channel + 1] = proper_x * axial_x + proper_y * axial_y
    sensors[8] = q_ddot[SLIDER_Y] - p.gravity_y
    sensors[9] = q_ddot[SLIDER_X] - p.gravity_x
    return sensors
