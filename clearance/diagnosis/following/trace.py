"""Where every recording's machine was, before any hypothesis: its path, from which a follower begins."""

from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.following.attempt import COARSE
from clearance.diagnosis.kinematics.agreement import Alignment, loose
from clearance.diagnosis.kinematics.pieces import reconstruct_whole
from clearance.diagnosis.kinematics.reconstruction import Reconstruction
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import NO_FAULT, Measured
from clearance.diagnosis.shooting.follow import Follower
from clearance.errors import InputError
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.layout import State

_REVOLUTIONS = 1.35  # that are followed of each recording
_SHORTEST = 60  # segments that are followed at least
_DRIVE = 5.0  # times as loose is the torque: a drive may be wrong by much
_SKIPPED = 3  # segments at the beginning, which the smoother knows from one side only


@dataclass(frozen=True)
class Trace:
    """A recording with the path that its accelerations show.

    Attributes:
        measured: the recording.
        alignment: of the ideal mechanism.
        path: reconstructed.
        arms: lever arms by which a force turns crank and rod [m].
    """

    measured: Measured
    alignment: Alignment
    path: Reconstruction
    arms: tuple[float, float]

    @staticmethod
    def of(
        measured: Measured, alignment: Alignment, machine: SliderCrank, instrument: Instrument = NO_FAULT
    ) -> "Trace":
        """Reconstruct a whole recording with a machine's clearances and masses, faults of sensors undone."""
        p = machine.parameters()
        path = reconstruct_whole(
            measured.undone(instrument), p, loose(machine), alignment.speed, alignment.angle
        )
        arms = (
            _DRIVE * float(p[Parameter.CRANK_LENGTH]),
            0.5 * float(p[Parameter.ROD_TO_B] + p[Parameter.ROD_TO_C]),
        )
        return Trace(measured, alignment, path, arms)

    @property
    def length(self) -> int:
        """Segments that are followed: a revolution and a third, or a period, if there are as many."""
        wanted = followed_segments(self.measured, self.alignment.speed)
        return min(wanted, len(self.path.nodes) - 2 * _SKIPPED)

    @property
    def speed(self) -> float:
        """That the drive seems to be asked for [rpm]."""
        return self.path.speed * 30.0 / np.pi

    @property
    def margin(self) -> int:
        """Segments that following may skip at the beginning."""
        return min((len(self.path.nodes) - 2 * _SKIPPED) // 2, self.length)

    def forces(self, looseness: float) -> np.ndarray:
        """(inputs,) unknown forces of a share of the joint's typical force [N m, N m, N]."""
        return looseness * self.path.force * np.array([self.arms[0], self.arms[1], 1.0])

    def follower(self, looseness: float) -> Follower:
        """A follower on the path, with unknown forces of a share of the joint's typical force."""
        first = _SKIPPED
        last = min(_SKIPPED + self.length + self.margin, len(self.path.nodes) - _SKIPPED)
        forces = self.forces(looseness)
        follower = Follower(self.measured.part(first, last), COARSE, forces)
        follower.path.nodes[:] = self.path.nodes[first:last]
        time = self.measured.begin + self.measured.segment * np.arange(first, last)
        follower.path.nodes[:, State.TIME] = time
        return follower


def followed_segments(measured: Measured, speed: float) -> int:
    """Segments that are followed of a recording at a speed [rad/s], if there are as many."""
    turn = 2.0 * np.pi / abs(speed) / measured.segment
    return int(max(_SHORTEST, _REVOLUTIONS * turn, measured.period / measured.segment))


def traced_segments(measured: Measured, speed: float) -> int:
    """Segments of a recording at a speed [rad/s] whose path tells where it can be followed."""
    return 2 * (followed_segments(measured, speed) + _SKIPPED)


def check_length(measured: Measured) -> None:
    """Refuse a recording that is too short to follow.

    Raises:
        InputError: it is.
    """
    needed = _SHORTEST + 2 * _SKIPPED
    if len(measured.values) < needed:
        raise InputError(
            f"{measured.name}: {measured.seconds:.2f} s are too short to follow; give "
            f"{3 * needed * measured.segment:.2g} s or more, of which a third is held out, or name "
            "held_out recordings"
        )
