"""What the slider works against along the guide: a spring, a process."""

from dataclasses import dataclass
from typing import Any, ClassVar

from clearance.compilation import kernel
from clearance.errors import InputError
from clearance.lanes import get, where, zero
from clearance.mechanism.jump import until_reached
from clearance.mechanism.parameters import Family, Law, Parameter, require

_BEYOND = 1e-8  # m, an edge is foreseen no better


@kernel
def spring_force(p: Any, position: Any) -> Any:
    """-k (x - x0) [N]."""
    return -get(p, Parameter.SPRING_STIFFNESS) * (position - get(p, Parameter.SPRING_FREE))


@kernel
def process_force(p: Any, position: Any) -> Any:
    """-F between start and end of the working stroke [N], whatever the velocity."""
    working = (position >= get(p, Parameter.PROCESS_START)) & (position <= get(p, Parameter.PROCESS_END))
    force = get(p, Parameter.PROCESS_FORCE)
    return where(working, -force, zero(force))


@kernel
def until_process_changes(p: Any, position: Any, velocity: Any, acceleration: Any, most: Any) -> Any:
    """Time [s] until the working stroke begins or ends, where ``process_force`` jumps; at most ``most``."""
    for edge in (get(p, Parameter.PROCESS_START), get(p, Parameter.PROCESS_END)):
        most = until_reached(edge - position, _BEYOND, velocity, acceleration, most)
        most = until_reached(position - edge, _BEYOND, -velocity, -acceleration, most)
    return most


@dataclass(frozen=True)
class NoSpring(Law):
    """No spring: the nominal slider."""

    family: ClassVar[Family] = Family.SPRING
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class LinearSpring(Law):
    """Force -k (x - x0) on the slider.

    Attributes:
        stiffness: k [N/m].
        free_position: x0, slider position from A at which the spring is relaxed [m].
    """

    stiffness: float = 500.0
    free_position: float = 0.12

    family: ClassVar[Family] = Family.SPRING
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, stiffness=self.stiffness)
        require(self, -100.0, 100.0, free_position=self.free_position)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        return {Parameter.SPRING_STIFFNESS: self.stiffness, Parameter.SPRING_FREE: self.free_position}


@dataclass(frozen=True)
class Idle(Law):
    """No process: the nominal slider."""

    family: ClassVar[Family] = Family.PROCESS
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class ConstantProcess(Law):
    """Force F towards -x while the slider is between two positions, on both strokes alike.

    Attributes:
        force: F [N].
        start: slider position from A [m].
        end: slider position from A [m], beyond ``start``.
    """

    force: float = 20.0
    start: float = 0.10
    end: float = 0.14

    family: ClassVar[Family] = Family.PROCESS
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, -1e6, 1e6, force=self.force)
        require(self, -100.0, 100.0, start=self.start, end=self.end)
        if self.end <= self.start:
            raise InputError(f"process.end = {self.end:g} m must lie beyond process.start = {self.start:g} m")

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        return {
            Parameter.PROCESS_FORCE: self.force,
            Parameter.PROCESS_START: self.start,
            Parameter.PROCESS_END: self.end,
        }
