"""From recordings to an explanation: nominal first, then one, two or three hypotheses beside it."""

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from clearance.diagnosis.alignment import align
from clearance.diagnosis.hypothesis import Hypothesis, Setting
from clearance.diagnosis.measured import Measured
from clearance.diagnosis.search import EXPLAINED, Attempt, Beginning, Candidate, begin, refine, screen
from clearance.diagnosis.start import distances
from clearance.errors import InputError

log = logging.getLogger(__name__)

CLEARANCES = tuple(np.geomspace(2e-5, 1.1e-3, 48))
"""Clearances [m] whose free runs are compared with a recording."""

_PROMISING = 10  # hypotheses that are stepped in with after screening
_FITTED = 3  # of them, that are fitted to all recordings
_SHORT = 60  # segments that are followed to judge a hypothesis
_MOST = 3  # effects at once


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
        """The attempt with the smallest penalised misfit."""
        return min([self.nominal, *self.attempts], key=penalised)


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
        """Segments of a stretch: a revolution and a third, at most what there is."""
        one = self.recordings[r]
        turn = 2.0 * np.pi / abs(self.alignments[r].speed) / one.segment
        return int(min(max(60, 1.35 * turn), len(one.values) - 24))

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

    def attempt(self, hypotheses: Sequence[Hypothesis], rows: Sequence[np.ndarray]) -> Attempt:
        """Fit a model to all recordings."""
        beginnings = self.begin_all(hypotheses, rows)
        model = self.setting.model(hypotheses)
        values = np.array([b.values for b in beginnings])
        # what is shared: the values of the recording that is followed best
        leader = min(range(len(beginnings)), key=lambda r: beginnings[r].level * beginnings[r].scale ** 2)
        values[:, : model.shared] = values[leader, : model.shared]
        scale = max(b.scale for b in beginnings)
        return refine(hypotheses, model, [b.follower for b in beginnings], values, scale, 8, self.workers)

    def nominal(self) -> Explanation:
        """Refit the nominal machine."""
        found = self.attempt((), [np.array([c]) for c in self.clearances])
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
        clearances = base.fit.values[0, 0] * np.array([0.94, 1.0, 1.06]) if base is not None else self.clearances
        known = self.alignments[0]
        found = screen(
            self.recordings[0], self.setting, held, values, list(groups.values()), clearances, known.speed,
            known.angle, self.workers, self.report,
        )  # fmt: skip
        explanation.candidates = found if base is None else explanation.candidates
        reference = base if base is not None else explanation.nominal
        ceiling = max(1.0, reference.scale / 3.0)

        def quick(candidate: Candidate) -> tuple[float, Candidate, np.ndarray]:
            row = np.concatenate([candidate.values[:1], values[1:], candidate.values[1:]])
            model = self.setting.model([*held, candidate.hypothesis])
            try:
                found = begin(
                    self.recordings[0], self.setting, model, [row], _SHORT, (0.0, 0.0),
                    (known.speed, known.angle, known.explained), ceiling=ceiling,
                )  # fmt: skip
            except InputError:
                return np.inf, candidate, row
            return found.level * found.scale**2, candidate, found.values[:-1]

        self.report(f"[{self.seconds:.0f} s] stepping in with the {_PROMISING} nearest hypotheses")
        with ThreadPoolExecutor(self.workers) as pool:
            tried = sorted(pool.map(quick, found[:_PROMISING]), key=lambda one: one[0])
        for misfit, candidate, row in tried:
            self.report(f"[{self.seconds:.0f} s] {candidate.hypothesis.label}: {misfit:.3g} at first")
        for misfit, candidate, row in tried[:_FITTED]:
            if misfit > max(4.0 * tried[0][0], 3.0) or misfit > reference.misfit:
                continue
            try:
                attempt = self.attempt([*held, candidate.hypothesis], [row])
            except InputError as error:
                self.report(f"{candidate.hypothesis.label}: {error}")
                continue
            explanation.attempts.append(attempt)
            self.report(f"[{self.seconds:.0f} s] {attempt.label}: misfit {attempt.misfit:.3g}")

    @property
    def seconds(self) -> float:
        """Since the start [s]."""
        return time.monotonic() - self.started


def _single(hypothesis: Hypothesis) -> bool:
    """Whether it is the simplest variant: one size, beside shapes; a drive has two gains."""
    if hypothesis.effect is None:
        return False
    sizes = [p for p in hypothesis.effect.free if not p.shape]
    return len(sizes) == 1 or hypothesis.name == "soft_drive"


def explained(attempt: Attempt) -> bool:
    """Whether nothing is left to explain."""
    return attempt.scale <= 1.0 and attempt.level < EXPLAINED
