"""The torques that recordings need beside those that a machine would give, and what effects make of them.

An effect's share follows from the simulator's own equations with ideal joints, so every law that is written
there is known here. Sizes are fitted by robust Gauss-Newton steps: many bins around a badly understood impact
say nothing.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from clearance.diagnosis.hypotheses.free_form import KNOTS, Curve, curve_over, free_form, halved, refined
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting
from clearance.diagnosis.kinematics.agreement import loose
from clearance.diagnosis.kinematics.pieces import reconstruct_whole
from clearance.diagnosis.kinematics.regression import cost_of, regressed, scatter_of
from clearance.diagnosis.kinematics.rhythm import Needed, Rhythm, find_rhythm
from clearance.diagnosis.kinematics.rigid_motion import counts, tilt
from clearance.diagnosis.kinematics.turning import Turning, answer, binned
from clearance.diagnosis.searching.edges import EDGED
from clearance.diagnosis.searching.search import Search
from clearance.errors import InputError
from clearance.mechanism.applied_force import NoForce
from clearance.mechanism.drive import Drive, Free, Smooth, SpeedControl
from clearance.mechanism.slider_crank import SliderCrank

_ITERATIONS = 12
_COARSER = 200.0  # times an unknown's step: an edge moves here from sample to sample
_STRAIGHT = 0.02  # of a change: up to which derivatives that foretold it hold on
_SETTLED = 1e-3  # share by which the cost still falls
_STIFF = 0.1  # of what a knot is known by as a rule: below, it lies between its neighbours
_PRICE, _PRICE_OF_KNOT = 0.04, 0.01  # of what is left, for each size of an effect and each knot of a table
_UNNAMED = 1.5  # times as much: a spline says nearly all that two names do
_SAYS = {
    "crank_angle": 2,
    "time": 3,
}  # the angle can say all of the place; one recording's time, of the angle
DRIVE = "soft_drive"
"""Whose recordings are asked for speeds of their own."""
_EDGES = 9  # places along the stroke where it may begin or end
_TABLES = {
    ("slider", "x"): ("slider_position", "slider_velocity", "crank_angle"),
    ("crank", "torque"): ("crank_angle",),
    ("rod", "moment"): ("rod_angle", "crank_angle"),
}
"""Where forces of free form are looked for, as functions of what; over time in ``rhythms``."""
_CLOCKED = (("slider", "x"), ("crank", "torque"))
"""Where forces by a clock of their own are looked for."""
_FINEST = 0.5  # of what a coarser table leaves: a finer one that leaves more says little more
_BLURRED = 0.05  # of a torque's size: what tells two laws of it apart


@dataclass(frozen=True)
class Balanced:
    """Effects that would give what the crank lacks.

    Attributes:
        hypotheses: one or two.
        values: (unknowns,) of their parameters.
        cost: robust mean square of what is left, in units of its scatter.
        clearance: of the joint beside them [m].
        curve: what a force of free form, which has no name, is a function of.
        rhythm: of one that repeats by a clock of its own.
        fewer: a table of half as many knots, where a few sensors say too little of each.
    """

    hypotheses: tuple[Hypothesis, ...]
    values: np.ndarray
    cost: float
    clearance: float
    curve: Curve | None = None
    rhythm: Rhythm | None = None
    fewer: "Balanced | None" = None

    @property
    def sizes(self) -> int:
        """Number of parameters that are no shape."""
        return sum(int((~h.shapes).sum()) for h in self.hypotheses)

    @property
    def price(self) -> float:
        """What is left, and a share of it for each size; names first; some arguments say all of another."""
        price = 1.0 + _PRICE * self.sizes
        if self.curve is not None:
            price = 1.0 + _PRICE_OF_KNOT * len(self.values)
            price *= _UNNAMED ** _SAYS.get(self.curve.argument, 1.0)
        return self.cost * price

    @property
    def label(self) -> str:
        """The hypotheses' labels."""
        shown = " + ".join(h.label for h in self.hypotheses)
        if self.curve is None:
            return shown
        return f"{shown} over {self.curve.argument}, {len(self.values)} knots, {self.curve.interpolation}"


def bends(curve: Curve) -> np.ndarray:
    """(rows, knots) of how much a table bends at each knot.

    Where a force does no work, at a dead centre, nothing is known of it: its knots there are led by their
    neighbours, without which one was -384 N where 11 N act.
    """
    knots: np.ndarray = np.eye(len(curve.knots))
    if curve.repeats:
        return np.roll(knots, 1, axis=1) - 2.0 * knots + np.roll(knots, -1, axis=1)
    return np.diff(knots, 2, axis=0)


def beyond_ideal(machine: SliderCrank, turning: Turning) -> np.ndarray:
    """(bins,) torque that the play of the journals needs beyond the ideal motion [N m].

    Loads that the reconstruction counted are part of that motion; the drive and other tables are not.
    """
    counted = machine.force if counts(machine.parameters(), turning.clocked) else NoForce()
    inertia, acceleration = answer(replace(machine, drive=Free(), ripple=Smooth(), force=counted), turning)
    return binned(turning.torque - inertia * (turning.acceleration - acceleration))


class Balance:
    """The torques that recordings need, beside those that a machine would give."""

    def __init__(self, search: Search, setting: Setting, machine: SliderCrank, clearance: float) -> None:
        """Reconstruct the motion of each recording.

        Args:
            search: with its alignments.
            setting: the machine that effects are added to.
            machine: the same or one with loads, from which the motion is reconstructed.
            clearance: of the diagnosed joint [m].

        Raises:
            LinAlgError: a linkage that does not turn.
        """
        self.setting, self.clearance = setting, clearance
        self.turnings: list[Turning] = []
        for measured, known in zip(search.recordings, search.alignments, strict=True):
            path = reconstruct_whole(measured, machine.parameters(), loose(machine), known.speed, known.angle)
            self.turnings.append(Turning.along(path, machine, measured))
        self.beyond = [beyond_ideal(machine, turning) for turning in self.turnings]
        left, offsets = self._left((), np.zeros(0))
        left = left - offsets @ np.linalg.lstsq(offsets, left, rcond=None)[0]
        ends = np.cumsum([len(part) for part in self.beyond])[:-1]
        self.scatter = scatter_of(np.split(left, ends))

    def timed(self, clocks: Sequence[float] | np.ndarray) -> "Balance":
        """The same by other clocks of the recordings [s]."""
        other = copy(self)
        other.turnings = [
            replace(turning, begin=turning.begin + clock)
            for turning, clock in zip(self.turnings, clocks, strict=True)
        ]
        return other

    def cost(self, hypotheses: tuple[Hypothesis, ...], values: np.ndarray) -> float:
        """What effects of given sizes leave, as of ``fit``."""
        return self._cost(*self._left(hypotheses, values))

    def least(self, share: float) -> float:
        """A force on the slider [N] whose work is, as mean square, a share of the scatter's."""
        slide = np.concatenate([binned(turning.slide) for turning in self.turnings])
        return float(np.sqrt(share) * self.scatter / np.sqrt(np.mean(slide**2)))

    def imitate(self, machine: SliderCrank) -> None:
        """Go on with what another machine would give in the place of what the motion needs.

        With the drive of the one that effects are added to: what another speed asks for is of no interest.
        """
        machine = replace(machine, drive=self._given((), np.zeros(0))[1][0])
        self.beyond = []
        for turning in self.turnings:
            inertia, acceleration = answer(machine, turning)
            self.beyond.append(binned(inertia * (acceleration - turning.acceleration)))
        left, offsets = self._left((), np.zeros(0))
        left = left - offsets @ np.linalg.lstsq(offsets, left, rcond=None)[0]
        self.scatter = max(_BLURRED * float(np.sqrt(np.mean(left**2))), 1e-9)

    def best(self, trials: Sequence[Hypothesis]) -> Balanced | None:
        """The best of several shapes of an effect."""
        starts = [(trial, trial.start) for trial in trials]
        if trials[0].name == EDGED:  # where it begins and ends no slope tells
            starts = [(trials[0], start) for start in self._edges(trials[0])]
        found = [one for trial, start in starts if (one := self.tried((trial,), start)) is not None]
        return min(found, key=lambda one: one.cost, default=None)

    def together(self, first: Balanced, other: Balanced) -> Balanced | None:
        """Two effects from what each was alone; a second one's edges, if it has any, all along the stroke."""
        hypotheses, starts = first.hypotheses + other.hypotheses, [other.values]
        if other.hypotheses[0].name == EDGED:
            starts += self._edges(other.hypotheses[0])
        found = [self.tried(hypotheses, np.append(first.values, start)) for start in starts]
        return min([one for one in found if one is not None], key=lambda one: one.cost, default=None)

    def _edges(self, hypothesis: Hypothesis) -> list[np.ndarray]:
        """Starts of a load over a part of the stroke, all along it."""
        names = [unknown.name for unknown in hypothesis.unknowns]
        place = np.concatenate([turning.place for turning in self.turnings])
        edges = np.linspace(place.min(), place.max(), _EDGES)
        found = []
        for i, start in enumerate(edges):
            for end in edges[i + 1 :]:
                values = hypothesis.start.copy()
                values[[names.index("start"), names.index("end")]] = start, end
                found.append(values)
        return found

    def tables(self, enough: float, most: float) -> list[Balanced]:
        """The cheapest force of free form over each argument, as of ``_cheapest``."""
        arguments = {
            "crank_angle": np.concatenate([turning.angle % (2.0 * pi) for turning in self.turnings]),
            "rod_angle": np.concatenate(
                [tilt(self.setting.machine.parameters(), turning.angle) for turning in self.turnings]
            ),
            "slider_position": np.concatenate([turning.place for turning in self.turnings]),
            "slider_velocity": np.concatenate([turning.slide * turning.speed for turning in self.turnings]),
        }
        found = []
        for (body, direction), names in _TABLES.items():
            for argument in names:
                found += self._cheapest(
                    curve_over(arguments[argument], body, direction, argument), enough, most
                )
        return found

    def rhythms(self, most: float) -> "list[Balanced]":
        """Likewise of forces over time that repeat by a clock of their own."""
        left, offsets = self._left((), np.zeros(0))
        ends = np.cumsum([len(part) for part in self.beyond])[:-1]
        parts = list(zip(np.split(left, ends), np.split(offsets, ends), self.turnings, strict=True))
        found = []
        for body, direction in _CLOCKED:
            needed = [
                Needed(
                    turning.begin + binned(turning.time),
                    binned(turning.slide) if body == "slider" else np.ones(len(torque)),
                    torque, own[:, np.abs(own).sum(axis=0) > 0.0],
                )
                for torque, own, turning in parts
            ]  # fmt: skip
            rhythm = find_rhythm(needed, self.scatter)
            if rhythm is None:
                continue
            clocked = self.timed(rhythm.clocks)
            knots = rhythm.period * np.arange(KNOTS) / KNOTS
            curve = Curve(
                body, direction, "time", knots, np.ones(KNOTS), np.zeros(KNOTS), 0.0, 0.0,
                period=rhythm.period,
            )  # fmt: skip
            found += [replace(one, rhythm=rhythm, fewer=None) for one in clocked._cheapest(curve, most, most)]
        return found

    def _cheapest(self, coarse: Curve, enough: float, most: float) -> "list[Balanced]":
        """The cheapest table over an argument, coarse or fine, of those that leave less than ``most``.

        One that leaves no more than ``enough`` comes first: the finer one says so where the coarser one just
        fails to, and over the wrong argument the finer one would be all that is left.
        """
        one = self._table(coarse)
        if one is None:
            return []
        fewer = self._table(halved(coarse))
        coarse = replace(coarse, forces=one.values)
        finer = [self._table(refined(coarse, between)) for between in ("linear", "cubic")]
        each = [table for table in (one, *finer) if table is not None and table.cost < most]
        best = sorted(each, key=lambda one: (one.cost > enough, one.price))[:1]
        # many knots are dear to follow with, but a high harmonic needs them
        finest = self._table(refined(refined(coarse, "cubic"), "cubic"))
        if finest is not None and finest.cost < min([most, *(_FINEST * one.cost for one in best)]):
            return [finest]
        return [replace(one, fewer=fewer) for one in best]

    def _table(self, curve: Curve) -> Balanced | None:
        """A force of free form from the forces of a curve on."""
        one = self.tried((free_form(curve, self.setting.joint),), curve.forces, bends(curve))
        if one is None:
            return None
        if curve.body == "crank":  # a constant torque is the drive's
            one = replace(one, values=one.values - one.values.mean())
        return replace(one, curve=replace(curve, forces=one.values))

    def tried(
        self, hypotheses: tuple[Hypothesis, ...], values: np.ndarray, straight: np.ndarray | None = None
    ) -> Balanced | None:
        """As ``fit``; ``None`` where a law does not take the values."""
        try:
            return self.fit(hypotheses, values, straight)
        except (InputError, np.linalg.LinAlgError):
            return None

    def fit(
        self, hypotheses: tuple[Hypothesis, ...], values: np.ndarray, straight: np.ndarray | None = None
    ) -> Balanced:
        """The best sizes of some effects, by Gauss-Newton.

        Args:
            hypotheses: effects.
            values: (unknowns,) to begin with.
            straight: (rows, unknowns) of them that should be small, as of ``bends``; none if ``None``.

        Raises:
            InputError: a law does not take the values.
            LinAlgError: torques that are not finite.
        """
        unknowns = [u for h in hypotheses for u in h.unknowns]
        low, high = np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns])
        free = [i for i, u in enumerate(unknowns) if u.low < u.high]
        best, cost, share = values.astype(float), np.inf, 1.0
        trial, before, fresh = best, np.zeros(0), True
        steps, change = np.zeros((0, len(free))), np.zeros(len(best))
        for _ in range(_ITERATIONS):
            left, offsets = self._left(hypotheses, trial)
            # what the drive is asked for is found anew at once
            now = self._cost(left, offsets)
            if now < cost:
                settled = cost - now < _SETTLED * now
                fresh = not len(steps) or _bent(left - before, -steps @ (trial - best)[free])
                best, cost, before, share = trial, now, left, 1.0
                if settled or not free:
                    break
            elif fresh:
                share *= 0.3
            else:  # derivatives of another place led astray
                fresh, share = True, 1.0
            if share == 1.0:
                steps = self._steps(hypotheses, best, free) if fresh else steps
                columns, lacking = np.column_stack([steps, offsets]), before
                if straight is not None:
                    stiff = _STIFF * float(np.median(np.linalg.norm(steps, axis=0))) * straight
                    bent = np.column_stack([stiff[:, free], np.zeros((len(stiff), offsets.shape[1]))])
                    columns, lacking = np.vstack([columns, bent]), np.append(lacking, -stiff @ best)
                change[free] = regressed(columns, lacking, self.scatter)[: len(free)]
            trial = np.clip(best + share * change, low, high)
        return Balanced(hypotheses, best, cost, self.clearance)

    def _cost(self, left: np.ndarray, offsets: np.ndarray) -> float:
        return cost_of(left - offsets @ regressed(offsets, left, self.scatter), self.scatter)

    def _left(self, hypotheses: Sequence[Hypothesis], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Torque needed minus torque given, and what it may be off by.

        Returns:
            (bins of all recordings,) [N m]; (bins, offsets) torques by which the drive of each recording may
            be off, since nobody knows what it is asked for.
        """
        torque, drives = self._given(hypotheses, values)
        offsets = []
        begin = 0
        for turning, drive in zip(self.turnings, drives, strict=True):
            time = binned(turning.time)
            level = np.ones(len(time))  # of a motor: its no-load speed
            for one in [level, time] if isinstance(drive, SpeedControl) else [level]:
                column = np.zeros(len(torque))
                column[begin : begin + len(one)] = one
                offsets.append(column)
            begin += len(time)
        return np.concatenate(self.beyond) - torque, np.array(offsets).reshape(-1, len(torque)).T

    def _steps(self, hypotheses: Sequence[Hypothesis], values: np.ndarray, free: Sequence[int]) -> np.ndarray:
        """(bins, free values) derivatives of the torque that is given."""
        unknowns = [u for h in hypotheses for u in h.unknowns]
        torque, steps = self._given(hypotheses, values)[0], []
        for i in free:
            moved = values.copy()
            step = _COARSER * unknowns[i].step
            moved[i] += step if moved[i] + step <= unknowns[i].high else -step
            steps.append((self._given(hypotheses, moved)[0] - torque) / (moved[i] - values[i]))
        return np.column_stack(steps)

    def _given(self, hypotheses: Sequence[Hypothesis], values: np.ndarray) -> tuple[np.ndarray, list[Drive]]:
        """(bins of all recordings,) torque that a machine with effects gives [N m], and the drive of each."""
        model = self.setting.model(hypotheses)
        asked = [float(np.mean(turning.speed)) * 30.0 / pi for turning in self.turnings]
        if not any(hypothesis.name == DRIVE for hypothesis in hypotheses):
            asked = asked[:1]  # what another speed asks for is one of the offsets
        machines = [model.machine(np.concatenate([[self.clearance], values, [one]])) for one in asked]
        machines *= len(self.turnings) // len(machines)
        parts = []
        for machine, turning in zip(machines, self.turnings, strict=True):
            inertia, acceleration = answer(machine, turning)
            parts.append(binned(inertia * (acceleration - turning.acceleration)))
        return np.concatenate(parts), [machine.drive for machine in machines]


def _bent(change: np.ndarray, expected: np.ndarray) -> bool:
    """Whether torques changed otherwise than derivatives say; most are straight in what is looked for."""
    return bool(np.linalg.norm(change - expected) > _STRAIGHT * np.linalg.norm(change))
