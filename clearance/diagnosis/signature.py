"""How machines run, as engineers plot it: phase averages, spectra and impacts of a recording and of models.

Beyond a fifth of a millimetre no run repeats another, so a model is simulated freely and only statistics are
compared, each with what it varies by. One run is not enough for that: some machines rattle for a second and
then roll for another, so every model runs several times from different starts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from clearance.diagnosis import impacts
from clearance.diagnosis.instrument import Instrument
from clearance.diagnosis.measured import Measured
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import CHANNELS
from clearance.simulation.batch import Sampling, run_batch
from clearance.simulation.failure import Failure
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal, State
from clearance.simulation.trajectory import rest_state

_RUNS = 8  # of a model; lanes of a vector that would otherwise be idle
_KICK = 0.05  # of its speed: by how much more than the last one each run's crank turns at the start
_SETTLE, _DURATION = 0.3, 1.8  # s, of a free run: until it has forgotten its start, and what is used of it
_BINS = (180, 120, 90, 60, 36)  # of a revolution: the finest of which each holds two samples
_WINDOW = 1024  # samples of a spectrum's windows, at most
_BANDS = 120  # of a spectrum, of equal ratio
_MISPLACED = 0.02  # rad, by which the crank angle at a recording's start may be wrong
_STEPS = 6  # of Gauss and Newton towards it
_DIGITS = 4


@dataclass(frozen=True)
class Running:
    """Signals of a machine that runs steadily, once or several times.

    Attributes:
        values: (runs, samples, channels).
        angle: (runs, samples) crank angle [rad], unwrapped.
        rate: [Hz].
    """

    values: np.ndarray
    angle: np.ndarray
    rate: float


@dataclass(frozen=True)
class PhaseAverage:
    """Time-synchronous average: a signal over one revolution of the crank.

    Attributes:
        mean: (bins, channels) at the bins' centres, not a number in bins that no sample fell into.
        spread: (bins, channels) standard deviation from one revolution to another.
        drift: (bins, channels) standard deviation from one run to another.
        runs: that the mean is of.
        revolutions: (bins,) likewise.
        samples: (bins,) likewise.
        slope: (bins, channels) of the mean [1/rad].
    """

    mean: np.ndarray
    spread: np.ndarray
    drift: np.ndarray
    runs: int
    revolutions: np.ndarray
    samples: np.ndarray
    slope: np.ndarray


def signatures(
    recordings: Sequence[Measured],
    speeds: Sequence[float],
    angles: Sequence[float],
    before: Sequence[SliderCrank],
    after: Sequence[SliderCrank],
    instrument: Instrument | None = None,
    workers: int | None = None,
) -> dict[str, Any]:
    """Phase averages, spectra and impacts of recordings and of both models, for the report.

    Args:
        recordings: that neither model was fitted to.
        speeds: mean crank speed of each [rad/s].
        angles: crank angle at the first sample of each [rad].
        before: the nominal machine at each recording's speed, its drive without a ramp.
        after: the corrected machine, likewise.
        instrument: what the correction says of the instruments; ``None``: they are right.
        workers: threads; all cores if ``None``.

    Returns:
        ``crank_angle_deg`` and, for each recording, ``phase``, ``spectrum`` and ``impacts``; a model that
        cannot run is left out.
    """
    seen = [_recorded(*each) for each in zip(recordings, speeds, angles, strict=True)]
    runs = _free_runs(recordings, [*before, *after], workers)
    shown = []
    for r, measured in enumerate(recordings):
        kinds = {"recorded": seen[r]}
        for kind, run, faults in (
            ("before", runs[r], None), ("after", runs[len(recordings) + r], instrument)
        ):  # fmt: skip
            if run is not None:
                kinds[kind] = _as_seen(run, measured, faults)
        shown.append(_compared(measured, kinds, abs(speeds[r])))
    return {"recordings": shown}


def _recorded(measured: Measured, speed: float, angle: float) -> Running:
    """A recording beside its crank angle: its encoder's increments, or as if the crank turned evenly."""
    values = measured.values.reshape(-1, len(measured.signals))
    if _has_encoder(measured):
        turned = values[:, measured.signals.index(Signal.CRANK_ANGLE)]
        turned = turned - turned[0]
    else:
        turned = speed * np.arange(len(values)) / measured.chain.rate
    return Running(values[None], (angle + turned)[None], measured.chain.rate)


def _has_encoder(measured: Measured) -> bool:
    return Signal.CRANK_ANGLE in measured.signals


def _free_runs(
    recordings: Sequence[Measured], machines: Sequence[SliderCrank], workers: int | None
) -> list[Running | None]:
    """Signals of each machine; machine ``i`` belongs to recording ``i`` modulo their number."""
    runs: dict[int, list[np.ndarray]] = {i: [] for i in range(len(machines))}
    for chain in dict.fromkeys(measured.chain for measured in recordings):
        own = [
            i
            for i in range(len(machines)) if recordings[i % len(recordings)].chain == chain
            for _ in range(_RUNS)
        ]  # fmt: skip
        states = np.array([rest_state(machines[i]) for i in own])
        for k, i in enumerate(own):
            speed = machines[i].parameters()[Parameter.DRIVE_SPEED]
            states[k, State.CRANK_SPEED] = _KICK * (k % _RUNS) * speed

        def sink(run: int, outcome: np.ndarray | Failure, own: list[int] = own) -> None:
            if not isinstance(outcome, Failure):
                runs[own[run]].append(outcome.copy())

        run_batch(
            [machines[i] for i in own], Integrator("runge_kutta_4", 1.0 / chain.base_rate, 2),
            Sampling(chain.base_rate, chain.filter(), _SETTLE, _DURATION), sink, workers, states,
            any_laws=True,
        )  # fmt: skip
    found: list[Running | None] = []
    for i, each in runs.items():
        rate = recordings[i % len(recordings)].chain.rate
        stacked = np.array(each)
        found.append(Running(stacked, stacked[..., Signal.CRANK_ANGLE], rate) if each else None)
    return found


def _as_seen(run: Running, measured: Measured, instrument: Instrument | None) -> Running:
    """What the recording's channels show of a run; both axes of a sensor are there to be turned."""
    values = run.values
    if instrument is not None:
        names = [Signal(i).name.lower() for i in range(values.shape[2])]
        values = np.array([instrument.apply(one, names, run.rate) for one in values])
    angle = run.angle
    if not _has_encoder(measured):  # placed by the same rule as the recording's samples
        time = np.arange(angle.shape[1])
        speed, first = np.polyfit(time, angle.T, 1)
        angle = first[:, None] + speed[:, None] * time
    return Running(values[..., list(measured.signals)], angle, run.rate)


def _compared(measured: Measured, kinds: dict[str, Running], speed: float) -> dict[str, Any]:
    turn = 2.0 * np.pi / speed * measured.chain.rate  # samples
    bins = next((b for b in _BINS if turn >= 2 * b), _BINS[-1])
    averages = {"recorded": phase_average(kinds["recorded"], bins)}
    distances: dict[str, np.ndarray] = {}
    for kind, run in kinds.items():
        if kind != "recorded":
            averages[kind], distances[kind] = registered(averages["recorded"], run, measured.sigma)
    spectra = {kind: spectrum(run, kinds["recorded"].values.shape[1]) for kind, run in kinds.items()}
    phase, lines = [], []
    for i, channel in enumerate(measured.channels):
        if channel == "crank_angle":  # a straight line over itself
            continue
        unit = CHANNELS[channel].unit
        phase.append({
            "channel": channel, "unit": unit,
            **{kind: {"mean": _rounded(a.mean[:, i]), "spread": _rounded(a.spread[:, i])}
               for kind, a in averages.items()},
            "distance": {kind: float(f"{each[i]:.3g}") for kind, each in distances.items()},
        })  # fmt: skip
        lines.append({
            "channel": channel, "unit": f"{unit}/√Hz",
            **{kind: _rounded(density[:, i]) for kind, (_, density) in spectra.items()},
        })  # fmt: skip
    centres = (np.arange(bins) + 0.5) * 360.0 / bins
    return {
        "name": measured.name, "revolutions": round(kinds["recorded"].values.shape[1] / turn, 1),
        "crank_angle_deg": centres.tolist(), "phase": phase,
        "frequency_hz": _rounded(spectra["recorded"][0]), "spectrum": lines,
        "impacts": _impacts(measured, kinds),
    }  # fmt: skip


def phase_average(run: Running, bins: int) -> PhaseAverage:
    """Average over revolutions in bins of the crank angle (McFadden 1987, Mech. Syst. Signal Process. 1).

    Samples fall elsewhere in a bin from one recording to another: what they show is moved to the bin's
    centre along the average's slope.

    Args:
        run: any length, either sense.
        bins: of a revolution.
    """
    width = 2.0 * np.pi / bins
    place = np.floor(run.angle / width).astype(int)
    off_centre = run.angle - (place + 0.5) * width
    place -= place.min(axis=1, keepdims=True) // bins * bins
    turns = place.max(axis=1) // bins + 1
    first = np.append(0, np.cumsum(turns))  # turn of each run, one after the other
    place += first[:-1, None] * bins

    def gathered(values: np.ndarray) -> np.ndarray:
        return np.bincount(place.ravel(), values.ravel(), first[-1] * bins).reshape(-1, bins)

    count = gathered(np.ones(place.shape))
    share = 1.0 / np.maximum(count, 1)
    present = (count > 0)[..., None]
    revolutions = (count > 0).sum(axis=0)
    each = np.stack([gathered(run.values[..., i]) * share for i in range(run.values.shape[2])], 2)
    mean = each.sum(axis=0) / np.maximum(revolutions, 1)[:, None]
    slope = (np.roll(mean, -1, axis=0) - np.roll(mean, 1, axis=0)) / (2.0 * width)
    known = revolutions > 0
    slope[~(known & np.roll(known, 1) & np.roll(known, -1))] = 0.0
    each -= (gathered(off_centre) * share)[..., None] * slope
    mean = each.sum(axis=0) / np.maximum(revolutions, 1)[:, None]
    square = (present * (each - mean) ** 2).sum(axis=0) / np.maximum(revolutions - 1, 1)[:, None]
    mean[~known] = np.nan
    square[revolutions < 2] = np.nan
    drift = np.zeros_like(mean)
    if len(turns) > 1:
        parts = np.add.reduceat(each, first[:-1]) / np.maximum(np.add.reduceat(present, first[:-1]), 1)
        drift = parts.std(axis=0, ddof=1)
    return PhaseAverage(mean, np.sqrt(square), drift, len(turns), revolutions, count.sum(axis=0), slope)


def registered(recorded: PhaseAverage, run: Running, sigma: np.ndarray) -> tuple[PhaseAverage, np.ndarray]:
    """A model's phase average at the crank angle where it lies best, and how far it is from the recording's.

    The angle at a recording's first sample is not known to a bin's width, and no model gets blamed for it.
    The distance is the root mean square difference over its standard error, 1 for a right model. The error
    is what the model says: what its own runs vary by from one revolution to the next, or from one run to
    another where that is more, for as many revolutions as the recording has and as were simulated, and the
    sensor's noise.

    Args:
        recorded: of few revolutions.
        run: of the model, many revolutions.
        sigma: (channels,) standard deviation of the noise of one sample.

    Returns:
        The average, and (channels,) distances; not a number where nothing can be compared.
    """
    bins, turned = len(recorded.mean), 0.0
    for _ in range(_STEPS):
        model = phase_average(replace(run, angle=run.angle + turned), bins)
        use = (recorded.revolutions > 0) & (model.revolutions > 1)
        if not use.any():
            return model, np.full(len(sigma), np.nan)
        shares = 1.0 / recorded.revolutions[use] + 1.0 / model.revolutions[use]
        a_run = model.revolutions[use] / model.runs  # revolutions
        varying = np.maximum(model.spread[use] ** 2, model.drift[use] ** 2 * a_run[:, None])
        bend = np.roll(model.mean, 1, axis=0) + np.roll(model.mean, -1, axis=0) - 2.0 * model.mean
        variance = varying * shares[:, None] + sigma**2 / recorded.samples[use, None]
        variance += np.nan_to_num(bend[use] / 24.0) ** 2  # what a bin's mean and its centre may differ by
        difference, slope = model.mean[use] - recorded.mean[use], model.slope[use]
        step = float((slope * difference / variance).sum() / max((slope**2 / variance).sum(), 1e-300))
        turned = float(np.clip(turned + step, -_MISPLACED, _MISPLACED))
    return model, np.sqrt((difference**2 / variance).mean(axis=0))


def spectrum(run: Running, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """One-sided amplitude spectral density (Welch 1967), averaged in power over bands of equal ratio.

    Args:
        run: the signals.
        samples: of the shortest run that is compared; windows are a third of it, or shorter.

    Returns:
        (bands,) centre frequencies [Hz] and (bands, channels) densities [unit/sqrt(Hz)].
    """
    from scipy.signal import welch

    length = int(min(_WINDOW, max(16, samples // 3)))
    frequency, power = welch(run.values, run.rate, nperseg=length, axis=1)
    frequency, power = frequency[1:], power.mean(axis=0)[1:]  # the mean is in the phase average
    band = np.round(np.log(frequency / frequency[0]) / np.log(frequency[-1] / frequency[0]) * (_BANDS - 1))
    starts = np.flatnonzero(np.diff(band, prepend=-1.0))
    width = np.diff(starts, append=len(band))
    centres = np.add.reduceat(frequency, starts) / width
    return centres, np.sqrt(np.add.reduceat(power, starts, axis=0) / width[:, None])


def _impacts(measured: Measured, kinds: dict[str, Running]) -> dict[str, Any] | None:
    channel = next((c for c in impacts.CHANNELS if c in measured.channels), None)
    if channel is None or measured.chain.rate < impacts.LEAST_RATE:
        return None
    column = measured.channels.index(channel)
    counted = impacts.count_impacts(
        {kind: run.values[..., column] for kind, run in kinds.items()},
        {kind: run.angle for kind, run in kinds.items()},
        measured.chain.rate,
    )
    return {"channel": channel, "unit": CHANNELS[channel].unit, **counted}


def _rounded(values: np.ndarray) -> list[float]:
    """To the digits that a picture shows."""
    return [float(f"{value:.{_DIGITS}g}") for value in values.tolist()]
