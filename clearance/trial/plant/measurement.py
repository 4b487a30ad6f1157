"""What instruments make of the plant's signals: faults, filter, sampling, noise; own code throughout.

Order: resonance of the sensor at the base rate, filter, sampling (late by the delay, at the clock's true
rate), misalignment, gain, noise, bias, saturation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import cheby1, cont2discrete, lfilter, sosfiltfilt

FloatArray = NDArray[np.float64]

# In pairs of one place: transverse, then axial (for the slider: vertical, then horizontal).
ACCELERATIONS = (
    "crank_a_transverse",
    "crank_a_axial",
    "crank_b_transverse",
    "crank_b_axial",
    "rod_b_transverse",
    "rod_b_axial",
    "rod_c_transverse",
    "rod_c_axial",
    "slider_vertical",
    "slider_horizontal",
)
CHANNELS = (
    *ACCELERATIONS,
    "crank_angle",
    "crank_speed",
    "drive_torque",
    "slider_position",
    "slider_velocity",
)
MARGIN = 0.01  # s simulated beyond both ends of a recording, for the filter's edges
NOISE_FLOOR = 0.01  # of the quietest acceleration: noise of a channel that does not move
_STILL = 1e-6  # of the liveliest acceleration: a channel that moves less than that does not move
_KINDS = {
    "sensor_gain": ("gain",),
    "sensor_bias": ("bias",),
    "sensor_misalignment": ("angle",),
    "sensor_delay": ("delay",),
    "sensor_resonance": ("frequency", "damping"),
    "sensor_saturation": ("limit",),
    "timebase": ("rate_error",),
}


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault of an instrument; give the numbers of its kind, leave the others.

    Attributes:
        kind: ``sensor_gain``, ``sensor_bias``, ``sensor_misalignment``, ``sensor_delay``,
            ``sensor_resonance``, ``sensor_saturation``; ``timebase`` (of all channels).
        channel: one of ``CHANNELS``; an acceleration for resonance and misalignment.
        gain: output over input [-].
        bias: [m/s²].
        angle: of the sensor's axis, counter-clockwise from the nominal one [rad].
        delay: by which the output is late [s].
        frequency: of the sensor's own resonance [Hz]: w0² / (s² + 2 damping w0 s + w0²).
        damping: of the resonance [-].
        limit: the output stays within ± this [m/s²].
        rate_error: samples are taken at the stated rate times 1 + this [-].
    """

    kind: str
    channel: str = ""
    gain: float = 1.0
    bias: float = 0.0
    angle: float = 0.0
    delay: float = 0.0
    frequency: float = 0.0
    damping: float = 0.0
    limit: float = 0.0
    rate_error: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise ValueError(f"Fault.kind = {self.kind!r}; choose from {', '.join(_KINDS)}")
        if self.kind != "timebase" and self.channel not in CHANNELS:
            raise ValueError(f"Fault.channel = {self.channel!r}; choose from {', '.join(CHANNELS)}")
        if self.kind in ("sensor_misalignment", "sensor_resonance") and self.channel not in ACCELERATIONS:
            raise ValueError(f"{self.kind} of {self.channel}: only accelerations have one")
        if abs(self.delay) > 0.5 * MARGIN:
            raise ValueError(f"Fault.delay = {self.delay:g} s is beyond {0.5 * MARGIN:g} s")
        for name in ("frequency", "limit"):
            if name in _KINDS[self.kind] and not getattr(self, name) > 0.0:
                raise ValueError(f"{self.kind} needs {name} > 0")


def low_pass(values: FloatArray, decimation: int) -> FloatArray:
    """The chain's filter at the base rate, unit gain at zero frequency.

    Args:
        values: (samples, channels).
        decimation: samples to one of the recording; 1 leaves the signal as it is.
    """
    if decimation == 1:
        return values
    sections = cheby1(8, 0.05, 0.8 / decimation, output="sos")
    gain = np.prod(sections[:, :3].sum(axis=1) / sections[:, 3:].sum(axis=1)) ** 2
    return sosfiltfilt(sections, values, axis=0, padtype="constant") / gain


def resonate(signal: FloatArray, base_rate: float, frequency: float, damping: float) -> FloatArray:
    """Second-order response [unit of the signal], from rest at the first value."""
    omega = 2.0 * pi * frequency
    transfer = ([omega**2], [1.0, 2.0 * damping * omega, omega**2])
    numerator, denominator, _ = cont2discrete(transfer, 1.0 / base_rate, method="foh")
    return signal[0] + lfilter(np.ravel(numerator), denominator, signal - signal[0])


def measure(
    signals: FloatArray,
    base_rate: float,
    duration: float,
    record_start: float,
    channels: Sequence[str],
    rate: float,
    noise: float,
    seed: int,
    encoder_counts: int | None,
    faults: Sequence[Fault],
) -> dict[str, FloatArray]:
    """Turn signals at the base rate into a recording; see ``Plant.recording``."""
    decimation = round(base_rate / rate)
    if decimation < 1 or abs(decimation * rate - base_rate) > 1e-6 * base_rate:
        raise ValueError(f"rate = {rate:g} Hz must divide {base_rate:g} Hz")
    if record_start < MARGIN:
        raise ValueError(f"record_start = {record_start:g} s is below {MARGIN:g} s, which the filter needs")
    unknown = [name for name in channels if name not in CHANNELS]
    if unknown:
        raise ValueError(f"channels {unknown} are unknown; choose from {', '.join(CHANNELS)}")
    signals = signals.copy()
    for fault in faults:
        if fault.kind == "sensor_resonance":
            column = CHANNELS.index(fault.channel)
            signals[:, column] = resonate(signals[:, column], base_rate, fault.frequency, fault.damping)
    first = round((record_start - MARGIN) * base_rate)
    raw = signals[first:]
    smooth = low_pass(raw, decimation)

    count = round(duration * rate)
    clock = 1.0 + sum(fault.rate_error for fault in faults if fault.kind == "timebase")
    times = record_start - first / base_rate + np.arange(count) / (rate * clock)
    late = {name: 0.0 for name in CHANNELS}
    for fault in faults:
        if fault.kind == "sensor_delay":
            late[fault.channel] += fault.delay

    @cache
    def sampled(name: str, lateness: float) -> FloatArray:
        column = (raw if name == "crank_angle" else smooth)[:, CHANNELS.index(name)]
        return _sample(column, base_rate, times - lateness)

    spread = {name: float(np.std(sampled(name, late[name]))) for name in ACCELERATIONS}
    still = _STILL * max(spread.values())
    floor = NOISE_FLOOR * min((value for value in spread.values() if value > still), default=0.0)
    table = {"time": np.arange(count) / rate}
    for name in channels:
        values = _mount(name, late[name], sampled, faults)
        for fault in faults:
            if fault.channel == name:
                values = fault.gain * values
        if name == "crank_angle":
            values = _encode(values, encoder_counts)
        elif noise > 0.0:
            level = noise * float(np.std(values))
            if name in ACCELERATIONS and spread[name] <= still:
                level = floor
            generator = np.random.default_rng([seed, CHANNELS.index(name)])
            values = values + level * generator.standard_normal(count)
        for fault in faults:
            if fault.channel == name:
                values = values + fault.bias
        for fault in faults:
            if fault.channel == name and fault.kind == "sensor_saturation":
                values = np.clip(values, -fault.limit, fault.limit)
        table[name] = values
    return table


def _sample(values: FloatArray, base_rate: float, times: FloatArray) -> FloatArray:
    """Values at any times, by a spline of fifth order; exact on the grid."""
    position = times * base_rate
    nearest = np.round(position).astype(int)
    if np.abs(position - nearest).max() < 1e-6:
        return values[nearest]
    return make_interp_spline(np.arange(len(values)), values, k=5)(position)


def _mount(
    name: str, late: float, sampled: Callable[[str, float], FloatArray], faults: Sequence[Fault]
) -> FloatArray:
    """What a turned sensor feels: its own axis and, in part, the other one of its place, both as late."""
    angle = sum(fault.angle for fault in faults if fault.channel == name)
    if angle == 0.0:
        return sampled(name, late)
    index = ACCELERATIONS.index(name)
    # an axial sensor turns towards the transverse axis, a transverse one away from the axial axis
    other, sign = (ACCELERATIONS[index + 1], -1.0) if index % 2 == 0 else (ACCELERATIONS[index - 1], 1.0)
    return cos(angle) * sampled(name, late) + sign * sin(angle) * sampled(other, late)


def _encode(angle: FloatArray, counts: int | None) -> FloatArray:
    """Unwrapped angle from a first turn on, in whole counts."""
    turn = 2.0 * pi
    angle = angle - turn * np.floor(angle[0] / turn)
    return angle if counts is None else np.round(angle * counts / turn) * turn / counts
