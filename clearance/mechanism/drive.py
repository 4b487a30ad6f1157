"""What turns the crank: a torque from its speed and the speed error's integral, and the torque's ripple."""

from dataclasses import dataclass, replace
from math import pi
from typing import Any, ClassVar

from clearance.compilation import kernel
from clearance.lanes import get, minimum, sine_cosine
from clearance.mechanism.parameters import Family, Law, Parameter, require


@kernel
def speed_error(p: Any, time: Any, speed: Any) -> Any:
    """Reference minus actual speed [rad/s]; the reference ramps up linearly, then stays."""
    ramp = minimum(get(p, Parameter.DRIVE_RAMP_START) + time * get(p, Parameter.DRIVE_RAMP_RATE), 1.0)
    return get(p, Parameter.DRIVE_SPEED) * ramp - speed


@kernel
def drive_torque(p: Any, error: Any, integral: Any) -> Any:
    """T = Kp e + Ki int(e) [N m]."""
    return get(p, Parameter.DRIVE_PROPORTIONAL) * error + get(p, Parameter.DRIVE_INTEGRAL_GAIN) * integral


@kernel
def ripple_torque(p: Any, angle: Any) -> Any:
    """A cos(k theta + phase) [N m]."""
    _, cosine = sine_cosine(get(p, Parameter.RIPPLE_ORDER) * angle + get(p, Parameter.RIPPLE_PHASE))
    return get(p, Parameter.RIPPLE_AMPLITUDE) * cosine


class Drive(Law):
    """What every drive can do."""

    family: ClassVar[Family] = Family.DRIVE

    def at_speed(self, speed_rpm: float) -> "Drive":
        """The same drive set to another speed [rpm]."""
        raise NotImplementedError


@dataclass(frozen=True)
class Free(Drive):
    """No torque: the crank runs out."""

    code: ClassVar[int] = 0

    def at_speed(self, speed_rpm: float) -> "Free":
        """The same: nothing sets the speed."""
        return self


@dataclass(frozen=True)
class SpeedControl(Drive):
    """A proportional-integral controller follows a speed that ramps up and stays; the nominal drive.

    Attributes:
        speed_rpm: speed after the ramp [rpm], either sense.
        proportional: Kp [N m s/rad].
        integral: Ki [N m/rad].
        ramp: duration of the ramp [s].
    """

    speed_rpm: float = 600.0
    proportional: float = 5.0
    integral: float = 200.0
    ramp: float = 0.5

    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, -2e4, 2e4, speed_rpm=self.speed_rpm)
        require(self, proportional=self.proportional, integral=self.integral, ramp=self.ramp)

    def at_speed(self, speed_rpm: float) -> "SpeedControl":
        """The same controller with another reference [rpm]."""
        return replace(self, speed_rpm=speed_rpm)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        return {
            Parameter.DRIVE_PROPORTIONAL: self.proportional,
            Parameter.DRIVE_INTEGRAL_GAIN: self.integral,
            Parameter.DRIVE_SPEED: self.speed_rpm * pi / 30.0,
            Parameter.DRIVE_RAMP_START: 0.0 if self.ramp > 0.0 else 1.0,
            Parameter.DRIVE_RAMP_RATE: 1.0 / self.ramp if self.ramp > 0.0 else 0.0,
        }


@dataclass(frozen=True)
class DirectCurrentMotor(Drive):
    """A motor at constant voltage: torque falls linearly from stall to the no-load speed, so its speed sags.

    T = T_stall (omega_0 - omega) / |omega_0|. Reference: Hughes & Drury, Electric Motors and Drives, ch. 3.

    Attributes:
        stall_torque: [N m].
        no_load_rpm: [rpm], either sense.
    """

    stall_torque: float = 1.0
    no_load_rpm: float = 700.0

    code: ClassVar[int] = 1  # the controller's kernel with Ki = 0 and no ramp

    def __post_init__(self) -> None:
        require(self, -2e4, 2e4, no_load_rpm=self.no_load_rpm)
        require(self, strict=True, stall_torque=self.stall_torque, no_load_rpm=abs(self.no_load_rpm))

    def at_speed(self, speed_rpm: float) -> "DirectCurrentMotor":
        """The same motor at the voltage of another no-load speed [rpm]."""
        return replace(self, no_load_rpm=speed_rpm)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        no_load = self.no_load_rpm * pi / 30.0
        return {
            Parameter.DRIVE_PROPORTIONAL: self.stall_torque / abs(no_load),
            Parameter.DRIVE_INTEGRAL_GAIN: 0.0,
            Parameter.DRIVE_SPEED: no_load,
            Parameter.DRIVE_RAMP_START: 1.0,
        }


@dataclass(frozen=True)
class Smooth(Law):
    """No ripple: the nominal drive."""

    family: ClassVar[Family] = Family.RIPPLE
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class TorqueRipple(Law):
    """Torque a cos(k theta + phase) on top of the drive's, as from a motor's slots or a coupling.

    Attributes:
        amplitude: a [N m].
        order: k, per revolution of the crank.
        phase: [rad].
    """

    amplitude: float = 0.1
    order: float = 6.0
    phase: float = 0.0

    family: ClassVar[Family] = Family.RIPPLE
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, amplitude=self.amplitude)
        require(self, 0.0, 1000.0, strict=True, order=self.order)
        require(self, -100.0, 100.0, phase=self.phase)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the parameter vector."""
        return {
            Parameter.RIPPLE_AMPLITUDE: self.amplitude,
            Parameter.RIPPLE_ORDER: self.order,
            Parameter.RIPPLE_PHASE: self.phase,
        }
