"""The paper's formulation, readable against its equations (1)-(8): natural coordinates and the R-matrix.

This is the second formulation. Data sets come from the fast compiled engine; this one is written for reading,
shares no equation with it, and must agree with it. Parameters in, trajectory out; nothing else depends on it
but tests and doubts. One step, file by file:

    links        M, constant                                           equation (2)
    positions    z -> q with Φ(q) = 0, and Φ_q                         equations (2)-(3)
    velocities   z' -> q' = R z', and R' z'                            equations (4)-(5)
    contact      gap, its rate and memory -> normal force              equation (1)
    forces       gravity, drive and the contacts -> Q                  equation (2)
    motion       R^T M R z'' = R^T (Q - M R' z') -> next z', z         equations (6)-(8)
    sensors      q, q'' -> what ten accelerometers read
    trajectory   a whole run: start, `simulate`, named samples         (parameters: the machine)

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

from clearance.simulation.natural_coordinates.contact import (
    flores_factor,
    hertz_stiffness,
    hunt_crossley_factor,
    lankarani_nikravesh_factor,
    normal_force,
    remembered_approach_speed,
)
from clearance.simulation.natural_coordinates.forces import applied_forces
from clearance.simulation.natural_coordinates.links import (
    COORDINATES,
    CRANK_B_X,
    ROD_B_X,
    ROD_C_X,
    SLIDER_X,
    link_mass_matrix,
)
from clearance.simulation.natural_coordinates.motion import independent_accelerations
from clearance.simulation.natural_coordinates.parameters import NaturalParameters, nominal_parameters
from clearance.simulation.natural_coordinates.positions import (
    constraint_jacobian,
    constraints,
    natural_positions,
)
from clearance.simulation.natural_coordinates.sensors import CHANNELS
from clearance.simulation.natural_coordinates.trajectory import (
    NaturalState,
    NaturalTrajectory,
    simulate,
    start_at,
)
from clearance.simulation.natural_coordinates.velocities import independent_rows, velocity_transformation

__all__ = [
    "CHANNELS",
    "COORDINATES",
    "CRANK_B_X",
    "ROD_B_X",
    "ROD_C_X",
    "SLIDER_X",
    "NaturalParameters",
    "NaturalState",
    "NaturalTrajectory",
    "applied_forces",
    "constraint_jacobian",
    "constraints",
    "flores_factor",
    "hertz_stiffness",
    "hunt_crossley_factor",
    "independent_accelerations",
    "independent_rows",
    "lankarani_nikravesh_factor",
    "link_mass_matrix",
    "natural_positions",
    "nominal_parameters",
    "normal_force",
    "remembered_approach_speed",
    "simulate",
    "start_at",
    "velocity_transformation",
]
