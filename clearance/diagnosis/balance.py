"""What turning the crank takes, and what would give it: the balance of work, whatever happens in the joints.

Turn the crank a little so that no journal moves against its bearing: the forces inside the joints then do no
work. The torque that the motion needs (d'Alembert: inertia forces times their way) must come from the drive
and from what acts on the links from outside. The motion is known from the accelerations alone
(``reconstruction``); so is what is missing, without a law of contact, without following the machine through
its impacts, however far it is from the nominal one. An effect's share follows from the simulator's own
equations with ideal joints, so every law that is written there is known here.

A law inside a joint does no work, but for friction on its surface. Reference: Lanczos 1970, The Variational
Principles of Mechanics, ch. IV.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy.optimize import minimize_scalar

from clearance.compilation import entry
from clearance.diagnosis.explain import Search
from clearance.diagnosis.geometry import GEOMETRIC
from clearance.diagnosis.hypothesis import SMALLEST_CLEARANCE, Hypothesis
from clearance.diagnosis.measured import SAMPLES
from clearance.diagnosis.reconstruction import reconstruct
from clearance.diagnosis.trace import CLEARANCES, COMPARED, agreement, loose
from clearance.errors import InputError
from clearance.mechanism.applied_force import CONSTANTS
from clearance.mechanism.drive import Drive, Free, Smooth, SpeedControl
from clearance.mechanism.frame import FixedFrame
from clearance.mechanism.guide import IdealGuide
from clearance.mechanism.link import RigidRod
from clearance.mechanism.parameters import JOINT_STRIDE, Family, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.batch import aligned
from clearance.simulation.equations import evaluate
from clearance.simulation.kinematics import project
from clearance.simulation.layout import RESULTS, STATES, Result, State

_EDGE = 3  # bins at both ends, which the smoother knows from one side only
_ROBUST = 2.0  # times the scatter beyond which a bin loses weight
_BALANCED = 3.0  # mean square in units of the scatter up to which nothing is missing here
_LEFT = 0.7  # of it: an effect that leaves more is not suggested
_BOTH = 0.4  # of what the better one of two leaves: they are suggested together
_PROMISING = 0.9  # of the imbalance: what leaves less may be one of two
_FIRST = 2  # single effects beside which a second one is looked for
_ITERATIONS, _REWEIGHTED = 12, 4
_SETTLED = 1e-3  # share by which the cost still falls
_PRICE = 0.02  # of what is left, for each parameter
_SHOWN = 3
_WITHIN, _CLOSER = 0.7, 10  # of the clearance's logarithm; clearances that are compared there
_TORQUE = 1e-3  # N m, that tells how much turning the crank takes


@dataclass(frozen=True)
class Turning:
    """A recording's motion as the crank feels it, bin by bin.

    Attributes:
        time: (bins,) [s].
        angle: (bins,) of the crank [rad].
        speed: (bins,) [rad/s].
        acceleration: (bins,) [rad/s^2].
        torque: (bins,) that the motion needs [N m].
        force: (bins,) in the loose joint [N].
    """

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    force: np.ndarray


@dataclass(frozen=True)
class Balanced:
    """Effects that would give what the crank lacks.

    Attributes:
        hypotheses: one or two.
        values: (unknowns,) of their parameters.
        cost: robust mean square of what is left, in units of its scatter.
        clearance: of the joint beside them [m].
    """

    hypotheses: tuple[Hypothesis, ...]
    values: np.ndarray
    cost: float
    clearance: float

    @property
    def label(self) -> str:
        """The hypotheses' labels."""
        return " + ".join(h.label for h in self.hypotheses)


def suggest_forces(search: Search) -> list[Balanced]:
    """Effects that leave little of the imbalance, alone or two together, the best first.

    Args:
        search: with its profile and alignments.

    Raises:
        LinAlgError: a linkage that does not turn.
    """
    balance = _Balance(search, search.setting.with_clearance(search.profile.best), search.profile.best)
    before = balance.fit((), np.zeros(0)).cost
    if before < _BALANCED:
        return []
    groups = [
        group
        for group in search.groups.values()
        if group[0].fault is None
        and group[0].name not in GEOMETRIC
        and not group[0].structural(search.setting.with_clearance(search.profile.best))
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
    found = [one for one in [*singles, *pairs] if one.cost < _LEFT * before]
    found.sort(key=lambda one: one.cost * (1.0 + _PRICE * len(one.values)))
    for one in found[:_SHOWN]:
        shown = ", ".join(f"{value:.4g}" for value in one.values)
        search.report(
            f"  the balance of work agrees with {one.label} = {shown}: {one.cost / before:.1%} are left"
        )
    return found


def settle_in(search: Search, one: Balanced) -> Balanced:
    """The same, when clearance and path have been sought anew with the loads that it puts on the links.

    Where the slider is pushed, the journal lies elsewhere than the nominal machine's motion would have it.

    Raises:
        InputError: a law does not take the values.
        LinAlgError: a linkage that does not turn.
    """

    if all(hypothesis.body == "crank" for hypothesis in one.hypotheses):
        return one

    def machine(clearance: float) -> SliderCrank:
        made, place = search.setting.with_clearance(clearance), 0
        for hypothesis in one.hypotheses:
            count = len(hypothesis.unknowns)
            made = hypothesis.apply(made, one.values[place : place + count])
            place += count
        return made

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
    return _Balance(search, machine(clearance), clearance).fit(one.hypotheses, one.values)


class _Balance:
    """The torques that recordings need, beside those that a machine would give."""

    def __init__(self, search: Search, machine: SliderCrank, clearance: float) -> None:
        self.search, self.clearance = search, clearance
        period = SAMPLES / search.recordings[0].chain.rate
        self.turnings: list[Turning] = []
        for measured, known in zip(search.recordings, search.alignments, strict=True):
            path = reconstruct(measured, machine.parameters(), loose(machine), known.speed, known.angle)
            rows = path.turning[:, : path.turning.shape[1] // SAMPLES * SAMPLES]
            rows = rows.reshape(len(rows), -1, SAMPLES).mean(axis=2)[:, _EDGE:-_EDGE]
            self.turnings.append(Turning(period * np.arange(rows.shape[1]), *rows))
        bare = replace(machine, drive=Free(), ripple=Smooth())
        self.beyond = []  # what the play of the journals needs beyond the ideal motion [N m]
        for turning in self.turnings:
            inertia, acceleration = _answer(bare, turning)
            self.beyond.append(turning.torque - inertia * (turning.acceleration - acceleration))
        left, offsets, _ = self._left((), np.zeros(0))
        left = left - offsets @ np.linalg.lstsq(offsets, left, rcond=None)[0]
        ends = np.cumsum([len(turning.time) for turning in self.turnings])[:-1]
        bends = np.concatenate([np.diff(part, 2) for part in np.split(left, ends)])
        self.scatter = float(1.4826 * np.median(np.abs(bends)) / np.sqrt(6.0))

    def best(self, trials: Sequence[Hypothesis]) -> Balanced | None:
        """The best of several shapes of an effect."""
        found = [one for trial in trials if (one := self.tried((trial,), trial.start)) is not None]
        return min(found, key=lambda one: one.cost, default=None)

    def tried(self, hypotheses: tuple[Hypothesis, ...], values: np.ndarray) -> Balanced | None:
        """As ``fit``; ``None`` where a law does not take the values."""
        try:
            return self.fit(hypotheses, values)
        except (InputError, np.linalg.LinAlgError):
            return None

    def fit(self, hypotheses: tuple[Hypothesis, ...], values: np.ndarray) -> Balanced:
        """The best sizes of some effects: Gauss-Newton, far bins weighing less (Huber).

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
            size, weight = left, np.ones(len(left))
            for _ in range(_REWEIGHTED):  # what the drive is asked for is found anew at once
                known = np.linalg.lstsq(offsets * weight[:, None], left * weight, rcond=None)[0]
                size = np.abs(left - offsets @ known) / self.scatter
                weight = np.sqrt(_ROBUST / np.maximum(size, _ROBUST))
            # bins around an impact that was understood wrongly are many, and say nothing (Cauchy)
            now = float((_ROBUST**2 * np.log1p((size / _ROBUST) ** 2)).mean())
            if now < cost:
                settled = cost - now < _SETTLED * now
                best, cost = trial, now
                whole = np.linalg.lstsq(columns * weight[:, None], left * weight, rcond=None)[0]
                change = np.zeros(len(best))
                change[free] = whole[: len(free)]
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
        model = self.search.setting.model(hypotheses)

        def given(values: np.ndarray) -> tuple[np.ndarray, list[Drive]]:
            parts, drives = [], []
            for turning in self.turnings:
                asked = np.mean(turning.speed) * 30.0 / pi
                machine = model.machine(np.concatenate([[self.clearance], values, [asked]]))
                inertia, acceleration = _answer(machine, turning)
                parts.append(inertia * (acceleration - turning.acceleration) + _rub(machine, turning))
                drives.append(machine.drive)
            return np.concatenate(parts), drives

        torque, drives = given(values)
        offsets = []
        begin = 0
        for turning, drive in zip(self.turnings, drives, strict=True):
            asked = isinstance(drive, SpeedControl)  # a motor's speed follows from its load
            for one in [np.ones(len(turning.time)), turning.time] if asked else []:
                column = np.zeros(len(torque))
                column[begin : begin + len(one)] = one
                offsets.append(column)
            begin += len(turning.time)
        steps = []
        for i in range(len(values)):
            moved = values.copy()
            moved[i] += model.step(np.concatenate([[0.0], values]), i + 1)
            steps.append((given(moved)[0] - torque) / (moved[i] - values[i]))
        return np.concatenate(self.beyond) - torque, np.array(offsets).reshape(-1, len(torque)).T, steps


def _answer(machine: SliderCrank, turning: Turning) -> tuple[np.ndarray, np.ndarray]:
    """(bins,) inertia that the crank feels [kg m^2], and the acceleration that an ideal machine would have.

    Args:
        machine: its joints are taken as ideal, its links and frame as rigid.
        turning: motion; the integral of the drive's speed error begins at zero with it.
    """
    ideal = replace(
        machine, joint_b=replace(machine.joint_b, clearance=0.0),
        joint_c=replace(machine.joint_c, clearance=0.0), guide=IdealGuide(), link=RigidRod(),
        frame=FixedFrame(),
    )  # fmt: skip
    codes, p = ideal.codes(), aligned(len(ideal.parameters()))
    p[:] = ideal.parameters()[:, None]
    if not codes[Family.FORCE]:
        codes[Family.FORCE] = CONSTANTS
    turned = turning.angle - turning.angle[0]
    integral = p[Parameter.DRIVE_SPEED, 0] * turning.time - turned
    motion = np.stack([turning.angle, turning.speed, integral, turning.time])
    out = np.zeros((2, motion.shape[1]))
    work = aligned(RESULTS + STATES)
    accelerate(codes, p, motion, work, out[0])
    p[Parameter.FORCE_CRANK_TORQUE] += _TORQUE
    accelerate(codes, p, motion, work, out[1])
    return _TORQUE / (out[1] - out[0]), out[0]


@entry
def accelerate(
    codes: np.ndarray, p: np.ndarray, motion: np.ndarray, work: np.ndarray, out: np.ndarray
) -> None:
    """Angular acceleration of an ideal machine's crank at each instant of a motion.

    Args:
        codes: (families,) chosen laws; joints ideal.
        p: (PARAMETERS, WIDTH), all lanes alike.
        motion: (4, instants) crank angle [rad], speed [rad/s], integral of the drive [rad], time [s].
        work: (RESULTS + STATES, WIDTH) scratch.
        out: (instants,) written [rad/s^2].
    """
    r, s = work[:RESULTS], work[RESULTS:]
    width, count = p.shape[1], motion.shape[1]
    for begin in range(0, count, width):
        for lane in range(width):
            k = min(begin + lane, count - 1)
            s[State.CRANK_ANGLE, lane] = motion[0, k]
            s[State.CRANK_SPEED, lane] = motion[1, k]
            s[State.DRIVE_INTEGRAL, lane] = motion[2, k]
            s[State.TIME, lane] = motion[3, k]
        project(codes, p, s)
        evaluate(codes, p, s, r)
        for lane in range(min(width, count - begin)):
            out[begin + lane] = r[Result.CRANK, lane]


def _rub(machine: SliderCrank, turning: Turning) -> np.ndarray:
    """(bins,) torque on the crank of friction in the loose joint, from the force that it carries [N m]."""
    p = machine.parameters()
    block = 0 if machine.joint_b.loose else JOINT_STRIDE
    length = p[Parameter.ROD_TO_B] + p[Parameter.ROD_TO_C]
    lever = p[Parameter.CRANK_LENGTH] / length
    sine = p[Parameter.GUIDE_OFFSET] / length - lever * np.sin(turning.angle)
    swing = -lever * np.cos(turning.angle) / np.sqrt(1.0 - sine**2)
    turn = 1.0 - swing if block == 0 else swing
    moment = p[Parameter.JOINT_FRICTION + block] * p[Parameter.JOINT_JOURNAL_RADIUS + block] * turning.force
    return -moment * np.abs(turn) * np.sign(turning.speed)
