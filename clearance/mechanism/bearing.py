"""The shape of the bearing's bore: round, or worn into lobes."""

from dataclasses import dataclass
from math import cos, sin
from typing import Any, ClassVar

from clearance.compilation import kernel
from clearance.errors import InputError
from clearance.lanes import get, nearest_integer, square_root, where
from clearance.mechanism.parameters import Family, Law, Parameter, require


@kernel
def worn_surface(
    p: Any, block: int, ex: Any, ey: Any, distance: Any, spin_sine: Any, spin_cosine: Any
) -> Any:
    """Gap and normal of a bore whose clearance is c(phi) = c + a cos(k phi + phase), phi in the bearing.

    Args:
        p: parameter vector.
        block: offset of the joint's block.
        ex: eccentricity in x [m].
        ey: eccentricity in y [m].
        distance: magnitude of the eccentricity [m].
        spin_sine: sine of the bearing's own angle.
        spin_cosine: its cosine.

    Returns:
        Penetration [m] and the two components of the outward normal: d = (r - c)/s and
        (r_hat - (c'/r) phi_hat)/s with s = sqrt(1 + (c'/r)^2).
    """
    radial_x, radial_y = ex / distance, ey / distance
    turned_cosine = radial_x * spin_cosine + radial_y * spin_sine
    turned_sine = radial_y * spin_cosine - radial_x * spin_sine
    # exp(i k phi) by repeated multiplication: the order is a small whole number, different from lane to lane
    order = nearest_integer(get(p, block + Parameter.JOINT_WEAR_ORDER))
    power_cosine, power_sine = (
        get(p, block + Parameter.JOINT_WEAR_COSINE),
        get(p, block + Parameter.JOINT_WEAR_SINE),
    )
    for k in range(1, MAXIMUM_ORDER + 1):
        more = order >= 1.0 * k
        next_cosine = power_cosine * turned_cosine - power_sine * turned_sine
        next_sine = power_sine * turned_cosine + power_cosine * turned_sine
        power_cosine = where(more, next_cosine, power_cosine)
        power_sine = where(more, next_sine, power_sine)
    amplitude = get(p, block + Parameter.JOINT_WEAR_AMPLITUDE)
    clearance = get(p, block + Parameter.JOINT_CLEARANCE) + amplitude * power_cosine
    slope = -(amplitude * order * power_sine) / distance
    inverse_stretch = 1.0 / square_root(1.0 + slope * slope)
    normal_x = (radial_x + slope * radial_y) * inverse_stretch
    normal_y = (radial_y - slope * radial_x) * inverse_stretch
    return (distance - clearance) * inverse_stretch, normal_x, normal_y


MAXIMUM_ORDER = 8


@dataclass(frozen=True)
class Round(Law):
    """A circular bore: the nominal bearing."""

    family: ClassVar[Family] = Family.BEARING
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class Worn(Law):
    """Clearance c(phi) = c + a cos(k phi + phase), phi measured in the bearing.

    What is given is where the journal's centre can be, not the bore's own profile. A journal that fits every
    lobe keeps a (k^2 - 1) below the clearance, where its radius about the centre and the bore's agree.
    Reference: Xu, Dong, Jia 2019, Multibody Syst. Dyn. 46, 457-478 (wear profiles of a clearance joint).

    Attributes:
        amplitude: a [m].
        order: k, a whole number of lobes.
        phase: [rad].
    """

    amplitude: float = 2e-5
    order: int = 2
    phase: float = 0.0

    family: ClassVar[Family] = Family.BEARING
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, 0.0, 1e-3, amplitude=self.amplitude)
        require(self, 1, MAXIMUM_ORDER, order=self.order)
        if self.order != round(self.order):  # 2.0 is as good: all unknowns of a fit are such numbers
            raise InputError(
                f"Worn.order = {self.order:g} is not a whole number of lobes; change the key that ends in "
                "'order'"
            )
        require(self, -100.0, 100.0, phase=self.phase)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of one joint's block of the parameter vector."""
        return {
            Parameter.JOINT_WEAR_AMPLITUDE: self.amplitude,
            Parameter.JOINT_WEAR_ORDER: float(self.order),
            Parameter.JOINT_WEAR_SINE: sin(self.phase),
            Parameter.JOINT_WEAR_COSINE: cos(self.phase),
        }
