"""Search: step into every recording, fit hypotheses to what was followed, from coarse to fine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from clearance.diagnosis.acquire import ANNEALING, step_in
from clearance.diagnosis.alignment import align
from clearance.diagnosis.fit import Fit, Model, fit, islands, mend
from clearance.diagnosis.follow import Follower
from clearance.diagnosis.hypothesis import Hypothesis, Setting
from clearance.diagnosis.measured import Measured
from clearance.diagnosis.start import STRETCH, Match, distances, match
from clearance.errors import InputError
from clearance.simulation.integrator import Integrator

FOLLOWED = 2.5  # robust cost a sample: above, a model does not follow at this scale of the noise
EXPLAINED = 1.35  # and up to which nothing is left to explain
TIGHT = np.array([1e-3, 1e-3, 1e-2])  # N m, N m, N: unknown forces that a right model does not need
INTEGRATOR = Integrator("runge_kutta_4", 1e-5, 2)
_SEARCHED = 90  # segments over which the beginning is looked for


@dataclass
class Beginning:
    """A stretch of a recording that is followed.

    Attributes:
        follower: of the stretch alone.
        segment: where it begins in the recording.
        speed: mean crank speed [rad/s].
        angle: crank angle at the recording's first sample [rad].
        explained: share of the variance that the ideal mechanism explains.
        values: (unknowns,) of the model that was stepped in with.
        scale: of the noise at which it follows.
        level: robust cost a sample.
        distance: of the match.
    """

    follower: Follower
    segment: int
    speed: float
    angle: float
    explained: float
    values: np.ndarray
    scale: float
    level: float
    distance: float


def best_match(
    measured: Measured,
    machines: Sequence[tuple[np.ndarray, Callable[[], object]]],
    speed: float,
    angle: float,
    window: Sequence[int],
) -> tuple[Match, np.ndarray]:
    """The nearest stretch of free runs of several machines, and that machine's values."""
    found: list[tuple[Match, np.ndarray]] = []
    for values, make in machines:
        try:
            one = match(measured, make(), speed, angle, window)  # type: ignore[arg-type]
        except InputError:
            continue
        if np.isfinite(one.distance):
            found.append((one, values))
    if not found:
        raise InputError(f"{measured.name}: no simulation of this mechanism runs at its speed")
    return min(found, key=lambda pair: pair[0].distance)


def begin(
    measured: Measured,
    setting: Setting,
    model: Model,
    candidates: Sequence[np.ndarray],
    length: int,
    speed_range: tuple[float, float],
    known: tuple[float, float, float] | None = None,
    refine: bool = True,
    first: int = 3,
) -> Beginning:
    """Step into a recording.

    Args:
        measured: the recording.
        setting: the nominal machine.
        model: to follow with.
        candidates: values without the speed to try, the clearance first.
        length: segments to follow.
        speed_range: [rad/s].
        known: speed, angle and explained share, if they are.
        refine: whether clearances near the best one are tried too.
        first: segment from which on the beginning is looked for.
    """
    flat = measured.values.reshape(-1, len(measured.signals))
    speed, angle, explained = known or align(
        setting.with_clearance(3e-4), flat, measured.signals, measured.chain.rate, speed_range
    )
    rpm = speed * 30.0 / np.pi
    last = min(first + _SEARCHED, len(measured.values) - length - 4)
    if last <= first:
        needed = 3 * (length + 8) * measured.segment
        raise InputError(
            f"{measured.name}: {measured.seconds:.2f} s are too short to follow at {abs(rpm):.0f} rpm; give "
            f"{needed:.1f} s or more, of which a third is held out, or name held_out recordings"
        )

    def makers(rows: Sequence[np.ndarray]) -> list[tuple[np.ndarray, Callable[[], object]]]:
        return [(row, lambda row=row: model.machine(np.append(row, rpm))) for row in rows]  # type: ignore[misc]

    found, values = best_match(measured, makers(candidates), speed, angle, range(first, last, 2))
    if refine:
        near = [np.concatenate([[values[0] * f], values[1:]]) for f in (0.87, 0.93, 0.97, 1.03, 1.07, 1.15)]
        better, changed = best_match(measured, makers(near), speed, angle, range(first, last))
        if better.distance < found.distance:
            found, values = better, changed
    segment = found.segment
    follower = Follower(measured.part(segment, segment + length), INTEGRATOR, TIGHT.copy())
    local = replace(found, segment=0)
    try:
        fitted, scale, level = step_in(follower, model, np.append(values, rpm), local, length)
    except (InputError, np.linalg.LinAlgError) as error:
        raise InputError(f"{measured.name}: cannot be followed ({error})") from None
    return Beginning(
        follower, segment, speed, angle, explained, fitted, scale, level, found.distance
    )  # fmt: skip


@dataclass
class Attempt:
    """A model fitted to the stretches of all recordings.

    Attributes:
        hypotheses: beside the nominal machine.
        model: of them.
        fit: the last fit that followed.
        scale: of the noise at which it follows.
        level: robust cost a sample at that scale.
        followers: with the paths of the fit.
        withdrawn: whether it must not be asserted: one of its effects may as well be off.
    """

    hypotheses: tuple[Hypothesis, ...]
    model: Model
    fit: Fit
    scale: float
    level: float
    followers: list[Follower]
    withdrawn: bool = False

    @property
    def misfit(self) -> float:
        """Robust mean square of residuals in units of the noise: 1 for a perfect model."""
        return self.level * self.scale**2

    @property
    def label(self) -> str:
        """The hypotheses' labels."""
        return " + ".join(h.label for h in self.hypotheses) or "nominal"


def refine(
    hypotheses: Sequence[Hypothesis],
    model: Model,
    followers: Sequence[Follower],
    values: np.ndarray,
    scale: float,
    iterations: int = 6,
    workers: int = 1,
    patient: bool = True,
) -> Attempt:
    """Fit at a scale of the noise, then at smaller ones as long as the model follows.

    The followers are not changed; the attempt has its own. ``patient``: whether a scale at which the model
    does not follow is tried twice.
    """
    own = [f.part(0, f.segments) for f in followers]
    best: Attempt | None = None
    for s in [scale, *[a for a in ANNEALING if a < 0.9 * scale]]:
        paths = [f.path.copy() for f in own]
        found = fit(own, model, values, iterations, 1e-2, workers, scale=s)
        level = found.level
        if patient and best is not None and level > FOLLOWED:
            # a good model often needs a second look where noise weighs ten times more
            found = fit(own, model, found.values, iterations, 1e-2, workers, scale=s)
            level = found.level
        if best is not None and level > FOLLOWED:
            if level * s**2 < best.misfit:
                best = Attempt(tuple(hypotheses), model, found, s, level, own)
            else:
                for follower, path in zip(own, paths, strict=True):
                    follower.path = path
            break
        values = found.values
        best = Attempt(tuple(hypotheses), model, found, s, level, own)
    assert best is not None
    return polish(best, workers) if best.scale <= 1.0 and best.level > EXPLAINED else best


def polish(attempt: Attempt, workers: int = 1) -> Attempt:
    """Mend the stretches that a good model does not follow yet, and fit once more."""
    for _ in range(3):
        for r, (follower, one) in enumerate(zip(attempt.followers, attempt.fit.passes, strict=True)):
            torn = one.local > 2.0 * one.residual[0].size
            if torn.mean() < 0.3:
                machine = attempt.model.machine(attempt.fit.values[r])
                for first, last in islands(torn, 6):
                    mend(follower, machine, first, last)
        found = fit(attempt.followers, attempt.model, attempt.fit.values, 4, 1e-2, workers)
        level = found.level
        settled = level > 0.95 * attempt.level
        attempt.fit, attempt.level = found, level
        if settled or level < EXPLAINED:
            break
    return attempt


@dataclass(frozen=True)
class Candidate:
    """A hypothesis with values at which a free run comes near the recording.

    Attributes:
        hypothesis: with the shapes of one trial.
        values: (1 + unknowns,) the clearance, then its parameters.
        distance: of the free run.
        rows: values of the next nearest free runs.
    """

    hypothesis: Hypothesis
    values: np.ndarray
    distance: float
    rows: tuple[np.ndarray, ...] = ()


def screen(
    measured: Measured,
    setting: Setting,
    base: Sequence[Hypothesis],
    base_values: np.ndarray,
    groups: Sequence[Sequence[Hypothesis]],
    clearances: Sequence[float],
    speed: float,
    angle: float,
    workers: int,
    report: Callable[[str], None] | None = None,
) -> list[Candidate]:
    """Free runs of every hypothesis at several sizes and clearances: the nearest values of each.

    A global search that needs no path: two rounds, the second around the best of the first.

    Args:
        measured: the recording.
        setting: the nominal machine.
        base: hypotheses that are taken for granted.
        base_values: (1 + their unknowns,) with the clearance in front.
        groups: each hypothesis with its trials.
        clearances: to try [m].
        speed: [rad/s].
        angle: at the first sample [rad].
        workers: threads.
        report: called with what is being done.
    """
    window = range(3, min(3 + _SEARCHED, len(measured.values) - STRETCH - 4), 2)
    generator = np.random.default_rng(0)
    model = setting.model(base)

    def run(jobs: list[tuple[int, Hypothesis, np.ndarray]]) -> list[tuple[int, Candidate]]:
        machines, kept = [], []
        for g, hypothesis, values in jobs:
            try:
                start = np.concatenate([values[:1], base_values[1:], [0.0]])
                machines.append(hypothesis.apply(model.machine(start), values[1:]))
            except InputError:
                continue
            kept.append((g, hypothesis, values))
        found = distances(measured, machines, speed, angle, window, workers)
        return [(g, Candidate(h, v, float(d))) for (g, h, v), d in zip(kept, found, strict=True)]

    jobs: list[tuple[int, Hypothesis, np.ndarray]] = []
    for g, group in enumerate(groups):
        mine = [
            (g, hypothesis, np.concatenate([[c], values]))
            for hypothesis in group
            for values in _sizes(hypothesis)
            for c in clearances
        ]
        if len(mine) > _COARSE:
            mine = [mine[i] for i in generator.choice(len(mine), _COARSE, replace=False)]
        jobs += mine
    if report is not None:
        report(f"screening {len(groups)} hypotheses with {len(jobs)} simulations")
    found = run(jobs)
    best = _best(found, len(groups))
    for closeness in _CLOSER:
        ranked = sorted(best.items(), key=lambda item: item[1].distance)[:_REFINED]
        found += run(
            [
                (g, candidate.hypothesis, _near(candidate, closeness, generator))
                for g, candidate in ranked
                for _ in range(_FINE)
            ]
        )
        best = _best(found, len(groups))
    everything = sorted(found, key=lambda pair: pair[1].distance)
    best = _best(everything, len(groups))
    for g, candidate in best.items():
        alike = [c.values for k, c in everything if k == g and c.hypothesis is candidate.hypothesis]
        best[g] = replace(candidate, rows=tuple(alike[1:_ROWS]))
    return sorted(best.values(), key=lambda c: c.distance)


_ROWS = 5  # free runs of a hypothesis that may be stepped in with
_COARSE, _REFINED, _FINE = 64, 14, 24  # simulations a hypothesis; hypotheses looked at closer; and again
_CLOSER = (1.0, 0.5)  # rounds of looking closer: their spread


def _near(candidate: Candidate, closeness: float, generator: np.random.Generator) -> np.ndarray:
    """Values drawn around: 6 % in the clearance, half in sizes, a third of a trial in shapes."""
    hypothesis, values = candidate.hypothesis, candidate.values.copy()
    values[0] *= np.exp(generator.normal(0.0, 0.06 * closeness))
    shapes = _shapes(hypothesis)
    for i, unknown in enumerate(hypothesis.unknowns):
        off = hypothesis.off[i] if np.isfinite(hypothesis.off[i]) else 0.0
        if not shapes[i]:
            values[1 + i] = off + (values[1 + i] - off) * np.exp(generator.normal(0.0, 0.5 * closeness))
        elif hypothesis.effect is not None and not hypothesis.effect.free[i].whole:
            trials = hypothesis.effect.free[i].trials
            if len(trials) > 1:
                spacing = (max(trials) - min(trials)) / (len(trials) - 1)
                values[1 + i] += generator.normal(0.0, 0.35 * closeness * spacing)
        values[1 + i] = np.clip(values[1 + i], unknown.low, unknown.high)
    return values


def _best(found: Sequence[tuple[int, Candidate]], groups: int) -> dict[int, Candidate]:
    best: dict[int, Candidate] = {}
    for g, candidate in found:
        if np.isfinite(candidate.distance) and (g not in best or candidate.distance < best[g].distance):
            best[g] = candidate
    return best


def _sizes(hypothesis: Hypothesis) -> list[np.ndarray]:
    """Values to screen with: a third, one and three times the plausible size, either sign if allowed."""
    off, start = hypothesis.off, hypothesis.start
    low = np.array([u.low for u in hypothesis.unknowns])
    high = np.array([u.high for u in hypothesis.unknowns])
    rows = []
    for factor in (0.4, 1.0, 2.5, -0.4, -1.0, -2.5):
        finite = np.where(np.isfinite(off), off, 0.0)
        values = finite + (start - finite) * factor
        if not np.isfinite(off).all():
            values = start * abs(factor)
            if factor < 0.0:
                continue
        values = np.where(_shapes(hypothesis), start, values)
        if ((values >= low) & (values <= high)).all():
            rows.append(values)
    return rows


def _shapes(hypothesis: Hypothesis) -> np.ndarray:
    if hypothesis.effect is None:
        return np.zeros(len(hypothesis.unknowns), dtype=bool)
    return np.array([parameter.shape for parameter in hypothesis.effect.free])
