"""A path through a whole recording, put together from pieces where it does not hold, or fit, in one."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from clearance.diagnosis.kinematics.reconstruction import Reconstruction, reconstruct
from clearance.diagnosis.sensing.measured import SAMPLES, Measured

_PIECE, _OVERLAP = 60, 4  # segments: about a turn of the crank at 10 kHz; what a smoother knows from one side
_LONGEST = 5000  # segments at once: a smoother keeps 4 kB for each of their samples


def reconstruct_whole(
    measured: Measured, parameters: np.ndarray, joints: Sequence[str], speed: float, angle: float
) -> Reconstruction:
    """Reconstruct the path through all of a recording; arguments as of ``reconstruct``.

    A long one is put together, so that memory is bounded. Where the path leads out of the links' reach, as by
    a clock that is wrong, the crank's phase, which gathers what does not agree, is told anew in each short
    piece. Its misfit is not to be compared with that of one piece.

    Raises:
        LinAlgError: the links do not reach in pieces either.
    """
    total = len(measured.values)
    try:
        if total <= _LONGEST:
            return reconstruct(measured, parameters, joints, speed, angle)
        return _joined(measured, parameters, joints, speed, angle, -(-total // _LONGEST))
    except np.linalg.LinAlgError:
        if total < 2 * _PIECE:
            raise
    return _joined(measured, parameters, joints, speed, angle, total // _PIECE)


def _joined(
    measured: Measured, parameters: np.ndarray, joints: Sequence[str], speed: float, angle: float, count: int
) -> Reconstruction:
    """A path of so many pieces."""
    total = len(measured.values)
    ends = np.linspace(0, total, count + 1).astype(int)
    found: list[Reconstruction] = []
    turning = np.zeros((4, 0))
    for first, last in pairwise(ends):
        low, high = max(int(first) - _OVERLAP, 0), min(int(last) + _OVERLAP, total)
        if first > 0:
            angle = float(turning[0, low * SAMPLES])
        one = reconstruct(measured.part(low, high), parameters, joints, speed, angle)
        inner = slice((first - low) * SAMPLES, (last - low) * SAMPLES)
        turning = np.concatenate([turning, one.turning[:, inner]], axis=1)
        found.append(replace(one, nodes=one.nodes[first - low : last - low]))
    return Reconstruction(
        np.concatenate([one.nodes for one in found]), float(np.mean([one.misfit for one in found])),
        float(np.median([one.force for one in found])), float(np.mean([one.speed for one in found])),
        turning,
    )  # fmt: skip
