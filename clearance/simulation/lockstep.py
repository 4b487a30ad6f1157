"""The compiled loop over time: ``WIDTH`` runs at once, filtered and decimated on the way."""

from typing import Any

import numpy as np

from clearance.compilation import entry, subroutine
from clearance.lanes import get, put, where, zero
from clearance.simulation.decimation import absorb_block, forward_output, retreat, start_sums
from clearance.simulation.equations import evaluate
from clearance.simulation.integrator import WORKSPACE, remember, step
from clearance.simulation.kinematics import project, sense
from clearance.simulation.layout import COORDINATES, RESULTS, SIGNALS, STATES, Result, State


@subroutine
def sample_period(
    codes: Any, p: Any, s: Any, r: Any, w: Any, scheme: int, h: float, substeps: int, refinement: int
) -> None:
    """Advance by one sampling period from an evaluated state."""
    step(codes, p, s, r, w, scheme, h, refinement)
    for _ in range(1, substeps):
        evaluate(codes, p, s, r)
        remember(codes, s, r)
        step(codes, p, s, r, w, scheme, h, refinement)


@subroutine
def _save(s: Any, saved: Any) -> None:
    """Keep the state of the lanes in which it is finite."""
    total = get(s, 0)
    for i in range(1, 2 * COORDINATES):
        total = total + get(s, i)
    finite = total * 0.0 == 0.0
    for i in range(STATES):
        put(saved, i, where(finite, get(s, i), get(saved, i)))


@entry
def run_lanes(
    codes: np.ndarray,
    p: np.ndarray,
    s: np.ndarray,
    saved: np.ndarray,
    r: np.ndarray,
    w: np.ndarray,
    work: np.ndarray,
    scheme: int,
    h: float,
    substeps: int,
    refinement: int,
    skipped: int,
    first: int,
    samples: int,
    filtered: np.ndarray,
    points: np.ndarray,
    weights: np.ndarray,
    decay: np.ndarray,
    residues: np.ndarray,
    rest: np.ndarray,
    direct: float,
    chunk: int,
    out: np.ndarray,
) -> None:
    """Simulate ``WIDTH`` runs and write their decimated signals.

    Args:
        codes: (families,) chosen laws, the same for all runs.
        p: (PARAMETERS, WIDTH).
        s: (STATES, WIDTH) start states; the end states on return.
        saved: (STATES, WIDTH) on return each run's last finite state at the end of a chunk.
        r: (Result.FORCE_B_X, WIDTH) scratch memory, an evaluation.
        w: (WORKSPACE, WIDTH) scratch memory of the scheme.
        work: rows of scratch memory, see ``filter_rows``.
        scheme: a ``Scheme``.
        h: step [s].
        substeps: steps a sampling period.
        refinement: steps that replace one in contact.
        skipped: decimated samples before the filter starts.
        first: decimated samples after that which are not written.
        samples: decimated samples to write.
        filtered: rows of ``Signal`` that pass the filter.
        points: rows of ``Signal`` that are sampled as they are.
        weights: see ``Decimation``, likewise the next five.
        decay: (2, poles).
        residues: (2, poles).
        rest: (2, poles).
        direct: weight of the sample itself.
        chunk: decimated samples between two backward passes.
        out: (WIDTH, samples, SIGNALS) written.
    """
    factor, poles = weights.shape[2], weights.shape[1]
    channels, width = filtered.size, s.shape[1]
    block = work[: factor * SIGNALS]
    row = factor * SIGNALS
    forward = work[row : row + channels * 2 * poles]
    row += channels * 2 * poles
    backward = work[row : row + channels * 2 * poles + 1]
    row += channels * 2 * poles + 1
    future = work[row : row + 2 * chunk * channels * 2 * poles]
    row += 2 * chunk * channels * 2 * poles
    partial = work[row : row + 2 * chunk * SIGNALS]

    project(codes, p, s)
    for i in range(STATES):
        put(saved, i, get(s, i))
    for k in range(skipped):
        for _ in range(factor):
            evaluate(codes, p, s, r)
            remember(codes, s, r)
            sample_period(codes, p, s, r, w, scheme, h, substeps, refinement)
        if k % chunk == 0:
            _save(s, saved)
    evaluate(codes, p, s, r)
    remember(codes, s, r)
    sense(codes, p, s, r, block, (factor - 1) * SIGNALS)
    for c in range(channels):
        value = get(block, (factor - 1) * SIGNALS + filtered[c])
        start_sums(forward, c * 2 * poles, value, rest)
    half = 0
    wanted = first + samples
    for begin in range(0, wanted + chunk, chunk):
        for k in range(chunk):
            slot = half * chunk + k
            # the decimated sample itself: the last of the previous block
            for c in range(channels):
                value = get(block, (factor - 1) * SIGNALS + filtered[c])
                output = forward_output(forward, c * 2 * poles, value, residues, direct)
                put(partial, slot * SIGNALS + filtered[c], output)
            for c in range(points.size):
                put(partial, slot * SIGNALS + points[c], get(block, (factor - 1) * SIGNALS + points[c]))
            for m in range(factor):
                sample_period(codes, p, s, r, w, scheme, h, substeps, refinement)
                evaluate(codes, p, s, r)
                remember(codes, s, r)
                sense(codes, p, s, r, block, m * SIGNALS)
            for c in range(channels):
                place = (slot * channels + c) * 2 * poles
                absorb_block(
                    block, filtered[c], SIGNALS, forward, c * 2 * poles, future, place, weights, decay
                )
        _save(s, saved)
        # backwards through the chunk just simulated, then through the one before, whose future is now known
        for c in range(channels):
            for i in range(2 * poles):
                put(backward, c * 2 * poles + i, zero(get(partial, 0)))
            if begin > 0 and poles > 0:
                for k in range(chunk - 1, -1, -1):
                    place = ((half * chunk + k) * channels + c) * 2 * poles
                    retreat(future, place, backward, c * 2 * poles, residues, decay)
                for k in range(chunk - 1, -1, -1):
                    slot = (1 - half) * chunk + k
                    place = (slot * channels + c) * 2 * poles
                    later = retreat(future, place, backward, c * 2 * poles, residues, decay)
                    cell = slot * SIGNALS + filtered[c]
                    put(partial, cell, get(partial, cell) + later)
        if begin > 0:
            for k in range(chunk):
                sample = begin - chunk + k - first
                if 0 <= sample < samples:
                    cell = ((1 - half) * chunk + k) * SIGNALS
                    for lane in range(width):
                        for c in range(channels):
                            out[lane, sample, filtered[c]] = partial[cell + filtered[c], lane]
                        for c in range(points.size):
                            out[lane, sample, points[c]] = partial[cell + points[c], lane]
        half = 1 - half


def filter_rows(factor: int, poles: int, channels: int, chunk: int) -> int:
    """Rows of scratch memory in which ``run_lanes`` filters."""
    sums = channels * 2 * poles
    return factor * SIGNALS + 2 * sums + 1 + 2 * chunk * (sums + SIGNALS)


@entry
def trace(
    codes: np.ndarray,
    p: np.ndarray,
    s: np.ndarray,
    scheme: int,
    h: float,
    refinement: int,
    every: int,
    states: np.ndarray,
    results: np.ndarray,
    signals: np.ndarray,
) -> int:
    """Simulate one run and keep all of it.

    Args:
        codes: (families,) chosen laws.
        p: (PARAMETERS,).
        s: (STATES,) start state; the end state on return.
        scheme: a ``Scheme``.
        h: step [s].
        refinement: steps that replace one in contact.
        every: steps from one kept sample to the next.
        states: (samples, STATES) written; likewise ``results`` and ``signals``.
        results: (samples, RESULTS).
        signals: (samples, SIGNALS).

    Returns:
        Samples written: all, or up to the first state that is not finite.
    """
    r = np.zeros(RESULTS)
    w = np.zeros(WORKSPACE)
    project(codes, p, s)
    for k in range(states.shape[0]):
        for m in range(every):
            evaluate(codes, p, s, r)
            remember(codes, s, r)
            if m == 0:
                states[k] = s
                results[k] = r
                sense(codes, p, s, r, signals[k], 0)
            step(codes, p, s, r, w, scheme, h, refinement)
        total = 0.0
        for i in range(State.TIME):
            total += s[i]
        for i in range(Result.SPEED_ERROR):
            total += r[i]
        if total * 0.0 != 0.0:
            return k + 1
    return states.shape[0]
