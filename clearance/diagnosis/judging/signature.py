"""How machines run, as engineers plot it: phase averages, spectra and impacts of a recording and of models.

Beyond a fifth of a millimetre no run repeats another, so a model is simulated freely and only statistics are
compared, each with what it varies by. One run is not enough for that: some machines rattle for a second and
then roll for another, so every model runs several times from different starts.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from clearance.diagnosis.judging import impacts
from clearance.diagnosis.judging.revolutions import Running, phase_average, registered, spectrum
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import Measured, pace
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
_STEP = 1e-5  # s, at most
_BINS = (180, 120, 90, 60, 36)  # of a revolution: the finest of which each holds two samples
_DIGITS = 4


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
        ``recordings``: of each ``name``, ``revolutions``, ``crank_angle_deg``, ``frequency_hz``, ``phase``,
        ``spectrum`` and ``impacts``; a model that cannot run is left out.
    """
    seen = [_recorded(*each) for each in zip(recordings, speeds, angles, strict=True)]
    same = list(before) == list(after)
    runs = _free_runs(recordings, before if same else [*before, *after], workers)
    shown = []
    for r, measured in enumerate(recordings):
        kinds = {"recorded": seen[r]}
        better = runs[r if same else len(recordings) + r]
        for kind, run, faults in (("before", runs[r], None), ("after", better, instrument)):
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
            if isinstance(outcome, Failure):
                return
            if (
                abs(outcome[-1, Signal.CRANK_ANGLE] - outcome[0, Signal.CRANK_ANGLE]) > 2.0 * np.pi
            ):  # no stall
                runs[own[run]].append(outcome.copy())

        run_batch(
            [machines[i] for i in own], Integrator("runge_kutta_4", _STEP, 2),
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
        own, counted = replace(instrument, timebase=0.0), pace(range(len(names)), instrument)
        values = np.array([own.apply(one / counted, names, run.rate) for one in values])
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
    shortest = min(run.values.shape[1] for run in kinds.values())
    spectra = {kind: spectrum(run, shortest) for kind, run in kinds.items()}
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
