"""The applied forces Q of equation (2): gravity, drive and contact on the basic points."""

import numpy as np

from clearance.compilation import entry, subroutine
from clearance.simulation.natural_coordinates.contact import gap, normal_force, remembered_approach_speed
from clearance.simulation.natural_coordinates.links import (
    COORDINATES,
    CRANK_B_X,
    CRANK_B_Y,
    JOINTS,
    ROD_B_X,
    ROD_C_X,
    SLIDER_X,
)
from clearance.simulation.natural_coordinates.parameters import Constants


@subroutine
def reference_speed_at(time: float, constants: Constants) -> float:
    """Reference speed of the drive [rad/s]: a ramp, then constant."""
    return constants.reference_speed * min(time / constants.ramp_time, 1.0)


@subroutine
def contacts(
    q: np.ndarray, q_dot: np.ndarray, memory: np.ndarray, constants: Constants
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Penetrations (2,), normal forces (2,) and normals (2, 2) at B and C; brings `memory` up to date."""
    p = constants
    is_open, clearance = (p.open_b, p.open_c), (p.clearance_b, p.clearance_c)
    stiffness = (p.stiffness_b, p.stiffness_c)
    penetration, force, normals = np.zeros(2), np.zeros(2), np.zeros((2, 2))
    for n, (journal, bearing) in enumerate(JOINTS):
        if is_open[n]:
            penetration[n], rate, normals[n, 0], normals[n, 1] = gap(q, q_dot, journal, bearing, clearance[n])
            memory[n] = remembered_approach_speed(penetration[n], rate, memory[n], p.approach_speed_floor)
            force[n] = normal_force(
                penetration[n], rate, memory[n], stiffness[n], p.exponent, p.hysteresis_factor
            )
    return penetration, force, normals


@entry
def applied_forces(
    q: np.ndarray, contact_force: np.ndarray, normals: np.ndarray, drive_torque: float, constants: Constants
) -> np.ndarray:
    """Q of equation (2), shape (8,) [N]: gravity, drive, contact at B, contact at C.

    A force on a basic point is its own generalised force. A force at s between two basic points splits as
    (1 - s) and s. A torque T on the crank is the force T/L across the crank at B, which does the same work.

    Args:
        q: (8,) natural coordinates [m].
        contact_force: (2,) normal forces at B and C [N].
        normals: (2, 2) unit vectors of the eccentricities at B and C.
        drive_torque: [N m].
        constants: the mechanism.
    """
    p = constants
    force = np.zeros(COORDINATES)
    for axis, gravity in enumerate((p.gravity_x, p.gravity_y)):
        force[CRANK_B_X + axis] += p.crank_mass * p.crank_centre * gravity
        force[ROD_B_X + axis] += p.rod_mass * (1.0 - p.rod_centre) * gravity
        force[ROD_C_X + axis] += p.rod_mass * p.rod_centre * gravity
        force[SLIDER_X + axis] += p.slider_mass * gravity

    force[CRANK_B_X] -= drive_torque * q[CRANK_B_Y] / p.crank_length**2
    force[CRANK_B_Y] += drive_torque * q[CRANK_B_X] / p.crank_length**2

    for n, (journal, bearing) in enumerate(JOINTS):
        # The journal is pushed back along -e, the bearing along +e.
        force[journal : journal + 2] -= contact_force[n] * normals[n]
        force[bearing : bearing + 2] += contact_force[n] * normals[n]
    return force
