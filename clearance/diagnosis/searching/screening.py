"""Which hypotheses point where the misfit points: one linear look at all of them.

While unknown forces keep the simulator on the recording, the path is right whatever the model lacks, and
what it lacks is spread over those forces and the residuals. A hypothesis that explains them lowers the cost
by what one Gauss-Newton step in its parameters promises. The states are eliminated once for all together
(score tests; Rao 1948, Math. Proc. Camb. Phil. Soc. 44(1), 50-57), so hundreds cost little more than one, and
two at a time are a matter of small matrices.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.hypotheses.free_form import Curve
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.hypotheses.missing_force import (
    constant,
    curves,
    directions,
    observe_forces,
    patterns,
    proportional,
)
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.shooting.calibration import calibration_of
from clearance.diagnosis.shooting.expectation import expected
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.stretch import Pass
from clearance.diagnosis.side_by_side import side_by_side
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank

_LOUD = 0.9  # quantile of the blocks' scores above which they count as much as at it
_PUSH, _ARM = 1e-3, 0.05  # of the joint's force, by which a direction is tried; m, its arm in a torque
_SMALL = 1e-4  # of its plausible size, by which an effect is tried
_FAR = 4.0  # times its plausible value: where one that vanishes at infinity is tried
_NOT_LINEAR = (
    "sensor_saturation",
    "sensor_resonance",
)  # clipping has no derivative; undoing a resonance removes noise
_BLOCK = 5  # segments whose scores count as one
_BESIDE = 12  # hypotheses whose pairs are looked at
_LARGEST = 3.0  # of the plausible size, to begin a fit with at most


ONSET = 0.01
"""Of what a linear look promises, to begin with: an effect changes the path that was looked at."""


@dataclass(frozen=True)
class Hint:
    """One or two hypotheses that promise to explain something.

    Attributes:
        hypotheses: to add.
        values: of their parameters to begin with.
        gain: by which the robust sum of squares would fall, in units of the noise.
        deviation: standard error of the size of a single one, if the rest of the model is right.
    """

    hypotheses: tuple[Hypothesis, ...]
    values: np.ndarray
    gain: float
    deviation: float = np.inf

    @property
    def label(self) -> str:
        """The hypotheses' labels."""
        return " + ".join(h.label for h in self.hypotheses)


@dataclass(frozen=True)
class _Column:
    """A hypothesis at a small size: what its derivative is taken from."""

    hypothesis: Hypothesis
    size: int
    step: float
    machine: SliderCrank | None
    instrument: Instrument | None


def _columns(
    groups: Sequence[Sequence[Hypothesis]], machine: SliderCrank, instrument: Instrument
) -> list[_Column]:
    """One column for each trial of another shape, of those with one size that add no coordinates."""
    columns = []
    for hypothesis in (h for group in groups for h in group if h is group[0] or h.shapes.any()):
        sizes = np.flatnonzero(~hypothesis.shapes)
        if len(sizes) != 1 or hypothesis.name in _NOT_LINEAR:
            continue
        size = int(sizes[0])
        values = hypothesis.start.copy()
        if np.isfinite(hypothesis.off[size]):
            step = _SMALL * (hypothesis.start[size] - hypothesis.off[size])
            values[size] = hypothesis.off[size] + step
        else:
            step = values[size] = _FAR * hypothesis.start[size]
        try:
            if hypothesis.fault is not None:
                changed = hypothesis.apply(machine, values)
                columns.append(
                    _Column(
                        hypothesis, size, step, None if changed is machine else changed,
                        hypothesis.fault(instrument, values),
                    )
                )  # fmt: skip
            elif not hypothesis.structural(machine):
                columns.append(_Column(hypothesis, size, step, hypothesis.apply(machine, values), None))
        except InputError:
            continue
    return columns


def screen(attempt: Attempt, groups: Sequence[Sequence[Hypothesis]], workers: int) -> "Screening":
    """Look at all hypotheses, alone and in pairs, beside a fitted model.

    Args:
        attempt: with its paths; its parameters and the speeds are free all the while.
        groups: hypotheses with their trials.
        workers: threads.
    """
    plain, calibration = attempt.model, calibration_of(attempt.followers, attempt.model)
    model, rows, sensors = plain, attempt.fit.values, attempt.sensors
    if calibration is not None:  # what sensors may do is free as well
        model, rows = calibration.model, calibration.beside(rows, sensors)
    count = len(model.unknowns)

    def look(r: int) -> tuple[list[_Column], np.ndarray, np.ndarray]:
        values, follower = rows[r], attempt.followers[r]
        if calibration is not None:
            follower = follower.part(0, follower.segments)
            follower.measured = follower.measured.as_recorded()
        machine, instrument = model.machine(values), model.instrument(values)
        columns = _columns(groups, machine, plain.instrument(attempt.fit.values[r]))
        machines, faults = model.columns(values)
        seen = [c.instrument if c.instrument is None else sensors.beside(c.instrument) for c in columns]
        one = follower.look(
            machine, [*machines, *(c.machine for c in columns)], instrument, [*faults, *seen],
            scale=attempt.scale,
        ).solve()  # fmt: skip
        # each recording's own unknowns, the last of the model's, are eliminated here
        shared, total = model.shared, count + len(columns)
        keep = [*range(shared), *range(count, total), len(one.gram) - 1]
        own = list(range(shared, count))
        whole = np.nan_to_num(one.gram, nan=0.0, posinf=0.0, neginf=0.0)
        lift = np.linalg.lstsq(whole[np.ix_(own, own)], whole[np.ix_(own, keep)], rcond=None)[0]
        gram = whole[np.ix_(keep, keep)] - whole[np.ix_(keep, own)] @ lift
        scores = np.nan_to_num(one.parts, nan=0.0, posinf=0.0, neginf=0.0)
        parts = scores[:, keep[:-1]] - scores[:, own] @ lift[:, :-1]
        return columns, gram, parts

    segments = [follower.segments for follower in attempt.followers]
    looks = side_by_side(look, range(len(segments)), workers, segments)
    gram = np.sum([gram for _, gram, _ in looks], axis=0) * attempt.scale**2
    parts = np.concatenate([_blocks(parts) for _, _, parts in looks]) * attempt.scale**2
    pull = np.zeros(model.shared)
    if calibration is not None:
        known, pull = expected(model, rows)
        gram[range(model.shared), range(model.shared)] += known
    return Screening(*_rank(looks[0][0], gram, parts, pull))


def shapes(
    attempt: Attempt, joint: str, force: float, workers: int, step: Sequence[np.ndarray] | None = None
) -> list[Curve]:
    """Forces of free form that explain the unknown forces of an attempt, most promising first.

    Args:
        attempt: with unknown forces, or one that follows without them.
        joint: the diagnosed one.
        force: typical in that joint [N].
        workers: threads.
        step: (inputs,) standard deviations for each recording of the unknown forces that one linear step
            would add to the attempt's path [N m, N m, N]; ``None``: it has its own.
    """
    places = directions(joint)
    sizes = _PUSH * np.array([_ARM if d in ("torque", "moment") else 1.0 for _, d in places])

    def look(r: int) -> tuple[Follower, Pass, np.ndarray]:
        values, follower = attempt.fit.values[r], attempt.followers[r]
        machine = attempt.model.machine(values)
        if step is not None:
            follower = follower.part(0, follower.segments)
            follower.input_sigma = step[r]
        pushes = [constant(machine, *place, force * size) for place, size in zip(places, sizes, strict=True)]
        pushes += [
            proportional(machine, *place, joint, size) for place, size in zip(places, sizes, strict=True)
        ]
        one = follower.look(machine, pushes, attempt.model.instrument(values), scale=attempt.scale)
        inputs = follower.path.inputs
        if step is not None:
            change = one.solve(judged=False).change(np.zeros(len(pushes)))
            inputs = change[:, -len(step[r]) :] * step[r]
        return follower, one, inputs

    looks = side_by_side(look, range(len(attempt.followers)), workers)
    followers, passes, inputs = zip(*looks, strict=True)
    seen = observe_forces(
        passes, inputs, attempt.model.machine(attempt.fit.values[0]), joint, [f.measured for f in followers]
    )  # fmt: skip
    pattern = patterns(passes, [f.input_sigma for f in followers], slice(0, None), seen.scatter)
    return curves(seen, pattern, joint, np.append(force * sizes, sizes))


@dataclass(frozen=True)
class Screening:
    """What one look at all hypotheses suggests, each most promising first.

    Attributes:
        singles: by what one step of Gauss-Newton promises, one trial of each label.
        pairs: the same for two at once.
    """

    singles: list[Hint]
    pairs: list[Hint]


def _begun(column: _Column, change: float) -> np.ndarray:
    """The trial's values with its size changed from off by so many steps of the column."""
    start = column.hypothesis.start.copy()
    if np.isfinite(column.hypothesis.off[column.size]):
        start[column.size] = column.hypothesis.off[column.size] + change * column.step
    return start


def _blocks(parts: np.ndarray) -> np.ndarray:
    whole = len(parts) // _BLOCK
    return parts[: whole * _BLOCK].reshape(whole, _BLOCK, -1).sum(axis=1)


def _range(column: _Column) -> tuple[float, float]:
    """Changes that the linearisation may be trusted with, in steps of the column."""
    hypothesis, size = column.hypothesis, column.size
    off, unknown = hypothesis.off[size], hypothesis.unknowns[size]
    if not np.isfinite(off):  # it vanishes at infinity; its square counts
        return 0.0, _FAR**2
    reach = _LARGEST * abs(hypothesis.start[size] - off)
    # what counts by ratios goes as far down as up: from near nothing no way may lead back
    down = off - off**2 / (off + reach) if unknown.log else reach
    ends = (max(unknown.low - off, -down) / column.step, min(unknown.high - off, reach) / column.step)
    return min(ends), max(ends)


def _rank(
    columns: Sequence[_Column], gram: np.ndarray, parts: np.ndarray, pull: np.ndarray
) -> tuple[list[Hint], list[Hint]]:
    """Gains of single columns and pairs, with the first unknowns free: ``pull``, what is known of these."""
    if not columns:
        return [], []
    held = len(pull)
    base, rest = list(range(held)), list(range(held, len(gram) - 1))
    unit = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram * np.outer(unit, unit)
    lift = np.linalg.lstsq(scaled[np.ix_(base, base)], scaled[base], rcond=1e-10)[0]
    left = scaled - scaled[:, base] @ lift
    scores = parts * unit[:-1]
    scores = scores[:, rest] - scores[:, base] @ lift[:, rest]
    matrix = left[np.ix_(rest, rest)]
    # a few blocks where an impact was put together wrongly must not speak louder than all others
    limit = np.quantile(np.abs(scores), _LOUD, axis=0)
    vector = np.clip(scores, -limit, limit).sum(axis=0) - (pull * unit[:held]) @ lift[:, rest]
    alone = np.diag(matrix)
    clear = alone > 1e-8
    safe = np.where(clear, alone, 1.0)
    low, high = np.array([_range(column) for column in columns]).T / unit[rest]
    changes = np.where(clear, np.clip(vector / safe, low, high), 0.0)
    gains = np.where(clear, (2.0 * vector - alone * changes) * changes, 0.0)

    def values(i: int, change: float) -> np.ndarray:
        return _begun(columns[i], change * unit[rest[i]])

    order: dict[str, int] = {}
    for i in np.argsort(-gains):
        order.setdefault(columns[i].hypothesis.label, int(i))
    step = np.array([column.step for column in columns]) * unit[rest]
    deviations = np.where(clear, np.abs(step) / np.sqrt(safe), np.inf)
    singles = [
        Hint((columns[i].hypothesis,), values(i, changes[i]), float(gains[i]), float(deviations[i]))
        for i in order.values()
    ]
    # pairs: every promising one with the column that gains most beside it
    pairs: dict[tuple[str, ...], Hint] = {}
    for i in list(order.values())[:_BESIDE]:
        beside = matrix[i] / safe[i]
        freed = alone - matrix[i] * beside
        rhs = vector - vector[i] * beside
        usable = clear & (freed > 1e-6 * safe)
        seconds = np.where(usable, np.clip(rhs / np.where(usable, freed, 1.0), low, high), 0.0)
        extra = np.where(usable, (2.0 * rhs - freed * seconds) * seconds, 0.0)
        for j in np.argsort(-extra)[:_BESIDE]:
            one, two = columns[i].hypothesis, columns[j].hypothesis
            if (one.name == two.name and one.channel == two.channel) or not usable[j]:
                continue
            key = tuple(sorted((one.label, two.label)))
            gain = float(gains[i] + extra[j])
            if key in pairs and pairs[key].gain >= gain:
                continue
            second = float(seconds[j])
            first = float(np.clip(changes[i] - beside[j] * second, low[i], high[i]))
            pairs[key] = Hint((one, two), np.concatenate([values(i, first), values(int(j), second)]), gain)
    return singles, sorted(pairs.values(), key=lambda hint: -hint.gain)
