"""The paper's formulation, readable against its equations (2)-(8): natural coordinates and the R-matrix.

This is the second formulation. Data sets come from the fast compiled engine; this one is written for reading,
shares no code with it, and must agree with it. Where in the flow: parameters in, trajectory out, nothing else
depends on it but tests and doubts.

Natural coordinates q are the Cartesian coordinates of the basic points of the bodies [m]:

    q = (B on the crank, B on the rod, C on the rod, C on the slider), two numbers each, A = origin.

Each link then has a constant mass matrix and no angle appears in equations (2)-(3). The two points of a joint
with clearance are free to differ; an ideal joint adds "the two points coincide" to the constraints. One point
carries all the inertia of the slider, which only translates along its guide.

Independent coordinates z are, by the number of degrees of freedom,

    z = (crank angle | rod angle, slider position | x of B on the rod, y of B on the rod)

of which the first one serves the ideal mechanism, the first three one clearance (at B or at C), and all five
clearances in both joints.

Readings of the paper:
    - Equation (6) is printed without the transpose of its second R; it is R^T M R z'' = R^T (Q - M R' z').
    - Equations (7)-(8) applied to q leave the constraints: each step moves the points along tangents. Here
      the same formula integrates z, and q(z) and q' = R z' follow exactly: no drift and no projection.

References: Nguyen et al. 2026, Multibody System Dynamics, Section 2; García de Jalón & Bayo 1994, Kinematic
and Dynamic Simulation of Multibody Systems, chapters 2, 4 and 5.
"""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from clearance.errors import InputError

CRANK_B_X, CRANK_B_Y, ROD_B_X, ROD_B_Y, ROD_C_X, ROD_C_Y, SLIDER_X, SLIDER_Y = range(8)
COORDINATES = 8
CHANNELS = (
    "crank_a_transverse",
    "crank_a_axial",
    "crank_b_transverse",
    "crank_b_axial",
    "rod_b_transverse",
    "rod_b_axial",
    "rod_c_transverse",
    "rod_c_axial",
    "slider_vertical",
    "slider_horizontal",
)
# Columns of the motion that a run stores beside the accelerations.
(
    _TIME,
    _CRANK_ANGLE,
    _CRANK_SPEED,
    _ROD_ANGLE,
    _ROD_SPEED,
    _SLIDER_POSITION,
    _SLIDER_VELOCITY,
    _FORCE_B,
    _FORCE_C,
    _PENETRATION_B,
    _PENETRATION_C,
    _APPROACH_B,
    _APPROACH_C,
    _TORQUE,
) = range(14)
_STORED = 14


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


class _Constants(NamedTuple):
    """What the compiled step reads: numbers only."""

    open_b: bool
    open_c: bool
    crank_length: float
    rod_length: float
    guide_offset: float
    crank_mass: float
    crank_centre: float
    rod_mass: float
    rod_centre: float
    slider_mass: float
    clearance_b: float
    clearance_c: float
    stiffness_b: float
    stiffness_c: float
    exponent: float
    hysteresis_factor: float
    approach_speed_floor: float
    gravity_x: float
    gravity_y: float
    reference_speed: float
    ramp_time: float
    proportional_gain: float
    integral_gain: float


@dataclass(frozen=True)
class NaturalParameters:
    """The mechanism of Tables 1 and 2 in SI units; a clearance of 0 is an ideal joint.

    Attributes:
        clearance_b: radial clearance between crank and rod [m].
        clearance_c: radial clearance between rod and slider [m].
        reference_speed: crank speed after the ramp [rad/s].
        stiffness_b: contact stiffness at B [N/m^exponent], needed where clearance_b > 0.
        stiffness_c: contact stiffness at C [N/m^exponent], needed where clearance_c > 0.
        hysteresis_factor: χ, the factor of (penetration rate / approach speed) [-].
        exponent: n of the contact law [-].
        approach_speed_floor: least approach speed that the law divides by [m/s].
        crank_mass: [kg].
        crank_inertia: about its centre of mass [kg m²].
        crank_length: A to B [m].
        crank_centre: place of its centre of mass, 0 at A and 1 at B [-].
        rod_mass: [kg].
        rod_inertia: about its centre of mass [kg m²].
        rod_length: B to C [m].
        rod_centre: place of its centre of mass, 0 at B and 1 at C [-].
        slider_mass: [kg].
        guide_offset: y of the guide [m].
        gravity: acceleration of gravity in the plane (x, y) [m/s²].
        ramp_time: the reference speed rises linearly over this time [s].
        proportional_gain: Kp [N m s/rad].
        integral_gain: Ki [N m/rad].
    """

    clearance_b: float = 0.0
    clearance_c: float = 0.0
    reference_speed: float = 500.0 * math.pi / 30.0
    stiffness_b: float = 0.0
    stiffness_c: float = 0.0
    hysteresis_factor: float = 0.75 * (1.0 - 0.9**2)
    exponent: float = 1.5
    approach_speed_floor: float = 1e-3
    crank_mass: float = 0.3
    crank_inertia: float = 1e-5
    crank_length: float = 0.05
    crank_centre: float = 0.5
    rod_mass: float = 0.21
    rod_inertia: float = 2.5e-4
    rod_length: float = 0.12
    rod_centre: float = 0.5
    slider_mass: float = 0.14
    guide_offset: float = 0.0
    gravity: tuple[float, float] = (0.0, 0.0)
    ramp_time: float = 0.5
    proportional_gain: float = 5.0
    integral_gain: float = 200.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not np.all(np.isfinite(value)):
                raise InputError(f"{name} = {value}: must be finite")
        for name in ("crank_mass", "crank_length", "rod_mass", "rod_length", "slider_mass"):
            _require(name, getattr(self, name), "> 0", getattr(self, name) > 0.0)
        for name in ("exponent", "approach_speed_floor", "ramp_time"):
            _require(name, getattr(self, name), "> 0", getattr(self, name) > 0.0)
        for name in ("crank_inertia", "rod_inertia", "clearance_b", "clearance_c", "hysteresis_factor"):
            _require(name, getattr(self, name), ">= 0", getattr(self, name) >= 0.0)
        for name in ("crank_centre", "rod_centre"):
            _require(name, getattr(self, name), "in [0, 1]", 0.0 <= getattr(self, name) <= 1.0)
        if self.clearance_b > 0.0:
            _require("stiffness_b", self.stiffness_b, "> 0 with a clearance at B", self.stiffness_b > 0.0)
        if self.clearance_c > 0.0:
            _require("stiffness_c", self.stiffness_c, "> 0 with a clearance at C", self.stiffness_c > 0.0)
        shortest = self.crank_length + abs(self.guide_offset)
        _require("rod_length", self.rod_length, f"> crank + offset = {shortest}", self.rod_length > shortest)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of independent coordinates z: 1, 3 or 5."""
        return 1 + 2 * (self.clearance_b > 0.0) + 2 * (self.clearance_c > 0.0)

    @property
    def constants(self) -> _Constants:
        """The numbers as the compiled functions of this module take them."""
        own = {name: float(getattr(self, name)) for name in _Constants._fields if hasattr(self, name)}
        gravity_x, gravity_y = (float(component) for component in self.gravity)
        return _Constants(
            open_b=self.clearance_b > 0.0,
            open_c=self.clearance_c > 0.0,
            gravity_x=gravity_x,
            gravity_y=gravity_y,
            **own,
        )

    @property
    def mass_matrix(self) -> np.ndarray:
        """(8, 8) constant mass matrix M of equation (2) [kg]."""
        crank = link_mass_matrix(self.crank_mass, self.crank_inertia, self.crank_length, self.crank_centre)
        rod = link_mass_matrix(self.rod_mass, self.rod_inertia, self.rod_length, self.rod_centre)
        matrix = np.zeros((COORDINATES, COORDINATES))
        # A stands still: of the crank only the block of its moving end takes part.
        matrix[CRANK_B_X : CRANK_B_Y + 1, CRANK_B_X : CRANK_B_Y + 1] = crank[2:, 2:]
        matrix[ROD_B_X : ROD_C_Y + 1, ROD_B_X : ROD_C_Y + 1] = rod
        matrix[SLIDER_X, SLIDER_X] = matrix[SLIDER_Y, SLIDER_Y] = self.slider_mass
        return matrix


def _require(name: str, value: float, allowed: str, holds: bool) -> None:
    if not holds:
        raise InputError(f"{name} = {value}: must be {allowed}")


def nominal_parameters(
    clearance_b: float = 0.0,
    clearance_c: float = 0.0,
    reference_speed: float = 500.0 * math.pi / 30.0,
    **changes: Any,
) -> NaturalParameters:
    """The nominal mechanism with the Hertzian stiffness that belongs to each clearance.

    Args:
        clearance_b: radial clearance at B [m].
        clearance_c: radial clearance at C [m].
        reference_speed: crank speed after the ramp [rad/s].
        **changes: any other field of `NaturalParameters`.
    """
    stiffness = {
        name: hertz_stiffness(value)
        for name, value in (("stiffness_b", clearance_b), ("stiffness_c", clearance_c))
        if value > 0.0
    }
    return NaturalParameters(clearance_b, clearance_c, reference_speed, **{**stiffness, **changes})


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


@njit(cache=True)
def natural_positions(z: np.ndarray, constants: _Constants) -> np.ndarray:
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


@njit(cache=True)
def constraints(q: np.ndarray, constants: _Constants) -> np.ndarray:
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
    if not p.open_b:
        phi[row] = q[CRANK_B_X] - q[ROD_B_X]
        phi[row + 1] = q[CRANK_B_Y] - q[ROD_B_Y]
        row += 2
    if not p.open_c:
        phi[row] = q[ROD_C_X] - q[SLIDER_X]
        phi[row + 1] = q[ROD_C_Y] - q[SLIDER_Y]
        row += 2
    return phi[:row]


@njit(cache=True)
def constraint_jacobian(q: np.ndarray, constants: _Constants) -> np.ndarray:
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
    if not p.open_b:
        jacobian[row, CRANK_B_X], jacobian[row, ROD_B_X] = 1.0, -1.0
        jacobian[row + 1, CRANK_B_Y], jacobian[row + 1, ROD_B_Y] = 1.0, -1.0
        row += 2
    if not p.open_c:
        jacobian[row, ROD_C_X], jacobian[row, SLIDER_X] = 1.0, -1.0
        jacobian[row + 1, ROD_C_Y], jacobian[row + 1, SLIDER_Y] = 1.0, -1.0
        row += 2
    return jacobian[:row]


@njit(cache=True)
def independent_rows(q: np.ndarray, constants: _Constants) -> np.ndarray:
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


@njit(cache=True)
def velocity_transformation(
    q: np.ndarray, z_dot: np.ndarray, constants: _Constants
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


@njit(cache=True)
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


@njit(cache=True)
def remembered_approach_speed(penetration: float, rate: float, memory: float, floor: float) -> float:
    """Approach speed δ'⁻ of this contact [m/s]: taken at first touch, kept until parting, 0 when apart."""
    if penetration <= 0.0:
        return 0.0
    if memory == 0.0:
        return max(rate, floor)
    return memory


@njit(cache=True)
def normal_force(
    penetration: float, rate: float, approach_speed: float, stiffness: float, exponent: float, factor: float
) -> float:
    """Equation (1): F = K δ^n (1 + χ δ'/δ'⁻) [N], never negative since a contact never pulls."""
    if penetration <= 0.0:
        return 0.0
    return max(0.0, stiffness * penetration**exponent * (1.0 + factor * rate / approach_speed))


@njit(cache=True)
def reference_speed_at(time: float, constants: _Constants) -> float:
    """Reference speed of the drive [rad/s]: a ramp, then constant."""
    return constants.reference_speed * min(time / constants.ramp_time, 1.0)


@njit(cache=True)
def applied_forces(
    q: np.ndarray, contact_force: np.ndarray, normals: np.ndarray, drive_torque: float, constants: _Constants
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

    for axis in range(2):
        # The journal (crank at B, rod at C) is pushed back along -e, the bearing along +e.
        force[CRANK_B_X + axis] -= contact_force[0] * normals[0, axis]
        force[ROD_B_X + axis] += contact_force[0] * normals[0, axis]
        force[ROD_C_X + axis] -= contact_force[1] * normals[1, axis]
        force[SLIDER_X + axis] += contact_force[1] * normals[1, axis]
    return force


@njit(cache=True)
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


@njit(cache=True)
def accelerometers(q: np.ndarray, q_ddot: np.ndarray, constants: _Constants) -> np.ndarray:
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


@njit(cache=True)
def _integrate(
    constants: _Constants,
    mass_matrix: np.ndarray,
    z: np.ndarray,
    z_dot: np.ndarray,
    drive_integral: float,
    memory: np.ndarray,
    step: float,
    steps: int,
    sample_every: int,
    stored: np.ndarray,
    accelerations: np.ndarray,
) -> tuple[int, float]:
    """Equations (7)-(8) on z; `z`, `z_dot` and `memory` are advanced in place.

    Returns:
        The step at which a force or the motion was not finite, or -1; and the drive integral at the end.
    """
    p = constants
    penetrations, contact_force, normals = np.zeros(2), np.zeros(2), np.zeros((2, 2))
    for n in range(steps):
        time = n * step
        q = natural_positions(z, p)
        transformation, convective = velocity_transformation(q, z_dot, p)
        q_dot = transformation @ z_dot

        for index, is_open, journal, bearing, clearance, stiffness in (
            (0, p.open_b, CRANK_B_X, ROD_B_X, p.clearance_b, p.stiffness_b),
            (1, p.open_c, ROD_C_X, SLIDER_X, p.clearance_c, p.stiffness_c),
        ):
            if is_open:
                penetration, rate, normal_x, normal_y = gap(q, q_dot, journal, bearing, clearance)
                memory[index] = remembered_approach_speed(
                    penetration, rate, memory[index], p.approach_speed_floor
                )
                contact_force[index] = normal_force(
                    penetration, rate, memory[index], stiffness, p.exponent, p.hysteresis_factor
                )
                penetrations[index], normals[index, 0], normals[index, 1] = penetration, normal_x, normal_y

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
            row = stored[n // sample_every]
            row[_TIME] = time
            row[_CRANK_ANGLE], row[_CRANK_SPEED] = z[0], z_dot[0]
            row[_ROD_ANGLE] = z[1] if z.size > 1 else math.atan2(rod_y, rod_x)
            row[_ROD_SPEED] = (rod_x * rod_y_dot - rod_y * rod_x_dot) / p.rod_length**2
            row[_SLIDER_POSITION], row[_SLIDER_VELOCITY] = q[SLIDER_X], q_dot[SLIDER_X]
            row[_FORCE_B], row[_FORCE_C] = contact_force
            row[_PENETRATION_B], row[_PENETRATION_C] = penetrations
            row[_APPROACH_B], row[_APPROACH_C] = memory
            row[_TORQUE] = drive_torque
            accelerations[n // sample_every] = accelerometers(q, q_ddot, p)

        z_dot += step * z_ddot  # equation (7), on z
        z += step * z_dot  # equation (8), with the new speed
        drive_integral += step * speed_error
        if not np.all(np.isfinite(z)):
            return n, drive_integral
    return -1, drive_integral


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
    _require("step", step, "> 0 s", 0.0 < step < math.inf)
    _require("duration", duration, ">= one step", step <= duration < math.inf)
    _require("sample_every", sample_every, ">= 1", sample_every >= 1)
    start = start_at(parameters) if start is None else start
    z, z_dot = (np.array(values, dtype=float) for values in (start.coordinates, start.speeds))
    expected = (parameters.degrees_of_freedom,)
    if z.shape != expected or z_dot.shape != expected:
        raise InputError(f"start has shapes {z.shape} and {z_dot.shape}: must be {expected}")

    steps = round(duration / step)
    samples = (steps - 1) // sample_every + 1
    stored, accelerations = np.zeros((samples, _STORED)), np.zeros((samples, len(CHANNELS)))
    memory = np.array(start.approach_speeds, dtype=float)
    failed, drive_integral = _integrate(
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
        accelerations,
    )
    if failed >= 0:
        raise FloatingPointError(
            f"non-finite force or motion at t = {failed * step:.9g} s, z = {z.tolist()}, "
            f"z' = {z_dot.tolist()}; step {step} s, hysteresis factor {parameters.hysteresis_factor}"
        )
    return NaturalTrajectory(
        time=stored[:, _TIME],
        crank_angle=stored[:, _CRANK_ANGLE],
        crank_speed=stored[:, _CRANK_SPEED],
        rod_angle=stored[:, _ROD_ANGLE],
        rod_speed=stored[:, _ROD_SPEED],
        slider_position=stored[:, _SLIDER_POSITION],
        slider_velocity=stored[:, _SLIDER_VELOCITY],
        accelerations=accelerations,
        contact_force=stored[:, _FORCE_B : _FORCE_C + 1],
        penetration=stored[:, _PENETRATION_B : _PENETRATION_C + 1],
        approach_speed=stored[:, _APPROACH_B : _APPROACH_C + 1],
        drive_torque=stored[:, _TORQUE],
        end=NaturalState(z, z_dot, drive_integral, (memory[0], memory[1])),
    )
