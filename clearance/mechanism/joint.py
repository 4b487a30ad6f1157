"""A revolute joint: ideal without clearance, else a journal loose in a bearing."""

from dataclasses import dataclass, field

from clearance.errors import InputError
from clearance.mechanism.bearing import Round, Worn
from clearance.mechanism.contact import ContactLaw, LankaraniNikravesh
from clearance.mechanism.film import Dry
from clearance.mechanism.friction import Frictionless
from clearance.mechanism.parameters import Family, Law, Parameter, require, require_kind

CLEARANCE_RANGE = (0.0, 2e-3)  # m; the paper studies up to 1e-3


@dataclass(frozen=True)
class Joint:
    """One joint and the laws that hold inside its clearance.

    Attributes:
        clearance: radial, 0 for the ideal joint [m].
        journal_radius: [m]; the bearing is larger by the clearance.
        contact: normal force law.
        friction: tangential force law.
        film: what fills the gap.
        bearing: shape of the bore.
    """

    clearance: float = 0.0
    journal_radius: float = 0.01
    contact: ContactLaw = field(default_factory=LankaraniNikravesh)
    friction: Law = field(default_factory=Frictionless)
    film: Law = field(default_factory=Dry)
    bearing: Law = field(default_factory=Round)

    def __post_init__(self) -> None:
        require_kind(self, ContactLaw, contact=self.contact)
        require_kind(self, Family.FRICTION, friction=self.friction)
        require_kind(self, Family.FILM, film=self.film)
        require_kind(self, Family.BEARING, bearing=self.bearing)
        require(self, *CLEARANCE_RANGE, clearance=self.clearance)
        require(self, strict=True, journal_radius=self.journal_radius)
        if isinstance(self.bearing, Worn) and 0.0 < self.clearance <= self.bearing.amplitude:
            raise InputError(
                f"bearing.amplitude = {self.bearing.amplitude:g} m closes the bore of a joint with "
                f"{self.clearance:g} m of clearance; set bearing.amplitude below it, or change the key that "
                "ends in 'clearance'"
            )

    @property
    def loose(self) -> bool:
        """Whether the joint has clearance."""
        return self.clearance > 0.0

    def numbers(self) -> dict[Parameter, float]:
        """Entries of the joint's block, named as for joint B."""
        if not self.loose:
            return {}
        return {
            Parameter.JOINT_CLEARANCE: self.clearance,
            Parameter.JOINT_STIFFNESS: self.contact.stiffness(self.journal_radius, self.clearance),
            Parameter.JOINT_HYSTERESIS: self.contact.hysteresis,
            Parameter.JOINT_JOURNAL_RADIUS: self.journal_radius,
            **self.friction.numbers(),
            **self.film.numbers(),
            **self.bearing.numbers(),
        }
