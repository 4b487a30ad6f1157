"""First guess: which speed and phase of the ideal mechanism fit a recording best, and where journals lie.

With ideal joints every signal is a function of the crank angle times a power of the speed. That is close
enough to a machine with clearance to find its speed and phase, and the ideal joint forces tell on which side
of its bearing a journal rests.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from clearance.errors import InputError
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.frame import FixedFrame
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Result, Signal, State
from clearance.simulation.trajectory import simulate_trajectory

_BINS = 720
_HARMONICS = 8


@dataclass(frozen=True)
class Cycle:
    """One revolution of the ideal mechanism at a reference speed, on a grid of crank angles.

    Attributes:
        speed: [rad/s].
        signals: (bins, SIGNALS).
        force_b: (bins, 2) on the crank at B [N]; the journal at B rests against its negative.
        force_c: (bins, 2) on the rod at C [N].
    """

    speed: float
    signals: np.ndarray
    force_b: np.ndarray
    force_c: np.ndarray

    @staticmethod
    def of(machine: SliderCrank, speed: float) -> "Cycle":
        """Simulate one revolution at a nearly constant speed [rad/s]."""
        period = 2.0 * np.pi / abs(speed)
        step = period / _BINS / 4.0
        inertia = 1.0 / machine.parameters()[Parameter.CRANK_INVERSE_INERTIA]
        # as stiff as the explicit scheme bears: the speed hardly ripples
        stiff = SpeedControl(speed * 30.0 / np.pi, proportional=inertia / step, integral=0.0, ramp=0.0)
        tight = replace(
            machine,
            joint_b=replace(machine.joint_b, clearance=0.0),
            joint_c=replace(machine.joint_c, clearance=0.0),
            drive=stiff,
            frame=FixedFrame(),  # a frame that moves answers to the speed by more than a power of it
        )
        run = simulate_trajectory(tight, Integrator("runge_kutta_4", step), 2.5 * period, 4)
        angle = run.states[:, State.CRANK_ANGLE] * np.sign(speed)
        first = int(np.searchsorted(angle, 2.0 * np.pi)) - 1
        part = slice(first, None)
        grid = 2.0 * np.pi * np.arange(_BINS) / _BINS

        def resample(columns: np.ndarray) -> np.ndarray:
            places = grid * np.sign(speed) % (2.0 * np.pi) + 2.0 * np.pi
            return np.stack([np.interp(places, angle[part], c) for c in columns[part].T], axis=1)

        forces = resample(run.results[:, Result.FORCE_B_X : Result.FORCE_C_Y + 1])
        return Cycle(speed, resample(run.signals), forces[:, :2], forces[:, 2:])


_OF_THE_DRIVE = (
    Signal.CRANK_A_TRANSVERSE, Signal.CRANK_B_TRANSVERSE, Signal.DRIVE_TORQUE, Signal.CRANK_ANGLE
)  # fmt: skip
_POWER = np.array([2.0] * 10 + [0.0, 1.0, 2.0, 0.0, 1.0])  # of the speed, by Signal


def align(
    machine: SliderCrank,
    values: np.ndarray,
    signals: tuple[int, ...],
    rate: float,
    speed_range: tuple[float, float],
) -> tuple[float, float, float]:
    """Speed [rad/s] and crank angle at the first sample [rad], and the share of variance they explain.

    An encoder tells both; what they explain is then said of the other channels, at the angle that suits them
    best, since the encoder's zero may be off.

    Args:
        machine: with any joints; taken with ideal ones.
        values: (samples, channels).
        signals: rows of ``Signal`` of the columns.
        rate: [Hz].
        speed_range: speeds to try [rad/s].
    """
    low, high = speed_range
    cycle = Cycle.of(machine, np.sqrt(low * high))
    shapes = np.fft.rfft(cycle.signals, axis=0)[: _HARMONICS + 1] / _BINS
    columns = [i for i, s in enumerate(signals) if s not in _OF_THE_DRIVE]
    columns = [i for i in columns if np.abs(shapes[1:, signals[i]]).max() > 1e-9]
    time = np.arange(len(values)) / rate
    told = None
    if Signal.CRANK_ANGLE in signals:
        speed, start = np.polyfit(time, values[:, signals.index(Signal.CRANK_ANGLE)], 1)
        told = (float(speed), float(start))
        low = high = max(abs(told[0]), 2.0 * np.pi / time[-1])  # a crank may stand still
    if not columns:
        if told is not None:
            return *told, 1.0
        raise InputError("recordings: no channel turns with the crank; give rod, crank or slider channels")
    # one or two revolutions of the slowest speed, at no more than fifty samples a revolution of the fastest
    length = min(len(values), round(2.5 * 2.0 * np.pi / low * rate))
    thin = max(1, int(rate / (50.0 * high / (2.0 * np.pi))))
    smooth = np.ones(thin) / thin
    data = np.stack([np.convolve(values[:length, i], smooth, "same")[::thin] for i in columns], axis=1)
    when = time[:length:thin]
    deviation = np.sqrt((data**2).mean(axis=0))
    data = data / deviation
    phases = np.exp(1j * np.outer(np.arange(1, _HARMONICS + 1), 2.0 * np.pi * np.arange(360) / 360))
    best = (-np.inf, 0.0, 0.0)
    step = 0.5 / when[-1]
    # of less than a turn the harmonics cannot be told apart: huge ones that cancel would score best
    slowest = min(max(low, 2.0 * np.pi / when[-1]), high)
    for speed in np.arange(slowest, high + step, step) if told is None else told[:1]:
        waves = np.exp(1j * speed * np.outer(when, np.arange(1, _HARMONICS + 1)))
        basis = np.concatenate([np.ones((len(when), 1)), waves.real, waves.imag], axis=1)
        found = np.linalg.lstsq(basis, data, rcond=None)[0]
        measured = found[1 : _HARMONICS + 1] - 1j * found[_HARMONICS + 1 :]  # y = Re(measured wave)
        scale = (speed / cycle.speed) ** _POWER[[signals[i] for i in columns]]
        expected = 2.0 * shapes[1:, [signals[i] for i in columns]] * scale
        expected = expected / deviation
        cross = (np.conj(measured)[:, :, None] * expected[:, :, None] * phases[:, None, :]).real.sum((0, 1))
        energy = (np.abs(expected) ** 2).sum()
        score = cross - 0.5 * energy
        index = int(score.argmax())
        if score[index] > best[0]:
            best = (float(score[index]), float(speed), 2.0 * np.pi * index / 360)

    def misfit(x: np.ndarray) -> np.ndarray:
        angle = (x[1] + x[0] * when) % (2.0 * np.pi) / (2.0 * np.pi) * _BINS
        index = angle.astype(int) % _BINS
        rest = (angle - np.floor(angle))[:, None]
        rows = cycle.signals[:, [signals[i] for i in columns]]
        shape = rows[index] * (1.0 - rest) + rows[(index + 1) % _BINS] * rest
        power = _POWER[[signals[i] for i in columns]]
        return (shape * (x[0] / cycle.speed) ** power / deviation - data).ravel()

    fit = least_squares(misfit, [best[1], best[2]], loss="soft_l1", x_scale=[1.0, 0.1], max_nfev=60)
    left = misfit(fit.x)
    explained = 1.0 - float((left**2).mean() / np.maximum((data**2).mean(), 1e-300))
    if told is not None:
        return *told, explained
    return float(fit.x[0]), float(fit.x[1] % (2.0 * np.pi)), explained
