"""Many short runs from given states, each with its neighbours in state and parameters: multiple shooting.

A recording is cut into segments of a millisecond or so. Each segment starts at a node; its runs are the one
from the node itself and others with one coordinate, one force or one parameter changed a little, sixteen in
lockstep. The result is what an estimator needs: where every run ends, and what it contributes to the filtered
samples of its own segment and of the two beside it.

A node is written in the layout of ``State``, with one change of variables: the place of a journal in its
bearing is kept as eccentricity over clearance. The penetration, some 1e-7 m and worth hundreds of newtons,
then survives a change of the clearance, which would otherwise tear every contact open.
"""

from math import asin, cos, sin

import numpy as np

from clearance.compilation import entry, subroutine
from clearance.lanes import get, put, zero
from clearance.mechanism.choice import chosen
from clearance.mechanism.parameters import JOINT_STRIDE, PARAMETERS, Family, Parameter
from clearance.simulation.equations import evaluate
from clearance.simulation.integrator import WORKSPACE, remember
from clearance.simulation.kinematics import project, sense
from clearance.simulation.layout import RESULTS, SIGNALS, STATES, Result, State
from clearance.simulation.lockstep import sample_period

# What four rows of ``State`` mean in a node: eccentricity over clearance, journal minus bearing.
ECCENTRICITY_B = (int(State.ROD_X), int(State.ROD_Y))
ECCENTRICITY_C = (int(State.SLIDER_X), int(State.ROD_ANGLE))
_RATE = int(State.FRAME_X_RATE)  # rows from a coordinate to its rate


@subroutine
def unfold(codes: np.ndarray, p: np.ndarray, node: np.ndarray, s: np.ndarray, lane: int) -> None:
    """Compute a lane's state from a node; ``project`` fills in what the constraints give."""
    for i in range(STATES):
        s[i, lane] = node[i]
    crank, to_b = p[Parameter.CRANK_LENGTH, lane], p[Parameter.ROD_TO_B, lane]
    length = to_b + p[Parameter.ROD_TO_C, lane]
    sine, cosine = sin(node[State.CRANK_ANGLE]), cos(node[State.CRANK_ANGLE])
    turn = crank * node[State.CRANK_SPEED]
    bx, by = node[State.FRAME_X] + crank * cosine, node[State.FRAME_Y] + crank * sine
    bvx, bvy = node[State.FRAME_X_RATE] - turn * sine, node[State.FRAME_Y_RATE] + turn * cosine
    if chosen(codes, Family.JOINT_B) == 1:
        gap = p[Parameter.JOINT_CLEARANCE, lane]
        bx, by = bx - gap * node[State.ROD_X], by - gap * node[State.ROD_Y]
        bvx, bvy = bvx - gap * node[State.ROD_X_RATE], bvy - gap * node[State.ROD_Y_RATE]
    height, lift = node[State.SLIDER_Y], node[State.SLIDER_Y_RATE]
    if chosen(codes, Family.GUIDE) == 0:
        height = node[State.FRAME_Y] + p[Parameter.GUIDE_OFFSET, lane]
        lift = node[State.FRAME_Y_RATE]
    ex, ey, evx, evy = 0.0, 0.0, 0.0, 0.0
    if chosen(codes, Family.JOINT_C) == 1:
        gap = p[Parameter.JOINT_CLEARANCE + JOINT_STRIDE, lane]
        ex, ey = gap * node[State.SLIDER_X], gap * node[State.ROD_ANGLE]
        evx, evy = gap * node[State.SLIDER_X_RATE], gap * node[State.ROD_SPEED]
    rod_sine = (height + ey - by) / length
    rod_angle = asin(rod_sine)
    rod_cosine = cos(rod_angle)
    rod_speed = (lift + evy - bvy) / (length * rod_cosine)
    s[State.ROD_ANGLE, lane], s[State.ROD_SPEED, lane] = rod_angle, rod_speed
    s[State.ROD_X, lane], s[State.ROD_Y, lane] = bx + to_b * rod_cosine, by + to_b * rod_sine
    s[State.ROD_X_RATE, lane] = bvx - to_b * rod_sine * rod_speed
    s[State.ROD_Y_RATE, lane] = bvy + to_b * rod_cosine * rod_speed
    s[State.SLIDER_X, lane] = bx + length * rod_cosine - ex
    s[State.SLIDER_X_RATE, lane] = bvx - length * rod_sine * rod_speed - evx
    s[State.SLIDER_Y, lane], s[State.SLIDER_Y_RATE, lane] = height, lift


@subroutine
def fold(codes: np.ndarray, p: np.ndarray, s: np.ndarray, lane: int, node: np.ndarray) -> None:
    """Write a lane's state as a node."""
    for i in range(STATES):
        node[i] = s[i, lane]
    crank, to_b = p[Parameter.CRANK_LENGTH, lane], p[Parameter.ROD_TO_B, lane]
    to_c = p[Parameter.ROD_TO_C, lane]
    sine, cosine = sin(s[State.CRANK_ANGLE, lane]), cos(s[State.CRANK_ANGLE, lane])
    rod_sine, rod_cosine = sin(s[State.ROD_ANGLE, lane]), cos(s[State.ROD_ANGLE, lane])
    turn, swing = crank * s[State.CRANK_SPEED, lane], s[State.ROD_SPEED, lane]
    x, y = s[State.ROD_X, lane], s[State.ROD_Y, lane]
    vx, vy = s[State.ROD_X_RATE, lane], s[State.ROD_Y_RATE, lane]
    for row in (State.ROD_X, State.ROD_Y, State.ROD_ANGLE, State.SLIDER_X):
        node[row] = 0.0
        node[row + _RATE] = 0.0
    if chosen(codes, Family.JOINT_B) == 1:
        gap = p[Parameter.JOINT_CLEARANCE, lane]
        node[State.ROD_X] = (s[State.FRAME_X, lane] + crank * cosine - x + to_b * rod_cosine) / gap
        node[State.ROD_Y] = (s[State.FRAME_Y, lane] + crank * sine - y + to_b * rod_sine) / gap
        rate = s[State.FRAME_X_RATE, lane] - turn * sine - vx - to_b * rod_sine * swing
        node[State.ROD_X_RATE] = rate / gap
        rate = s[State.FRAME_Y_RATE, lane] + turn * cosine - vy + to_b * rod_cosine * swing
        node[State.ROD_Y_RATE] = rate / gap
    if chosen(codes, Family.JOINT_C) == 1:
        gap = p[Parameter.JOINT_CLEARANCE + JOINT_STRIDE, lane]
        node[State.SLIDER_X] = (x + to_c * rod_cosine - s[State.SLIDER_X, lane]) / gap
        node[State.ROD_ANGLE] = (y + to_c * rod_sine - s[State.SLIDER_Y, lane]) / gap
        node[State.SLIDER_X_RATE] = (vx - to_c * rod_sine * swing - s[State.SLIDER_X_RATE, lane]) / gap
        node[State.ROD_SPEED] = (vy + to_c * rod_cosine * swing - s[State.SLIDER_Y_RATE, lane]) / gap


@subroutine
def note(r: np.ndarray, lane: int, contact: np.ndarray) -> None:
    """Write a lane's penetration and normal force of B, then of C."""
    contact[0], contact[1] = r[Result.PENETRATION_B, lane], r[Result.NORMAL_FORCE_B, lane]
    contact[2], contact[3] = r[Result.PENETRATION_C, lane], r[Result.NORMAL_FORCE_C, lane]


@subroutine
def _divided(work: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Scratch for an evaluation, a step, a state, its signals and the lanes' parameters."""
    state = RESULTS + WORKSPACE
    lanes = state + STATES + SIGNALS
    return (
        work[:RESULTS], work[RESULTS:state], work[state : state + STATES], work[state + STATES : lanes],
        work[lanes : lanes + PARAMETERS],
    )  # fmt: skip


@entry
def shoot(
    codes: np.ndarray,
    p: np.ndarray,
    nodes: np.ndarray,
    varied: np.ndarray,
    change: np.ndarray,
    input_rows: np.ndarray,
    inputs: np.ndarray,
    scheme: int,
    h: float,
    substeps: int,
    refinement: int,
    periods: int,
    filtered: np.ndarray,
    points: np.ndarray,
    weights: np.ndarray,
    work: np.ndarray,
    ends: np.ndarray,
    signals: np.ndarray,
    contacts: np.ndarray,
    blocks: np.ndarray,
    samples: np.ndarray,
) -> None:
    """Run every segment from its node several times, each run with something else changed.

    The lanes are filled run by run, segment by segment, so that none is idle but in the last group.

    Args:
        codes: (families,) chosen laws.
        p: (PARAMETERS, runs) parameters of each run; rows ``input_rows`` are added to ``inputs``.
        nodes: (segments, STATES) starts, see the module.
        varied: (runs,) row of the node that a run changes; -1 for none.
        change: (runs,) by how much.
        input_rows: (inputs,) rows of ``p`` that differ between segments: constant forces.
        inputs: (segments, inputs) their values.
        scheme: a ``Scheme``.
        h: step [s].
        substeps: steps a base sample.
        refinement: steps that replace one in contact.
        periods: base samples a segment.
        filtered: rows of ``Signal`` that pass the filter.
        points: rows of ``Signal`` that are sampled as they are.
        weights: (3 m, periods) of a segment's base samples in the m filtered samples of the segment before,
            of its own and of the one after.
        work: (WORK_ROWS, WIDTH) scratch.
        ends: (segments, runs, STATES) written: the runs' last states as nodes.
        signals: (segments, periods, SIGNALS) written: the first run's signals at the base rate.
        contacts: (segments, m, 4) written: penetration and normal force of B, then of C, in the first run.
        blocks: (segments, 3 m, filtered, runs) written: contributions to the filtered samples.
        samples: (segments, m, points, runs) written.
    """
    m, width, count, runs = weights.shape[0] // 3, work.shape[1], filtered.size, p.shape[1]
    every, total = periods // m, nodes.shape[0] * runs
    r, w, s, y, q = _divided(work)
    node = np.zeros(STATES)
    heard = np.empty((count * periods, width))  # what passes the filter, at the base rate
    sums = np.empty((3, width))
    segment, run = np.zeros(width, dtype=np.int64), np.zeros(width, dtype=np.int64)
    for first in range(0, total, width):
        for lane in range(width):
            job = min(first + lane, total - 1)
            k, v = job // runs, job % runs
            segment[lane], run[lane] = k, v
            for i in range(p.shape[0]):
                q[i, lane] = p[i, v]
            for i in range(input_rows.size):
                q[input_rows[i], lane] = p[input_rows[i], v] + inputs[k, i]
            node[:] = nodes[k]
            if varied[v] >= 0:
                node[varied[v]] += change[v]
            unfold(codes, q, node, s, lane)
        project(codes, q, s)
        for i in range(periods):
            evaluate(codes, q, s, r)
            remember(codes, s, r)
            sense(codes, q, s, r, y, 0)
            for c in range(count):
                put(heard, c * periods + i, get(y, filtered[c]))
            for lane in range(width):
                k, v = segment[lane], run[lane]
                if v == 0:
                    for c in range(SIGNALS):
                        signals[k, i, c] = y[c, lane]
                if i % every == 0:
                    if v == 0:
                        note(r, lane, contacts[k, i // every])
                    for c in range(points.size):
                        samples[k, i // every, c, v] = y[points[c], lane]
            sample_period(codes, q, s, r, w, scheme, h, substeps, refinement)
        for lane in range(width):
            fold(codes, q, s, lane, ends[segment[lane], run[lane]])
        for c in range(count):
            for j in range(m):  # three sums in registers: the filter costs as much as the motion otherwise
                before = after = amid = zero(get(heard, 0))
                for i in range(periods):
                    value = get(heard, c * periods + i)
                    before += weights[j, i] * value
                    amid += weights[m + j, i] * value
                    after += weights[2 * m + j, i] * value
                put(sums, 0, before)
                put(sums, 1, amid)
                put(sums, 2, after)
                for lane in range(width):
                    for part in range(3):
                        blocks[segment[lane], part * m + j, c, run[lane]] = sums[part, lane]


@entry
def coast(
    codes: np.ndarray,
    p: np.ndarray,
    nodes: np.ndarray,
    input_rows: np.ndarray,
    inputs: np.ndarray,
    scheme: int,
    h: float,
    substeps: int,
    refinement: int,
    every: int,
    work: np.ndarray,
    ends: np.ndarray,
    signals: np.ndarray,
    contacts: np.ndarray,
) -> None:
    """Run every segment from its node and change nothing: ``WIDTH`` segments at a time, side by side.

    Args:
        codes: (families,) chosen laws.
        p: (PARAMETERS,) parameters; rows ``input_rows`` are added to ``inputs``.
        nodes: (segments, STATES) starts, see the module.
        input_rows: (inputs,) rows of ``p`` that differ between segments: constant forces.
        inputs: (segments, inputs) their values.
        scheme: a ``Scheme``.
        h: step [s].
        substeps: steps a base sample.
        refinement: steps that replace one in contact.
        every: base samples from one contact that is noted to the next.
        work: (WORK_ROWS, WIDTH) scratch.
        ends: (segments, STATES) written: the last states as nodes.
        signals: (segments, periods, SIGNALS) written: the signals at the base rate.
        contacts: (segments, m, 4) written: penetration and normal force of B, then of C.
    """
    width, count, periods = work.shape[1], nodes.shape[0], signals.shape[1]
    r, w, s, y, q = _divided(work)
    for i in range(p.shape[0]):
        for lane in range(width):
            q[i, lane] = p[i]
    for first in range(0, count, width):
        for lane in range(width):
            k = min(first + lane, count - 1)
            for i in range(input_rows.size):
                q[input_rows[i], lane] = p[input_rows[i]] + inputs[k, i]
            unfold(codes, q, nodes[k], s, lane)
        project(codes, q, s)
        for i in range(periods):
            evaluate(codes, q, s, r)
            remember(codes, s, r)
            sense(codes, q, s, r, y, 0)
            for lane in range(min(width, count - first)):
                for c in range(SIGNALS):
                    signals[first + lane, i, c] = y[c, lane]
                if i % every == 0:
                    note(r, lane, contacts[first + lane, i // every])
            sample_period(codes, q, s, r, w, scheme, h, substeps, refinement)
        for lane in range(min(width, count - first)):
            fold(codes, q, s, lane, ends[first + lane])


WORK_ROWS = RESULTS + WORKSPACE + STATES + SIGNALS + PARAMETERS
