"""Undo what a recording declares of its sensors: the inverse of the invertible part of ``sensors``.

Bias, gain, delay and mounting angle are taken out, so that a model trained on ideal sensors can read the
recording, and a bandwidth where that makes no noise more than twice as loud: from 0.29 of the rate on. A
narrower one stays, like the noise. An encoder's angle that begins again after each turn, or after several, is
counted on.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from clearance.errors import InputError
from clearance.recording.channels import AXIS_PAIRS
from clearance.recording.recording import Recording
from clearance.recording.sensors import declared_chain

_ENCODER = "crank_angle"
_TURN = 2.0 * np.pi  # rad
_TOO_FAR = 0.4  # from sample to sample, of the turns after which an angle begins again
_LOUDER = 2.0  # times: amplification, near the Nyquist frequency, up to which a bandwidth is undone
_PARALLEL = 0.1  # cosine of the angle by which two axes differ from a right one: less tells them not apart


def corrected(recording: Recording, channels: Sequence[str] | None = None) -> Recording:
    """What ideal sensors would have written; the same object where nothing is declared or begins again.

    Args:
        recording: as it was read.
        channels: that are wanted, in their order: what is wrong with others does no harm; ``None``: all.

    Raises:
        InputError: if an angle that begins again turns too far between samples, or does so after no whole
            number of turns; if a mounting angle is declared for an axis whose partner was not recorded, or
            leaves both axes of a pair along about one direction.
    """
    if channels is not None:
        partners = {name for pair in AXIS_PAIRS if set(pair) & set(channels) for name in pair}
        beside = [name for name in recording.channels if name in partners and name not in channels]
        return corrected(recording.select([*channels, *beside])).select(channels)
    recording = _counted_on(recording)
    chain = declared_chain(recording)
    if not chain.sensors:
        return recording
    columns = {name: recording.values[:, i].copy() for i, name in enumerate(recording.channels)}
    for name, sensor in chain.sensors.items():
        if name in columns:
            plain = (columns[name] - sensor.bias) / sensor.gain
            columns[name] = _restored(plain, recording.rate, sensor.delay, sensor.bandwidth)
    for first, turned in AXIS_PAIRS:
        alpha, beta = (np.radians(chain.sensor(name).mounting_angle) for name in (first, turned))
        if alpha == 0.0 and beta == 0.0:
            continue
        missing = [name for name in (first, turned) if name not in columns]
        if len(missing) == 2:
            continue
        if missing:
            if (beta if missing == [first] else alpha) == 0.0:
                continue  # what is recorded looks along its own axis
            raise InputError(
                f"sensors: a mounting_angle mixes {first} and {turned}, but {missing[0]} is not recorded; "
                "record it too, or leave the angle out"
            )
        if abs(np.cos(alpha - beta)) < _PARALLEL:
            raise InputError(
                f"sensors: mounting_angle = {np.degrees(alpha):g} of {first} and {np.degrees(beta):g} of "
                f"{turned} leave both along one direction; correct sensors.{first}.mounting_angle or "
                f"sensors.{turned}.mounting_angle"
            )
        mixing = np.array([[np.cos(alpha), np.sin(alpha)], [-np.sin(beta), np.cos(beta)]])
        columns[first], columns[turned] = np.linalg.solve(mixing, np.stack([columns[first], columns[turned]]))
    return replace(recording, values=np.stack([columns[name] for name in recording.channels], axis=1))


def _counted_on(recording: Recording) -> Recording:
    """The recording with an encoder's angle that goes on from turn to turn."""
    if _ENCODER not in recording.channels:
        return recording
    angle = recording.channel(_ENCODER)
    if not _jumps_back(angle):
        return recording
    span = float(np.ptp(angle)) / _TURN
    turns = max(round(span), 1)
    onward = np.unwrap(angle, period=turns * _TURN)
    turned = float(np.median(np.abs(np.diff(onward)))) / _TURN
    every = "each turn" if turns == 1 else f"{turns} turns"
    if turned > _TOO_FAR * turns:
        raise InputError(
            f"{_ENCODER} begins again after {every} and goes {turned:.2f} turns from sample to sample; "
            f"above {_TOO_FAR * turns:g} nobody can say which way: give it counted on from turn to turn, or "
            "record faster"
        )
    if _jumps_back(onward):
        raise InputError(
            f"{_ENCODER} covers {span:.2f} turns and jumps back by others than {every}: where it begins "
            "again cannot be told; give it counted on from turn to turn"
        )
    values = recording.values.copy()
    values[:, recording.channels.index(_ENCODER)] = onward
    return replace(recording, values=values)


def _jumps_back(angle: np.ndarray) -> bool:
    """Whether (samples,) angles anywhere go more than half a turn against the sense of most steps."""
    steps = np.diff(angle)
    sense = np.sign(np.sign(steps).sum())
    return bool(((np.abs(steps) > _TURN / 2.0) & (steps * sense <= 0.0)).any())


def _restored(signal: np.ndarray, rate: float, delay: float, bandwidth: float | None) -> np.ndarray:
    """The signal earlier and before its low-pass, if that can be undone; continued by its mirror image."""
    wide = bandwidth is not None and np.hypot(1.0, 0.5 * rate / bandwidth) <= _LOUDER
    corner = bandwidth if bandwidth is not None and wide else np.inf
    if abs(delay) * rate >= len(signal):
        raise InputError(
            f"sensor delay: {delay:g} s is not shorter than the recording ({len(signal) / rate:g} s); give "
            "less"
        )
    if delay == 0.0 and not wide:
        return signal
    mirrored = np.concatenate([signal, signal[::-1]])
    frequency = np.fft.rfftfreq(len(mirrored), 1.0 / rate)
    back = np.exp(2j * np.pi * frequency * delay) * (1.0 + 1j * frequency / corner)
    return np.fft.irfft(np.fft.rfft(mirrored) * back, len(mirrored))[: len(signal)]
