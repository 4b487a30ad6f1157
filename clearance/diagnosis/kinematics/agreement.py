"""How well the motion that was recorded agrees with a machine's geometry, and with which clearance best."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.kinematics.alignment import align
from clearance.diagnosis.kinematics.reconstruction import reconstruct
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.diagnosis.side_by_side import side_by_side
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank

CLEARANCES = np.geomspace(1e-5, 1.3e-3, 20)
"""Clearances [m] that are compared first."""

COMPARED = 130
"""Segments of each recording that tell the clearance."""
_CLOSER = 6  # further clearances around the best one


@dataclass(frozen=True)
class Alignment:
    """Speed [rad/s], angle at the first sample [rad], share of the variance explained."""

    speed: float
    angle: float
    explained: float


@dataclass(frozen=True)
class Profile:
    """How well the motion agrees with each clearance [m]."""

    clearance: np.ndarray
    misfit: np.ndarray

    @property
    def best(self) -> float:
        """The clearance at the least misfit, between the grid's points [m]."""
        i = int(np.argmin(self.misfit))
        if not 0 < i < len(self.misfit) - 1:
            return float(self.clearance[i])
        part = slice(i - 1, i + 2)
        if not np.isfinite(self.misfit[part]).all():
            return float(self.clearance[i])
        place = np.log(self.clearance[part])
        a, b, _ = np.polyfit(place - place[1], self.misfit[part], 2)
        return float(np.exp(place[1] + np.clip(-0.5 * b / a, place[0] - place[1], place[2] - place[1])))


def profile(
    recordings: Sequence[Measured],
    alignments: Sequence[Alignment],
    machine: Callable[[float], SliderCrank],
    workers: int,
) -> Profile:
    """How well the motion of all recordings agrees with each clearance.

    Infinitely badly where no machine has it, or where its links do not reach.

    Args:
        recordings: of one machine.
        alignments: theirs.
        machine: with a clearance [m].
        workers: threads.

    Raises:
        LinAlgError: links that reach at no clearance.
    """

    def misfit(clearances: np.ndarray, segments: int) -> np.ndarray:
        found, machines, places = np.full(len(clearances), np.inf), [], []
        for i, clearance in enumerate(clearances):
            try:
                machines.append(machine(clearance))
            except InputError:  # lobes that close the bore
                continue
            places.append(i)
        if machines:
            found[places] = agreement(recordings, alignments, machines, segments, workers)
        return found

    coarse = misfit(CLEARANCES, COMPARED // 2)
    if not np.isfinite(coarse).any():
        raise np.linalg.LinAlgError("the links reach at no clearance")
    best = int(np.argmin(coarse))
    low, high = CLEARANCES[max(best - 1, 0)], CLEARANCES[min(best + 1, len(CLEARANCES) - 1)]
    fine = np.geomspace(low, high, _CLOSER + 2)
    closer = misfit(fine, COMPARED)
    # the coarse ones saw less of the recordings: they are set level with the others where both were taken
    with np.errstate(invalid="ignore"):  # where there is no machine in either
        apart = closer[[0, -1]] - coarse[[max(best - 1, 0), min(best + 1, len(coarse) - 1)]]
    level = apart[np.isfinite(apart)].mean() if np.isfinite(apart).any() else 0.0
    far = (low > CLEARANCES) | (high < CLEARANCES)
    clearances = np.concatenate([CLEARANCES[far], fine])
    order = np.argsort(clearances)
    return Profile(clearances[order], np.concatenate([coarse[far] + level, closer])[order])


def agreement(
    recordings: Sequence[Measured],
    alignments: Sequence[Alignment],
    machines: Sequence[SliderCrank],
    segments: int,
    workers: int,
) -> np.ndarray:
    """(machines,) how badly the motion of all recordings agrees with each machine's geometry.

    Infinite where the links do not reach.

    Args:
        recordings: of one machine.
        alignments: theirs.
        machines: to compare.
        segments: of each recording that are looked at.
        workers: threads.
    """

    def one(job: tuple[SliderCrank, int]) -> float:
        made, r = job
        known = alignments[r]
        samples = segments * SAMPLES
        parameters, joints = made.parameters(), loose(made)
        try:
            with np.errstate(invalid="ignore"):
                return reconstruct(
                    recordings[r], parameters, joints, known.speed, known.angle, samples
                ).misfit
        except np.linalg.LinAlgError:  # the links do not reach
            return np.inf

    jobs = [(made, r) for made in machines for r in range(len(recordings))]
    return np.array(side_by_side(one, jobs, workers)).reshape(len(machines), -1).mean(axis=1)


def loose(machine: SliderCrank) -> tuple[str, ...]:
    """Joints with clearance."""
    return tuple(j for j, joint in (("B", machine.joint_b), ("C", machine.joint_c)) if joint.loose)


def aligned(measured: Measured, machine: SliderCrank, speed_range: tuple[float, float]) -> Alignment:
    """Speed and angle of a recording, as if its joints were ideal."""
    flat = measured.values.reshape(-1, len(measured.signals))
    return Alignment(*align(machine, flat, measured.signals, measured.chain.rate, speed_range))
