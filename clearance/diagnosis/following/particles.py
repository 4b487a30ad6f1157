"""Find the way again where a path is lost at an impact: samples of what is known are run on.

A journal or a shoe that strikes a little earlier, or with its other end, goes on elsewhere, where no small
correction leads back. What the samples before leave open is known, though: the linearised smoother gives the
states' distribution in square-root form, from which states are drawn, parameters of the machine with them
where these are not known yet. Each is run on by the simulator; those that come nearest to the recording are
corrected as usual.

References: draws from a square-root information matrix: Rue & Held 2005, Gaussian Markov Random Fields, sec.
2.3. Weighing simulated draws by what is measured next: Gordon, Salmond & Smith 1993, IEE Proc. F 140(2).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.shooting.chart import Chart
from clearance.diagnosis.shooting.follow import EDGE, Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.settle import settle
from clearance.diagnosis.shooting.stretch import Path
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank

FRESH, DOUBT = 0.99, 0.1
"""Factors on the doubt of a first node: nothing is known before it, but its samples count; it is followed."""

_NEARBY, _WIDE = 1.0, 4.0  # factors on what is known of the states
_ROUGH = 3.0  # factor on the noise, to correct a draw at first
_GOAL = 1.05  # cost a sample at which it is right
_KNOWN = 2  # segments before the lost one whose samples tell the state, beyond those at the edge
_ROUNDS = (1.0, 1.0, 0.5, 0.3)  # the same where parameters are drawn, each round about the best
_WITHIN = 3.0  # standard deviations of a parameter that a draw may be from where it is expected
_SHARES = (1.0, 0.3, 0.1, 0.0)  # of them, that one draw after the other takes: more is known at each strike
_NEAR = 12.0  # cost a sample of a rough correction that is worth another one
_APART = 0.01  # of a slider's play, by which ways on differ
_PRESSED = 0.02  # of it, by which a draw may press deeper into a rail than the path
_TRIES = 4  # times as many draws as wanted, of which those beyond the rails do not count
_NOTHING = np.zeros(0)


@dataclass(frozen=True)
class _Effort:
    """How many draws are made and corrected.

    Attributes:
        machines: draws of the parameters.
        states: draws of the states for each.
        corrected: of all, nearest first.
    """

    machines: int
    states: int
    corrected: int


_FOLLOWED, _DOUBTED, _UNSEEN = _Effort(1, 64, 8), _Effort(8, 16, 8), _Effort(4, 64, 16)
"""Where the machine is known; where its parameters are drawn; where nothing is known before a stretch."""


@dataclass(frozen=True)
class Lost:
    """A stretch that is followed up to a segment.

    Attributes:
        follower: with its path; changed from ``first`` to ``last`` by what tries to find the way.
        first: first segment that is looked at.
        last: one beyond the last.
        place: first segment that is not followed.
        fresh: whether nothing is known of the path before ``first``.
    """

    follower: Follower
    first: int
    last: int
    place: int
    fresh: bool = False

    @property
    def options(self) -> dict[str, Any]:
        """For ``Follower.look``."""
        return {"first": self.first, "last": self.last, "doubt": FRESH if self.fresh else DOUBT}

    def judged(self, model: Model, values: np.ndarray) -> "Found":
        """The present path."""
        seen = self.follower.compare(model.machine(values), model.instrument(values), **self.options)
        worst = float(seen.each[EDGE:-EDGE].max())
        return Found(self.follower.path.copy(), values, seen.cost, seen.cost / max(seen.samples, 1), worst)

    def corrected(
        self, model: Model, begin: "Found", scale: float, home: np.ndarray | None, **how: Any
    ) -> "Found":
        """A path and its parameters after a few steps; infinitely bad where a law does not take them."""
        self.follower.path = begin.path.copy()
        how = {"iterations": 4, "tolerance": 5e-2, "tries": 2} | how
        goal = _GOAL if scale == 1.0 else 0.0
        try:
            found = settle(
                [self.follower], model, begin.values[None], workers=1, goal=goal, scale=scale,
                home=None if home is None else home[None], **self.options, **how,
            )  # fmt: skip
            return self.judged(model, found.values[0])
        except InputError:
            return replace(begin, cost=np.inf, level=np.inf, worst=np.inf)


@dataclass(frozen=True)
class Found:
    """A way on from where a path was lost.

    Attributes:
        path: with it.
        values: (unknowns,).
        cost: of the stretch.
        level: cost a sample.
        worst: that of the segment that is followed worst.
    """

    path: Path
    values: np.ndarray
    cost: float
    level: float
    worst: float


def rejoin(lost: Lost, fixed: Model, limit: float, wide: bool) -> bool:
    """Put a path together anew from a segment on that is lost; kept where it comes nearer.

    Args:
        lost: the stretch.
        fixed: model without unknowns.
        limit: cost a sample up to which a segment is followed.
        wide: whether it is looked for further away than what is known of the states says.

    Returns:
        Whether all is followed now.
    """
    lost = replace(lost, fresh=False)
    random = np.random.default_rng([lost.place, lost.last])
    begin = best = lost.judged(fixed, _NOTHING)
    spread = _WIDE if wide else _NEARBY
    for rough in _drawn(lost, begin, fixed, None, _NOTHING, spread, _FOLLOWED, random)[:1]:
        best = min(best, lost.corrected(fixed, rough, 1.0, None), key=lambda one: one.cost)
    lost.follower.path = best.path
    return best.worst < limit


def ways_on(
    lost: Lost, model: Model, values: np.ndarray, home: np.ndarray, deviations: np.ndarray, limit: float
) -> Iterator[Found | None]:
    """Ways on from where a path is lost and the machine may be wrong; ``None`` after each round of draws.

    Args:
        lost: the stretch, with its path at the first call.
        model: with the parameters that are drawn as unknowns.
        values: (unknowns,) with which the path was followed.
        home: (unknowns,) where they are expected.
        deviations: (unknowns,) standard deviations of that.
        limit: cost a sample up to which a segment is followed.
    """
    bounded = replace(
        model,
        unknowns=tuple(
            replace(unknown, low=float(at - _WITHIN * deviation), high=float(at + _WITHIN * deviation))
            for unknown, at, deviation in zip(model.unknowns, home, deviations, strict=True)
        ),
    )
    effort = _UNSEEN if lost.fresh else _DOUBTED
    random = np.random.default_rng([lost.place, lost.last])
    best = lost.judged(bounded, values)
    gone: list[np.ndarray] = []
    for spread in _ROUNDS:
        for rough in _drawn(lost, best, bounded, home, deviations, spread, effort, random):
            if rough.level > _NEAR:
                break
            found = lost.corrected(bounded, rough, 1.0, home, iterations=12, tolerance=1e-3, tries=4)
            chart = Chart.of(bounded.machine(found.values))
            place = chart.between_rails(found.path.nodes[lost.last - EDGE])
            if found.worst < limit and all(np.abs(place - other).max() > _APART for other in gone):
                gone.append(place)
                yield found
            best = min(best, found, key=lambda one: one.cost)
        yield None


def _drawn(
    lost: Lost,
    begin: Found,
    model: Model,
    home: np.ndarray | None,
    deviations: np.ndarray,
    spread: float,
    effort: _Effort,
    random: np.random.Generator,
) -> list[Found]:
    """Draws of what is known before a path is lost, roughly corrected, the nearest one first."""
    follower, first = lost.follower, lost.first
    place = max(lost.place - 1, first + EDGE)  # where the draws are taken
    follower.path = begin.path.copy()
    machine, instrument = model.machine(begin.values), model.instrument(begin.values)
    chart, known = Chart.of(machine), begin.path.nodes[first : place + 1]
    smoothed = follower.look(
        machine, (), instrument, forces=follower.forced,
        **lost.options | {"last": min(place + _KNOWN, lost.last)},
    ).solve(judged=False)  # fmt: skip
    low = np.array([u.low for u in model.unknowns])
    high = np.array([u.high for u in model.unknowns])
    most = np.maximum(chart.pressed(known), 1.0) + _PRESSED
    drawn: list[tuple[float, Path, np.ndarray]] = []
    for i in range(effort.machines):
        away = spread * _SHARES[i % len(_SHARES)] * deviations * random.standard_normal(len(deviations))
        row = np.clip(begin.values + away, low, high)
        try:
            other, faults = model.machine(row), model.instrument(row)
        except InputError:
            continue
        rails = Chart.of(other)
        moved: list[np.ndarray] = []
        for _ in range(_TRIES * effort.states):
            change = smoothed.draw(random)[: len(known), : len(chart.rows)]
            nodes = rails.carried(chart.moved(known, spread * change), chart)
            if (rails.pressed(nodes) < most).all():
                moved.append(nodes)
            if len(moved) == effort.states:
                break
        if moved:
            follower.path = begin.path.copy()
            drawn += [(cost, path, row) for cost, path in _run_on(lost, other, faults, np.array(moved))]
    nearest = sorted(drawn, key=lambda one: one[0])[: effort.corrected]
    roughly = [
        lost.corrected(model, Found(path, row, cost, np.inf, np.inf), _ROUGH, home)
        for cost, path, row in nearest
    ]
    return sorted(roughly, key=lambda one: one.cost)


def _run_on(
    lost: Lost, machine: SliderCrank, instrument: Instrument, moved: np.ndarray
) -> list[tuple[float, Path]]:
    """Run a machine on from where (draws, nodes, STATES) end: cost and path of each."""
    follower, first = lost.follower, lost.first
    place = first + moved.shape[1] - 1
    states, after = moved[:, -1], []
    for k in range(place, min(lost.last, follower.segments - 1)):
        states = follower.arrivals(machine, k, states)
        after.append(states)
    found = []
    for i, nodes in enumerate(moved):
        follower.path.nodes[first : place + 1] = nodes
        for k, arrived in enumerate(after):
            follower.path.nodes[place + 1 + k] = arrived[i]
        cost = follower.compare(machine, instrument, **lost.options).cost
        found.append((cost, follower.path.copy()))
    return found
