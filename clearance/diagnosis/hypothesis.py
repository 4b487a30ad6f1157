"""What may be missing: named effects as models with unknown parameters, beside clearance and speed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np

from clearance.diagnosis.effect import Effect
from clearance.diagnosis.fit import Model, Unknown
from clearance.diagnosis.start import quick
from clearance.errors import InputError
from clearance.mechanism.drive import Drive
from clearance.mechanism.joint import CLEARANCE_RANGE
from clearance.mechanism.slider_crank import SliderCrank

SMALLEST_CLEARANCE = 5e-6  # m; below, the joint is as good as ideal
_STEP = 1e-4  # of a parameter's plausible size, for its derivative


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

    @property
    def label(self) -> str:
        """Name with what distinguishes its variants."""
        return f"{self.name}({', '.join(u.name for u in self.unknowns)})" if self.effect else self.name

    def structural(self, machine: SliderCrank) -> bool:
        """Whether it gives the machine new coordinates."""
        from clearance.diagnosis.follow import STRUCTURE

        codes = self.apply(machine, self.start).codes()
        return bool((codes[list(STRUCTURE)] != machine.codes()[list(STRUCTURE)]).any())


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
            step = _STEP * max(size, 1e-3 * abs(start[parameter.name]), 1e-12)
            unknowns.append(Unknown(parameter.name, step, low, high, reach=0.3 * step / _STEP))
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

    def model(self, hypotheses: Sequence[Hypothesis] = ()) -> Model:
        """Unknowns: the clearance, the hypotheses' parameters, each recording's speed [rpm]."""
        unknowns = (
            Unknown("clearance", 1e-9, SMALLEST_CLEARANCE, CLEARANCE_RANGE[1] * (1.0 - 1e-6)),
            *(u for h in hypotheses for u in h.unknowns),
            Unknown("speed", 1e-3, own=True),
        )

        def build(values: np.ndarray) -> SliderCrank:
            machine = self.with_clearance(values[0])
            drive = machine.drive
            assert isinstance(drive, Drive)
            machine = replace(machine, drive=quick(drive.at_speed(float(values[-1]))))
            place = 1
            for hypothesis in hypotheses:
                count = len(hypothesis.unknowns)
                machine = hypothesis.apply(machine, values[place : place + count])
                place += count
            return machine

        return Model(unknowns, build)


def gather(effects: Sequence[Effect], machine: SliderCrank, joint: str) -> dict[str, list[Hypothesis]]:
    """Hypotheses by label: of each variant of each physical effect, its trials."""
    found: dict[str, list[Hypothesis]] = {}
    for effect in effects:
        if effect.kind != "physics":
            continue
        for variant in effect.variants():
            try:
                trials = of_effect(variant, machine, joint)
            except InputError:
                continue
            if trials:
                found[trials[0].label] = trials
    return found
