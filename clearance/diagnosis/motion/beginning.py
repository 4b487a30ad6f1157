"""First guess of how a recording began: the crank's angle and speed, from whichever channel tells them."""

import numpy as np

from clearance.diagnosis.motion.track import Track
from clearance.errors import InputError

_HARMONICS = 3
_LOOK = 3.0  # s at most from which speed and phase are found


def begin(track: Track, speeds: tuple[float, float], zero: float = 0.0) -> np.ndarray:
    """(5,) angle [rad], speed [rad/s], integral 0, drive's speed [rpm], encoder's zero at the first sample.

    Args:
        track: the recording.
        speeds: range [rad/s] in which the speed is looked for where no channel tells it.
        zero: of the encoder [rad].

    Raises:
        InputError: no channel tells how the crank turns.
    """
    time = np.arange(len(track.values)) / track.rate
    named = {c: track.values[:, i] for i, c in enumerate(track.channels)}
    count = len(time)
    first = max(6, count // 50)
    late = slice(count // 2, None)
    if "crank_angle" in named:
        angle = named["crank_angle"]
        slope = float(np.polyfit(time[:first], angle[:first], 1)[0])
        final = float(np.polyfit(time[late], angle[late], 1)[0])
        return np.array([angle[0] - zero, slope, 0.0, final * 30.0 / np.pi, zero])
    if "slider_position" not in named and "slider_velocity" not in named:
        raise InputError(
            f"{track.name}: has {', '.join(track.channels)}; crank_angle, slider_position or slider_velocity "
            "is needed to know where the crank stands"
        )
    channel = "slider_position" if "slider_position" in named else "slider_velocity"
    part = time < _LOOK
    values = named[channel][part]
    if "crank_speed" in named:
        measured = named["crank_speed"]
        turned = np.concatenate([[0.0], np.cumsum(0.5 * (measured[1:] + measured[:-1])) / track.rate])[part]
        sense = 1.0 if measured.mean() >= 0.0 else -1.0
        phase = _phase(values, turned)[1]
        start = float(np.median(measured[:first]))
        final = float(measured[late].mean())
    else:
        grid = np.arange(speeds[0], speeds[1], 2.0 * np.pi / (4.0 * time[part][-1]))
        rests = [_phase(values, trial * time[part])[0] for trial in grid]
        start = final = float(grid[np.argmin(rests)])
        sense, phase = 1.0, _phase(values, start * time[part])[1]
    # the slider stands farthest out at angle zero; its velocity is a quarter turn ahead
    stands = phase if channel == "slider_position" else phase - sense * np.pi / 2.0
    return np.array([np.mod(stands, 2.0 * np.pi), start, 0.0, final * 30.0 / np.pi, 0.0])


def _phase(values: np.ndarray, turned: np.ndarray) -> tuple[float, float]:
    """What harmonics of an angle leave unexplained, and the phase of the first [rad]."""
    columns = [np.ones_like(turned)]
    for k in range(1, _HARMONICS + 1):
        columns += [np.cos(k * turned), np.sin(k * turned)]
    basis = np.stack(columns, axis=1)
    weights, *_ = np.linalg.lstsq(basis, values, rcond=None)
    rest = float(((values - basis @ weights) ** 2).sum())
    sizes = np.hypot(weights[1::2], weights[2::2])
    if sizes[0] < sizes[1:].max():  # a fraction of the true speed, whose harmonics fit as well
        rest = np.inf
    # A cos(turned + phase) has weights A cos(phase) and -A sin(phase)
    return rest, float(np.arctan2(-weights[2], weights[1]))
