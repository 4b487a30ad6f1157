"""The connecting rod's bending: rigid, or its first mode."""

from dataclasses import dataclass
from math import pi
from typing import ClassVar

from clearance.mechanism.parameters import Family, Law, Parameter, require


@dataclass(frozen=True)
class RigidRod(Law):
    """No bending: the nominal rod."""

    family: ClassVar[Family] = Family.LINK
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class FlexibleRod(Law):
    """First bending mode of a uniform rod between its pins, w(s, t) = eta(t) sin(pi s / L).

    Modal mass m/2; the mode moves the rod's momentum by 2 m / pi per unit of eta. Valid for deflections far
    below the rod's length and frequencies well above the crank's.
    Reference: Shabana, Dynamics of Multibody Systems, ch. 5 (floating frame, simply supported mode).

    Attributes:
        frequency: of the mode with both pins held [Hz].
        damping_ratio: [-].
    """

    frequency: float = 800.0
    damping_ratio: float = 0.01

    family: ClassVar[Family] = Family.LINK
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, 20.0, 1e5, frequency=self.frequency)
        require(self, 0.0, 1.0, damping_ratio=self.damping_ratio)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        omega = 2.0 * pi * self.frequency
        return {
            Parameter.ROD_MODE_STIFFNESS: omega**2,
            Parameter.ROD_MODE_DAMPING: 2.0 * self.damping_ratio * omega,
            Parameter.ROD_MODE_COUPLING: 2.0 / pi,
        }
