"""What could be seen of effects that have no derivative at "off", by what a finite size of them leaves.

Effects that give the machine new coordinates are looked for where the nominal machine leaves more than right
ones do (``CALM``), however long a recording is. That is asked here without noise: the machine with the effect
is recorded, the nominal one follows it, with its path, the clearance and the speed free, and what it leaves
is counted in the variance of the noise.

Faults of a sensor that are off at infinity are asked by linear theory for the whole of what they change.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting
from clearance.diagnosis.judging.detectability import STANDARD_ERRORS, Fault, follower_on_path
from clearance.diagnosis.searching.significance import CALM
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import ACCELERATIONS, SensorSet

LEFT = CALM - 1.0  # variances of noise, on average over samples
_SEGMENTS = 150  # that are followed
_ITERATIONS, _TOLERANCE = 3, 3e-2  # of the nominal machine's fit
_STRONGER, _RUNGS = 4.0, 12  # times the start's strength; sizes, each of half the strength of the one before
_RESONANCES = tuple(500.0 * 2.0**k for k in range(7))  # Hz
_CLIPPED = (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99)  # of the largest acceleration


class Ladder:
    """Sizes of an effect from strong to weak, and what the nominal machine leaves of each.

    Attributes:
        sizes: of the effect's first parameter, in its unit.
        left: by sensor set of each rung that was asked for.
    """

    def __init__(self, hypothesis: Hypothesis, ask: Callable[[float], Mapping[str, float]]) -> None:
        """Nothing is asked yet; ``ask`` gives what is left by sensor set, infinite where nothing follows."""
        self.sizes = ladder_of(hypothesis)
        self.left: dict[int, Mapping[str, float]] = {}
        self._ask = ask

    def smallest(self, begin: int) -> tuple[dict[str, float | None], int]:
        """The weakest size that is seen by each sensor set, and a rung about there.

        From rung ``begin`` on to where all see it, and to where none does: what is seen on a weaker rung
        beyond one that is not does not count. Between two rungs it is interpolated by logarithms. On the
        weakest rung it is at most that; ``None``: on no rung.
        """
        low = high = min(max(begin, 0), len(self.sizes) - 1)
        while low > 0 and not all(one > LEFT for one in self._at(low).values()):
            low -= 1
        while high < len(self.sizes) - 1 and any(one > LEFT for one in self._at(high).values()):
            high += 1
        return {name: self._between(name, low, high) for name in self._at(low)}, (low + high) // 2

    def _at(self, rung: int) -> Mapping[str, float]:
        if rung not in self.left:
            self.left[rung] = self._ask(float(self.sizes[rung]))
        return self.left[rung]

    def _between(self, name: str, low: int, high: int) -> float | None:
        left = [self._at(rung)[name] for rung in range(low, high + 1)]
        unseen = next((k for k, one in enumerate(left) if not one > LEFT), None)
        if unseen == 0:
            return None
        if unseen is None:
            return float(self.sizes[high])
        strong, weak = self.sizes[low + unseen - 1], self.sizes[low + unseen]
        most, least = np.log(np.clip([left[unseen - 1], left[unseen]], 1e-6, 1e6))
        share = (most - np.log(LEFT)) / (most - least)
        return float(strong * (weak / strong) ** share)


def ladder_of(hypothesis: Hypothesis) -> np.ndarray:
    """(rungs,) sizes of an effect's first parameter within its bounds, from strong to weak."""
    unknown, start = hypothesis.unknowns[0], float(hypothesis.start[0])
    weaker = 2.0 if np.isinf(hypothesis.off[0]) else 0.5
    strongest = start / _STRONGER if weaker > 1.0 else start * _STRONGER
    sizes = strongest * weaker ** np.arange(_RUNGS)
    within: np.ndarray = sizes[(sizes > unknown.low) & (sizes < unknown.high)]
    return within


def left_by_sensor_set(
    setting: Setting,
    hypothesis: Hypothesis,
    clearance: float,
    speed: float,
    sensor_sets: Sequence[SensorSet],
    size: float,
) -> dict[str, float]:
    """What the nominal machine leaves of a recording with an effect, a sample, in variances of noise.

    Args:
        setting: the nominal machine and the joint.
        hypothesis: the effect; its shapes are as in its trial.
        clearance: of the recorded machine [m].
        speed: likewise [rpm].
        sensor_sets: of accelerations, whose noise is that beside the nominal machine.
        size: of the effect's first parameter.

    Returns:
        By sensor set; infinite where the machine with the effect does not run, or nothing follows it.
    """
    model, values = setting.model(), np.array([[clearance, speed]])
    machine = model.machine(values[0])
    sigma = follower_on_path(machine).measured.sigma
    effect = hypothesis.start.copy()
    effect[0] = size
    try:
        run = follower_on_path(hypothesis.apply(machine, effect))
    except InputError:
        return {sensors.name: np.inf for sensors in sensor_sets}
    run.measured = replace(run.measured, sigma=sigma)
    found = {}
    for sensors in sensor_sets:
        measured = run.measured
        for channel in ACCELERATIONS:
            if channel not in sensors.channels:
                measured = measured.without(channel)
        whole = Follower(measured, run.integrator, run.input_sigma.copy())
        whole.path = run.path.copy()
        own = [whole.part(0, _SEGMENTS)]
        try:
            found[sensors.name] = settle(own, model, values, _ITERATIONS, _TOLERANCE, 1).level
        except np.linalg.LinAlgError:
            found[sensors.name] = np.inf
    return found


def without_derivative(groups: Mapping[str, Sequence[Hypothesis]], machine: SliderCrank) -> list[Hypothesis]:
    """The first hypothesis of each effect that gives a machine new coordinates."""
    found: dict[str, Hypothesis] = {}
    for trials in groups.values():
        if trials[0].structural(machine):
            found.setdefault(trials[0].name, trials[0])
    return list(found.values())


def limits_of_sensors(effects: Sequence[Effect]) -> list[Effect]:
    """Faults of one sensor that are off at infinity."""
    return [e for e in effects if e.each_channel and e.free[0].off == np.inf]


def rungs(effect: Effect, signals: np.ndarray) -> list[Fault]:
    """A fault that is off at infinity from strong to weak: resonances, and limits to what a sensor shows.

    Args:
        effect: the fault.
        signals: (samples, accelerations) without it.
    """
    largest = np.abs(signals).max(axis=0)
    if effect.free[0].path == "saturation":
        return [Fault(effect, np.maximum(share * largest, effect.free[0].bounds[0])) for share in _CLIPPED]
    return [Fault(effect, np.full(len(largest), value)) for value in _RESONANCES]


def weakest(effect: Effect) -> float | None:
    """The weakest value that is asked of a fault which is off at infinity; ``None``: it is the signals'."""
    return None if effect.free[0].path == "saturation" else _RESONANCES[-1]


def highest(faults: Sequence[Fault], errors: np.ndarray) -> float | None:
    """The highest value with which the sensor that shows a fault least shows it, of those that do at all.

    Args:
        faults: of one effect, see ``rungs``.
        errors: (faults, accelerations) standard errors of their changes.

    Returns:
        Between two rungs interpolated by logarithms; ``None``: no sensor shows any.
    """
    values = np.array([fault.values for fault in faults])
    with np.errstate(divide="ignore"):
        margins = np.log(np.maximum(1.0 / errors, 1e-6) / STANDARD_ERRORS)
    shown = []
    for own, margin in zip(values.T, margins.T, strict=True):
        if margin[0] <= 0.0:
            continue
        unseen = next((k for k, one in enumerate(margin) if one <= 0.0), None)
        if unseen is None:
            shown.append(own[-1])
            continue
        share = margin[unseen - 1] / (margin[unseen - 1] - margin[unseen])
        shown.append(own[unseen - 1] * (own[unseen] / own[unseen - 1]) ** share)
    return float(min(shown)) if shown else None
