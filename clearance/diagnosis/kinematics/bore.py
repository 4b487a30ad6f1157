"""Where a loaded journal rests in its bearing, whose bore may be worn into lobes."""

from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.kinematics.rigid_motion import Felt
from clearance.mechanism.parameters import JOINT_STRIDE, Parameter

_TILTS = 65  # of the surface against the force that are compared where the bore is not round
_FORCED, _PLACED = 0.1, 0.5  # rad: how well the force tells the normal, and the path where the journal is


@dataclass(frozen=True)
class Bore:
    """A loose joint's bearing: clearance c(phi) = c + a cos(k phi + phase), phi in the bearing.

    Attributes:
        joint: B or C.
        clearance: c [m].
        stiffness: of the contact [N/m^1.5].
        amplitude: a [m]; 0 where it is round.
        order: k.
        phase: [rad].
    """

    joint: str
    clearance: float
    stiffness: float
    amplitude: float
    order: float
    phase: float

    @staticmethod
    def of(p: np.ndarray, joint: str) -> "Bore":
        """The bore of a joint, from (PARAMETERS,) of a machine."""
        block = 0 if joint == "B" else JOINT_STRIDE
        sine, cosine = p[Parameter.JOINT_WEAR_SINE + block], p[Parameter.JOINT_WEAR_COSINE + block]
        return Bore(
            joint, float(p[Parameter.JOINT_CLEARANCE + block]), float(p[Parameter.JOINT_STIFFNESS + block]),
            float(p[Parameter.JOINT_WEAR_AMPLITUDE + block]), float(p[Parameter.JOINT_WEAR_ORDER + block]),
            float(np.arctan2(sine, cosine)),
        )  # fmt: skip

    def force(self, felt: Felt) -> np.ndarray:
        """(samples, 2) force of the journal on this bearing [N]: it points to where the journal rests."""
        return felt.force_b if self.joint == "B" else -felt.force_c

    def angle(self, normal: np.ndarray, felt: Felt) -> np.ndarray:
        """(samples,) phi of (samples, 2) directions [rad]: B's bearing is the rod's, C's the slider's."""
        turned: np.ndarray = np.arctan2(normal[:, 1], normal[:, 0])
        return turned - felt.rod_angle if self.joint == "B" else turned

    def radius(self, normal: np.ndarray, felt: Felt) -> np.ndarray:
        """(samples,) clearance in (samples, 2) directions [m]."""
        return self._lobes(self.angle(normal, felt))[0]

    def tilt(self, place: np.ndarray, felt: Felt) -> np.ndarray:
        """(samples,) by how much the surface's normal lags behind (samples, 2) places [rad]."""
        radius, slope = self._lobes(self.angle(place, felt))
        return np.arctan2(slope, radius)

    def rest(self, normal: np.ndarray, felt: Felt, place: np.ndarray | None = None) -> np.ndarray:
        """Where a journal rests whose force has certain directions.

        Where lobes are deep (a k^2 > c, about) several places of the bore have the same normal. It is the one
        near which the journal is or, as long as that is not known, to which its force presses it farthest.

        Args:
            normal: (samples, 2) directions of the force.
            felt: on the path.
            place: (samples, 2) of the journal [m], as far as it is known.

        Returns:
            (2, samples) along the directions and across [m].
        """
        if self.amplitude == 0.0:
            return np.stack([np.full(len(normal), self.clearance), np.zeros(len(normal))])
        steepest = np.arctan2(self.order * abs(self.amplitude), self.clearance - abs(self.amplitude))
        tried = steepest * np.linspace(-1.0, 1.0, _TILTS)[:, None]
        pressed = self.angle(normal, felt)
        radius, slope = self._lobes(pressed + tried)
        if place is None:
            cost = -radius * np.cos(tried)
        else:
            behind = self.angle(place, felt) - pressed
            off = np.angle(np.exp(1j * (behind - tried)))
            cost = ((np.arctan2(slope, radius) - tried) / _FORCED) ** 2 + (off / _PLACED) ** 2
        best = cost.argmin(axis=0)
        tilt, radius = tried[best, 0], radius[best, np.arange(len(normal))]
        return radius * np.stack([np.cos(tilt), np.sin(tilt)])

    def _lobes(self, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(samples,) clearance [m] and its change [m/rad] at angles in the bearing."""
        place = self.order * angle + self.phase
        return (
            self.clearance + self.amplitude * np.cos(place),
            -self.amplitude * self.order * np.sin(place),
        )
