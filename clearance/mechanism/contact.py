"""Normal contact of journal and bearing.

All laws share Hertz's stiffness and differ in one number, the hysteresis factor chi:
F = K d^1.5 (1 + chi d'/d'_0), never negative, with d the penetration, d' its rate and d'_0 the approach
speed at first touch. Choice of law and restitution are therefore one parameter.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Any

from clearance.compilation import kernel
from clearance.lanes import maximum, square_root
from clearance.mechanism.parameters import require

APPROACH_FLOOR = 1e-3  # m/s: a slower first touch counts as this fast, else the hysteresis diverges


@kernel
def normal_force(penetration: Any, rate: Any, approach: Any, stiffness: Any, hysteresis: Any) -> Any:
    """Hertzian contact with hysteresis [N]; zero where there is no penetration, never pulling."""
    depth = maximum(penetration, 0.0)
    elastic = stiffness * depth * square_root(depth)
    return maximum(elastic * (1.0 + hysteresis * (rate / approach)), 0.0)


@dataclass(frozen=True)
class ContactLaw:
    """Hertzian stiffness from the material, paper Table 2; exponent 1.5.

    Valid for penetrations far below the clearance and impacts far below the material's wave speed.

    Attributes:
        restitution: e of the law's formula [-]; the rebound differs from it.
        youngs_modulus: E of journal and bearing alike [Pa].
        poissons_ratio: nu [-].
        stiffness_scale: factor of K [-].
    """

    restitution: float = 0.9
    youngs_modulus: float = 200e9
    poissons_ratio: float = 0.3
    stiffness_scale: float = 1.0

    def __post_init__(self) -> None:
        require(self, 0.0, 1.0, strict=True, restitution=self.restitution)
        require(self, strict=True, youngs_modulus=self.youngs_modulus, stiffness_scale=self.stiffness_scale)
        require(self, 0.0, 0.5, poissons_ratio=self.poissons_ratio)

    @property
    def hysteresis(self) -> float:
        """The factor chi of penetration rate over approach speed [-]."""
        raise NotImplementedError

    def stiffness(self, journal_radius: float, clearance: float) -> float:
        """K = 4/(3 * 2 sigma) sqrt(R_j R_b / (R_b - R_j)), sigma = (1 - nu^2)/E [N/m^1.5]."""
        sigma = (1.0 - self.poissons_ratio**2) / self.youngs_modulus
        bearing_radius = journal_radius + clearance
        return self.stiffness_scale * 4.0 / (6.0 * sigma) * sqrt(journal_radius * bearing_radius / clearance)


@dataclass(frozen=True)
class LankaraniNikravesh(ContactLaw):
    """chi = 3 (1 - e^2) / 4, valid for e near 1. Lankarani & Nikravesh 1990, J. Mech. Des. 112, 369."""

    @property
    def hysteresis(self) -> float:
        """The factor chi of penetration rate over approach speed [-]."""
        return 0.75 * (1.0 - self.restitution**2)


@dataclass(frozen=True)
class HuntCrossley(ContactLaw):
    """chi = 3 (1 - e) / 2. Hunt & Crossley 1975, J. Appl. Mech. 42(2), 440-445. Valid for e near 1."""

    @property
    def hysteresis(self) -> float:
        """The factor chi of penetration rate over approach speed [-]."""
        return 1.5 * (1.0 - self.restitution)


@dataclass(frozen=True)
class Flores(ContactLaw):
    """chi = 8 (1 - e) / (5 e). Flores et al. 2011, Multibody Syst. Dyn. 25, 357-375. Valid for all e."""

    @property
    def hysteresis(self) -> float:
        """The factor chi of penetration rate over approach speed [-]."""
        return 1.6 * (1.0 - self.restitution) / self.restitution
