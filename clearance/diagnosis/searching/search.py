"""Fits to several recordings: the nominal machine first, then hypotheses beside it, each made once."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from clearance.diagnosis.following.attempt import (
    ANNEALING,
    FOLLOWED,
    LOOSENESS,
    POOR,
    Attempt,
    explained,
    loosen,
    refine,
    whole,
)
from clearance.diagnosis.following.finished import Finished, kept_in
from clearance.diagnosis.following.growth import ISLANDS, Start, scale_of
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting, same
from clearance.diagnosis.kinematics.agreement import Alignment, profile
from clearance.diagnosis.kinematics.rhythm import Rhythm
from clearance.diagnosis.searching.beside import BETTER, HALFWAY, NEARLY, beside
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.one_by_one import follow_all
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import NO_FAULT, Measured
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.side_by_side import side_by_side
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank

PATIENCE = 40  # times that a path is looked for in vain at the beginning
_ISLANDS = 3  # of a recording from which it is looked for
_LOOKS = 2  # times that recordings are followed anew with better values
_LEFT = 0.3  # of what is missing beside a near path: what is right leaves less, but for torn impacts
_AS_GOOD = 1.05  # times the best misfit: what explains and leaves no more has ended in its minimum
_WORSE = 2.0  # of the best misfit so far: a model is given up that follows worse than that


class Search:
    """The search for an explanation of several recordings of one machine."""

    def __init__(
        self,
        recordings: Sequence[Measured],
        alignments: Sequence[Alignment],
        setting: Setting,
        groups: dict[str, list[Hypothesis]],
        workers: int,
        report: Callable[[str], None],
        deadline: float = np.inf,
        finished: Path | None = None,
    ) -> None:
        self.recordings, self.alignments, self.setting = list(recordings), list(alignments), setting
        self.groups, self.workers, self.report = groups, workers, report
        self.clearance, self.traces, self.starts = np.nan, list[Trace](), list[Start]()
        self.deadline, self.stopped = deadline, ""
        self.most: float = np.inf  # effects that may be missing together
        self.speed_range = (0.0, np.inf)  # [rad/s] in which other recordings are
        self.patient_until = np.inf  # of ``time.monotonic``: when lost paths are not looked for any more
        folder = kept_in(finished, self.recordings, self.alignments, setting, groups)
        self.finished = Finished(folder, self.recordings, report)

    def late(self) -> bool:
        """Whether nothing new is to be tried; ``stopped`` says why."""
        if not self.stopped and time.monotonic() > self.deadline:
            self.stopped = "four fifths of time_limit were over (time_limit=null sets none)"
            self.finished.stop()
        return bool(self.stopped)

    def hear(self, recordings: Sequence[Measured]) -> None:
        """Go on with these recordings; fits of an earlier run are recalled for them too."""
        self.recordings = self.finished.recordings = list(recordings)

    def trace(self) -> None:
        """Find the clearance at which the motion agrees best, and the path of every recording."""
        self.profile = self.finished.profile(
            lambda: profile(self.recordings, self.alignments, self.setting.with_clearance, self.workers)
        )
        self.retrace_all(self.profile.best)
        joint, shown = self.setting.joint, f"{self.clearance * 1e3:.3f} mm"
        self.report(f"the motion alone suggests a clearance of {shown} in joint {joint}")

    def begin(
        self,
        traces: Sequence[Trace],
        model: Model,
        values: np.ndarray,
        patience: int = 0,
        before: Sequence[Start] = (),
        islands: int = ISLANDS,
    ) -> list[Start]:
        """Where each recording can be followed from by a machine with these values.

        Args:
            traces: of the recordings.
            model: of the machine.
            values: (recordings, unknowns).
            patience: as of ``Start.of``.
            before: starts that are kept where a recording is followed from them.
            islands: as of ``Start.of``.
        """

        def one(r: int) -> Start:
            if before and before[r].doubt < FOLLOWED:
                return before[r]
            return Start.of(traces[r], model.held(values[r]), LOOSENESS, patience, islands)

        return side_by_side(one, range(len(traces)), self.workers, [trace.length for trace in traces])

    def grown(
        self,
        hypotheses: Sequence[Hypothesis],
        values: np.ndarray,
        starts: Sequence[Start] | None = None,
        limit: float = np.inf,
        model: Model | None = None,
        base: Attempt | None = None,
        insist: int = 0,
    ) -> Attempt | None:
        """Follow all recordings step by step with a model, and fit it to all of them.

        Args:
            hypotheses: beside the nominal machine.
            values: (recordings, unknowns) to begin with.
            starts: where the recordings are followed from; as the nominal machine is if ``None``.
            limit: misfit above which a model is given up on the way.
            model: of the hypotheses; with its usual unknowns if ``None``.
            base: an attempt that the first recording must be followed clearly better with than it is.
            insist: times that each recording may be the first one, each time with a little more clearance:
                values that are nearly right may be lost at one of its impacts and not at another's.
        """
        model = self.setting.model(hypotheses) if model is None else model
        starts = self.starts if starts is None else starts

        def seek(r: int, row: np.ndarray) -> Iterator[Start]:
            try:
                if not self.late():
                    yield self.sought(r, model, row, PATIENCE)
                if not self.late():
                    trace = self.retrace(r, model.machine(row), model.instrument(row))
                    held = model.held(np.append(row[:-1], trace.speed))
                    yield from Start.several(trace, held, LOOSENESS, _ISLANDS)
            except (InputError, np.linalg.LinAlgError):  # no motion is near with such values
                return

        grown = follow_all(starts, model, values, seek, self.workers, limit, base, insist)
        if grown is None:
            return None
        followers, rows, misfit = grown
        return refine(hypotheses, model, followers, rows, scale_of(misfit), 8, self.workers)

    def sought(self, r: int, model: Model, row: np.ndarray, patience: int = 0) -> Start:
        """Where a recording can be followed from, at its own speed, by a machine of others' values."""
        trace = self.retrace(r, model.machine(row), model.instrument(row))
        return Start.of(trace, model.held(np.append(row[:-1], trace.speed)), LOOSENESS, patience)

    def loosened(self, attempt: Attempt) -> Attempt:
        """The nominal machine on an attempt's paths with unknown forces: what it lacks shows in them."""
        forces = [trace.forces(LOOSENESS) for trace in self.traces]
        values = attempt.fit.values[:, [0, -1]]
        # where the nominal machine follows, forces are small: nothing has to be smoothed first
        small = explained(attempt) and not attempt.hypotheses
        scales = ANNEALING[3:] if small else ANNEALING[2:4]
        return loosen(self.setting.model(), values, attempt.followers, forces, scales, self.workers)

    def others(self, base: Attempt) -> list[list[Hypothesis]]:
        """Hypotheses about other things than those of an attempt."""
        return [g for g in self.groups.values() if all(not same(g[0], h) for h in base.hypotheses)]

    def follow(self, explanation: Explanation, base: Attempt, hint: Hint) -> None:
        """Fit what a hint suggests beside the hypotheses of ``base``."""
        held, values = beside(base, hint.hypotheses, hint.values)
        limit = max(min(base.misfit, _WORSE * explanation.best.misfit), POOR)
        self.keep(explanation, held, lambda: self.tighten(held, base, values, limit))

    def tighten(
        self, held: Sequence[Hypothesis], base: Attempt, values: np.ndarray, limit: float
    ) -> Attempt | None:
        """Fit hypotheses on the path of ``base`` where that is near, and step by step where it is not."""
        if base.scale > ANNEALING[3]:
            return self.follow_anew(held, base, values, limit)
        found = refine(held, self.setting.model(held), base.followers, values, ANNEALING[3], 8, self.workers)
        if explained(found) or 1.0 + _LEFT * (base.misfit - 1.0) <= found.misfit <= base.misfit:
            return found
        # more unknowns leave no more at their minimum: a fit that does has torn the path of ``base``
        begun = values if found.misfit > base.misfit else found.fit.values
        return self.follow_anew(held, base, begun, limit, found)

    def follow_anew(
        self,
        held: Sequence[Hypothesis],
        base: Attempt,
        values: np.ndarray,
        limit: float,
        found: Attempt | None = None,
    ) -> Attempt | None:
        """Fit hypotheses step by step, unless that is no better than what was found beside the path."""
        starts, heard = self.starts, any(h.fault is not None for h in held)
        for look in range(_LOOKS):  # torn impacts are met better with the right values
            other = self.grown(held, values, starts, limit, base=base)
            if other is None and found is None:  # what is missing may have led the clearance astray
                values = values.copy()
                values[:, 0] = self.clearance
                continue
            better = found is None or (other is not None and other.misfit < found.misfit)
            found = other if better else found
            near = max(NEARLY, HALFWAY * base.misfit) if heard else NEARLY
            if found is None or whole(found) or found.misfit > near or not better or look == _LOOKS - 1:
                break
            values = found.fit.values
            if found.misfit > NEARLY:  # on a path of its own, its sensors' faults undone
                starts = self.anew(found)
        return found

    def follow_best(self, explanation: Explanation, base: Attempt, tried: Sequence[Hint]) -> None:
        """Follow with the best of what was tried beside the near path of ``base``: impacts may be torn."""
        labels = [" + ".join(h.label for h in (*base.hypotheses, *hint.hypotheses)) for hint in tried]
        fitted = [a for a in explanation.attempts if a.label in labels]
        best = min(fitted, key=explanation.price, default=None)
        if base.scale > ANNEALING[3] or best is None or not best.misfit < BETTER * base.misfit:
            return
        limit = max(base.misfit, POOR)
        self.keep(
            explanation, best.hypotheses,
            lambda: self.follow_anew(best.hypotheses, base, best.fit.values, limit, best),
        )  # fmt: skip

    def anew(self, attempt: Attempt) -> list[Start]:
        """Where the recordings can be followed from with an attempt's machine and instruments."""
        model = attempt.model
        traces = [
            self.retrace(r, model.machine(row), model.instrument(row))
            for r, row in enumerate(attempt.fit.values)
        ]
        return self.begin(traces, model, attempt.fit.values)

    def keep(
        self,
        explanation: Explanation,
        held: Sequence[Hypothesis],
        make: Callable[[], Attempt | None],
        again: bool = False,
    ) -> Attempt | None:
        """Add an attempt to those that were made, unless it fails, has too many effects or was made before.

        ``again``: though one with the same hypotheses explains, and not clearly worse than the best one does.
        """
        if len(held) > self.most:
            return None
        label, level = " + ".join(h.label for h in held), _AS_GOOD * explanation.best.misfit
        made = [a for a in explanation.attempts if a.label == label and explained(a)]
        if not again and any(a.misfit < level for a in made):
            return None
        try:
            found = self.finished.attempt(held, self.setting.model(held), make, self.workers)
        except (InputError, np.linalg.LinAlgError) as error:
            self.report(f"{label}: {error}")
            return None
        if found is None or not np.isfinite(found.fit.information).all():
            self.report(f"{label}: follows no better")
            return None
        explanation.attempts.append(found)
        shown = ", ".join(f"{v:.5g}" for v in found.fit.values[0, 1 : found.model.shared])
        self.report(f"{found.label}: misfit {found.misfit:.3g} at {shown}")
        return found

    def refit(
        self,
        explanation: Explanation,
        held: Sequence[Hypothesis],
        followers: Sequence[Follower],
        values: np.ndarray,
        scale: float,
        iterations: int = 8,
        again: bool = False,
    ) -> Attempt | None:
        """Fit hypotheses on paths that are nearly right, from a scale of the noise on; keep the attempt."""
        model = self.setting.model(held)
        return self.keep(
            explanation, held,
            lambda: refine(held, model, followers, values, scale, iterations, self.workers), again,
        )  # fmt: skip

    @contextmanager
    def timed(self, rhythm: Rhythm | None) -> Iterator[None]:
        """Within it paths are sought by a clock that recordings share, for a period at least."""
        before = self.recordings
        if rhythm is not None:
            self.recordings = [
                replace(one, clock=clock, period=rhythm.period)
                for one, clock in zip(before, rhythm.clocks, strict=True)
            ]
        try:
            yield
        finally:
            self.recordings = before

    @contextmanager
    def hearing(self, recordings: Sequence[Measured]) -> Iterator[None]:
        """Within it the recordings are others: without some channel, or with its fault undone."""
        before = self.recordings
        self.recordings = list(recordings)
        try:
            yield
        finally:
            self.recordings = before

    def retrace_all(self, clearance: float) -> None:
        """Go on with a clearance [m]: the paths of all recordings."""
        self.clearance = clearance
        machine = self.setting.with_clearance(clearance)

        def make(r: int) -> Trace:
            return self.retrace(r, machine)

        self.traces = self.finished.traces(
            self.alignments, lambda: side_by_side(make, range(len(self.recordings)), self.workers)
        )

    def retrace(self, r: int, machine: SliderCrank, instrument: Instrument = NO_FAULT) -> Trace:
        """The path of a recording for another machine, or with faults of its sensors undone."""
        return Trace.of(self.recordings[r], self.alignments[r], machine, instrument)
