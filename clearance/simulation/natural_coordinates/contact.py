"""Contact in a joint with clearance: the gap, its memory, and the normal force of equation (1)."""

import math

import numpy as np

from clearance.compilation import entry, subroutine


def lankarani_nikravesh_factor(restitution: float) -> float:
    """Hysteresis factor χ = 3(1 - e²)/4 of Lankarani & Nikravesh 1990 [-]."""
    return 0.75 * (1.0 - restitution**2)


def hunt_crossley_factor(restitution: float) -> float:
    """Hysteresis factor χ = 3(1 - e)/2 of Hunt & Crossley 1975 [-]."""
    return 1.5 * (1.0 - restitution)


def flores_factor(restitution: float) -> float:
    """Hysteresis factor χ = 8(1 - e)/(5e) of Flores, Machado, Silva & Martins 2011 [-]."""
    return 1.6 * (1.0 - restitution) / restitution


def hertz_stiffness(
    radial_clearance: float,
    journal_radius: float = 0.01,
    youngs_modulus: float = 200e9,
    poisson_ratio: float = 0.3,
) -> float:
    """Contact stiffness K of a journal in a bearing larger by the clearance [N/m^1.5].

    Args:
        radial_clearance: c [m], above 0.
        journal_radius: R_j [m]; Table 2 prints 0.01 mm, read as 10 mm.
        youngs_modulus: E [Pa], of both bodies.
        poisson_ratio: ν [-], of both bodies.
    """
    compliance = (1.0 - poisson_ratio**2) / youngs_modulus
    bearing_radius = journal_radius + radial_clearance
    return 4.0 / (3.0 * 2.0 * compliance) * math.sqrt(journal_radius * bearing_radius / radial_clearance)


@subroutine
def gap(q: np.ndarray, q_dot: np.ndarray, journal: int, bearing: int, clearance: float) -> tuple:
    """Penetration δ = |e| - c, its rate, and the unit vector of e = journal centre - bearing centre.

    Args:
        q: (8,) natural coordinates [m].
        q_dot: (8,) their rates [m/s].
        journal: index of the journal's x in q.
        bearing: index of the bearing's x in q.
        clearance: radial clearance c [m].
    """
    e_x, e_y = q[journal] - q[bearing], q[journal + 1] - q[bearing + 1]
    eccentricity = math.hypot(e_x, e_y)
    if eccentricity == 0.0:
        return -clearance, 0.0, 0.0, 0.0
    normal_x, normal_y = e_x / eccentricity, e_y / eccentricity
    rate = (q_dot[journal] - q_dot[bearing]) * normal_x + (q_dot[journal + 1] - q_dot[bearing + 1]) * normal_y
    return eccentricity - clearance, rate, normal_x, normal_y


@entry
def remembered_approach_speed(penetration: float, rate: float, memory: float, floor: float) -> float:
    """Approach speed δ'⁻ of this contact [m/s]: taken at first touch, kept until parting, 0 when apart."""
    if penetration <= 0.0:
        return 0.0
    if memory == 0.0:
        return max(rate, floor)
    return memory


@entry
def normal_force(
    penetration: float, rate: float, approach_speed: float, stiffness: float, exponent: float, factor: float
) -> float:
    """Equation (1): F = K δ^n (1 + χ δ'/δ'⁻) [N], never negative since a contact never pulls."""
    if penetration <= 0.0:
        return 0.0
    return max(0.0, stiffness * penetration**exponent * (1.0 + factor * rate / approach_speed))
