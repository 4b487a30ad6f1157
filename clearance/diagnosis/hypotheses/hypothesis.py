"""What may be missing: named effects as models with unknown parameters, beside clearance and speed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.errors import InputError
from clearance.mechanism.drive import DirectCurrentMotor, Drive, SpeedControl
from clearance.mechanism.joint import CLEARANCE_RANGE
from clearance.mechanism.parameters import STRUCTURE
from clearance.mechanism.slider_crank import SliderCrank

JOINTS = ("B", "C")
SMALLEST_CLEARANCE = 5e-6  # m; below, the joint is as good as ideal
SOME_CLEARANCE = 3e-4  # m, of a machine where any will do
_STEP = 1e-4  # of a parameter's plausible size, for its derivative
_REACH = 0.3  # of it: change that a linearisation surely bears
_SPAN = 0.1  # of its range is plausible where a parameter begins at zero
_SAMPLES, _RATE = 64, 1e4  # of a recording of nothing, to see whether a fault can be undone at all


def settled(drive: Drive) -> Drive:
    """The same drive without a ramp: recordings begin long after it."""
    return replace(drive, ramp=0.0) if hasattr(drive, "ramp") else drive  # type: ignore[type-var]


@dataclass(frozen=True)
class Hypothesis:
    """One thing that may be missing.

    Attributes:
        name: of the effect.
        kind: physics or instrument.
        body: where it acts.
        direction: in which.
        unknowns: its parameters.
        off: (unknowns,) values without it.
        start: (unknowns,) plausible values.
        apply: the machine with it.
        effect: the named effect.
        channel: whose sensor is at fault.
        fault: the instruments with it; ``None`` for physics.
    """

    name: str
    kind: str
    body: str
    direction: str
    unknowns: tuple[Unknown, ...]
    off: np.ndarray
    start: np.ndarray
    apply: Callable[[SliderCrank, np.ndarray], SliderCrank] = field(repr=False)
    effect: Effect | None = None
    channel: str | None = None
    fault: Callable[[Instrument, np.ndarray], Instrument] | None = field(default=None, repr=False)

    @property
    def label(self) -> str:
        """Name with what distinguishes its variants."""
        if self.effect is None:
            return f"{self.name}({self.body} {self.direction})"
        parts = [self.channel] if self.channel else []
        return f"{self.name}({', '.join([*parts, *(u.name for u in self.unknowns)])})"

    @property
    def shapes(self) -> np.ndarray:
        """(unknowns,) whether each says how the effect is shaped, not how large it is."""
        if self.effect is None:
            return np.zeros(len(self.unknowns), dtype=bool)
        return np.array([parameter.shape for parameter in self.effect.free], dtype=bool)

    def structural(self, machine: SliderCrank) -> bool:
        """Whether it gives the machine new coordinates; not where it begins larger than a small gap takes."""
        try:
            codes = self.apply(machine, self.start).codes()
        except InputError:  # lobes that close the bore
            return False
        return bool((codes[STRUCTURE] != machine.codes()[STRUCTURE]).any())


def same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are about the same thing."""
    return one.name == other.name and one.channel == other.channel


def of_effect(effect: Effect, machine: SliderCrank, joint: str) -> list[Hypothesis]:
    """The hypotheses of one variant of a physical effect: one for each trial of its shapes."""
    found = []
    off = effect.off(machine, joint)
    for start in effect.starts(machine, joint):
        unknowns = []
        for parameter in effect.free:
            low, high = parameter.bounds
            size = abs(
                start[parameter.name] - (off[parameter.name] if isfinite(off[parameter.name]) else 0.0)
            )
            if size == 0.0 and isfinite(high - low):  # a phase of zero is no small phase
                size = _SPAN * (high - low)
            if parameter.whole:
                low = high = start[parameter.name]
            size, log = max(size, 1e-3 * abs(start[parameter.name]), 1e-12), parameter.scale == "log"
            unknowns.append(
                Unknown(
                    parameter.name, _STEP * size, low, high, reach=_REACH * size, log=log,
                    turns=parameter.unit == "rad" and high - low >= 2.0 * np.pi,
                )
            )  # fmt: skip
        names = effect.parameters

        def apply(
            machine: SliderCrank, values: np.ndarray, names: Sequence[str] = names, effect: Effect = effect
        ) -> SliderCrank:
            return effect.machine(machine, joint, dict(zip(names, map(float, values), strict=True)))

        found.append(
            Hypothesis(
                effect.name, effect.kind, effect.place(joint), effect.direction, tuple(unknowns),
                np.array([off[n] for n in names]), np.array([start[n] for n in names]), apply, effect,
            )
        )  # fmt: skip
    return found


def of_fault(effect: Effect, machine: SliderCrank, joint: str) -> Hypothesis:
    """The hypothesis of one fault of one channel's instrument, or of the recorder's clock."""
    off, start = effect.off(machine, joint), next(effect.starts(machine, joint))
    names = effect.parameters
    unknowns = []
    for parameter in effect.free:
        low, high = parameter.bounds
        base = off[parameter.name] if isfinite(off[parameter.name]) else 0.0
        size = max(abs(start[parameter.name] - base), 1e-3 * abs(start[parameter.name]), 1e-12)
        unknowns.append(Unknown(parameter.name, _STEP * size, low, high, reach=_REACH * size))

    def named(values: np.ndarray) -> dict[str, float]:
        return dict(zip(names, map(float, values), strict=True))

    def fault(instrument: Instrument, values: np.ndarray) -> Instrument:
        return effect.instrument(instrument, named(values))

    def apply(machine: SliderCrank, values: np.ndarray) -> SliderCrank:
        return at_pace(machine, fault(Instrument(), values).timebase)

    return Hypothesis(
        effect.name, effect.kind, effect.place(joint), effect.direction, tuple(unknowns),
        np.array([off[n] for n in names]), np.array([start[n] for n in names]), apply, effect, effect.channel,
        fault,
    )  # fmt: skip


def at_pace(machine: SliderCrank, rate_error: float) -> SliderCrank:
    """The machine as a clock sees it whose second lasts ``1 + rate_error``: stiffer, and driven harder.

    Forces count the square of the unit of time, dampings its first power. Contact and drive are
    carried over; other laws keep their numbers, and are off by up to twice what the clock is.
    """
    if rate_error == 0.0:
        return machine
    pace = 1.0 + rate_error
    drive = machine.drive
    if isinstance(drive, SpeedControl):
        drive = replace(drive, proportional=drive.proportional * pace, integral=drive.integral * pace**2)
    elif isinstance(drive, DirectCurrentMotor):
        drive = replace(drive, stall_torque=drive.stall_torque * pace**2)
    joints = {
        name: replace(
            joint, contact=replace(joint.contact, stiffness_scale=joint.contact.stiffness_scale * pace**2)
        )
        for name in ("joint_b", "joint_c")
        for joint in (getattr(machine, name),)
    }
    return replace(machine, drive=drive, **joints)


def _with_effects(machine: SliderCrank, hypotheses: Sequence[Hypothesis], values: np.ndarray) -> SliderCrank:
    """The machine with effects, as a clock at fault sees it: sizes of effects are by that clock's seconds."""
    place, each = 0, []
    for hypothesis in hypotheses:
        count = len(hypothesis.unknowns)
        each.append((hypothesis, values[place : place + count]))
        place += count
    for hypothesis, own in sorted(each, key=lambda one: one[0].fault is None):
        machine = hypothesis.apply(machine, own)
    return machine


@dataclass(frozen=True)
class Setting:
    """The nominal machine and what is always unknown about it.

    Attributes:
        machine: nominal.
        joint: B or C.
    """

    machine: SliderCrank
    joint: str

    def with_clearance(self, clearance: float) -> SliderCrank:
        """The nominal machine with a clearance [m] in the diagnosed joint."""
        key = "joint_b" if self.joint == "B" else "joint_c"
        return replace(self.machine, **{key: replace(getattr(self.machine, key), clearance=float(clearance))})

    def added(self, hypotheses: Sequence[Hypothesis], values: np.ndarray) -> "Setting":
        """The setting whose nominal machine has effects, with all their parameters' values."""
        return replace(self, machine=_with_effects(self.machine, hypotheses, values))

    def model(self, hypotheses: Sequence[Hypothesis] = ()) -> Model:
        """Unknowns: the clearance, the hypotheses' parameters, each recording's speed [rpm]."""
        unknowns = (
            Unknown("clearance", 1e-9, SMALLEST_CLEARANCE, CLEARANCE_RANGE[1] * (1.0 - 1e-6)),
            *(u for h in hypotheses for u in h.unknowns),
            Unknown("speed", 1e-3, own=True),
        )

        def build(values: np.ndarray) -> SliderCrank:
            machine = _with_effects(self.with_clearance(values[0]), hypotheses, values[1:])
            drive = machine.drive
            assert isinstance(drive, Drive)
            return replace(machine, drive=settled(drive.at_speed(float(values[-1]))))

        def sense(values: np.ndarray) -> Instrument:
            instrument, place = Instrument(), 1
            for hypothesis in hypotheses:
                count = len(hypothesis.unknowns)
                if hypothesis.fault is not None:
                    instrument = hypothesis.fault(instrument, values[place : place + count])
                place += count
            return instrument

        sensing = [False] + [h.fault is not None for h in hypotheses for _ in h.unknowns] + [False]
        return Model(unknowns, build, sense, tuple(sensing))


def gather(
    effects: Sequence[Effect], machine: SliderCrank, joint: str, channels: Sequence[str]
) -> dict[str, list[Hypothesis]]:
    """Hypotheses by label: of each variant of each effect, its trials.

    Args:
        effects: to try.
        machine: nominal.
        joint: B or C.
        channels: recorded ones, whose instruments may be at fault.
    """
    found: dict[str, list[Hypothesis]] = {}
    for effect in effects:
        for variant in effect.variants(channels):
            if effect.kind == "instrument":
                fault = of_fault(variant, machine, joint)
                trials = [fault] if _can_be_undone(fault, channels) else []
            else:
                try:
                    trials = of_effect(variant, machine, joint)
                except InputError:
                    continue
            if trials:
                found[trials[0].label] = trials
    return found


def _can_be_undone(hypothesis: Hypothesis, channels: Sequence[str]) -> bool:
    """Whether a fault can be taken out of what was recorded: an axis alone cannot be turned back."""
    assert hypothesis.fault is not None
    instrument = hypothesis.fault(Instrument(), hypothesis.start)
    try:
        instrument.correct(np.zeros((_SAMPLES, len(channels))), channels, _RATE)
    except InputError:
        return False
    return True
