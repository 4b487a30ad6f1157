"""Many runs: grouped by their laws, ``WIDTH`` in lockstep, one group a core.

A run's signals do not depend on which runs share its group, on the number of workers or on their order.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from threading import Event, local
from typing import Any

import numpy as np

from clearance.errors import InputError
from clearance.lanes import WIDTH
from clearance.mechanism.choice import LawChoice
from clearance.mechanism.parameters import PARAMETERS, Family, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.decimation import Decimation
from clearance.simulation.failure import Failure, explain_failure
from clearance.simulation.integrator import WORKSPACE, Integrator
from clearance.simulation.layout import SIGNALS, STATES, Result, Signal
from clearance.simulation.lockstep import filter_rows, run_lanes
from clearance.simulation.trajectory import rest_state


@dataclass(frozen=True)
class Sampling:
    """When and how often the machine's signals are taken.

    Attributes:
        base_rate: sampling rate before the filter [Hz].
        decimation: the filter, and how many samples at the base rate make one of the result.
        start: time of the first sample [s].
        duration: of the result [s].
    """

    base_rate: float
    decimation: Decimation
    start: float
    duration: float

    @property
    def rate(self) -> float:
        """Sampling rate of the result [Hz]."""
        return self.base_rate / self.decimation.factor

    @property
    def samples(self) -> int:
        """Number of samples of the result."""
        return round(self.duration * self.rate)

    @property
    def first(self) -> int:
        """Index of the first sample, counted from the start of the simulation."""
        return round(self.start * self.rate)


Sink = Callable[[int, np.ndarray | Failure], None]
"""Receives a run's index and its (samples, SIGNALS) float64 signals, valid during the call, or its
failure."""


def run_batch(
    machines: Sequence[SliderCrank],
    integrator: Integrator,
    sampling: Sampling,
    sink: Sink,
    workers: int | None = None,
    states: np.ndarray | None = None,
    any_laws: bool = False,
) -> None:
    """Simulate machines and hand each one's signals to ``sink`` as soon as they are there.

    Args:
        machines: one a run.
        integrator: scheme and steps.
        sampling: which samples are wanted.
        sink: called from the worker threads.
        workers: threads; all cores if ``None``.
        states: (runs, STATES) start states; at rest at outer dead centre if ``None``.
        any_laws: whether laws are chosen while it runs: slower by a factor of three, but compiled once for
            all laws. For few runs of many kinds.
    """
    require_sample(sampling)
    groups = []
    for alike in by_laws(machines).values():
        groups += [alike[i : i + WIDTH] for i in range(0, len(alike), WIDTH)]
    workspaces, stop = local(), Event()

    def work(group: list[int]) -> None:
        if not stop.is_set():
            _run_group(group, machines, states, integrator, sampling, workspaces, sink, any_laws)

    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        futures = [pool.submit(work, group) for group in groups]
        try:
            for future in futures:
                future.result()
        except BaseException:
            stop.set()  # a group under way finishes, no new one begins
            raise


def require_sample(sampling: Sampling) -> None:
    """Check that a result holds at least one sample."""
    if sampling.samples < 1:
        raise InputError(f"a recording of {sampling.duration:g} s holds no sample at {sampling.rate:g} Hz")


def by_laws(machines: Sequence[SliderCrank]) -> dict[tuple[int, ...], list[int]]:
    """Machines' indices by the codes of their laws, in the codes' order."""
    keys = [tuple(int(code) for code in machine.codes()) for machine in machines]
    order = sorted(range(len(machines)), key=lambda i: keys[i])
    return {codes: list(members) for codes, members in groupby(order, key=lambda i: keys[i])}


def aligned(rows: int) -> np.ndarray:
    """(rows, WIDTH) zeros that begin on a cache line: a vector store never straddles two."""
    flat = np.zeros(rows * WIDTH + 8)
    offset = (-flat.ctypes.data // 8) % 8
    return flat[offset : offset + rows * WIDTH].reshape(rows, WIDTH)


def silent_signals(codes: tuple[int, ...], p: np.ndarray) -> set[int]:
    """Acceleration signals that are identically zero, so that filtering them would be waste.

    Args:
        codes: (families,) chosen laws.
        p: (PARAMETERS, runs).
    """
    if codes[Family.FRAME]:
        return set()
    silent: set[int] = set()
    weightless = not p[[Parameter.GRAVITY_X, Parameter.GRAVITY_Y]].any()
    if weightless and not p[Parameter.SENSOR_CRANK_A].any():
        silent |= {Signal.CRANK_A_TRANSVERSE, Signal.CRANK_A_AXIAL}
    if not p[Parameter.GRAVITY_Y].any() and not codes[Family.GUIDE]:
        silent.add(Signal.SLIDER_VERTICAL)
    return silent


def loop_arguments(integrator: Integrator, sampling: Sampling, silent: set[int]) -> tuple[Any, ...]:
    """Arguments of ``run_lanes`` from ``h`` to ``chunk``, the same for all runs."""
    filters = sampling.decimation
    period = 1.0 / sampling.base_rate
    substeps = integrator.substeps(period)
    skipped = max(0, sampling.first - filters.chunk)
    return (
        period / substeps,
        substeps,
        integrator.contact_refinement,
        skipped,
        sampling.first - skipped,
        sampling.samples,
        np.array([row for row in range(Signal.CRANK_ANGLE) if row not in silent], dtype=np.int64),
        np.arange(Signal.CRANK_ANGLE, SIGNALS),
        filters.weights,
        filters.decay,
        filters.residues,
        filters.rest,
        filters.direct,
        filters.chunk,
    )


def scratch_rows(sampling: Sampling, silent: set[int]) -> int:
    """Rows of scratch memory in which ``run_lanes`` filters what is not silent."""
    filters = sampling.decimation
    return filter_rows(
        filters.factor, filters.decay.shape[1], Signal.CRANK_ANGLE - len(silent), filters.chunk
    )


_LEAST_SEARCHED = 20_000  # steps from the last state kept, in which a failure is looked for


def hand_over(
    sink: Sink,
    run: int,
    machine: SliderCrank,
    signals: np.ndarray,
    saved: np.ndarray,
    integrator: Integrator,
    sampling: Sampling,
) -> None:
    """Give a run's signals to ``sink``, or its failure where they are not finite.

    Args:
        sink: receives either.
        run: its index.
        machine: what ran.
        signals: (samples, SIGNALS).
        saved: (STATES,) its last finite state at the end of a chunk.
        integrator: scheme and steps.
        sampling: which samples were wanted.
    """
    if np.isfinite(signals[-1]).all() and np.isfinite(signals.sum()):
        sink(run, signals)
        return
    period, filters = 1.0 / sampling.base_rate, sampling.decimation
    # a state is kept once a chunk, at a multiple of it before and after recording begins
    steps = 3 * filters.chunk * filters.factor * integrator.substeps(period)
    sink(run, explain_failure(machine, saved, integrator.within(period), max(steps, _LEAST_SEARCHED)))


def _run_group(
    group: list[int],
    machines: Sequence[SliderCrank],
    states: np.ndarray | None,
    integrator: Integrator,
    sampling: Sampling,
    workspaces: local,
    sink: Sink,
    any_laws: bool,
) -> None:
    lanes = group + [group[-1]] * (WIDTH - len(group))
    codes = machines[group[0]].codes()
    p, s, saved = aligned(PARAMETERS), aligned(STATES), aligned(STATES)
    for lane, run in enumerate(lanes):
        p[:, lane] = machines[run].parameters()
        s[:, lane] = rest_state(machines[run]) if states is None else states[run]
    silent = silent_signals(tuple(codes), p)
    rows = scratch_rows(sampling, silent)
    key = (rows, (WIDTH, sampling.samples, SIGNALS), silent)  # silent signals stay the zeros they began as
    if getattr(workspaces, "key", None) != key:
        workspaces.key, workspaces.work, workspaces.out = key, aligned(rows), np.zeros(key[1])
        workspaces.r, workspaces.w = aligned(Result.FORCE_B_X), aligned(WORKSPACE)
    out = workspaces.out
    run_lanes(
        codes if any_laws else LawChoice(codes),
        p,
        s,
        saved,
        workspaces.r,
        workspaces.w,
        workspaces.work,
        integrator.code,
        *loop_arguments(integrator, sampling, silent),
        out,
    )
    for lane, run in enumerate(group):
        hand_over(sink, run, machines[run], out[lane], saved[:, lane].copy(), integrator, sampling)


def simulate(
    machine: SliderCrank, integrator: Integrator, sampling: Sampling, state: np.ndarray | None = None
) -> np.ndarray:
    """Signals of one run, (samples, SIGNALS).

    Raises:
        InputError: if the run becomes non-finite.
    """
    result: list[np.ndarray | Failure] = []

    def keep(_: int, outcome: np.ndarray | Failure) -> None:
        result.append(outcome if isinstance(outcome, Failure) else outcome.copy())

    run_batch([machine], integrator, sampling, keep, 1, None if state is None else state[None])
    if isinstance(result[0], Failure):
        raise InputError(str(result[0]))
    return result[0]
