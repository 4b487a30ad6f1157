"""The slider's guide: ideal or loose, and the friction along it."""

from dataclasses import dataclass
from typing import Any, ClassVar

from clearance.compilation import kernel
from clearance.lanes import absolute, exponential, get, maximum, where, zero
from clearance.mechanism.friction import smoothed_sign
from clearance.mechanism.jump import until_reached
from clearance.mechanism.parameters import Family, Law, Parameter, require

_BEYOND = 1e-8  # m, a strike is foreseen no better


@kernel
def shoe_force(p: Any, height: Any, rate: Any) -> Any:
    """Force of a loose guide on one end of the shoe [N], from the end's height [m] and its rate [m/s]."""
    side = where(height > 0.0, zero(height) + 1.0, zero(height) - 1.0)
    depth = absolute(height) - get(p, Parameter.GUIDE_GAP)
    push = get(p, Parameter.GUIDE_STIFFNESS) * depth + get(p, Parameter.GUIDE_DAMPING) * (side * rate)
    return where(depth > 0.0, -side * maximum(push, 0.0), zero(height))


@kernel
def until_shoe_strikes(p: Any, height: Any, rate: Any, acceleration: Any, most: Any) -> Any:
    """Time [s] until one end of the shoe meets the guide, where ``shoe_force`` jumps; at most ``most``."""
    gap = get(p, Parameter.GUIDE_GAP)
    above = until_reached(gap - height, _BEYOND, rate, acceleration, most)
    return until_reached(gap + height, _BEYOND, -rate, -acceleration, above)


@kernel
def guide_friction(p: Any, velocity: Any, reaction: Any) -> Any:
    """Friction of the guide on the slider [N] from its velocity [m/s] and what presses it there [N]."""
    ratio = velocity * get(p, Parameter.GUIDE_INVERSE_STRIBECK_SPEED)
    dry = (
        get(p, Parameter.GUIDE_COULOMB)
        + get(p, Parameter.GUIDE_STRIBECK) * exponential(-(ratio * ratio))
        + get(p, Parameter.GUIDE_FRICTION) * absolute(reaction)
    )
    slide = smoothed_sign(velocity, get(p, Parameter.GUIDE_FRICTION_SPEED))
    return -(dry * slide + get(p, Parameter.GUIDE_VISCOUS) * velocity)


@dataclass(frozen=True)
class IdealGuide(Law):
    """The slider moves along the guide line only: the nominal guide."""

    family: ClassVar[Family] = Family.GUIDE
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class LooseGuide(Law):
    """Free travel across the guide; the shoe's two ends strike linear springs and dampers.

    Valid for tilts below a few degrees.
    Reference: Flores, Ambrosio, Claro, Lankarani 2008, J. Comput. Nonlinear Dyn. 3, 011007 (translational
    joint).

    Attributes:
        gap: free travel on each side [m].
        stiffness: of a shoe's end against the guide [N/m].
        damping: likewise [N s/m].
        shoe_half_length: distance of the shoe's ends from the slider's centre [m].
    """

    gap: float = 1e-4
    stiffness: float = 1e7
    damping: float = 50.0
    shoe_half_length: float = 0.0075

    family: ClassVar[Family] = Family.GUIDE
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, 0.0, 5e-3, gap=self.gap)
        require(self, strict=True, stiffness=self.stiffness, shoe_half_length=self.shoe_half_length)
        require(self, damping=self.damping)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        return {
            Parameter.GUIDE_GAP: self.gap,
            Parameter.GUIDE_STIFFNESS: self.stiffness,
            Parameter.GUIDE_DAMPING: self.damping,
            Parameter.SHOE_HALF_LENGTH: self.shoe_half_length,
        }


@dataclass(frozen=True)
class FrictionlessGuide(Law):
    """No force along the guide: the nominal guide."""

    family: ClassVar[Family] = Family.GUIDE_FRICTION
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class StribeckGuide(Law):
    """Coulomb, Stribeck and viscous friction along the guide, and Coulomb friction on its reaction.

    F = -[F_c + F_s exp(-(v/v_s)^2) + mu |N|] sign(v) - d v, the sign smoothed over ``smoothing_speed``.
    Reference: Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7), 1083-1138.

    Attributes:
        coulomb_force: F_c [N].
        viscous_damping: d [N s/m].
        stribeck_force: F_s, what rest adds to sliding [N].
        stribeck_velocity: v_s [m/s].
        friction_coefficient: mu on the guide's reaction, of a tilted shoe's two ends each [-]; up to 0.5, at
            which the passes between reaction and friction leave 0.2 %.
        smoothing_speed: [m/s].
    """

    coulomb_force: float = 0.0
    viscous_damping: float = 0.0
    stribeck_force: float = 0.0
    stribeck_velocity: float = 0.05
    friction_coefficient: float = 0.0
    smoothing_speed: float = 1e-3

    family: ClassVar[Family] = Family.GUIDE_FRICTION
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, coulomb_force=self.coulomb_force, viscous_damping=self.viscous_damping)
        require(self, stribeck_force=self.stribeck_force)
        require(self, 0.0, 0.5, friction_coefficient=self.friction_coefficient)
        require(
            self, strict=True, stribeck_velocity=self.stribeck_velocity, smoothing_speed=self.smoothing_speed
        )

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        return {
            Parameter.GUIDE_COULOMB: self.coulomb_force,
            Parameter.GUIDE_VISCOUS: self.viscous_damping,
            Parameter.GUIDE_STRIBECK: self.stribeck_force,
            Parameter.GUIDE_INVERSE_STRIBECK_SPEED: 1.0 / self.stribeck_velocity,
            Parameter.GUIDE_FRICTION: self.friction_coefficient,
            Parameter.GUIDE_FRICTION_SPEED: self.smoothing_speed,
        }
