"""Oil in the gap: resists the journal's motion inside the bearing, more the thinner the film."""

from dataclasses import dataclass
from typing import Any, ClassVar

from clearance.compilation import kernel
from clearance.lanes import minimum, square_root
from clearance.mechanism.parameters import Family, Law, Parameter, require

ECCENTRICITY_LIMIT = 0.99  # of the clearance: a film thinner than surface roughness grows no stiffer


@kernel
def film_damping(eccentricity_ratio: Any, damping: Any) -> Any:
    """Damping [N s/m] of a film whose journal sits at ``eccentricity_ratio`` of the clearance."""
    ratio = minimum(eccentricity_ratio, ECCENTRICITY_LIMIT)
    thinness = 1.0 - ratio * ratio
    return damping / (thinness * square_root(thinness))


@dataclass(frozen=True)
class Dry(Law):
    """No film: the nominal joint."""

    family: ClassVar[Family] = Family.FILM
    code: ClassVar[int] = 0


@dataclass(frozen=True)
class SqueezeFilm(Law):
    """Force -d (1 - eps^2)^-1.5 e' on the journal, eps = eccentricity over clearance, e' its velocity.

    Valid for a short bearing with a full film; capped at eps = 0.99. A worn bore counts as round here. At the
    cap it is 356 times as stiff as at the centre: ``stiffest_film`` says what a step can follow.
    Reference: Hamrock, Fundamentals of Fluid Film Lubrication, ch. 8 (squeeze film of a journal bearing).

    Attributes:
        damping: d at the centre of the gap [N s/m].
    """

    damping: float = 10.0

    family: ClassVar[Family] = Family.FILM
    code: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require(self, damping=self.damping)

    def numbers(self) -> dict[Parameter, float]:
        """Entries of one joint's block of the parameter vector."""
        return {Parameter.JOINT_FILM_DAMPING: self.damping}
