"""Many short runs from given states, each with its neighbours in state and parameters: multiple shooting.

A recording is cut into segments of a millisecond or so. Each segment starts at a node; its sixteen lanes are
the run from the node itself and runs from it with one coordinate, one force or one parameter changed a
little. The result is what an estimator needs: where every run ends, and what it contributes to the filtered
samples of its own segment and of the two beside it.

A node is written in the layout of ``State``, with one change of variables: the place of a journal in its
bearing is kept as eccentricity over clearance. The penetration, some 1e-7 m and worth hundreds of newtons,
then survives a change of the clearance, which would otherwise tear every contact open.
"""

from math import asin, cos, sin

import numpy as np

from clearance.compilation import entry, subroutine
from clearance.lanes import WIDTH, get, put, zero
from clearance.mechanism.choice import chosen
from clearance.mechanism.parameters import JOINT_STRIDE, Family, Parameter
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
    """Run every segment from its node in ``WIDTH`` lanes.

    Args:
        codes: (families,) chosen laws.
        p: (PARAMETERS, WIDTH) parameters of each lane; rows ``input_rows`` are added to ``inputs``.
        nodes: (segments, STATES) starts, see the module.
        varied: (WIDTH,) row of the node that a lane changes; -1 for none.
        change: (WIDTH,) by how much.
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
        work: (RESULTS + WORKSPACE + STATES + SIGNALS, WIDTH) scratch.
        ends: (segments, WIDTH, STATES) written: the lanes' last states as nodes.
        signals: (segments, periods, SIGNALS) written: the first lane's signals at the base rate.
        contacts: (segments, m, 4) written: penetration and normal force of B, then of C, in the first lane.
        blocks: (segments, 3 m, filtered, WIDTH) written: contributions to the filtered samples.
        samples: (segments, m, points, WIDTH) written.
    """
    rows, width, count = weights.shape[0], p.shape[1], filtered.size
    m = rows // 3
    every = periods // m
    r = work[:RESULTS]
    w = work[RESULTS : RESULTS + WORKSPACE]
    s = work[RESULTS + WORKSPACE : RESULTS + WORKSPACE + STATES]
    y = work[RESULTS + WORKSPACE + STATES :]
    node = np.zeros(STATES)
    heard = np.empty((count * periods, width))  # what passes the filter, at the base rate
    mixed = blocks.reshape(nodes.shape[0] * rows * count, width)
    own = p[input_rows, :].copy() if input_rows.size else np.zeros((0, width))
    for k in range(nodes.shape[0]):
        for i in range(input_rows.size):
            for lane in range(width):
                p[input_rows[i], lane] = own[i, lane] + inputs[k, i]
        for lane in range(width):
            node[:] = nodes[k]
            if varied[lane] >= 0:
                node[varied[lane]] += change[lane]
            unfold(codes, p, node, s, lane)
        project(codes, p, s)
        for i in range(periods):
            evaluate(codes, p, s, r)
            remember(codes, s, r)
            sense(codes, p, s, r, y, 0)
            for c in range(SIGNALS):
                signals[k, i, c] = y[c, 0]
            for c in range(count):
                put(heard, c * periods + i, get(y, filtered[c]))
            if i % every == 0:
                note(r, 0, contacts[k, i // every])
                for c in range(points.size):
                    for lane in range(width):
                        samples[k, i // every, c, lane] = y[points[c], lane]
            sample_period(codes, p, s, r, w, scheme, h, substeps, refinement)
        for lane in range(width):
            fold(codes, p, s, lane, ends[k, lane])
        for c in range(count):
            for j in range(m):  # three sums in registers: the filter costs as much as the motion otherwise
                before = after = amid = zero(get(heard, 0))
                for i in range(periods):
                    value = get(heard, c * periods + i)
                    before += weights[j, i] * value
                    amid += weights[m + j, i] * value
                    after += weights[2 * m + j, i] * value
                put(mixed, (k * rows + j) * count + c, before)
                put(mixed, (k * rows + m + j) * count + c, amid)
                put(mixed, (k * rows + 2 * m + j) * count + c, after)
    for i in range(input_rows.size):
        for lane in range(width):
            p[input_rows[i], lane] = own[i, lane]


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
        p: (PARAMETERS, WIDTH) parameters, all lanes alike; rows ``input_rows`` are added to ``inputs``.
        nodes: (segments, STATES) starts, see the module.
        input_rows: (inputs,) rows of ``p`` that differ between segments: constant forces.
        inputs: (segments, inputs) their values.
        scheme: a ``Scheme``.
        h: step [s].
        substeps: steps a base sample.
        refinement: steps that replace one in contact.
        every: base samples from one contact that is noted to the next.
        work: (RESULTS + WORKSPACE + STATES + SIGNALS, WIDTH) scratch.
        ends: (segments, STATES) written: the last states as nodes.
        signals: (segments, periods, SIGNALS) written: the signals at the base rate.
        contacts: (segments, m, 4) written: penetration and normal force of B, then of C.
    """
    width, count, periods = p.shape[1], nodes.shape[0], signals.shape[1]
    r = work[:RESULTS]
    w = work[RESULTS : RESULTS + WORKSPACE]
    s = work[RESULTS + WORKSPACE : RESULTS + WORKSPACE + STATES]
    y = work[RESULTS + WORKSPACE + STATES :]
    own = p[input_rows, 0].copy()
    for first in range(0, count, width):
        for lane in range(width):
            k = min(first + lane, count - 1)
            for i in range(input_rows.size):
                p[input_rows[i], lane] = own[i] + inputs[k, i]
            unfold(codes, p, nodes[k], s, lane)
        project(codes, p, s)
        for i in range(periods):
            evaluate(codes, p, s, r)
            remember(codes, s, r)
            sense(codes, p, s, r, y, 0)
            for lane in range(min(width, count - first)):
                for c in range(SIGNALS):
                    signals[first + lane, i, c] = y[c, lane]
                if i % every == 0:
                    note(r, lane, contacts[first + lane, i // every])
            sample_period(codes, p, s, r, w, scheme, h, substeps, refinement)
        for lane in range(min(width, count - first)):
            fold(codes, p, s, lane, ends[first + lane])
    for i in range(input_rows.size):
        p[input_rows[i], :] = own[i]


WORK_ROWS = RESULTS + WORKSPACE + STATES + SIGNALS
assert WIDTH >= 2
