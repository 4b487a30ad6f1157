"""Where to begin: the moment at which a free run of the simulator looks most like the recording.

A chaotic mechanism visits every way of moving that it has. A second of simulation at the right speed holds,
for some revolution, a few milliseconds that are nearly those of the recording at the same crank angle: that
is where the estimator steps in. How near they come also tells the clearance to a few per cent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from clearance.diagnosis.measured import SAMPLES, Measured
from clearance.mechanism.drive import Drive
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import Sampling, run_batch
from clearance.simulation.decimation import Decimation
from clearance.simulation.failure import Failure
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import STATES, Signal, State
from clearance.simulation.shooting import fold
from clearance.simulation.trajectory import simulate_trajectory

STRETCH = 8  # segments that are compared
_NEAREST = 5  # stretches whose distances are averaged
_SETTLE = 0.3  # s until a free run has forgotten its start
_DURATION = 1.2  # s of a free run
_OF_THE_DRIVE = (
    Signal.CRANK_ANGLE, Signal.CRANK_SPEED, Signal.CRANK_A_TRANSVERSE, Signal.CRANK_A_AXIAL,
    Signal.CRANK_B_TRANSVERSE, Signal.CRANK_B_AXIAL, Signal.DRIVE_TORQUE,
)  # fmt: skip


@dataclass(frozen=True)
class Match:
    """A stretch of a free run beside a stretch of a recording.

    Attributes:
        distance: mean absolute difference, in standard deviations of the channels.
        segment: first segment of the recording's stretch.
        nodes: (STRETCH, STATES) of the run.
        machine: that ran.
    """

    distance: float
    segment: int
    nodes: np.ndarray
    machine: SliderCrank


def match(
    measured: Measured, machine: SliderCrank, speed: float, start_angle: float, segments: Sequence[int]
) -> Match:
    """Find the stretch of a free run that is nearest to one of the recording.

    Args:
        measured: the recording.
        machine: with the clearance to try; its drive is set to ``speed``.
        speed: mean crank speed [rad/s].
        start_angle: crank angle at the first sample [rad].
        segments: where the recording's stretch may begin.
    """
    drive = machine.drive
    assert isinstance(drive, Drive)
    chain = measured.chain
    running = replace(machine, drive=quick(drive.at_speed(speed * 30.0 / np.pi)))
    integrator = Integrator("runge_kutta_4", 1.0 / chain.base_rate, 2)
    run = simulate_trajectory(running, integrator, _DURATION)
    filtered = measured.filtered
    signals = run.signals[:, list(measured.signals)].copy()
    signals[:, :filtered] = chain.smooth(signals[:, :filtered])
    angle = run.states[:, State.CRANK_ANGLE] * np.sign(speed)
    first = round(_SETTLE * chain.base_rate)
    use = _compared(measured)
    deviation = measured.values[..., use].std(axis=(0, 1))
    periods = SAMPLES * chain.decimation
    window = np.arange(0, STRETCH * periods, chain.decimation)
    best: tuple[float, int, int, float] = (np.inf, segments[0], first, 0.0)
    for segment in segments:
        expected = (start_angle + speed * segment * measured.segment) * np.sign(speed)
        data = measured.values[segment : segment + STRETCH].reshape(-1, len(measured.signals))[:, use]
        turns = np.arange(np.ceil((angle[first] - expected) / (2 * np.pi)), angle[-1] / (2 * np.pi))
        places = np.searchsorted(angle, expected + 2 * np.pi * turns)
        places = places[places + window[-1] + 20 * chain.decimation < len(angle)]
        for place in places:
            piece = signals[place + window][:, use]
            distance = float((np.abs(piece - data) / deviation).mean())
            if distance < best[0]:
                best = (distance, segment, int(place), expected)
    distance, segment, place, expected = best
    nodes = np.zeros((STRETCH, STATES))
    codes, p = running.codes(), running.parameters()[:, None].copy()
    states = np.ascontiguousarray(run.states[place : place + STRETCH * periods : periods, :, None])
    for k in range(STRETCH):
        _fold(codes, p, states[k], nodes[k])
    whole = round((angle[place] - expected) / (2 * np.pi)) * 2 * np.pi * np.sign(speed)
    nodes[:, State.CRANK_ANGLE] -= whole
    nodes[:, State.TIME] = 0.0
    return Match(distance, segment, nodes, running)


@njit(cache=True)
def _fold(codes: np.ndarray, p: np.ndarray, s: np.ndarray, node: np.ndarray) -> None:
    fold(codes, p, s, 0, node)


def quick(drive: Drive) -> Drive:
    """The same drive without a ramp."""
    return replace(drive, ramp=0.0) if hasattr(drive, "ramp") else drive  # type: ignore[type-var]


def distances(
    measured: Measured,
    machines: Sequence[SliderCrank],
    speed: float,
    start_angle: float,
    segments: Sequence[int],
    workers: int,
) -> np.ndarray:
    """(machines,) how near each one's free run comes to the recording; infinite where it fails.

    Coarser than ``match`` and many times faster: it runs machines in lockstep and compares at twice the
    recording's rate.
    """
    chain = measured.chain
    finer = 2 if chain.decimation % 2 == 0 else 1
    if chain.decimation == finer == 1:
        filters = Decimation.none()
    else:
        filters = Decimation.chebyshev(
            chain.decimation // finer, chain.filter_order, chain.ripple_db, chain.cutoff / finer
        )
    sampling = Sampling(chain.base_rate, filters, _SETTLE, _DURATION - _SETTLE)
    running = []
    for machine in machines:
        drive = machine.drive
        assert isinstance(drive, Drive)
        running.append(replace(machine, drive=quick(drive.at_speed(speed * 30.0 / np.pi))))
    use = _compared(measured)
    rows = [measured.signals[i] for i in use]
    deviation = measured.values[..., use].std(axis=(0, 1))
    window = np.arange(0, STRETCH * SAMPLES * finer, finer)
    data = np.stack(
        [measured.values[k : k + STRETCH].reshape(-1, len(measured.signals))[:, use] for k in segments]
    )
    expected = (start_angle + speed * np.array(segments) * measured.segment) * np.sign(speed)
    found = np.full(len(machines), np.inf)

    def sink(run: int, outcome: np.ndarray | Failure) -> None:
        if isinstance(outcome, Failure):
            return
        angle = outcome[:, Signal.CRANK_ANGLE] * np.sign(speed)
        if not (np.diff(angle) > 0.0).all():
            return
        signals = outcome[:, rows]
        nearest = np.full(len(segments), np.nan)
        for k in range(len(segments)):
            turns = np.arange(np.ceil((angle[0] - expected[k]) / (2 * np.pi)), angle[-1] / (2 * np.pi))
            places = np.searchsorted(angle, expected[k] + 2 * np.pi * turns)
            places = places[places + window[-1] < len(angle)]
            if len(places):
                pieces = signals[places[:, None] + window]
                nearest[k] = (np.abs(pieces - data[k]) / deviation).mean(axis=(1, 2)).min()
        found[run] = np.nanmean(np.sort(nearest)[:_NEAREST])

    run_batch(
        running, Integrator("runge_kutta_4", 1.0 / chain.base_rate, 2), sampling, sink, workers, any_laws=True
    )  # fmt: skip
    return found


def _compared(measured: Measured) -> list[int]:
    """Channels that tell how the mechanism moves, not what its drive does."""
    use = [i for i, s in enumerate(measured.signals) if s not in _OF_THE_DRIVE]
    loud = [i for i in use if measured.values[..., i].std() > 3.0 * measured.sigma[i]]
    return loud or use or list(range(len(measured.signals)))
