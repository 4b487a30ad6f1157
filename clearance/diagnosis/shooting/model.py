"""What is to be found: a machine and its instruments as a function of unknown parameters."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import NO_FAULT
from clearance.mechanism.slider_crank import SliderCrank


@dataclass(frozen=True)
class Unknown:
    """A parameter to be found.

    Attributes:
        name: in plain words or as in an effect.
        step: change for its derivative, about its smallest uncertainty.
        low: bound.
        high: bound.
        own: whether each recording has its own value.
        reach: change that the linearisation surely bears; 0: a share of its value.
        log: whether it counts by ratios: one step changes it by a share at most.
        turns: whether it is an angle [rad], which has no bounds and does not change much in one step: the
            phase of what is hardly there would turn as often as it liked.
        expected: what it is known to be near before it is fitted.
        within: standard deviation of that; infinite: nothing is known.
    """

    name: str
    step: float
    low: float = -np.inf
    high: float = np.inf
    own: bool = False
    reach: float = 0.0
    log: bool = False
    turns: bool = False
    expected: float = 0.0
    within: float = np.inf


@dataclass(frozen=True)
class Model:
    """A machine with unknown parameters.

    Attributes:
        unknowns: shared ones first, then those that each recording has for itself.
        machine: makes the machine from values in that order.
        instrument: makes the instruments from them.
        sensing: (unknowns,) whether each is one of the instruments'; none if empty.
    """

    unknowns: tuple[Unknown, ...]
    machine: Callable[[np.ndarray], SliderCrank]
    instrument: Callable[[np.ndarray], Instrument] = lambda _: NO_FAULT
    sensing: tuple[bool, ...] = ()

    @property
    def shared(self) -> int:
        """Number of shared unknowns."""
        return sum(not u.own for u in self.unknowns)

    def columns(self, values: np.ndarray) -> tuple[list[SliderCrank | None], list[Instrument | None]]:
        """Machine and instruments with each unknown changed by its step (inwards at an upper bound).

        ``None``: it does not change them, as an unknown that has no room between its bounds.
        """
        machines: list[SliderCrank | None] = []
        faults: list[Instrument | None] = []
        for i in range(len(self.unknowns)):
            if self.unknowns[i].low == self.unknowns[i].high:  # a number of lobes, which is not fitted
                machines.append(None)
                faults.append(None)
                continue
            changed = values.copy()
            changed[i] += self.step(values, i)
            sensing = bool(self.sensing) and self.sensing[i]
            machines.append(
                None if sensing and self.machine(changed) == self.machine(values) else self.machine(changed)
            )
            faults.append(self.instrument(changed) if sensing else None)
        return machines, faults

    def held(self, values: np.ndarray) -> "Model":
        """The same without unknowns, at these values."""
        machine, instrument = self.machine(values), self.instrument(values)
        return Model((), lambda _: machine, lambda _: instrument)

    def only(self, kept: Sequence[int], values: np.ndarray) -> "Model":
        """The same with some of the unknowns, the others at these values."""

        def whole(some: np.ndarray) -> np.ndarray:
            every = values.copy()
            every[list(kept)] = some
            return every

        return Model(
            tuple(self.unknowns[i] for i in kept), lambda v: self.machine(whole(v)),
            lambda v: self.instrument(whole(v)), tuple(self.sensing[i] for i in kept) if self.sensing else (),
        )  # fmt: skip

    def step(self, values: np.ndarray, i: int) -> float:
        """Signed step of unknown ``i``."""
        unknown = self.unknowns[i]
        return -unknown.step if values[i] + unknown.step > unknown.high else unknown.step
