"""Real sensors between mechanism and recording: linear and electrical effects in a chain, off by default.

The order is that of the signal's way through an instrument, and each step acts on what the one before it
passes on:

1. mounting: which direction the housing looks is geometry, before anything electrical;
2. gain, bandwidth, delay: linear and time-invariant, so their order among themselves does not matter;
3. bias: an offset of the output, neither filtered nor scaled by the sensitivity;
4. noise: that of the electronics, added to the output (a bandwidth limit before it does not colour it);
5. saturation and resolution: the converter's range and step, last, since they see everything.

The steps act on a recording that is already band-limited and sampled: linear time-invariant effects commute
with the measurement chain's own filter, and white noise of the electronics is white up to the recording's
Nyquist frequency.

References: first-order instrument and its corner frequency: Doebelin 2004, Measurement Systems, 5th ed., ch.
3.3. Band-limited fractional delay: Oppenheim & Schafer 2010, Discrete-Time Signal Processing, 3rd ed., sec.
4.5.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from clearance.errors import InputError
from clearance.recording.bounds import bounded, listing, resembling
from clearance.recording.channels import ACCELERATIONS, AXIS_PAIRS, require_channel
from clearance.recording.recording import Recording

FloatArray = NDArray[np.float64]

_FIRST_AXIS = {first: turned for first, turned in AXIS_PAIRS}
_TURNED_AXIS = {turned: first for first, turned in AXIS_PAIRS}


@dataclass(frozen=True)
class Sensor:
    """One sensor; the defaults are an ideal one.

    Attributes:
        gain: output over input at zero frequency [-], not 0; negative where the sensor is mounted backwards.
        bias: offset of the output [unit of the channel].
        noise: white noise as a fraction of the standard deviation of the channel in this recording [-], 0 to
            10; a channel that is constant gets none.
        noise_density: white noise [unit of the channel / √Hz], one-sided, up to the Nyquist frequency.
        mounting_angle: angle from the nominal axis to the sensor's, positive counter-clockwise [deg], -180 to
            180.
        bandwidth: corner frequency (-3 dB) of a first-order low-pass [Hz], at most 1e7; None: unlimited.
        delay: time by which the output is late [s], -0.01 (early, beside others) to 1; any fraction of a
            sample.
        saturation: the output stays within ± this value [unit of the channel]; None: unlimited.
        resolution: step of the output [unit of the channel], rounded to the nearest; 0: continuous. An
            encoder with 4096 counts a turn has 2π/4096.
    """

    gain: float = 1.0
    bias: float = 0.0
    noise: float = 0.0
    noise_density: float = 0.0
    mounting_angle: float = 0.0
    bandwidth: float | None = None
    delay: float = 0.0
    saturation: float | None = None
    resolution: float = 0.0

    def __post_init__(self) -> None:
        for name, (low, high, unit) in _LIMITS.items():
            value = getattr(self, name)
            if value is not None or name not in _OPTIONAL:
                object.__setattr__(self, name, bounded(value, f"sensor {name}", low, high, unit))
        if self.gain == 0.0:
            raise InputError("sensor gain: 0 gives no signal; give a number other than 0, from -1000 to 1000")


_LIMITS: Mapping[str, tuple[float, float, str]] = {
    "gain": (-1e3, 1e3, ""),
    "bias": (-1e6, 1e6, ""),
    "noise": (0.0, 10.0, "of the standard deviation"),
    "noise_density": (0.0, 1e6, ""),
    "mounting_angle": (-180.0, 180.0, "deg"),
    "bandwidth": (1e-3, 1e7, "Hz"),
    "delay": (-0.01, 1.0, "s"),
    "saturation": (1e-9, 1e9, ""),
    "resolution": (0.0, 1e6, ""),
}
_OPTIONAL = ("bandwidth", "saturation")
SENSOR_KEYS: tuple[str, ...] = tuple(entry.name for entry in fields(Sensor))
IDEAL = Sensor()


@dataclass(frozen=True)
class SensorChain:
    """The sensors of a recording; without arguments, the null member: every sensor ideal.

    Attributes:
        sensors: channel to its sensor (or the sensor's keys), where it differs from the default.
        default: the sensor of every acceleration that `sensors` does not name; other channels are ideal by
            default.
    """

    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    default: Sensor = IDEAL

    def __post_init__(self) -> None:
        # A configuration gives plain keys: OmegaConf would turn nested `Sensor` objects into mappings again.
        object.__setattr__(self, "default", _as_sensor(self.default, "sensor_chain.default"))
        named = {}
        for name, given in self.sensors.items():
            channel = require_channel(name, "sensor_chain.sensors")
            sensor = _as_sensor(given, f"sensor_chain.sensors.{channel}")
            if sensor.mounting_angle and channel not in ACCELERATIONS:
                raise InputError(
                    f"sensor_chain.sensors.{channel}.mounting_angle: {sensor.mounting_angle:g} deg has no "
                    "meaning; only accelerations have a mounting angle, leave it at 0"
                )
            named[channel] = sensor
        object.__setattr__(self, "sensors", named)

    def sensor(self, channel: str) -> Sensor:
        """Return the sensor of one channel."""
        return self.sensors.get(channel, self.default if channel in ACCELERATIONS else IDEAL)

    def apply(self, recording: Recording, generator: np.random.Generator) -> Recording:
        """Return what these sensors would have recorded.

        Args:
            recording: the signals as they are.
            generator: source of the noise; drawn from for noisy sensors only, in the order of the channels.

        Raises:
            InputError: a mounting angle needs the other axis of the point, and the recording lacks it.
        """
        if all(self.sensor(name) == IDEAL for name in recording.channels):
            return recording
        measured = np.column_stack(
            [self._measure(name, recording, generator) for name in recording.channels]  # one draw order
        )
        return Recording(
            measured, recording.channels, recording.rate, recording.start_time, recording.metadata
        )

    def _measure(self, channel: str, recording: Recording, generator: np.random.Generator) -> FloatArray:
        sensor = self.sensor(channel)
        signal = _mounted(channel, sensor.mounting_angle, recording)
        if sensor.gain != 1.0:
            signal = sensor.gain * signal
        signal = _respond(signal, recording.rate, sensor.bandwidth, sensor.delay)
        level = math.hypot(
            sensor.noise * float(np.std(signal)), sensor.noise_density * math.sqrt(0.5 * recording.rate)
        )
        if sensor.bias:
            signal = signal + sensor.bias
        if level:
            signal = signal + level * generator.standard_normal(len(signal))
        if sensor.saturation is not None:
            signal = np.clip(signal, -sensor.saturation, sensor.saturation)
        if sensor.resolution:
            signal = sensor.resolution * np.round(signal / sensor.resolution)
        return signal


def declared_chain(recording: Recording) -> SensorChain:
    """Return the sensors that the recording's metadata declare; ideal where they declare none."""
    declared: Mapping[str, Mapping[str, float]] = recording.metadata.get("sensors", {})
    return SensorChain({name: declared_sensor(entry, f"sensors.{name}") for name, entry in declared.items()})


def _as_sensor(given: object, key: str) -> Sensor:
    if isinstance(given, Sensor):
        return given
    if isinstance(given, Mapping):
        return declared_sensor(given, key)
    raise InputError(f"{key}: {given!r} is no sensor; give a mapping with keys out of {listing(SENSOR_KEYS)}")


def declared_sensor(entry: Mapping[str, float], key: str) -> Sensor:
    """Return the sensor of one declaration; its `position` is the mechanism's business and is passed over."""
    unknown = [str(name) for name in entry if name != "position" and name not in SENSOR_KEYS]
    if unknown:
        allowed = ("position", *SENSOR_KEYS)
        raise InputError(
            f"{key}: unknown key {listing(unknown)}{resembling(unknown[0], allowed)}; allowed are "
            f"{listing(allowed)}"
        )
    try:
        return Sensor(**{name: value for name, value in entry.items() if name != "position"})
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def _mounted(channel: str, angle: float, recording: Recording) -> FloatArray:
    """Return what a sensor sees whose axis is turned by `angle` [deg] from the channel's."""
    signal = recording.channel(channel)
    if angle == 0.0:
        return signal
    other = _FIRST_AXIS.get(channel) or _TURNED_AXIS[channel]
    if other not in recording.channels:
        raise InputError(
            f"sensor {channel}: mounting_angle {angle:g} deg mixes in {other}, which the recording does not "
            f"have; record {other} too, or set the angle to 0"
        )
    # The first axis turns towards the second, the second away from the first.
    sign = 1.0 if channel in _FIRST_AXIS else -1.0
    turn = math.radians(angle)
    return math.cos(turn) * signal + sign * math.sin(turn) * recording.channel(other)


def _respond(signal: FloatArray, rate: float, bandwidth: float | None, delay: float) -> FloatArray:
    """Return the signal behind a first-order low-pass at `bandwidth` [Hz] and a pure `delay` [s].

    The signal is continued by its mirror image, which has no jump for a band-limited shift to ring on; at the
    start the output is therefore that of the mirrored past.
    """
    shift = delay * rate
    if shift >= len(signal):
        raise InputError(
            f"sensor delay: {delay:g} s is not shorter than the recording ({len(signal) / rate:g} s); give "
            "less"
        )
    if bandwidth is None and shift == 0.0:
        return signal
    mirrored = np.concatenate([signal, signal[::-1]])
    whole = round(shift)
    # 1e-9 samples: `delay * rate` of a whole number of samples is whole only up to rounding.
    if bandwidth is None and abs(shift - whole) < 1e-9:
        return np.roll(mirrored, whole)[: len(signal)]
    frequency = np.fft.rfftfreq(len(mirrored), 1.0 / rate)
    response = np.exp(-2j * np.pi * frequency * delay)
    if bandwidth is not None:
        response /= 1.0 + 1j * frequency / bandwidth
    return np.fft.irfft(np.fft.rfft(mirrored) * response, len(mirrored))[: len(signal)]
