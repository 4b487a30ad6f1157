"""From recordings to an explanation: nominal first, then one, two or three hypotheses beside it."""

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from clearance.diagnosis.acquire import ANNEALING
from clearance.diagnosis.alignment import align
from clearance.diagnosis.hypothesis import Hypothesis, Setting
from clearance.diagnosis.measured import Measured
from clearance.diagnosis.search import (
    EXPLAINED,
    FOLLOWED,
    Attempt,
    Beginning,
    Candidate,
    begin,
    refine,
    screen,
)
from clearance.diagnosis.start import distances
from clearance.errors import InputError

log = logging.getLogger(__name__)

CLEARANCES = tuple(np.geomspace(2e-5, 1.1e-3, 48))
"""Clearances [m] whose free runs are compared with a recording."""

_PROMISING = 10  # hypotheses that are stepped in with after screening
_FITTED = 3  # of them, that are fitted to all recordings
_ELSEWHERE = 45  # segments further, where a second beginning is looked for
_SHORT = 60  # segments that are followed to judge a hypothesis


@dataclass
class Explanation:
    """What was tried and what came of it.

    Attributes:
        nominal: the machine as it is, refitted.
        attempts: hypotheses that were fitted, best first.
        candidates: of the screening.
        best: the attempt that explains the recordings, or the best one.
    """

    nominal: Attempt
    attempts: list[Attempt] = field(default_factory=list)
    candidates: list[Candidate] = field(default_factory=list)

    @property
    def best(self) -> Attempt:
        """The attempt with the smallest penalised misfit, of those that may be asserted."""
        return min([self.nominal, *(a for a in self.attempts if not a.withdrawn)], key=penalised)


def penalised(attempt: Attempt) -> float:
    """Robust sum of squares at the smallest scale reached, with a price for each parameter (Schwarz 1978)."""
    samples = sum(p.samples for p in attempt.fit.passes)
    shared = attempt.model.shared
    return samples * attempt.misfit + shared * np.log(samples) * max(attempt.misfit, 1.0)


@dataclass(frozen=True)
class Alignment:
    """Speed [rad/s], angle at the first sample [rad], share of the variance explained."""

    speed: float
    angle: float
    explained: float


class Search:
    """The search for an explanation of several recordings of one machine."""

    def __init__(
        self,
        recordings: Sequence[Measured],
        setting: Setting,
        groups: dict[str, list[Hypothesis]],
        speed_range: tuple[float, float],
        workers: int,
        report: Callable[[str], None],
    ) -> None:
        self.recordings, self.setting, self.groups = list(recordings), setting, groups
        self.workers, self.report, self.started = workers, report, time.monotonic()
        machine = setting.with_clearance(3e-4)
        self.alignments = []
        for one in self.recordings:
            flat = one.values.reshape(-1, len(one.signals))
            found = Alignment(*align(machine, flat, one.signals, one.chain.rate, speed_range))
            report(f"{one.name}: {found.speed * 30 / np.pi:.1f} rpm")
            self.alignments.append(found)
        self.clearances = self._clearances(0)

    def _clearances(self, r: int) -> np.ndarray:
        """The clearances whose nominal free runs come nearest to recording ``r``."""
        one, found = self.recordings[r], self.alignments[r]
        window = range(3, min(93, len(one.values) - 12), 2)
        away = distances(
            one, [self.setting.with_clearance(c) for c in CLEARANCES], found.speed, found.angle, window,
            self.workers,
        )  # fmt: skip
        self.distances = away
        return np.array(CLEARANCES)[np.argsort(away)[:6]]

    def length(self, r: int) -> int:
        """Segments of a stretch of recording ``r``: a revolution and a third."""
        turn = 2.0 * np.pi / abs(self.alignments[r].speed) / self.recordings[r].segment
        return int(max(_SHORT, 1.35 * turn))

    def begin_all(self, hypotheses: Sequence[Hypothesis], rows: Sequence[np.ndarray]) -> list[Beginning]:
        """Step into every recording with a model, from candidate values."""
        model = self.setting.model(hypotheses)

        def one(r: int) -> Beginning:
            known = self.alignments[r]
            return begin(
                self.recordings[r], self.setting, model, rows, self.length(r), (0.0, 0.0),
                (known.speed, known.angle, known.explained),
            )  # fmt: skip

        with ThreadPoolExecutor(self.workers) as pool:
            return list(pool.map(one, range(len(self.recordings))))

    def attempt(
        self, hypotheses: Sequence[Hypothesis], rows: Sequence[np.ndarray], patient: bool = True
    ) -> Attempt:
        """Fit a model to all recordings."""
        beginnings = self.begin_all(hypotheses, rows)
        model = self.setting.model(hypotheses)
        values = np.array([b.values for b in beginnings])
        # what is shared: the values of the recording that is followed best
        leader = min(range(len(beginnings)), key=lambda r: beginnings[r].level * beginnings[r].scale ** 2)
        values[:, : model.shared] = values[leader, : model.shared]
        scale = max(b.scale for b in beginnings)
        return refine(
            hypotheses,
            model,
            [b.follower for b in beginnings],
            values,
            scale,
            8 if patient else 4,
            self.workers,
            patient,
        )

    def nominal(self) -> Explanation:
        """Refit the nominal machine."""
        found = self.attempt((), [np.array([c]) for c in self.clearances], patient=False)
        self.report(f"nominal: misfit {found.misfit:.3g}, clearance {found.fit.values[0, 0] * 1e3:.4f} mm")
        return Explanation(found)

    def widen(self, explanation: Explanation, base: Attempt | None = None) -> None:
        """Try every hypothesis beside those of ``base``, and fit the promising ones."""
        held = base.hypotheses if base is not None else ()
        groups = {
            label: group
            for label, group in self.groups.items()
            if all(group[0].name != h.name for h in held) and _single(group[0])
        }
        values = base.fit.values[0][:-1] if base is not None else self.clearances[:1]
        # the nominal machine's clearance may be far off where something is missing: look everywhere
        clearances = [float(c) for c in (*self.clearances[:3], *CLEARANCES[4::5])]
        if base is not None:
            clearances = [float(base.fit.values[0, 0] * factor) for factor in (0.94, 1.0, 1.06)]
        known = self.alignments[0]
        found = screen(
            self.recordings[0], self.setting, held, values, list(groups.values()), clearances, known.speed,
            known.angle, self.workers, self.report,
        )  # fmt: skip
        explanation.candidates = found if base is None else explanation.candidates
        reference = base if base is not None else explanation.nominal

        def quick(candidate: Candidate) -> tuple[float, Candidate, np.ndarray]:
            rows = [np.concatenate([v[:1], values[1:], v[1:]]) for v in (candidate.values, *candidate.rows)]
            model = self.setting.model([*held, candidate.hypothesis])
            best = (np.inf, candidate, rows[0])
            for first in (3, 3 + _ELSEWHERE):  # a beginning can fail by bad luck: try another
                try:
                    found = begin(
                        self.recordings[0], self.setting, model, rows, _SHORT, (0.0, 0.0),
                        (known.speed, known.angle, known.explained), refine=False, first=first,
                    )  # fmt: skip
                except InputError:
                    continue
                closer = refine(
                    [*held, candidate.hypothesis], model, [found.follower], found.values[None], found.scale,
                    6, patient=False,
                )  # fmt: skip
                misfit = closer.misfit
                if misfit < best[0]:
                    best = (misfit, candidate, closer.fit.values[0, :-1])
                if misfit < FOLLOWED:
                    break
            return best

        self.report(f"[{self.seconds:.0f} s] stepping in with the {_PROMISING} nearest hypotheses")
        with ThreadPoolExecutor(self.workers) as pool:
            tried = sorted(pool.map(quick, found[:_PROMISING]), key=lambda one: one[0])
        for misfit, candidate, _ in tried:
            self.report(f"[{self.seconds:.0f} s] {candidate.hypothesis.label}: {misfit:.3g} at first")
        for misfit, candidate, row in tried[:_FITTED]:
            hopeless = misfit > 0.3 * reference.misfit and misfit > tried[0][0]
            if hopeless or misfit > max(4.0 * tried[0][0], 3.0) or misfit > reference.misfit:
                continue
            try:
                attempt = self.attempt([*held, candidate.hypothesis], [row])
            except InputError as error:
                self.report(f"{candidate.hypothesis.label}: {error}")
                continue
            explanation.attempts.append(attempt)
            self.report(f"[{self.seconds:.0f} s] {attempt.label}: misfit {attempt.misfit:.3g}")

    def prune(self, explanation: Explanation) -> None:
        """Take effects away from the best attempt as long as it explains as much without them."""
        while len(explanation.best.hypotheses) > 1:
            best = explanation.best
            shorter = []
            for left_out in range(len(best.hypotheses)):
                held = [h for i, h in enumerate(best.hypotheses) if i != left_out]
                if any(h.structural(self.setting.with_clearance(3e-4)) for h in best.hypotheses):
                    continue
                model = self.setting.model(held)
                keep = [0]
                place = 1
                for i, hypothesis in enumerate(best.hypotheses):
                    count = len(hypothesis.unknowns)
                    keep += [] if i == left_out else range(place, place + count)
                    place += count
                values = best.fit.values[:, [*keep, place]]
                shorter.append(refine(held, model, best.followers, values, ANNEALING[2], 8, self.workers))
            explanation.attempts += shorter
            for one in shorter:
                self.report(f"[{self.seconds:.0f} s] {one.label}: misfit {one.misfit:.3g}")
            if explanation.best is best:
                break

    def enlarge(self, explanation: Explanation) -> None:
        """Try the variants of the best attempt's effects that have more parameters."""
        best = explanation.best
        for index, hypothesis in enumerate(best.hypotheses):
            for group in self.groups.values():
                larger = group[0]
                names = {u.name for u in hypothesis.unknowns}
                if larger.name != hypothesis.name or not names < {u.name for u in larger.unknowns}:
                    continue
                held = [*best.hypotheses[:index], larger, *best.hypotheses[index + 1 :]]
                offset = 1 + sum(len(h.unknowns) for h in best.hypotheses[:index])
                old = best.fit.values[:, offset : offset + len(hypothesis.unknowns)]
                own = {u.name: old[:, i] for i, u in enumerate(hypothesis.unknowns)}
                middle = np.stack(
                    [
                        own.get(u.name, np.full(len(old), _ready(larger, i)))
                        for i, u in enumerate(larger.unknowns)
                    ],
                    axis=1,
                )  # fmt: skip
                values = np.concatenate(
                    [best.fit.values[:, :offset], middle, best.fit.values[:, offset + old.shape[1] :]], axis=1
                )
                one = refine(
                    held, self.setting.model(held), best.followers, values, best.scale, 8, self.workers
                )
                explanation.attempts.append(one)
                self.report(f"[{self.seconds:.0f} s] {one.label}: misfit {one.misfit:.3g}")

    @property
    def seconds(self) -> float:
        """Since the start [s]."""
        return time.monotonic() - self.started


def _ready(hypothesis: Hypothesis, i: int) -> float:
    """Where a further parameter begins: off, or its plausible value where that is infinite or a shape."""
    effect = hypothesis.effect
    if (effect is not None and effect.free[i].shape) or not np.isfinite(hypothesis.off[i]):
        return float(hypothesis.start[i])
    return float(hypothesis.off[i])


def _single(hypothesis: Hypothesis) -> bool:
    """Whether it is the simplest variant: one size, beside shapes; a drive has two gains."""
    if hypothesis.effect is None:
        return False
    sizes = [p for p in hypothesis.effect.free if not p.shape]
    return len(sizes) == 1 or hypothesis.name == "soft_drive"


def explained(attempt: Attempt) -> bool:
    """Whether nothing is left to explain."""
    return attempt.scale <= 1.0 and attempt.level < EXPLAINED
