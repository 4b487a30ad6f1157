"""Find the way again where a path is lost at an impact: samples of what is known are run on.

A journal or a shoe that strikes a little earlier, or with its other end, goes on elsewhere, where no small
correction leads back. What the samples before leave open is known, though: the linearised smoother gives the
states' distribution in square-root form, from which states are drawn. Each is run on by the simulator; those
that come nearest to the recording are corrected as usual.

References: draws from a square-root information matrix: Rue & Held 2005, Gaussian Markov Random Fields, sec.
2.3. Weighing simulated draws by what is measured next: Gordon, Salmond & Smith 1993, IEE Proc. F 140(2).
"""

import numpy as np

from clearance.diagnosis.chart import Chart
from clearance.diagnosis.fit import Model, Settled, settle
from clearance.diagnosis.follow import EDGE, Follower

_DRAWN = 64  # states
_SPREADS = (1.0, 4.0)  # factors on what is known of them, in turn
_CORRECTED = 8  # of them, nearest first; roughly, then the best one of them to the end
_ROUGH = 3.0  # factor on the noise, to correct them at first
_ITERATIONS, _GOAL = 4, 1.05
_KNOWN = 2  # segments before the lost one whose samples tell the state, beyond those at the edge
_DOUBT = 0.1  # factor on that of a first node: the path before it is followed
_NOTHING = np.zeros((1, 0))


def rejoin(follower: Follower, fixed: Model, first: int, last: int, lost: int, limit: float) -> bool:
    """Put a path together anew from a segment on that is lost; kept where it comes nearer.

    Args:
        follower: with a path; changed from ``first`` to ``last``.
        fixed: model without unknowns.
        first: first segment that is looked at.
        last: one beyond the last.
        lost: first segment that is not followed.
        limit: cost a sample up to which a segment is followed.

    Returns:
        Whether all is followed now.
    """
    machine, instrument = fixed.machine(_NOTHING[0]), fixed.instrument(_NOTHING[0])
    chart, random = Chart.of(machine), np.random.default_rng([lost, last])
    begin, best = follower.path.copy(), follower.path.copy()
    place = max(lost - 1, first + EDGE)  # where the draws are taken
    known = follower.look(
        machine, (), instrument, first=first, last=min(place + _KNOWN, last), doubt=_DOUBT,
        forces=follower.forced,
    ).solve(judged=False)  # fmt: skip

    def judge() -> tuple[float, float]:
        seen = follower.compare(machine, instrument, first, last, doubt=_DOUBT)
        return seen.cost, float(seen.each[EDGE:-EDGE].max())

    def correct(scale: float) -> Settled:
        return settle(
            [follower], fixed, _NOTHING, _ITERATIONS, 5e-2, 1, tries=2, goal=_GOAL if scale == 1.0 else 0.0,
            first=first, last=last, scale=scale, doubt=_DOUBT,
        )  # fmt: skip

    least, worst = judge()
    part = slice(first, place + 1)
    for spread in _SPREADS:
        drawn = []
        for _ in range(_DRAWN):
            change = known.draw(random)[: place + 1 - first, : len(chart.rows)]
            nodes = begin.nodes.copy()
            nodes[part] = chart.moved(nodes[part], spread * change)
            drawn.append(nodes)
        states = np.array([nodes[place] for nodes in drawn])
        for k in range(place, min(last, follower.segments - 1)):
            states = follower.arrivals(machine, k, states)
            for nodes, state in zip(drawn, states, strict=True):
                nodes[k + 1] = state
        follower.path.inputs[:] = begin.inputs
        costs = []
        for nodes in drawn:
            follower.path.nodes[:] = nodes
            costs.append(judge()[0])
        roughly = []
        for i in np.argsort(costs)[:_CORRECTED]:
            follower.path.nodes[:], follower.path.inputs[:] = drawn[i], begin.inputs
            found = correct(_ROUGH)
            roughly.append((found.cost, follower.path.copy()))
        follower.path = min(roughly, key=lambda one: one[0])[1]
        correct(1.0)
        cost, high = judge()
        if cost < least:
            least, worst, best = cost, high, follower.path.copy()
        if worst < limit:
            follower.path = best
            return True
    follower.path = best
    return False
