"""The machine: Tables 1 and 2 in SI units, checked, and the same numbers as the compiled step reads."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from clearance.errors import InputError
from clearance.simulation.natural_coordinates.contact import hertz_stiffness, lankarani_nikravesh_factor
from clearance.simulation.natural_coordinates.links import assembled_mass_matrix, link_mass_matrix

_POSITIVE = "crank_mass crank_length rod_mass rod_length slider_mass exponent approach_speed_floor ramp_time"
_NOT_NEGATIVE = "crank_inertia rod_inertia clearance_b clearance_c hysteresis_factor"


class Constants(NamedTuple):
    """What the compiled step reads: numbers only, as in `NaturalParameters`."""

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
    hysteresis_factor: float = lankarani_nikravesh_factor(0.9)
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
        for name in _POSITIVE.split():
            require(name, getattr(self, name), "> 0", getattr(self, name) > 0.0)
        for name in _NOT_NEGATIVE.split():
            require(name, getattr(self, name), ">= 0", getattr(self, name) >= 0.0)
        for name in ("crank_centre", "rod_centre"):
            require(name, getattr(self, name), "in [0, 1]", 0.0 <= getattr(self, name) <= 1.0)
        for joint, clearance, stiffness in (
            ("b", self.clearance_b, self.stiffness_b),
            ("c", self.clearance_c, self.stiffness_c),
        ):
            allowed = f"> 0 with a clearance at {joint.upper()}"
            require(f"stiffness_{joint}", stiffness, allowed, clearance == 0.0 or stiffness > 0.0)
        shortest = self.crank_length + abs(self.guide_offset)
        require("rod_length", self.rod_length, f"> crank + offset = {shortest}", self.rod_length > shortest)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of independent coordinates z: 1, 3 or 5."""
        return 1 + 2 * (self.clearance_b > 0.0) + 2 * (self.clearance_c > 0.0)

    @property
    def constants(self) -> Constants:
        """The numbers as the compiled functions of this package take them."""
        own = {name: float(getattr(self, name)) for name in Constants._fields if hasattr(self, name)}
        gravity_x, gravity_y = (float(component) for component in self.gravity)
        return Constants(
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
        return assembled_mass_matrix(crank, rod, self.slider_mass)


def require(name: str, value: float, allowed: str, holds: bool) -> None:
    """Refuse a value that is not allowed, and say what is."""
    if not holds:
        raise InputError(f"{name} = {value}: must be {allowed}")


def nominal_parameters(
    clearance_b: float = 0.0,
    clearance_c: float = 0.0,
    reference_speed: float = NaturalParameters.reference_speed,
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
