"""What turning the crank takes, and what would give it: the balance of work, whatever happens in the joints.

Turn the crank a little so that no journal moves against its bearing: the forces inside the joints then do no
work. The torque that the motion needs (d'Alembert: inertia forces times their way) must come from the drive
and from what acts on the links from outside. The motion is known from the accelerations alone
(``reconstruction``); so is what is missing, without a law of contact, without following the machine through
its impacts, however far it is from the nominal one. An effect's share follows from the simulator's own
equations with ideal joints, so every law that is written there is known here.

What is inside a joint is not seen here: contact and film do no work, and friction, which does, turns the
force of the contact by so much that the motion's forces are not known any more.

Reference: Lanczos 1970, The Variational Principles of Mechanics, ch. IV.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy.optimize import minimize_scalar

from clearance.diagnosis.explain import Search
from clearance.diagnosis.geometry import GEOMETRIC
from clearance.diagnosis.hypothesis import SMALLEST_CLEARANCE, Hypothesis, Setting
from clearance.diagnosis.measured import Measured
from clearance.diagnosis.missing_force import KNOTS, Curve, curve_over, free_form, refined
from clearance.diagnosis.reconstruction import reconstruct
from clearance.diagnosis.regression import cost_of, regressed
from clearance.diagnosis.rhythm import Needed, Rhythm, find_rhythm
from clearance.diagnosis.rigid_motion import counts
from clearance.diagnosis.trace import CLEARANCES, COMPARED, Alignment, agreement, loose
from clearance.diagnosis.turning import Turning, answer, binned
from clearance.errors import InputError
from clearance.mechanism.applied_force import NoForce
from clearance.mechanism.drive import Drive, Free, Smooth, SpeedControl
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank

_BALANCED = 3.0  # mean square in units of the scatter up to which nothing need be missing here
_QUIET = 1.2  # of it: up to which nothing can be told
_TAKEN = 0.12  # of it: what an effect takes away at least for each of its sizes (wrong ones 0.06 for one)
_FREE = 0.65  # likewise of a force of free form
_CLOCKED = 0.45  # of one over time: in a short recording a turn of the crank is a period, too
_BOTH = 0.4  # of what the better one of two leaves: they are suggested together
_PROMISING = 0.9  # of the imbalance: what leaves less may be one of two
_FIRST = 2  # single effects beside which a second one is looked for
_ITERATIONS = 12
_COARSER = 200.0  # times an unknown's step: an edge moves here from sample to sample
_SETTLED = 1e-3  # share by which the cost still falls
_PRICE, _PRICE_OF_KNOT = 0.04, 0.01  # of what is left, for each size of an effect and each knot of a table
_UNNAMED = 1.5  # times as much: a spline says nearly all that two names do
_SAYS = {
    "crank_angle": 2,
    "time": 3,
}  # the angle can say all of the place; one recording's time, of the angle
_SHOWN = 3
_WITHIN, _CLOSER = 0.7, 10  # of the clearance's logarithm; clearances that are compared there
DRIVE = "soft_drive"
_EDGED, _EDGES = "process_load", 9  # places along the stroke where it may begin or end
_TABLES = {
    ("slider", "x"): ("slider_position", "slider_velocity", "crank_angle"),
    ("crank", "torque"): ("crank_angle",),
}
"""Where forces of free form are looked for, as functions of what; over time in ``rhythms``."""
_CLOCKS = 120  # places in a period where another recording may begin
_RHYTHM = 0.3  # of the imbalance: where nothing else leaves less, a rhythm of its own is looked for


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
    """

    hypotheses: tuple[Hypothesis, ...]
    values: np.ndarray
    cost: float
    clearance: float
    curve: Curve | None = None
    rhythm: Rhythm | None = None

    @property
    def sizes(self) -> int:
        """Number of parameters that are no shape."""
        return sum(int((~h.shapes).sum()) for h in self.hypotheses)

    @property
    def label(self) -> str:
        """The hypotheses' labels."""
        shown = " + ".join(h.label for h in self.hypotheses)
        if self.curve is None:
            return shown
        return f"{shown} over {self.curve.argument}, {len(self.values)} knots, {self.curve.interpolation}"


@dataclass(frozen=True)
class Suggested:
    """What the balance of work says of a machine.

    Attributes:
        forces: effects that leave little of the imbalance, alone or two together, the best first.
        balanced: whether there is none to speak of.
    """

    forces: list[Balanced]
    balanced: bool


def suggest_forces(
    search: Search, setting: Setting, clearance: float, named: bool = False
) -> Suggested | None:
    """What would give the torque that the motion needs and a machine lacks.

    Returns:
        ``None`` where the nominal drive is not a speed control, so that the balance cannot be asked.

    Args:
        search: with its alignments.
        setting: the machine.
        clearance: of its joint [m].
        named: whether only effects with a name are wanted.

    Raises:
        LinAlgError: a linkage that does not turn.
    """
    if not isinstance(setting.machine.drive, SpeedControl):
        return None  # a motor's slope goes with its voltage, which nobody knows
    machine = setting.with_clearance(clearance)
    balance = _Balance(search, setting, machine, clearance)
    before = balance.fit((), np.zeros(0)).cost
    if before < _QUIET:
        return Suggested([], balanced=True)
    groups = [
        group
        for group in search.groups.values()
        if group[0].fault is None and group[0].name not in GEOMETRIC and not group[0].structural(machine)
    ]
    singles = [one for group in groups if (one := balance.best(group)) is not None]
    singles.sort(key=lambda one: one.cost)
    pairs = []
    for first in [one for one in singles if one.cost < _PROMISING * before][:_FIRST]:
        for other in singles:
            if other.hypotheses[0].name == first.hypotheses[0].name:
                continue
            pair = balance.tried(first.hypotheses + other.hypotheses, np.append(first.values, other.values))
            if pair is not None and pair.cost < _BOTH * min(first.cost, other.cost):
                pairs.append(pair)
    found = [one for one in [*singles, *pairs] if one.cost < (1.0 - _TAKEN * one.sizes) * before]
    if not named:
        found += balance.tables(_FREE * before)
        if min((one.cost for one in found), default=before) > _RHYTHM * before and not search.late():
            found += balance.rhythms(_CLOCKED * before)
    found.sort(key=_priced)
    for one in found[:_SHOWN]:
        shown = ", ".join(f"{value:.3g}" for value in one.values)
        search.report(
            f"  the balance of work agrees with {one.label} = {shown}: {one.cost / before:.1%} are left"
        )
    return Suggested(found, balanced=before < _BALANCED and not found)


def _priced(one: Balanced) -> float:
    """What is left, and a share of it for each size; names first; some arguments can say all of another."""
    price = 1.0 + _PRICE * one.sizes
    if one.curve is not None:
        price = 1.0 + _PRICE_OF_KNOT * len(one.values)
        price *= _UNNAMED ** _SAYS.get(one.curve.argument, 1.0)
    return one.cost * price


def settle_in(search: Search, setting: Setting, one: Balanced) -> Balanced:
    """The same, when clearance and path have been sought anew with the loads that it puts on the links.

    Where the slider is pushed, the journal lies elsewhere than the nominal machine's motion would have it.
    The reconstruction knows no clock: with a force over time it stays as it is.

    Raises:
        InputError: a law does not take the values.
        LinAlgError: a linkage that does not turn.
    """
    if one.rhythm is not None or all(hypothesis.body == "crank" for hypothesis in one.hypotheses):
        return one

    model, asked = setting.model(one.hypotheses), search.alignments[0].speed * 30.0 / pi

    def machine(clearance: float) -> SliderCrank:
        return model.machine(np.concatenate([[clearance], one.values, [asked]]))

    def disagree(size: float) -> float:
        made = [machine(float(np.exp(size)))]
        return float(agreement(search.recordings, search.alignments, made, COMPARED, search.workers)[0])

    middle = np.log(one.clearance)
    low = max(middle - _WITHIN, np.log(SMALLEST_CLEARANCE))
    found = minimize_scalar(
        disagree, method="bounded", bounds=(low, min(middle + _WITHIN, np.log(CLEARANCES[-1]))),
        options={"maxiter": _CLOSER},
    )  # fmt: skip
    clearance = float(np.exp(found.x))
    balance = _Balance(search, setting, machine(clearance), clearance)
    again = [balance.fit(one.hypotheses, one.values)]
    if one.hypotheses[0].name == _EDGED and len(one.hypotheses) == 1:  # its edges may have been met wrongly
        again += [other for other in [balance.best(one.hypotheses)] if other is not None]
    return replace(min(again, key=lambda other: other.cost), curve=one.curve)


def find_clock(measured: Measured, known: Alignment, machine: SliderCrank) -> float:
    """What the clock of a machine's table over time shows where a recording begins [s].

    Args:
        measured: whole recording.
        known: its alignment.
        machine: with the table.

    Raises:
        LinAlgError: a linkage that does not turn.
    """
    path = reconstruct(measured, machine.parameters(), loose(machine), known.speed, known.angle)
    turning = Turning.along(path, machine, measured)
    beyond, time = _beyond(machine, turning), binned(turning.time)
    offsets = np.column_stack([np.ones(len(time)), time])

    def left(clock: float) -> np.ndarray:
        inertia, acceleration = answer(machine, replace(turning, begin=turning.begin + clock))
        lacking = beyond - binned(inertia * (acceleration - turning.acceleration))
        bare: np.ndarray = lacking - offsets @ regressed(offsets, lacking, scatter)
        return bare

    scatter = _scatter([beyond])
    period = float(machine.parameters()[Parameter.TABLE_PERIOD])
    step = period / _CLOCKS
    near = min(step * np.arange(_CLOCKS), key=lambda clock: cost_of(left(clock), scatter))
    found = minimize_scalar(
        lambda clock: cost_of(left(clock), scatter), method="bounded", bounds=(near - step, near + step),
        options={"maxiter": _CLOSER},
    )  # fmt: skip
    return float(found.x % period)


def _beyond(machine: SliderCrank, turning: Turning) -> np.ndarray:
    """(bins,) torque that the play of the journals needs beyond the ideal motion [N m].

    Loads that the reconstruction counted are part of that motion; the drive and other tables are not.
    """
    counted = machine.force if counts(machine.parameters()) else NoForce()
    inertia, acceleration = answer(replace(machine, drive=Free(), ripple=Smooth(), force=counted), turning)
    return binned(turning.torque - inertia * (turning.acceleration - acceleration))


def _scatter(parts: Sequence[np.ndarray]) -> float:
    """Of a bin of torques, from how much they bend [N m]."""
    bends = np.concatenate([np.diff(part, 2) for part in parts])
    return float(1.4826 * np.median(np.abs(bends)) / np.sqrt(6.0))


class _Balance:
    """The torques that recordings need, beside those that a machine would give."""

    def __init__(self, search: Search, setting: Setting, machine: SliderCrank, clearance: float) -> None:
        self.setting, self.clearance = setting, clearance
        self.turnings: list[Turning] = []
        for measured, known in zip(search.recordings, search.alignments, strict=True):
            path = reconstruct(measured, machine.parameters(), loose(machine), known.speed, known.angle)
            self.turnings.append(Turning.along(path, machine, measured))
        self.beyond = [_beyond(machine, turning) for turning in self.turnings]
        left, offsets, _ = self._left((), np.zeros(0))
        left = left - offsets @ np.linalg.lstsq(offsets, left, rcond=None)[0]
        ends = np.cumsum([len(part) for part in self.beyond])[:-1]
        self.scatter = _scatter(np.split(left, ends))

    def best(self, trials: Sequence[Hypothesis]) -> Balanced | None:
        """The best of several shapes of an effect."""
        starts = [(trial, trial.start) for trial in trials]
        if trials[0].name == _EDGED:  # where it begins and ends no slope tells
            starts = [(trials[0], start) for start in self._edges(trials[0])]
        found = [one for trial, start in starts if (one := self.tried((trial,), start)) is not None]
        return min(found, key=lambda one: one.cost, default=None)

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

    def tables(self, most: float) -> list[Balanced]:
        """The cheapest force of free form over each argument, of those that cost less than ``most``."""
        arguments = {
            "crank_angle": np.concatenate([turning.angle % (2.0 * pi) for turning in self.turnings]),
            "slider_position": np.concatenate([turning.place for turning in self.turnings]),
            "slider_velocity": np.concatenate([turning.slide * turning.speed for turning in self.turnings]),
        }
        found = []
        for (body, direction), names in _TABLES.items():
            for argument in names:
                found += self._cheapest(curve_over(arguments[argument], body, direction, argument), most)
        return found

    def rhythms(self, most: float) -> "list[Balanced]":
        """Likewise of forces over time that repeat by a clock of their own."""
        left, offsets, _ = self._left((), np.zeros(0))
        ends = np.cumsum([len(part) for part in self.beyond])[:-1]
        parts = list(zip(np.split(left, ends), np.split(offsets, ends), self.turnings, strict=True))
        found = []
        for body, direction in _TABLES:
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
            clocked = copy(self)
            clocked.turnings = [
                replace(turning, begin=turning.begin + clock)
                for turning, clock in zip(self.turnings, rhythm.clocks, strict=True)
            ]
            knots = rhythm.period * np.arange(KNOTS) / KNOTS
            curve = Curve(
                body, direction, "time", knots, np.ones(KNOTS), np.zeros(KNOTS), 0.0, 0.0,
                period=rhythm.period,
            )  # fmt: skip
            found += [replace(one, rhythm=rhythm) for one in clocked._cheapest(curve, most)]
        return found

    def _cheapest(self, coarse: Curve, most: float) -> "list[Balanced]":
        """The cheapest table over an argument, coarse or fine, if it costs less than ``most``."""
        one = self._table(coarse)
        if one is None:
            return []
        coarse = replace(coarse, forces=one.values)
        finer = [self._table(refined(coarse, between)) for between in ("linear", "cubic")]
        each = [table for table in (one, *finer) if table is not None and table.cost < most]
        return sorted(each, key=_priced)[:1]

    def _table(self, curve: Curve) -> Balanced | None:
        """A force of free form from the forces of a curve on."""
        one = self.tried((free_form(curve, self.setting.joint),), curve.forces)
        if one is None:
            return None
        if curve.body == "crank":  # a constant torque is the drive's
            one = replace(one, values=one.values - one.values.mean())
        return replace(one, curve=replace(curve, forces=one.values))

    def tried(self, hypotheses: tuple[Hypothesis, ...], values: np.ndarray) -> Balanced | None:
        """As ``fit``; ``None`` where a law does not take the values."""
        try:
            return self.fit(hypotheses, values)
        except (InputError, np.linalg.LinAlgError):
            return None

    def fit(self, hypotheses: tuple[Hypothesis, ...], values: np.ndarray) -> Balanced:
        """The best sizes of some effects, by Gauss-Newton.

        Args:
            hypotheses: effects.
            values: (unknowns,) to begin with.

        Raises:
            InputError: a law does not take the values.
        """
        unknowns = [u for h in hypotheses for u in h.unknowns]
        low, high = np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns])
        free = [i for i, u in enumerate(unknowns) if u.low < u.high]
        best, cost, share = values.astype(float), np.inf, 1.0
        trial = best
        for _ in range(_ITERATIONS):
            left, offsets, steps = self._left(hypotheses, trial)
            columns = np.column_stack([*(steps[i] for i in free), offsets])
            # what the drive is asked for is found anew at once
            now = cost_of(left - offsets @ regressed(offsets, left, self.scatter), self.scatter)
            if now < cost:
                settled = cost - now < _SETTLED * now
                best, cost = trial, now
                change = np.zeros(len(best))
                change[free] = regressed(columns, left, self.scatter)[: len(free)]
                if settled or not free:
                    break
                share = 1.0
            else:
                share *= 0.3
            trial = np.clip(best + share * change, low, high)
        return Balanced(hypotheses, best, cost, self.clearance)

    def _left(
        self, hypotheses: Sequence[Hypothesis], values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        """Torque needed minus torque given, and its derivatives.

        Returns:
            (bins of all recordings,) [N m]; (bins, offsets) torques by which the drive of each recording may
            be off, since nobody knows what it is asked for; (unknowns) times (bins,) by the values, negative.
        """
        model = self.setting.model(hypotheses)
        asked = [float(np.mean(turning.speed)) * 30.0 / pi for turning in self.turnings]
        if not any(hypothesis.name == DRIVE for hypothesis in hypotheses):
            asked = asked[:1]  # what another speed asks for is one of the offsets

        def given(values: np.ndarray) -> tuple[np.ndarray, list[Drive]]:
            machines = [model.machine(np.concatenate([[self.clearance], values, [one]])) for one in asked]
            machines *= len(self.turnings) // len(machines)
            parts = []
            for machine, turning in zip(machines, self.turnings, strict=True):
                inertia, acceleration = answer(machine, turning)
                parts.append(binned(inertia * (acceleration - turning.acceleration)))
            return np.concatenate(parts), [machine.drive for machine in machines]

        torque, drives = given(values)
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
        steps = []
        for i in range(len(values)):
            moved = values.copy()
            unknown = model.unknowns[i + 1]
            step = _COARSER * unknown.step
            moved[i] += step if moved[i] + step <= unknown.high else -step
            steps.append((given(moved)[0] - torque) / (moved[i] - values[i]))
        return np.concatenate(self.beyond) - torque, np.array(offsets).reshape(-1, len(torque)).T, steps
