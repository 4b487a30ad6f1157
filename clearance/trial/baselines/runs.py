"""Trajectories of the simulator beside recordings: single shooting from a clearance, speeds and angles."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.kinematics.alignment import align
from clearance.diagnosis.sensing.measured import chain_of
from clearance.errors import InputError
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.recording import Recording
from clearance.simulation.batch import Sampling, run_batch
from clearance.simulation.failure import Failure
from clearance.simulation.integrator import Integrator
from clearance.simulation.layout import Signal
from clearance.simulation.trajectory import turning_state

LEAD = 0.05  # s before a recording in which the journals, which begin centred, find their bearings
FIT, JUDGED = 0.25, 0.1  # s of a recording that are fitted, and after them by which a fit is judged
ROUNDS = 8  # evaluations of a fit, each with its derivatives
_CLEARANCES = np.geomspace(2e-5, 1e-3, 32)  # m
_BEGINNINGS = 3  # of them, from which a fit begins
_LOST = 10.0  # standard deviations of a channel: what a run is off that broke down
_SMALL = 1e-4  # step of a derivative, over the scale of its parameter
_SPEEDS = (150.0 * np.pi / 30.0, 3000.0 * np.pi / 30.0)  # rad/s, where the crank's speed is looked for
_TURN = 0.05  # rad, scale of the crank's angle

Values = np.ndarray
"""Clearance [m]; speed [rad/s] and crank angle [rad] of each recording; then an effect's parameters."""


@dataclass(frozen=True)
class Track:
    """The beginning of a recording.

    Attributes:
        values: (samples, channels) recorded, accelerations alone.
        channels: their names.
        scale: (channels,) standard deviations.
        rate: [Hz].
        sampling: of a run that covers it.
        speed: of the crank, as if no joint were loose [rad/s].
        angle: likewise, at the first sample [rad].
    """

    values: np.ndarray
    channels: tuple[str, ...]
    scale: np.ndarray
    rate: float
    sampling: Sampling
    speed: float
    angle: float

    @property
    def fitted(self) -> int:
        """Samples by which a fit is made; the others judge it."""
        return round(FIT / (FIT + JUDGED) * len(self.values))


def track(recording: Recording, machine: SliderCrank, seconds: float) -> Track:
    """The first seconds of a recording, or all of it; aligned with the machine as the diagnosis does it."""
    chain = chain_of(recording, "recording")
    known = [c for c in ACCELERATIONS if c in recording.channels and np.ptp(recording.channel(c)) > 0.0]
    whole = [*known, *(["crank_angle"] if "crank_angle" in recording.channels else [])]
    signals = tuple(int(Signal[c.upper()]) for c in whole)
    speed, angle, _ = align(machine, recording.select(whole).values, signals, chain.rate, _SPEEDS)
    values = recording.select(known).values[: round(seconds * chain.rate)]
    sampling = Sampling(chain.base_rate, chain.filter(), LEAD, len(values) / chain.rate)
    return Track(values, tuple(known), values.std(axis=0), chain.rate, sampling, speed, angle)


@dataclass(frozen=True)
class Bench:
    """A machine, the joint whose clearance is sought, and the recordings.

    Attributes:
        machine: nominal.
        joint: B or C.
        tracks: beginnings of the recordings.
    """

    machine: SliderCrank
    joint: str
    tracks: Sequence[Track]

    @staticmethod
    def of(machine: SliderCrank, joint: str, recordings: Sequence[Recording], seconds: float) -> "Bench":
        """Recordings cut to their first seconds; a machine that turns from the outset."""
        tracks = [track(recording, machine, seconds) for recording in recordings]
        if isinstance(machine.drive, SpeedControl):
            machine = replace(machine, drive=replace(machine.drive, ramp=0.0))
        return Bench(machine, joint, tracks)

    def machine_with(self, values: Values, r: int, effect: Effect | None = None) -> SliderCrank:
        """The machine of one recording: with its speed, the clearance and an effect."""
        key = f"joint_{self.joint.lower()}"
        joint = replace(getattr(self.machine, key), clearance=float(values[0]))
        drive = self.machine.drive.at_speed(float(values[1 + 2 * r]) * 30.0 / np.pi)
        machine = replace(self.machine, drive=drive, **{key: joint})
        if effect is None or effect.kind == "instrument":
            return machine
        own = values[1 + 2 * len(self.tracks) :]
        named = {
            parameter.name: float(round(value) if parameter.whole else value)
            for parameter, value in zip(effect.free, own, strict=True)
        }
        return effect.machine(machine, self.joint, named)

    def run(self, candidates: Sequence[Values], effect: Effect | None = None) -> list[list[np.ndarray]]:
        """Signals (samples, SIGNALS) by candidate and recording; not a number where a run breaks down."""
        found = [[np.full((len(t.values), len(Signal)), np.nan) for t in self.tracks] for _ in candidates]
        for r, one in enumerate(self.tracks):
            made: dict[int, SliderCrank] = {}
            for i, values in enumerate(candidates):
                with suppress(InputError):
                    made[i] = self.machine_with(values, r, effect)
            states = [
                turning_state(machine, values[2 + 2 * r] - values[1 + 2 * r] * LEAD, values[1 + 2 * r])
                for machine, values in ((made[i], candidates[i]) for i in made)
            ]
            places = list(made)

            def keep(k: int, outcome: np.ndarray | Failure, r: int = r, places: list[int] = places) -> None:
                if not isinstance(outcome, Failure):
                    found[places[k]][r] = outcome.copy()

            if made:
                machines = list(made.values())
                run_batch(machines, Integrator(), one.sampling, keep, 1, np.array(states), any_laws=True)
        return found

    def misfit(self, signals: Sequence[np.ndarray], judged: bool = False) -> np.ndarray:
        """What is left of the recordings, over each channel's standard deviation, all in a row."""
        rows = []
        for one, simulated in zip(self.tracks, signals, strict=True):
            columns = [int(Signal[c.upper()]) for c in one.channels]
            part = slice(one.fitted, None) if judged else slice(0, one.fitted)
            left = (simulated[part, columns] - one.values[part]) / one.scale
            rows.append(
                np.nan_to_num(left, nan=_LOST, posinf=_LOST, neginf=-_LOST).clip(-_LOST, _LOST).ravel()
            )
        return np.concatenate(rows)

    def nominal(self) -> "Fit":
        """Clearance, speeds and angles that fit best, from several beginnings."""
        aligned = np.array([v for one in self.tracks for v in (one.speed, one.angle)])
        grid = [np.append(c, aligned) for c in _CLEARANCES]
        costs = [float((self.misfit(signals) ** 2).mean()) for signals in self.run(grid)]
        best = sorted(range(len(grid)), key=lambda i: costs[i])[:_BEGINNINGS]
        fits = [self.fit(grid[i]) for i in best]
        return min(fits, key=lambda fit: fit.cost)

    def fit(self, start: Values, effect: Effect | None = None) -> "Fit":
        """Least squares within bounds (SciPy's trust region), derivatives by differences."""
        free = list(effect.free) if effect else []
        low, high = self._limits([parameter.bounds for parameter in free])
        own = [abs(parameter.start) or 1.0 for parameter in free]
        scale = np.array([1e-4, *[1.0, _TURN] * len(self.tracks), *own])

        def left(values: Values) -> np.ndarray:
            return self.misfit(self.run([values], effect)[0])

        def slopes(values: Values) -> np.ndarray:
            steps = _SMALL * scale * np.where(values + _SMALL * scale > high, -1.0, 1.0)
            moved = [
                values,
                *(values + step * unit for step, unit in zip(steps, np.eye(len(values)), strict=True)),
            ]
            rows = [self.misfit(signals) for signals in self.run(moved, effect)]
            return np.stack(
                [(row - rows[0]) / step for row, step in zip(rows[1:], steps, strict=True)], axis=1
            )

        inside = np.clip(start, low + 1e-9 * scale, high - 1e-9 * scale)
        found = least_squares(left, inside, slopes, bounds=(low, high), x_scale=scale, max_nfev=ROUNDS)
        return Fit(found.x, float(found.cost), spread(found.jac, found.fun))

    def _limits(self, bounds: Sequence[Sequence[float]]) -> tuple[np.ndarray, np.ndarray]:
        low, high = [0.0], [2e-3]
        for one in self.tracks:
            low += [0.9 * one.speed, one.angle - 1.0]
            high += [1.1 * one.speed, one.angle + 1.0]
        return (
            np.array(low + [pair[0] for pair in bounds], dtype=float),
            np.array(high + [pair[1] for pair in bounds], dtype=float),
        )


@dataclass(frozen=True)
class Fit:
    """A fit.

    Attributes:
        values: see ``Values``.
        cost: half the sum of squares.
        spread: (values,) standard deviations by the textbook: independent residuals, a linear model.
    """

    values: Values
    cost: float
    spread: np.ndarray


def named(effect: Effect, fit: Fit, recordings: int) -> Mapping[str, tuple[float, float]]:
    """An effect's parameters: value and standard deviation."""
    first = 1 + 2 * recordings
    pairs = zip(fit.values[first:].tolist(), fit.spread[first:].tolist(), strict=True)
    return dict(zip(effect.parameters, pairs, strict=True))


def spread(jacobian: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(values,) standard deviations of a linear model whose residuals are independent and alike."""
    variance = (left**2).sum() / max(1, left.size - jacobian.shape[1])
    scale = np.sqrt((jacobian**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), hermitian=True)
    found: np.ndarray = np.sqrt(variance * np.maximum(np.diag(inverse), 0.0)) / scale
    return found
