"""What carries the crank's pivot A and the guide: fixed ground, or a mass on springs."""

from dataclasses import dataclass
from math import pi
from typing import ClassVar

from clearance.mechanism.parameters import Family, Law, Parameter, require


@dataclass(frozen=True)
class FixedFrame(Law):
    """The frame stands fast: the nominal machine."""

    family: ClassVar[Family] = Family.FRAME
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class FlexibleFrame(Law):
    """A frame sprung alike in x and y that moves without turning; its own weight is balanced by the springs.

    Reference: Rao, Mechanical Vibrations, ch. 9 (machine on a resilient foundation).

    Attributes:
        frequency: sqrt(k/m)/2 pi of the frame alone [Hz].
        damping_ratio: of the frame alone [-].
        mass: of the frame [kg].
    """

    frequency: float = 60.0
    damping_ratio: float = 0.03
    mass: float = 20.0

    family: ClassVar[Family] = Family.FRAME
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, 0.1, 1e4, frequency=self.frequency)
        require(self, 0.0, 2.0, damping_ratio=self.damping_ratio)
        require(self, strict=True, mass=self.mass)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector; the moving masses are added by the mechanism."""
        omega = 2.0 * pi * self.frequency
        return {
            Parameter.FRAME_STIFFNESS: self.mass * omega**2,
            Parameter.FRAME_DAMPING: 2.0 * self.damping_ratio * omega * self.mass,
        }
