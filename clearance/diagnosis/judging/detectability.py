"""What could be seen, by linear theory: the smallest size of an effect that sensors show.

Beside a path that is known to within the noise, an effect's parameter has a standard error,
with the path, the clearance and the speed unknown. An effect is seen with power 90 % in a two-sided test at
5 % where it is z(0.975) + z(0.9) = 3.24 standard errors from "off" (Lachin 1981, Control. Clin. Trials 2).
Below that it cannot be seen here, which is not the same as absent. What has no derivative at "off" is in
``finite_sizes``, the map over clearances, speeds and sensor sets in ``nominal_map``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from clearance.compilation import entry
from clearance.diagnosis.following.attempt import explained
from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.screening import screen
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.instrument import sensitivity as derivative
from clearance.diagnosis.sensing.measured import REACH, SAMPLES, Measured, filter_weights
from clearance.diagnosis.shooting.follow import TIGHT, Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.stretch import Pass
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.chain import MeasurementChain
from clearance.recording.channels import ACCELERATIONS, SensorSet
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal
from clearance.simulation.shooting import fold
from clearance.simulation.trajectory import simulate_trajectory

STANDARD_ERRORS = 1.959964 + 1.281552
NOISE = 0.01  # of a channel's standard deviation

_SETTLED, _DURATION = 0.3, 0.3  # s
_MARGIN = 100  # samples of a recording for the filter's tails
_STEP = 1e-5  # s, at most
_CHAIN = MeasurementChain()


def smallest(deviations: np.ndarray) -> np.ndarray:
    """Sizes that are seen with power 90 % at 5 %, from standard errors in the same units."""
    return STANDARD_ERRORS * np.asarray(deviations, dtype=float)


def seen(hypotheses: Sequence[Hypothesis], deviations: Sequence[float]) -> list[dict[str, Any]]:
    """What a finished fit of the nominal machine could have shown, for the report.

    Args:
        hypotheses: one an effect.
        deviations: standard error of each one's first parameter, by linear theory at the fitted machine.

    Returns:
        Name, parameter, unit and smallest size of each; no size where the parameter cannot become so large.
    """
    found = []
    for hypothesis, deviation in zip(hypotheses, deviations, strict=True):
        unknown = hypothesis.unknowns[0]
        unit = hypothesis.effect.parameter(unknown.name).unit if hypothesis.effect else ""
        size = shown_size(deviation, unknown.high - unknown.low)
        found.append({"name": hypothesis.name, "parameter": unknown.name, "unit": unit, "size": size})
    return found


def seen_beside(search: Search, explanation: Explanation) -> list[dict[str, Any]]:
    """The smallest sizes of further physical effects that the fitted recordings would have shown.

    By the linear look beside the best attempt, its states, parameters and speeds unknown; nothing where it
    does not explain. What is off at infinity or adds coordinates is not listed.

    Args:
        search: with its hypotheses.
        explanation: whose look beside the nominal machine, if that one explains, has been taken.

    Returns:
        As ``seen``, by name.
    """
    best, hints = explanation.best, explanation.hints
    if not explained(best):
        return []
    if best is not explanation.nominal:
        hints = screen(best, search.others(best), search.workers).singles
    one = [
        (hint.hypotheses[0], hint.deviation)
        for hint in hints
        if hint.hypotheses[0].kind == "physics"
        and np.isfinite(hint.hypotheses[0].off[0])
        and not hint.hypotheses[0].shapes[0]
    ]
    one.sort(key=lambda pair: pair[0].label)
    return seen(*zip(*one, strict=True)) if one else []


def shown_size(deviation: float, span: float) -> float | None:
    """The smallest size from a standard error; none beyond what a parameter may be."""
    size = float(smallest(np.array(deviation)))
    return rounded(size if np.isfinite(size) and size < span else None)


def rounded(size: float | None) -> float | None:
    """A size to the digits that such a reckoning is worth."""
    return None if size is None else float(f"{size:.3g}")


def differentiable(groups: Mapping[str, Sequence[Hypothesis]], machine: SliderCrank) -> list[Hypothesis]:
    """The first hypothesis of each effect that is no sensor's and that a machine has a derivative by."""
    found: dict[str, Hypothesis] = {}
    for trials in groups.values():
        hypothesis = trials[0]
        if hypothesis.channel or hypothesis.name in found or hypothesis.structural(machine):
            continue
        if np.isfinite(hypothesis.off[0]):
            found[hypothesis.name] = hypothesis
    return list(found.values())


@dataclass(frozen=True)
class Fault:
    """What a fault of one sensor changes, in whichever sensor it is.

    Attributes:
        effect: whose first parameter it is.
        values: (accelerations,) of the parameter, whose whole change is one unit; ``None``: its derivative
            at "off", in the parameter's unit.
    """

    effect: Effect
    values: np.ndarray | None = None

    def change(self, signals: np.ndarray, channel: str, rate: float) -> np.ndarray:
        """(samples, accelerations) that it changes (samples, accelerations) signals by, if it is there."""
        parameter = self.effect.free[0]
        if self.values is not None:
            value = float(self.values[ACCELERATIONS.index(channel)])
            faulty = Instrument().changed(parameter.path, value, channel)
            return faulty.apply(signals, ACCELERATIONS, rate) - signals
        assert parameter.off is not None
        return derivative(
            Instrument(), parameter.path, parameter.off, 1e-3 * abs(parameter.start), signals, ACCELERATIONS,
            rate, channel,
        )  # fmt: skip


def faults_of_sensors(effects: Sequence[Effect]) -> list[Fault]:
    """Faults of one sensor that are off at a finite value, which have a derivative there."""
    return [
        Fault(e)
        for e in effects
        if e.each_channel and e.free[0].off is not None and np.isfinite(e.free[0].off)
    ]


@dataclass(frozen=True)
class Linearised:
    """The nominal machine on a noiseless recording of itself, with first traces of effects beside it.

    Attributes:
        look: by all accelerometers; clearance, speed, then the effects.
        measured: the recording.
        model: of the nominal machine.
        steps: of each parameter.
    """

    look: Pass
    measured: Measured
    model: Model
    steps: np.ndarray

    @property
    def signals(self) -> np.ndarray:
        """(samples, accelerations) recorded."""
        return self.measured.values.reshape(-1, len(ACCELERATIONS))

    def errors(self, sensors: SensorSet, faults: Sequence[Fault] = ()) -> tuple[np.ndarray, np.ndarray]:
        """Standard errors of first parameters in a second of recording, one effect or fault at a time.

        Args:
            sensors: of accelerations.
            faults: of one of these sensors.

        Returns:
            (effects,) and (faults, accelerations); infinite where nothing shows it.
        """
        one = _with_sensors(_with_faults(self.look, self.measured, faults), sensors.channels)
        steps = np.append(self.steps, np.ones(len(faults) * len(ACCELERATIONS)))
        found = np.sqrt(self.measured.seconds) * _standard_errors(one.gram, steps, self.model)
        effects = len(self.steps) - len(self.model.unknowns)
        return found[:effects], found[effects:].reshape(len(faults), len(ACCELERATIONS))


def linearised(
    setting: Setting, hypotheses: Sequence[Hypothesis], clearance: float, speed: float, noise: float = NOISE
) -> Linearised:
    """Linearise the nominal machine about itself.

    Args:
        setting: the nominal machine and the joint.
        hypotheses: effects beside it, see ``differentiable``.
        clearance: [m].
        speed: [rpm].
        noise: standard deviation over that of the channel.
    """
    model, values = setting.model(), np.array([clearance, speed])
    machine = model.machine(values)
    follower = follower_on_path(machine, noise)
    columns, _ = model.columns(values)
    traces = [(one, _trace(one)) for one in hypotheses]
    faulty = [one.fault and one.fault(Instrument(), trace) for one, trace in traces]
    look = follower.look(
        machine,
        [*columns, *(one.apply(machine, trace) for one, trace in traces)],
        faults=[*[None] * len(columns), *faulty],
    )
    own = [model.step(values, i) for i in range(len(values))]
    steps = np.array([*own, *(one.unknowns[0].step for one in hypotheses)])
    return Linearised(look, follower.measured, model, steps)


def _trace(hypothesis: Hypothesis) -> np.ndarray:
    """(unknowns,) values of a first trace of an effect, its shapes as in the trial."""
    values = np.where(hypothesis.shapes, hypothesis.start, hypothesis.off)
    values[0] += hypothesis.unknowns[0].step
    return values


def follower_on_path(
    machine: SliderCrank, noise: float = NOISE, chain: MeasurementChain = _CHAIN
) -> Follower:
    """A follower on a noiseless recording of the machine by all accelerometers, at the true nodes.

    Args:
        machine: runs by Runge-Kutta's fourth order in steps of at most 10 µs, refined in contact.
        noise: what the recording is held to have: standard deviation over that of the channel.
        chain: of measurement, of at least 500 Hz.
    """
    period = 1.0 / chain.base_rate
    integrator = Integrator("runge_kutta_4", _STEP, 2).within(period)
    first, periods = round(_SETTLED * chain.base_rate), SAMPLES * chain.decimation
    segments = round(_DURATION * chain.base_rate / periods)
    margin = _MARGIN * chain.decimation
    duration = _SETTLED + _DURATION + margin * period
    run = simulate_trajectory(machine, integrator, duration, integrator.substeps(period))
    if not run.finite:
        raise InputError("detectability: the nominal machine does not run at this clearance and speed")
    filtered = chain.smooth(run.signals[first - margin :, : Signal.CRANK_ANGLE])[margin :: chain.decimation]
    values = filtered[: segments * SAMPLES].reshape(segments, SAMPLES, -1)
    size = values.std(axis=(0, 1))
    # a sensor that shows nothing yet has the noise of the others
    sigma = noise * np.where(size > 1e-6 * size.max(), size, np.median(size[size > 1e-6 * size.max()]))
    weights = filter_weights(chain, SAMPLES, REACH)
    signals = tuple(range(Signal.CRANK_ANGLE))
    measured = Measured(
        "nominal", values, values.reshape(-1, len(signals)), 0, ACCELERATIONS, signals, sigma, chain, weights,
        np.full(len(signals), np.inf),
    )  # fmt: skip
    follower = Follower(measured, integrator, TIGHT.copy())
    codes, p = machine.codes(), machine.parameters()[:, None].copy()
    for k in range(segments):
        state = np.ascontiguousarray(run.states[first + k * periods, :, None])
        _fold(codes, p, state, follower.path.nodes[k])
    return follower


@entry
def _fold(codes: np.ndarray, p: np.ndarray, s: np.ndarray, node: np.ndarray) -> None:
    fold(codes, p, s, 0, node)


def _with_faults(one: Pass, measured: Measured, faults: Sequence[Fault]) -> Pass:
    """The same linearisation with a column for each fault of each sensor, in the fault's unit."""
    flow, *rest, sensitivity, residual = one.system
    signals = measured.values.reshape(-1, len(ACCELERATIONS))
    weight = one.used / measured.sigma
    columns = [sensitivity]
    for fault in faults:
        for channel in ACCELERATIONS:
            change = fault.change(signals, channel, measured.chain.rate)
            columns.append((change.reshape(weight.shape) * weight).reshape(*residual.shape, 1))
    moved = np.zeros((*flow.shape[:2], len(columns) - 1))  # no sensor changes how the machine moves
    flow, shown = np.concatenate([flow, moved], axis=2), np.concatenate(columns, axis=2)
    return replace(one, system=(flow, *rest, shown, residual))


def _with_sensors(one: Pass, channels: Sequence[str]) -> Pass:
    """The same linearisation as if only some channels had been recorded."""
    flow, defect, inputs, own, doubt, held, jacobian, sensitivity, residual = one.system
    hidden = np.tile([name not in channels for name in ACCELERATIONS], SAMPLES)
    jacobian, sensitivity, residual = jacobian.copy(), sensitivity.copy(), residual.copy()
    jacobian[:, :, hidden] = 0.0
    sensitivity[:, hidden] = 0.0
    residual[:, hidden] = 0.0
    return replace(
        one, system=(flow, defect, inputs, own, doubt, held, jacobian, sensitivity, residual)
    ).solve()


def _standard_errors(gram: np.ndarray, steps: np.ndarray, model: Model) -> np.ndarray:
    """Of each parameter beside the model's own, one at a time; infinite where nothing tells it apart."""
    information = gram[:-1, :-1] / np.outer(steps, steps)
    nuisance = list(range(len(model.unknowns)))
    found = []
    for k in range(len(nuisance), len(steps)):
        own = [*nuisance, k]
        part = information[np.ix_(own, own)]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(part), 1e-300))
        inverse = np.linalg.pinv(part * np.outer(scale, scale), rcond=1e-10, hermitian=True)[-1, -1]
        found.append(scale[-1] * np.sqrt(inverse) if part[-1, -1] > 0.0 and inverse >= 1.0 - 1e-6 else np.inf)
    return np.array(found)
