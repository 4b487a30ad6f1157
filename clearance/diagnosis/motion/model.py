"""Unknowns of a machine seen by its motion: what is always refitted, and the terms that may be missing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite, log

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import settled
from clearance.diagnosis.motion.prediction import Guess
from clearance.diagnosis.motion.track import LATEST, Track
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.errors import InputError
from clearance.mechanism.description import read_path, with_values
from clearance.mechanism.drive import Drive, Free
from clearance.mechanism.parameters import STRUCTURE, Parameter
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import si_unit
from clearance.simulation.ideal import Motion

# Changes for derivatives, over a parameter's plausible size: so small that the crank's phase, which gathers a
# change of speed over a minute, stays near; where a force begins or ends, so large that steps meet the edge.
_STEP, _SHAPE_STEP = 2e-4, 2e-3
_LARGEST_CLEARANCE = 2e-3  # m
_KEPT = 256  # machines that are not made anew
_RESOLVED = 0.4  # of the sampling rate: what repeats faster is not looked for
_FASTER = 20.0  # times the speed at the beginning, and the mean speed, at most


@dataclass(frozen=True)
class Unknown:
    """A number to be found.

    Attributes:
        name: of it.
        unit: of it.
        low: bound.
        high: bound.
        step: change for its derivative, on its scale.
        log: whether the fit works on its logarithm.
        prior: (mean, standard deviation) on its scale, where the data may say nothing; ``None``: none.
        shape: whether it has a meaning only where another one is not off.
        whole: whether it counts something.
    """

    name: str
    unit: str
    low: float
    high: float
    step: float
    log: bool = False
    prior: tuple[float, float] | None = None
    shape: bool = False
    whole: bool = False

    def inner(self, value: float) -> float:
        """The value on the scale of the fit."""
        return log(value) if self.log else value

    def outer(self, value: float) -> float:
        """A value on the scale of the fit, inside the bounds, as it is."""
        if self.log:
            return float(np.exp(np.clip(value, log(self.low), log(self.high))))
        inside = float(np.clip(value, self.low, self.high))
        return float(round(inside)) if self.whole else inside


@dataclass(frozen=True)
class Term:
    """One thing that may be missing: a variant of an effect.

    Attributes:
        effect: with the parameters of this variant alone.
        joint: B or C.
        unknowns: its parameters.
        off: (unknowns,) without it.
        starts: (unknowns,) each, where a fit may begin.
    """

    effect: Effect
    joint: str
    unknowns: tuple[Unknown, ...]
    off: np.ndarray
    starts: tuple[np.ndarray, ...]

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.effect.name

    @property
    def place(self) -> tuple[str, str | None]:
        """What cannot be there twice."""
        return self.effect.name, self.effect.channel

    @property
    def label(self) -> str:
        """Name with what distinguishes its variants."""
        inside = [self.effect.channel] if self.effect.channel else [u.name for u in self.unknowns]
        return f"{self.name}({', '.join(inside)})"

    @property
    def linear(self) -> bool:
        """Whether its size is worth a linearisation at "off": not where that is infinitely far."""
        return bool(np.isfinite(self.off[self.sizes]).all()) and self.name != "soft_drive"

    @property
    def sizes(self) -> list[int]:
        """Places of the unknowns that vanish with it."""
        return [i for i, unknown in enumerate(self.unknowns) if not unknown.shape]

    def values(self, inner: np.ndarray) -> dict[str, float]:
        """Parameters by name from those on the scale of the fit."""
        return {u.name: u.outer(float(v)) for u, v in zip(self.unknowns, inner, strict=True)}


def term_of(effect: Effect, machine: SliderCrank, joint: str) -> Term | None:
    """The term of one variant of an effect; ``None`` where the machine takes none of its starts."""
    starts = list(effect.starts(machine, joint))
    if not starts:
        return None
    try:
        off = effect.off(machine, joint)
    except InputError:
        return None
    unknowns = []
    for parameter in effect.free:
        low, high = parameter.bounds
        size = max(abs(parameter.start), abs(parameter.start - _finite(off[parameter.name])))
        size = size or 0.05 * (high - low)
        is_log = parameter.scale == "log"
        step = _SHAPE_STEP if parameter.shape else _STEP
        unknowns.append(
            Unknown(
                parameter.name, parameter.unit, low, high, step if is_log else step * size, is_log,
                shape=parameter.shape, whole=parameter.whole,
            )
        )  # fmt: skip
    inner = [np.array([u.inner(start[u.name]) for u in unknowns]) for start in starts]
    different = {tuple(v): v for v in inner}
    outside = np.array([u.inner(off[u.name]) if isfinite(off[u.name]) else off[u.name] for u in unknowns])
    return Term(effect, joint, tuple(unknowns), outside, tuple(different.values()))


def _finite(value: float) -> float:
    return value if isfinite(value) else 0.0


def gather(
    effects: Sequence[Effect],
    machine: SliderCrank,
    joint: str,
    tracks: Sequence[Track],
    fixed: Sequence[str],
    turns: float,
) -> dict[str, Term]:
    """Terms by label: those that ideal joints let be seen, and the faults of the recorded channels.

    Args:
        effects: named ones.
        machine: nominal.
        joint: B or C.
        tracks: recordings.
        fixed: paths that are uncertain anyway, which no effect may claim.
        turns: of the crank [1/s]: what happens more often in a turn than sampling shows is not looked for.
    """
    shared = [c for c in tracks[0].channels if all(c in track.channels for track in tracks)]
    spread = {c: float(np.mean([t.values[:, t.channels.index(c)].std() for t in tracks])) for c in shared}
    found: dict[str, Term] = {}
    for effect in effects:
        if effect.kind == "physics":
            if effect.place(joint) in ("joint_b", "joint_c"):
                continue
            variants = list(_resolved(effect, _RESOLVED * min(t.rate for t in tracks) / turns).variants())
        elif effect.each_channel and effect.name in ("sensor_gain", "sensor_bias", "sensor_delay"):
            variants = [_fault(effect, c, spread[c]) for c in shared if _sensible(effect.name, c, shared)]
        else:
            continue
        for variant in variants:
            if any(parameter.path in fixed for parameter in variant.free):
                continue
            term = term_of(variant, machine, joint)
            if term is not None and not _structural(term, machine):
                found[term.label] = term
    return found


def _resolved(effect: Effect, highest: float) -> Effect:
    """An effect whose order, if it has one, stays below the highest that the sampling shows."""
    free = tuple(
        replace(
            parameter,
            bounds=(parameter.bounds[0], max(highest, 2.0 * parameter.bounds[0])),
            start=min(parameter.start, max(highest, parameter.bounds[0])),
            trials=tuple(trial for trial in parameter.trials if trial <= highest) or (parameter.bounds[0],),
        )
        if parameter.name == "order" and parameter.bounds[1] > highest
        else parameter
        for parameter in effect.free
    )
    return replace(effect, free=free)


def _sensible(name: str, channel: str, channels: Sequence[str]) -> bool:
    """An encoder's zero is always refitted; one channel alone cannot be late."""
    if channel == "crank_angle":
        return False
    return name != "sensor_delay" or len(channels) > 1


def _fault(effect: Effect, channel: str, spread: float) -> Effect:
    """The fault of one channel's instrument, in the channel's own unit and size."""
    parameter = effect.free[0]
    if effect.name == "sensor_bias":
        parameter = replace(
            parameter, unit=si_unit(channel), bounds=(-10.0 * spread, 10.0 * spread), start=0.05 * spread
        )
    if effect.name == "sensor_delay":
        parameter = replace(parameter, bounds=(0.0, LATEST), start=1e-3)
    return replace(effect.on_channel(channel), free=(parameter,))


def encoder_zero(effect: Effect) -> Effect:
    """The unknown zero of an encoder as the fault of its instrument."""
    parameter = replace(
        effect.free[0],
        unit="rad",
        bounds=(-2.0 * np.pi, 2.0 * np.pi),
        start=0.1,
        phrase="{value} from its zero",
    )
    return replace(effect.on_channel("crank_angle"), free=(parameter,))


def _structural(term: Term, machine: SliderCrank) -> bool:
    """Whether the term gives the machine new coordinates."""
    if term.effect.kind != "physics":
        return False
    changed = term.effect.machine(machine, term.joint, term.values(term.starts[0]))
    return bool((changed.codes()[STRUCTURE] != machine.codes()[STRUCTURE]).any())


@dataclass(frozen=True)
class Model:
    """A machine with unknown numbers, for several recordings.

    Shared unknowns are the uncertain values of the machine, the clearance where the slider's position can
    show it, and the parameters of the terms. Each recording has its own start angle, start speed, start of
    the drive's integral, speed of the drive and zero of the encoder.

    Attributes:
        machine: nominal, joints ideal.
        joint: B or C, for the clearance.
        terms: that are in.
        uncertain: paths of the mechanism to bounds.
        with_clearance: whether a clearance is fitted.
        with_zero: whether the encoder's zero is fitted.
        zero_deviation: within which it is known before [rad].
        instrument: faults that are there anyway.
        known_clearance: [m], where none is fitted.
    """

    machine: SliderCrank
    joint: str
    terms: tuple[Term, ...] = ()
    uncertain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    with_clearance: bool = False
    with_zero: bool = False
    zero_deviation: float = 10.0
    instrument: Instrument = field(default_factory=Instrument)
    known_clearance: float = 0.0
    _made: dict[bytes, tuple[SliderCrank, Instrument]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @cached_property
    def fixed_unknowns(self) -> tuple[Unknown, ...]:
        """Shared unknowns before those of the terms."""
        found = []
        for path, (low, high) in self.uncertain.items():
            is_log = low > 0.0
            nominal = float(np.clip(read_path(self.machine, path), low, high))
            inner = (log(low), log(high)) if is_log else (low, high)
            middle = log(nominal) if is_log else nominal
            width = inner[1] - inner[0]
            found.append(
                Unknown(path, "", low, high, _STEP if is_log else _STEP * width, is_log, (middle, width))
            )
        if self.with_clearance:
            found.append(Unknown("clearance", "m", 0.0, _LARGEST_CLEARANCE, 1e-5))
        return tuple(found)

    @cached_property
    def shared(self) -> tuple[Unknown, ...]:
        """All shared unknowns."""
        return (*self.fixed_unknowns, *(u for term in self.terms for u in term.unknowns))

    def own(self, begin: np.ndarray) -> tuple[Unknown, ...]:
        """Each recording's own unknowns: angle, speed, integral, drive's speed [rpm], encoder's zero.

        Args:
            begin: (5,) first guess of them, which those keep that the data say nothing about.
        """
        machine, _ = self.apply(np.array([u.inner(self._begin(u)) for u in self.shared]))
        driven = not isinstance(machine.drive, Free)
        gain = float(machine.parameters()[Parameter.DRIVE_INTEGRAL_GAIN])
        speed = max(abs(float(begin[1])), 1.0)
        # a run at an absurd speed needs as many more steps
        fastest, unloaded = _FASTER * max(speed, 10.0), _FASTER * max(abs(float(begin[3])), 100.0)
        fixed = 1e-12  # a prior that holds an unknown where it is
        torque = 5.0 / gain if gain > 0.0 else fixed
        zero = self.zero_deviation if self.with_zero else fixed
        return (
            Unknown("angle", "rad", -np.inf, np.inf, 1e-4, prior=(float(begin[0]), 10.0)),
            Unknown("speed", "rad/s", -fastest, fastest, 1e-4 * speed, prior=(float(begin[1]), speed)),
            Unknown("integral", "rad", -1e6, 1e6, max(1e-3 * torque, 1e-12), prior=(float(begin[2]), torque)),
            Unknown(
                "drive_speed", "rpm", -unloaded, unloaded, 1e-4 * max(abs(float(begin[3])), 1.0),
                prior=(float(begin[3]), 2.0 * abs(float(begin[3])) + 10.0 if driven else fixed),
            ),
            Unknown("zero", "rad", -50.0, 50.0, 1e-4, prior=(float(begin[4]), zero)),
        )  # fmt: skip

    def _begin(self, unknown: Unknown) -> float:
        for term in self.terms:
            if unknown in term.unknowns:
                place = term.unknowns.index(unknown)
                return unknown.outer(float(term.starts[0][place]))
        if unknown.name == "clearance":
            return max(unknown.low, 0.0)
        return float(np.clip(read_path(self.machine, unknown.name), unknown.low, unknown.high))

    def apply(self, shared: np.ndarray) -> tuple[SliderCrank, Instrument]:
        """Machine and instruments with shared values on the scale of the fit."""
        key = shared.tobytes()
        if key not in self._made:
            if len(self._made) > _KEPT:
                self._made.clear()
            self._made[key] = self._apply(shared)
        return self._made[key]

    def _apply(self, shared: np.ndarray) -> tuple[SliderCrank, Instrument]:
        machine, instrument = self.machine, self.instrument
        values = dict(zip(self.fixed_unknowns, shared, strict=False))
        place = len(values)
        uncertain = {u.name: u.outer(float(v)) for u, v in values.items() if u.name != "clearance"}
        if uncertain:
            machine = with_values(machine, uncertain)
        for term in self.terms:
            named = term.values(shared[place : place + len(term.unknowns)])
            machine = term.effect.machine(machine, term.joint, named)
            instrument = term.effect.instrument(instrument, named)
            place += len(term.unknowns)
        return machine, instrument

    def clearance(self, shared: np.ndarray) -> float:
        """The clearance [m]."""
        if not self.with_clearance:
            return self.known_clearance
        place = len(self.fixed_unknowns) - 1
        return self.fixed_unknowns[place].outer(float(shared[place]))

    def guess(self, shared: np.ndarray, own: np.ndarray) -> Guess | None:
        """What to predict with; ``None`` where a law does not take the values."""
        try:
            machine, instrument = self.apply(shared)
            drive = machine.drive
            assert isinstance(drive, Drive)
            machine = replace(machine, drive=settled(drive.at_speed(float(own[3]))))
        except InputError:
            return None
        if self.with_zero:
            instrument = instrument.changed("bias", float(own[4]), "crank_angle")
        slack = Motion.SLACK_B if self.joint == "B" else Motion.SLACK_C
        return Guess(
            machine,
            instrument,
            float(own[0]),
            float(own[1]),
            float(own[2]),
            self.clearance(shared),
            int(slack),
        )
