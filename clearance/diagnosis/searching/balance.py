"""What turning the crank takes, and what would give it: the balance of work, whatever happens in the joints.

Turn the crank a little so that no journal moves against its bearing: the forces inside the joints then do no
work. The torque that the motion needs (d'Alembert: inertia forces times their way) must come from the drive
and from what acts on the links from outside. The motion is known from the accelerations alone
(``kinematics.reconstruction``); so is what is missing, without a law of contact, without following the
machine through its impacts, however far it is from the nominal one. An effect's share follows from the
simulator's own equations with ideal joints, so every law that is written there is known here.

What is inside a joint is not seen here: contact and film do no work, and friction, which does, turns the
force of the contact by so much that the motion's forces are not known any more.

Reference: Lanczos 1970, The Variational Principles of Mechanics, ch. IV.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import pi

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from clearance.diagnosis.hypotheses.hypothesis import SMALLEST_CLEARANCE, Hypothesis, Setting
from clearance.diagnosis.kinematics.agreement import CLEARANCES, COMPARED, Alignment, agreement, loose
from clearance.diagnosis.kinematics.pieces import reconstruct_whole
from clearance.diagnosis.kinematics.regression import cost_of, regressed, scatter_of
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.kinematics.turning import Turning, answer, binned
from clearance.diagnosis.searching.edges import EDGED
from clearance.diagnosis.searching.geometry import GEOMETRIC
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.work import Balance, Balanced, bends, beyond_ideal
from clearance.diagnosis.sensing.measured import Measured
from clearance.errors import InputError
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank

_BALANCED = 3.0  # mean square in units of the scatter up to which nothing need be missing here
_QUIET = 1.2  # of it: up to which nothing can be told
_FAINT = 0.05  # of the slider's inertia force: where no less shows beside the scatter, nothing can either
_SURELY = 0.3  # of the imbalance: a name that leaves less is there, though no path may be followed with it
_TAKEN = 0.12  # of it: what an effect takes away at least for each of its sizes (wrong ones 0.06 for one)
_FREE = 0.65  # likewise of a force of free form
_SOME = 0.85  # likewise of one that is tried only where nothing else is near
_CLOCKED = 0.45  # of one over time: in a short recording a turn of the crank is a period, too
_CLEARER = 0.7  # of what all others leave: a weak rhythm leaves much of what impacts do
_OWN = 0.4  # likewise: a clock of its own comes first (three of them left a third, names a half and more)
_BOTH = 0.4  # of what the better one of two leaves: they are suggested together
_MORE = 0.95  # of the price of the best one alone: pairs are worth a try
_PROMISING = 0.9  # of the imbalance: what leaves less may be one of two
_FIRST = 2  # single effects beside which a second one is looked for
_SHOWN = 3
_ALIKE = 0.6  # of a table's torques: an effect that leaves more does something else; 0.46 was right
_WITHIN, _CLOSER = 0.7, 10  # of the clearance's logarithm; clearances that are compared there
_PERIODS = 4  # times the segments that tell the clearance beside a rhythm
_VALLEY, _PLACES = 0.08, 9  # of the clearance's logarithm around its best; clearances there
_LONGER, _AHEAD = 5e-4, 5e-4  # of a period, and s of a clock, by which they are tried at first
_ROUNDS, _TRIALS = 2, 40  # of period and clocks, then shape; and for each of the former
_CLOCKS = 120  # places in a period where another recording may begin
_RHYTHM = 0.3  # of the imbalance: where nothing else leaves less, a rhythm of its own is looked for


@dataclass(frozen=True)
class Suggested:
    """What the balance of work says of a machine.

    Attributes:
        forces: effects that leave little of the imbalance, alone or two together, the best first.
        balanced: whether there is none to speak of.
        blind: whether there is none because the scatter would hide one that matters.
        pairs: two effects that leave less than any alone, the best first.
        weak: the likeliest force without a name, where all of these leave much: impacts hide what is weak.
        lacking: robust mean square of the imbalance, in units of its scatter.
    """

    forces: list[Balanced]
    balanced: bool
    pairs: list[Balanced] = field(default_factory=list)
    weak: Balanced | None = None
    lacking: float = 1.0
    blind: bool = False

    @property
    def sure(self) -> Balanced | None:
        """The best name, if it is there whatever else is: it leaves little of the imbalance."""
        best = next((one for one in self.forces if one.curve is None), None)
        return best if best is not None and best.cost < _SURELY * self.lacking else None


def suggest_forces(
    search: Search, setting: Setting, clearance: float, named: bool = False
) -> Suggested | None:
    """What would give the torque that the motion needs and a machine lacks.

    Args:
        search: with its alignments.
        setting: the machine.
        clearance: of its joint [m].
        named: whether only effects with a name are wanted.

    Returns:
        ``None`` where the nominal drive is not a speed control, so that the balance cannot be asked.

    Raises:
        LinAlgError: a linkage that does not turn.
    """
    if not isinstance(setting.machine.drive, SpeedControl):
        return None  # a motor's slope goes with its voltage, which nobody knows
    machine = setting.with_clearance(clearance)
    balance = Balance(search, setting, machine, clearance)
    before = balance.fit((), np.zeros(0)).cost
    faintest = balance.least(_TAKEN)
    blind = before < _BALANCED and faintest > _FAINT * _inertia_force(search, machine)
    if blind:
        search.report(f"  the balance of work would show no force below {faintest:.2g} N")
    if before < _QUIET:
        return Suggested([], balanced=not blind, blind=blind)
    singles = _singles(search, balance, machine)
    pairs, clear = _pairs(balance, singles, _PROMISING * before)
    found = [one for one in [*singles, *clear] if one.cost < (1.0 - _TAKEN * one.sizes) * before]
    tables, own = list[Balanced](), 0.0
    if not (named or blind):  # a table would be of noise
        tables = balance.tables(_FREE * before, before)
        found += [one for one in tables if one.cost < _FREE * before]
        if min((one.cost for one in found), default=before) > _RHYTHM * before and not search.late():
            least = min((one.cost for one in [*singles, *tables]), default=before)
            rhythms = balance.rhythms(max(_CLOCKED * before, _CLEARER * least))
            found += rhythms
            own = min([_OWN * least, *(pair.cost for pair in pairs)])
    elif blind and not (named or search.late()):  # but what comes again by its own clock stands out of noise
        found += balance.rhythms(_CLEARER * min([before, *(one.cost for one in singles)]))
        own = np.inf
    found.sort(key=lambda one: (one.rhythm is None or one.cost > own, one.price))
    for one in found[:_SHOWN]:
        shown = ", ".join(f"{value:.3g}" for value in one.values)
        search.report(
            f"  the balance of work agrees with {one.label} = {shown}: {one.cost / before:.1%} are left"
        )
    alone = min((one.price for one in singles), default=np.inf)
    more = [
        one for one in pairs if one.price < _MORE * alone and one.cost < (1.0 - _TAKEN * one.sizes) * before
    ]
    more.sort(key=lambda one: one.price)
    some = [one for one in tables if one.cost < _SOME * before]
    weak = None if any(one.curve for one in found) else min(some, key=lambda one: one.price, default=None)
    balanced = before < _BALANCED and not (found or blind)
    return Suggested(found, balanced, more, weak, before, blind and not found)


def _inertia_force(search: Search, machine: SliderCrank) -> float:
    """What takes the slider to and fro, about [N]."""
    speed = min(abs(known.speed) for known in search.alignments)
    return float(machine.slider.mass * machine.crank.length * speed**2)


def suggest_names(search: Search, machine: SliderCrank, clearance: float) -> list[Balanced]:
    """Effects, or two, that would turn the crank as a machine's force of free form does, the likeliest first.

    Beside the path of a table a linear look knows no way to where a load begins and ends.

    Args:
        search: with its alignments.
        machine: with the table.
        clearance: of its joint [m].

    Raises:
        LinAlgError: a linkage that does not turn.
    """
    nominal = search.setting.with_clearance(clearance)
    balance = Balance(search, search.setting, nominal, clearance)
    balance.imitate(machine)
    before = balance.fit((), np.zeros(0)).cost
    singles = _singles(search, balance, nominal)
    _, both = _pairs(balance, singles, _PROMISING * before)
    alike = [one for one in [*singles, *both] if one.cost < _ALIKE * before]
    return sorted(alike, key=lambda one: one.price)


def _singles(search: Search, balance: Balance, machine: SliderCrank) -> list[Balanced]:
    """Every effect that acts on the links of a machine, as well as it goes alone, the best first."""
    groups = [
        group
        for group in search.groups.values()
        if group[0].fault is None and group[0].name not in GEOMETRIC and not group[0].structural(machine)
    ]
    found = [one for group in groups if (one := balance.best(group)) is not None]
    return sorted(found, key=lambda one: one.cost)


def _pairs(
    balance: Balance, singles: Sequence[Balanced], most: float
) -> tuple[list[Balanced], list[Balanced]]:
    """The best that leave less than ``most``, each with every other; and those that are clearly two."""
    pairs, clear = [], []
    for first in [one for one in singles if one.cost < most][:_FIRST]:
        for other in singles:
            if other.hypotheses[0].name == first.hypotheses[0].name:
                continue
            pair = balance.together(first, other)
            if pair is not None:
                pairs.append(pair)
            if pair is not None and pair.cost < _BOTH * min(first.cost, other.cost):
                clear.append(pair)
    return pairs, clear


def settle_in(search: Search, setting: Setting, one: Balanced) -> Balanced:
    """The same, when clearance and path have been sought anew with the loads that it puts on the links.

    Where the slider is pushed, the journal lies elsewhere than the nominal machine's motion would have it.

    Raises:
        InputError: a law does not take the values.
        LinAlgError: a linkage that does not turn.
    """
    if all(hypothesis.body == "crank" for hypothesis in one.hypotheses):
        return one

    model, asked = setting.model(one.hypotheses), search.alignments[0].speed * 30.0 / pi

    def machine(clearance: float) -> SliderCrank:
        return model.machine(np.concatenate([[clearance], one.values, [asked]]))

    def disagree(size: float) -> float:
        try:
            made = [machine(float(np.exp(size)))]
        except InputError:  # lobes that close the bore
            return float("inf")
        return float(agreement(search.recordings, search.alignments, made, compared, search.workers)[0])

    # what is pushed by a clock of its own is pushed otherwise in every turn
    compared = COMPARED if one.rhythm is None else _PERIODS * COMPARED
    middle = np.log(one.clearance)
    low = max(middle - _WITHIN, np.log(SMALLEST_CLEARANCE))
    found = minimize_scalar(
        disagree, method="bounded", bounds=(low, min(middle + _WITHIN, np.log(CLEARANCES[-1]))),
        options={"maxiter": _CLOSER},
    )  # fmt: skip
    clearance = float(np.exp(found.x if one.rhythm is None else _middle(disagree, float(found.x))))
    balance = Balance(search, setting, machine(clearance), clearance)
    again = [balance.fit(one.hypotheses, one.values, None if one.curve is None else bends(one.curve))]
    if one.hypotheses[0].name == EDGED and len(one.hypotheses) == 1:  # its edges may have been met wrongly
        again += [other for other in [balance.best(one.hypotheses)] if other is not None]
    return replace(min(again, key=lambda other: other.cost), curve=one.curve, rhythm=one.rhythm)


def _middle(disagree: Callable[[float], float], least: float) -> float:
    """Where a parabola through what is near the least value is lowest: impacts roughen a smooth valley."""
    places = np.linspace(-_VALLEY, _VALLEY, _PLACES)
    values = np.array([disagree(least + place) for place in places])
    if not np.isfinite(values).all():
        return least
    bend, slope, _ = np.polyfit(places, values, 2)
    if bend <= 0.0:
        return least
    return least + float(np.clip(-0.5 * slope / bend, -_VALLEY, _VALLEY))


def settle_clocks(
    search: Search,
    setting: Setting,
    one: Balanced,
    force: Callable[[float], Hypothesis],
    known_at: Sequence[float] | None = None,
) -> Balanced:
    """A force over time with the period and the clocks that suit the motion beside it best.

    Args:
        search: with its alignments, by the clocks that are known.
        setting: the machine.
        one: the force, as of ``settle_in``.
        force: with a period [s], for the same values.
        known_at: what each recording's clock shows where it is right [s]: then the period alone is sought.

    Raises:
        InputError: a law does not take the values.
        LinAlgError: a linkage that does not turn.
    """
    assert one.rhythm is not None
    period, clocks, shape = one.rhythm.period, np.array(one.rhythm.clocks), one
    straight = None if one.curve is None else bends(one.curve)
    asked = search.alignments[0].speed * 30.0 / pi
    machine = setting.model(one.hypotheses).machine(np.concatenate([[one.clearance], one.values, [asked]]))
    balance = Balance(search, setting, machine, one.clearance)
    held = known_at or [turning.begin + 0.5 * turning.time[-1] for turning in balance.turnings]

    def timed(change: np.ndarray) -> tuple[float, np.ndarray]:
        """The period and by how much each clock is ahead: where it is held, by as much as is asked for."""
        longer, ahead = change[0] * _LONGER, np.zeros(len(clocks))
        ahead[1 : len(change)] = change[1:] * _AHEAD
        return period * (1.0 + longer), longer * np.array(held) + ahead

    def left(change: np.ndarray) -> float:
        longer, ahead = timed(change)
        return balance.timed(ahead).cost((force(longer),), shape.values)

    change = np.zeros(len(clocks) if known_at is None else 1)
    for _ in range(_ROUNDS):
        simplex = np.vstack([change, change + np.eye(len(change))])
        options = {"maxfev": _TRIALS * len(change), "xatol": 0.05, "fatol": 1e-5, "initial_simplex": simplex}
        change = minimize(left, change, method="Nelder-Mead", options=options).x
        longer, ahead = timed(change)
        if known_at is None:
            shape = balance.timed(ahead).fit((force(longer),), shape.values, straight)
    return replace(shape, curve=one.curve, rhythm=Rhythm(float(longer), tuple(map(float, clocks + ahead))))


def find_clock(measured: Measured, known: Alignment, machine: SliderCrank) -> float:
    """What the clock of a machine's table over time shows where a recording begins [s].

    Args:
        measured: whole recording.
        known: its alignment.
        machine: with the table.

    Raises:
        LinAlgError: a linkage that does not turn.
    """
    path = reconstruct_whole(measured, machine.parameters(), loose(machine), known.speed, known.angle)
    turning = Turning.along(path, machine, measured)
    beyond, time = beyond_ideal(machine, turning), binned(turning.time)
    offsets = np.column_stack([np.ones(len(time)), time])

    def left(clock: float) -> np.ndarray:
        inertia, acceleration = answer(machine, replace(turning, begin=turning.begin + clock))
        lacking = beyond - binned(inertia * (acceleration - turning.acceleration))
        bare: np.ndarray = lacking - offsets @ regressed(offsets, lacking, scatter)
        return bare

    scatter = scatter_of([beyond])
    period = float(machine.parameters()[Parameter.TABLE_PERIOD])
    step = period / _CLOCKS
    near = min(step * np.arange(_CLOCKS), key=lambda clock: cost_of(left(clock), scatter))
    found = minimize_scalar(
        lambda clock: cost_of(left(clock), scatter), method="bounded", bounds=(near - step, near + step),
        options={"maxiter": _CLOSER},
    )  # fmt: skip
    return float(found.x % period)
