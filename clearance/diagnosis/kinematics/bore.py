"""Where a loaded journal rests in its bearing, whose bore may be worn into lobes."""

from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.kinematics.rigid_motion import Felt
from clearance.mechanism.parameters import JOINT_STRIDE, Parameter

_TILTED = 3  # times that the direction from the centre is corrected where the bore is not round


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

    def rest(self, normal: np.ndarray, felt: Felt) -> np.ndarray:
        """(2, samples) where a journal rests whose force has these directions: along them and across [m]."""
        pressed = self.angle(normal, felt)
        tilt = np.zeros(len(normal))
        for _ in range(_TILTED):  # the surface's normal is not radial
            radius, slope = self._lobes(pressed + tilt)
            tilt = np.arctan2(slope, radius)
        return radius * np.stack([np.cos(tilt), np.sin(tilt)])

    def _lobes(self, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(samples,) clearance [m] and its change [m/rad] at angles in the bearing."""
        place = self.order * angle + self.phase
        return (
            self.clearance + self.amplitude * np.cos(place),
            -self.amplitude * self.order * np.sin(place),
        )
