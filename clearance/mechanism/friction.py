"""Sliding friction between journal and bearing: Coulomb's law on the contact force, smoothed near rest."""

from dataclasses import dataclass
from typing import Any, ClassVar

from clearance.compilation import kernel
from clearance.lanes import square_root
from clearance.mechanism.parameters import Family, Law, Parameter, require


@kernel
def smoothed_sign(speed: Any, smoothing_speed: Any) -> Any:
    """V / sqrt(v^2 + v0^2): the direction of sliding, differentiable at rest."""
    return speed / square_root(speed * speed + smoothing_speed * smoothing_speed)


@dataclass(frozen=True)
class Frictionless(Law):
    """No tangential force: the nominal joint."""

    family: ClassVar[Family] = Family.FRICTION
    code: ClassVar[int] = 0

    def numbers(self) -> dict[Parameter, float]:
        """Entries of one joint's block: the other joint's friction has this one divide by its speed, too."""
        return {Parameter.JOINT_FRICTION_SPEED: 1e-3}


@dataclass(frozen=True)
class Coulomb(Law):
    """Tangential force mu F_N against the sliding speed at the contact point.

    Valid for dry or boundary-lubricated metal, mu up to about 0.5.
    Reference: Flores & Ambrosio 2004, Comput. Struct. 82, 1359-1369 (joint with clearance).

    Attributes:
        friction_coefficient: mu [-].
        smoothing_speed: sliding speed below which the force fades [m/s].
    """

    friction_coefficient: float = 0.1
    smoothing_speed: float = 1e-3

    family: ClassVar[Family] = Family.FRICTION
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, 0.0, 2.0, friction_coefficient=self.friction_coefficient)
        require(self, strict=True, smoothing_speed=self.smoothing_speed)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of one joint's block of the parameter vector."""
        return {
            Parameter.JOINT_FRICTION: self.friction_coefficient,
            Parameter.JOINT_FRICTION_SPEED: self.smoothing_speed,
        }
