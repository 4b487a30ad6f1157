"""Named effects: physics or an instrument's faults that a simulator may lack.

An effect is data: the laws that it switches on, the numbers that are free, where each of them vanishes.
Applied to a machine it gives another machine, so that several effects compose by applying one after the
other. Adding one is a YAML file and, if need be, a law.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import floor, isfinite, log10
from typing import Any

from clearance.diagnosis.sensing.instrument import FAULTY_CHANNELS, Instrument
from clearance.errors import InputError
from clearance.mechanism.description import read_path, with_laws, with_values
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.bounds import listing
from clearance.recording.channels import require_channel

KINDS = ("physics", "instrument")
NOMINAL = "nominal"
"""An effect's ``off``: the value that the machine has without the effect."""

_OPERATIONS = ("set", "multiply", "add")
_SCALES = ("linear", "log")
_JOINTS = {"B": ("joint_b", "joint_c"), "C": ("joint_c", "joint_b")}
_SECONDS = {"s": 1, "Hz": -1, "N": -2}
_WRITTEN_OUT = (1e-3, 1e5)  # others are powers of ten
_PLAIN = {"joint_b": "joint B", "joint_c": "joint C"}


@dataclass(frozen=True)
class FreeParameter:
    """A number of an effect that is found from data.

    Attributes:
        name: as in the report.
        path: of the value in a ``SliderCrank`` that it sets, with ``{joint}`` and ``{other_joint}``; of an
            instrument's effect, the fault of an ``Instrument``.
        unit: SI, but deg for mounting angles.
        bounds: low, high.
        around: whether bounds, start and trials count from the machine's own value (see ``Effect.around``).
        off: where the effect vanishes; ``None``: at the machine's own value (see ``Effect.off``).
        start: a plausible size.
        scale: linear or log, for steps and intervals.
        operation: set the value at the path, multiply it or add to it.
        of: path of the value that is multiplied or added to, where that is another one.
        over: path of a value that the parameter is divided by first.
        shape: whether it has a meaning only where another parameter is not off.
        whole: whether it counts something.
        trials: values to begin a fit at.
        phrase: its part of the effect's sentence, around ``{value}``.
        percent: whether people are told it in percent.
    """

    name: str
    path: str
    unit: str
    bounds: tuple[float, float]
    off: float | None
    start: float
    around: bool = False
    scale: str = "linear"
    operation: str = "set"
    of: str | None = None
    over: str | None = None
    shape: bool = False
    whole: bool = False
    trials: tuple[float, ...] = ()
    phrase: str = "{value}"
    percent: bool = False

    def __post_init__(self) -> None:
        low, high = self.bounds
        checks = (
            (self.operation in _OPERATIONS, f"operation = {self.operation!r} is not one of {_OPERATIONS}"),
            (self.scale in _SCALES, f"scale = {self.scale!r} is not one of {_SCALES}"),
            (low < high, f"bounds = {list(self.bounds)} do not rise"),
            (self.scale == "linear" or low > 0.0, f"bounds = {list(self.bounds)} reach 0 on a log scale"),
            (
                all(low <= value <= high for value in (self.start, *self.trials)),
                f"start = {self.start} and trials = {list(self.trials)} must lie within {list(self.bounds)}",
            ),
            ("{value}" in self.phrase, f"phrase = {self.phrase!r} does not show {{value}}"),
        )
        for holds, message in checks:
            if not holds:
                raise InputError(message)

    @property
    def seconds(self) -> int:
        """Power of the second in its unit: by whose seconds it is counted matters."""
        over, _, under = self.unit.partition("/")
        factors = [(one, 1) for one in over.split()] + [(one, -1) for one in under.split()]
        powers = [(*one.partition("^")[::2], sign) for one, sign in factors]
        return sum(sign * _SECONDS.get(name, 0) * int(power or 1) for name, power, sign in powers)

    def text(self, value: float, low: float | None = None, high: float | None = None) -> str:
        """The value with its interval, if there is one, and its unit, for people: 2.5 (2.3 to 2.7) mm.

        All three have the decimals that the interval's width is worth.
        """
        factor, unit = 1.0, {"-": "", "deg": "°"}.get(self.unit, f" {self.unit}")
        if self.percent:
            factor, unit = 100.0, " %"
        if self.unit in ("m", "s") and 0.0 < abs(value) < 1.0:
            factor, prefix = (1e6, "µ") if abs(value) < 1e-3 else (1e3, "m")
            unit = f" {prefix}{self.unit}"
        if low is None or high is None or not low < high:
            return f"{factor * value:.4g}{unit}"
        shown, *ends = rounded_alike(factor * value, factor * low, factor * high)
        between = " to ".join(ends)
        return f"{shown} ({between}){unit}" if unit.startswith(" ") else f"{shown}{unit} ({between})"


def rounded_alike(value: float, low: float, high: float) -> list[str]:
    """A value and its interval: the interval is at least two units of the last decimal wide."""
    numbers = (value, low, high)
    written = _WRITTEN_OUT[0] <= max(map(abs, numbers)) < _WRITTEN_OUT[1]
    if not (low < high and isfinite(high - low) and written):
        return [f"{number:.4g}" for number in numbers]
    decimals = max(0, -floor(log10((high - low) / 2.0) + 1e-9))
    rounded = [round(number, decimals) for number in numbers]
    return [  # what rounding would change by a tenth has digits of its own
        f"{number:.2g}" if abs(near - number) > 0.1 * abs(number) else f"{near + 0.0:.{decimals}f}"
        for number, near in zip(numbers, rounded, strict=True)
    ]


@dataclass(frozen=True)
class Variant:
    """A subset of an effect's parameters that is tried as a hypothesis of its own.

    Attributes:
        free: names of the parameters.
        patch: instead of the effect's; ``None``: the effect's.
        direction: instead of the effect's; ``None``: the effect's.
    """

    free: tuple[str, ...]
    patch: Mapping[str, Any] | None = None
    direction: str | None = None


@dataclass(frozen=True)
class Effect:
    """Something that a simulator may lack.

    Attributes:
        name: as in the report.
        kind: physics or instrument.
        body: where it acts; with ``{joint}`` and ``{other_joint}``.
        direction: in which it acts.
        reference: literature.
        validity: where the law holds, in words.
        sentence: what it says when it is found, around ``{parameters}``.
        free: its parameters.
        patch: laws that are switched on, nested like a mechanism's configuration; their numbers stand for
            parameters that are left alone.
        choices: its variants; none: one, with all parameters.
        each_channel: whether it is a fault of one channel (instruments).
        channel: of which channel, where ``each_channel`` and chosen.
    """

    name: str
    kind: str
    body: str
    direction: str
    reference: str
    validity: str
    sentence: str
    free: tuple[FreeParameter, ...]
    patch: Mapping[str, Any] = field(default_factory=dict)
    choices: tuple[Variant, ...] = ()
    each_channel: bool = False
    channel: str | None = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(parameter.name for parameter in self.free)

    def parameter(self, name: str) -> FreeParameter:
        """One free parameter by name."""
        for parameter in self.free:
            if parameter.name == name:
                return parameter
        raise InputError(f"effect {self.name} has no parameter {name!r}; it has {listing(self.parameters)}")

    def variants(self, channels: Sequence[str] = FAULTY_CHANNELS) -> tuple["Effect", ...]:
        """The hypotheses that the effect stands for, simple ones first.

        Args:
            channels: in which a fault of one channel is looked for.
        """
        if self.each_channel and self.channel is None:
            return tuple(self.on_channel(name) for name in channels if name in FAULTY_CHANNELS)
        return tuple(
            replace(
                self,
                free=tuple(self.parameter(name) for name in choice.free),
                patch=self.patch if choice.patch is None else choice.patch,
                direction=choice.direction or self.direction,
                choices=(),
            )
            for choice in self.choices
        ) or (self,)

    def on_channel(self, channel: str) -> "Effect":
        """The fault of one channel's instrument."""
        if not self.each_channel:
            raise InputError(f"effect {self.name} is no fault of one channel")
        return replace(self, channel=require_channel(channel, f"effect {self.name}"))

    def place(self, joint: str) -> str:
        """The body where it acts: crank, rod, slider, frame, joint_b, joint_c or instrument."""
        return _filled(self.body, joint)

    def around(self, machine: SliderCrank) -> "Effect":
        """The effect for one machine: numbers that count from the machine's own value are moved there."""
        free = []
        for one in self.free:
            own = float(read_path(machine, one.path)) if one.around else 0.0
            low, high = one.bounds
            free.append(
                replace(
                    one, bounds=(low + own, high + own), start=one.start + own,
                    trials=tuple(trial + own for trial in one.trials), around=False,
                )
            )  # fmt: skip
        return replace(self, free=tuple(free))

    def off(self, machine: SliderCrank, joint: str) -> dict[str, float]:
        """The value of each parameter at which the effect vanishes.

        Of a law that the machine has already (friction on the guide, of which there may be more or less) that
        is the machine's own number, unless the effect has a shape, too.
        """
        return self._off(machine, with_laws(machine, _filled_keys(self.patch, joint)), joint)

    def _off(self, machine: SliderCrank, changed: SliderCrank, joint: str) -> dict[str, float]:
        """See ``off``; ``changed`` is the machine with the effect's laws."""
        shaped = any(one.shape for one in self.free)  # a place or an order says nothing of the machine's own
        lawful = bool(self.patch) and changed == machine and not shaped
        found = {}
        for one in self.free:
            if one.off is None or (lawful and one.operation == "set" and isfinite(one.off)):
                found[one.name] = float(read_path(machine, _filled(one.of or one.path, joint)))
            else:
                found[one.name] = one.off
        return found

    def starts(self, machine: SliderCrank, joint: str) -> Iterator[dict[str, float]]:
        """Values to begin a fit at: every combination of the trials that the machine allows.

        Where an effect vanishes at the machine's own number they count from there.
        """
        off, trials = self.off(machine, joint), []
        for one in self.free:
            own = 0.0 if one.off is None or not isfinite(one.off) else off[one.name] - one.off
            trials.append([trial + own for trial in one.trials or (one.start,)])
        for values in product(*trials):
            named = dict(zip(self.parameters, map(float, values), strict=True))
            try:
                self.machine(machine, joint, named)
            except InputError:
                continue
            yield named

    def machine(self, machine: SliderCrank, joint: str, values: Mapping[str, float]) -> SliderCrank:
        """The machine with this effect.

        Args:
            machine: without it.
            joint: the diagnosed one, B or C.
            values: of free parameters; one that is not named is left alone. With all of them off but for the
                shape's, the machine is returned as it is; an instrument's fault leaves it as it is.

        Raises:
            InputError: unknown names, or values that a law does not take.
        """
        for name in values:
            self.parameter(name)
        if self.kind == "instrument":
            return machine
        changed = with_laws(machine, _filled_keys(self.patch, joint))
        off = self._off(machine, changed, joint)
        sizes = [
            parameter.name for parameter in self.free if not parameter.shape and parameter.name in values
        ]
        if all(values[name] == off[name] for name in sizes):
            return machine
        settings: dict[str, float] = {}
        for name, value in values.items():
            parameter = self.parameter(name)
            path = _filled(parameter.path, joint)
            part = value / read_path(machine, _filled(parameter.over, joint)) if parameter.over else value
            if parameter.operation != "set":
                source = machine if parameter.of else changed
                base = read_path(source, _filled(parameter.of or parameter.path, joint))
                part = base * part if parameter.operation == "multiply" else base + part
            settings[path] = float(part)
        return with_values(changed, settings)

    def instrument(self, instrument: Instrument, values: Mapping[str, float]) -> Instrument:
        """The instruments with this fault; physics leaves them as they are."""
        if self.kind == "physics":
            return instrument
        if self.each_channel and self.channel is None:
            raise InputError(f"effect {self.name}: which channel's? choose one with on_channel")
        for name, value in values.items():
            parameter = self.parameter(name)
            if isfinite(value) or not parameter.shape:
                instrument = instrument.changed(parameter.path, value, self.channel)
        return instrument

    def describe(self, values: Mapping[str, float | str], joint: str) -> str:
        """The effect in plain words.

        Args:
            values: of the parameters, as numbers or as finished text ("5.1 (4.8 to 5.4) N").
            joint: the diagnosed one.
        """
        phrases = []
        for name, value in values.items():
            parameter = self.parameter(name)
            shown = value if isinstance(value, str) else parameter.text(value)
            phrases.append(parameter.phrase.format(value=shown))
        text = self.sentence.format(
            parameters=", ".join(phrases), channel=self.channel, joint="{joint}", other_joint="{other_joint}"
        )
        text = _filled(text, joint)
        for short, plain in _PLAIN.items():
            text = text.replace(short, plain)
        return text[0].upper() + text[1:]


def _filled(text: str, joint: str) -> str:
    if joint not in _JOINTS:
        raise InputError(f"joint = {joint!r} is not one of {', '.join(_JOINTS)}; change joint")
    this, other = _JOINTS[joint]
    return text.replace("{joint}", this).replace("{other_joint}", other)


def _filled_keys(patch: Mapping[str, Any], joint: str) -> dict[str, Any]:
    return {_filled(name, joint): value for name, value in patch.items()}
