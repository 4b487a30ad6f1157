"""From recordings to an explanation: nominal first, then one, two or three hypotheses beside it."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from clearance.diagnosis.hypothesis import Hypothesis, Setting
from clearance.diagnosis.instrument import Instrument
from clearance.diagnosis.measured import NO_FAULT, Measured
from clearance.diagnosis.missing_force import free_form
from clearance.diagnosis.screening import Hint, Screening, screen
from clearance.diagnosis.search import ANNEALING, EXPLAINED, FOLLOWED, Attempt, refine, release
from clearance.diagnosis.suspicion import suspect
from clearance.diagnosis.trace import Trace, aligned, profile
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank

LOOSENESS = 0.15  # of the joint's typical force: unknown forces while hypotheses are looked for
_FITTED = 4  # hypotheses of one screening that are fitted
_HOPEFUL = 0.1  # of the best one's gain: less is not fitted
_DEAF = 2  # channels without which a fit is tried
_SUSPECTED = 3  # faults of a channel that are fitted
_TRIALS = 3  # plausible shapes of an effect that are tried where no linear look can judge it
_STUCK = 100.0  # misfit with unknown forces from which on not even they follow
_DRIVEN = 30.0  # times as loose is the unknown torque then
_AGAIN, _NEARLY = 3, 0.3  # times that a fit is repeated whose misfit fell to this share
_FAR_BETTER = 0.05  # of the nominal misfit: such an effect is right, or nearly
_PAIRS = 3  # pairs that are fitted
_CURVES = 3  # forces of free form that are fitted
_ELSEWHERE = (
    "soft_drive", "second_clearance", "joint_lubrication", "worn_bearing", "restitution", "contact_stiffness",
    "rod_flexibility", "flexible_base", "guide_clearance",
)  # fmt: skip
"""Effects that no linear look beside a nominal path can judge, cheap and frequent ones first."""


@dataclass
class Explanation:
    """What was tried and what came of it.

    Attributes:
        nominal: the machine as it is, refitted.
        attempts: hypotheses that were fitted, best first.
        hints: of the first screening.
    """

    nominal: Attempt
    attempts: list[Attempt] = field(default_factory=list)
    hints: list[Hint] = field(default_factory=list)

    @property
    def best(self) -> Attempt:
        """The attempt with the smallest penalised misfit, of those that may be asserted."""
        return min([self.nominal, *(a for a in self.attempts if not a.withdrawn)], key=penalised)


def penalised(attempt: Attempt) -> float:
    """Robust sum of squares at the smallest scale reached, with a price for each parameter (Schwarz 1978)."""
    samples = sum(p.samples for p in attempt.fit.passes)
    shared = attempt.model.shared
    return samples * attempt.misfit + shared * np.log(samples) * max(attempt.misfit, 1.0)


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
        self.workers, self.say, self.started = workers, report, time.monotonic()
        self.alignments = [aligned(one, setting.with_clearance(3e-4), speed_range) for one in self.recordings]
        for one, found in zip(self.recordings, self.alignments, strict=True):
            self.report(f"{one.name}: {found.speed * 30 / np.pi:.1f} rpm")

    def trace(self) -> None:
        """Find the clearance at which the motion agrees best, and the path of every recording."""
        self.profile = profile(self.recordings, self.alignments, self.setting.with_clearance, self.workers)
        self.clearance = self.profile.best
        machine = self.setting.with_clearance(self.clearance)
        self.traces = [
            Trace.of(one, known, machine) for one, known in zip(self.recordings, self.alignments, strict=True)
        ]
        self.report(f"the motion alone suggests a clearance of {self.clearance * 1e3:.3f} mm")

    @property
    def seconds(self) -> float:
        """Since the start [s]."""
        return time.monotonic() - self.started

    def report(self, message: str) -> None:
        """Say what is being done, and when."""
        self.say(f"[{self.seconds:.0f} s] {message}")

    def nominal(self) -> Explanation:
        """Refit the nominal machine."""
        model = self.setting.model()
        values = np.array([[self.clearance, trace.speed] for trace in self.traces])
        followers = [trace.follower(LOOSENESS) for trace in self.traces]
        self.free = release((), model, followers, values, self.workers)
        if self.free.misfit > _STUCK:  # a drive that is wrong altogether
            followers = [trace.follower(LOOSENESS, _DRIVEN) for trace in self.traces]
            other = release((), model, followers, values, self.workers)
            self.free = min(self.free, other, key=lambda one: one.misfit)
        self.report(f"with unknown forces: misfit {self.free.misfit:.3g}")
        found = self.tighten((), self.free, self.free.fit.values)
        self.report(f"nominal: misfit {found.misfit:.3g}, clearance {found.fit.values[0, 0] * 1e3:.4f} mm")
        return Explanation(found)

    def tighten(self, hypotheses: Sequence[Hypothesis], base: Attempt, values: np.ndarray) -> Attempt:
        """Fit a model without unknown forces, from a path that was found with them."""
        model = self.setting.model(hypotheses)
        return refine(hypotheses, model, base.followers, values, ANNEALING[1], 8, self.workers)

    def release(self, base: Attempt) -> Attempt:
        """Let unknown forces in beside an attempt's hypotheses, on a path of its own."""
        rows = base.fit.values
        traces = [
            self.retrace(r, base.model.machine(row), base.model.instrument(row)) for r, row in enumerate(rows)
        ]
        followers = [trace.follower(LOOSENESS) for trace in traces]
        return release(base.hypotheses, base.model, followers, rows, self.workers)

    def widen(self, explanation: Explanation, free: Attempt) -> None:
        """Fit what points where the misfit points beside ``free``, until something explains the recordings.

        In order of promise and price: single effects, deaf channels (whose sensors may be at fault), pairs of
        effects, forces of free form, effects that no linear look can judge. Where not even unknown forces
        follow, these come right after the likeliest.
        """
        groups = [g for g in self.groups.values() if all(not _same(g[0], h) for h in free.hypotheses)]
        self.report("looking at all hypotheses at once")
        found = screen(free, groups, self.setting.joint, self.traces[0].path.force, self.workers)
        if not explanation.hints:
            explanation.hints = found.singles
        for hint in found.singles[:5]:
            self.report(f"  {hint.label}: promises {hint.gain:.4g}")
        physics = [h for h in found.singles if h.hypotheses[0].kind == "physics"]
        sensors = [h for h in found.singles if h.hypotheses[0].channel is not None]
        likely = [h for h in physics[:_FITTED] if h.gain > max(_HOPEFUL * physics[0].gain, 0.0)]
        likely += [h for h in found.forces[:1] if all(h.label != one.label for one in likely)]
        channels = list(dict.fromkeys(str(h.hypotheses[0].channel) for h in sensors))
        first = channels[:_DEAF] if sensors and physics and sensors[0].gain > physics[0].gain else []
        steps: list[Callable[[], None]] = []
        steps += [lambda c=c: self.deafen(explanation, free, c) for c in first]  # type: ignore[misc]
        steps += [lambda h=h: self.follow(explanation, free, h) for h in likely]  # type: ignore[misc]
        steps += [lambda c=c: self.deafen(explanation, free, c) for c in channels[:_DEAF] if c not in first]  # type: ignore[misc]
        if not free.hypotheses:
            pairs = [lambda h=h: self.follow(explanation, free, h) for h in found.pairs[:_PAIRS]]
            freely = [lambda: self.shape_freely(explanation, free, found)]
            elsewhere = [lambda: self.begin_elsewhere(explanation, groups)]
            if free.misfit > _STUCK:  # not even unknown forces follow
                steps = [*steps[:1], *elsewhere, *steps[1:], *pairs, *freely]
            else:
                steps = [*steps, *pairs, *freely, *elsewhere]
        for step in steps:
            step()
            if explained(explanation.best):
                return
            if len(explanation.best.hypotheses) > len(free.hypotheses) and (
                explanation.best.misfit < _FAR_BETTER * explanation.nominal.misfit
            ):
                return  # something else must be missing beside it

    def follow(self, explanation: Explanation, free: Attempt, hint: Hint) -> None:
        """Fit what a hint suggests beside the hypotheses of ``free``."""
        held = [*free.hypotheses, *hint.hypotheses]
        rows = free.fit.values
        added = np.repeat(hint.values[None], len(rows), axis=0)
        values = np.concatenate([rows[:, : free.model.shared], added, rows[:, free.model.shared :]], axis=1)
        self.keep(explanation, held, lambda: self.tighten(held, free, values))

    def keep(
        self, explanation: Explanation, held: Sequence[Hypothesis], make: Callable[[], Attempt]
    ) -> Attempt | None:
        """Add an attempt to those that were made, unless it fails or was made before."""
        label = " + ".join(h.label for h in held)
        if any(a.label == label and explained(a) for a in explanation.attempts):
            return None
        try:
            found = make()
        except (InputError, np.linalg.LinAlgError) as error:
            self.report(f"{label}: {error}")
            return None
        reference = explanation.nominal.misfit
        for look in range(_AGAIN):  # what is nearly right is worth another look, from a path of its own
            if explained(found) or found.misfit > _NEARLY * reference:
                break
            if look == 0:
                free = self.release(found)
                other = self.tighten(found.hypotheses, free, free.fit.values)
                found = min(found, other, key=lambda one: one.misfit)
                continue
            again = refine(
                found.hypotheses,
                found.model,
                found.followers,
                found.fit.values,
                ANNEALING[2],
                8,
                self.workers,
            )
            if again.misfit > 0.9 * found.misfit:
                break
            found = again
        if not np.isfinite(found.fit.information).all():
            self.report(f"{label}: does not run along the whole path")
            return None
        explanation.attempts.append(found)
        shown = ", ".join(f"{v:.5g}" for v in found.fit.values[0, 1 : found.model.shared])
        self.report(f"{found.label}: misfit {found.misfit:.3g} at {shown}")
        return found

    def deafen(self, explanation: Explanation, free: Attempt, channel: str) -> None:
        """Fit without a channel: where that explains everything, its sensor is at fault; how, is fitted."""
        deaf = [f.part(0, f.segments) for f in free.followers]
        for follower in deaf:
            follower.measured = follower.measured.without(channel)
        try:
            found = refine(
                free.hypotheses, free.model, deaf, free.fit.values, ANNEALING[1], 8, self.workers,
                False,
            )  # fmt: skip
        except (InputError, np.linalg.LinAlgError):
            return
        self.report(f"without {channel}: misfit {found.misfit:.3g}")
        if found.scale > 1.0 or found.level > FOLLOWED:
            return
        hearing = [f.part(0, f.segments) for f in found.followers]
        for follower, trace in zip(hearing, self.traces, strict=True):
            first = follower.measured.first - trace.measured.first
            follower.measured = trace.measured.part(first, first + follower.segments)
        one, measured = found.fit.passes[0], hearing[0].measured
        shape = (-1, len(measured.channels))
        suspicions = suspect(
            measured.values.reshape(shape), one.predicted.reshape(shape), list(measured.channels),
            measured.chain.rate, measured.sigma, channel,
        )  # fmt: skip
        known = {(g[0].name, g[0].channel): g[0] for g in self.groups.values()}
        for suspicion in suspicions[:_SUSPECTED]:
            hypothesis = known.get((suspicion.effect, channel))
            if hypothesis is None:
                continue
            held = [*free.hypotheses, hypothesis]
            shared = found.model.shared
            added = [suspicion.parameters[u.name] for u in hypothesis.unknowns]
            rows = found.fit.values
            values = np.concatenate(
                [rows[:, :shared], np.repeat([added], len(rows), axis=0), rows[:, shared:]], axis=1
            )
            self.keep(
                explanation, held,
                lambda held=held, values=values: refine(  # type: ignore[misc]
                    held, self.setting.model(held), hearing, values, ANNEALING[2], 8, self.workers
                ),
            )  # fmt: skip
            if explained(explanation.best):
                return

    def begin_elsewhere(self, explanation: Explanation, groups: Sequence[Sequence[Hypothesis]]) -> None:
        """Fit effects that change what happens in a contact or add coordinates, from plausible sizes.

        No linear look at a path without them can judge them. They are tried on the first recording alone; the
        best are fitted to all.
        """
        tried: list[tuple[float, Hypothesis, np.ndarray]] = []
        enough = max(FOLLOWED, _FAR_BETTER * explanation.nominal.misfit)
        for group in _judged_elsewhere(groups):
            for hypothesis in group[:_TRIALS]:
                model = self.setting.model([hypothesis])
                values = np.concatenate([[self.clearance], hypothesis.start, [self.traces[0].speed]])[None]
                try:
                    machine = model.machine(values[0])
                    one = self.retrace(0, machine)
                    own = [one.follower(LOOSENESS)]
                    found = refine([hypothesis], model, own, values, ANNEALING[0], 6, 1, False)
                except (InputError, np.linalg.LinAlgError):
                    continue
                self.report(f"  {hypothesis.label}: misfit {found.misfit:.3g} on the first recording")
                tried.append((found.misfit, hypothesis, found.fit.values[0]))
                if found.misfit < enough:
                    break
            if tried and tried[-1][0] < enough:
                break
        tried.sort(key=lambda one: one[0])
        for misfit, hypothesis, row in tried[:2]:
            if misfit > max(10.0 * tried[0][0], FOLLOWED) and misfit > 0.5 * explanation.best.misfit:
                continue
            model = self.setting.model([hypothesis])
            values = np.array([[*row[:-1], trace.speed] for trace in self.traces])
            machine = model.machine(values[0])
            traces = [self.retrace(r, machine) for r in range(len(self.traces))]
            followers = [trace.follower(LOOSENESS) for trace in traces]
            self.keep(
                explanation, [hypothesis],
                lambda h=hypothesis, m=model, f=followers, v=values: refine(  # type: ignore[misc]
                    [h], m, f, v, ANNEALING[0], 8, self.workers
                ),
            )  # fmt: skip
            if explained(explanation.best):
                return

    def retrace(self, r: int, machine: SliderCrank, instrument: Instrument = NO_FAULT) -> Trace:
        """The path of a recording for another machine, or with faults of its sensors undone."""
        return Trace.of(self.recordings[r], self.alignments[r], machine, instrument)

    def shape_freely(self, explanation: Explanation, free: Attempt, found: Screening) -> None:
        """Let a force of free form explain what no named effect does: the best curves are fitted."""
        for curve in found.curves[:_CURVES]:
            if curve.gain < curve.price:
                return
            self.report(f"  {curve.body} {curve.direction} by {curve.argument}: promises {curve.gain:.4g}")
            hypothesis = free_form(curve, self.setting.joint)
            self.follow(explanation, free, Hint((hypothesis,), hypothesis.start, curve.gain, 0.0))
            if explained(explanation.best):
                return

    def prune(self, explanation: Explanation) -> None:
        """Take effects away from the best attempt as long as it explains as much without them."""
        while len(explanation.best.hypotheses) > 1:
            best = explanation.best
            shorter = []
            for left_out in range(len(best.hypotheses)):
                held = [h for i, h in enumerate(best.hypotheses) if i != left_out]
                model = self.setting.model(held)
                keep = [0]
                place = 1
                for i, hypothesis in enumerate(best.hypotheses):
                    count = len(hypothesis.unknowns)
                    keep += [] if i == left_out else range(place, place + count)
                    place += count
                values = best.fit.values[:, [*keep, place]]
                if best.hypotheses[left_out].structural(self.setting.with_clearance(3e-4)):
                    # a path with other coordinates is no beginning
                    followers = [trace.follower(LOOSENESS) for trace in self.traces]
                    free = release(held, model, followers, values, self.workers)
                    shorter.append(self.tighten(held, free, free.fit.values))
                    continue
                shorter.append(refine(held, model, best.followers, values, ANNEALING[2], 8, self.workers))
            explanation.attempts += shorter
            for one in shorter:
                self.report(f"{one.label}: misfit {one.misfit:.3g}")
            if explanation.best is best:
                break

    def enlarge(self, explanation: Explanation) -> None:
        """Try the variants of the best attempt's effects that have more parameters."""
        best = explanation.best
        for index, hypothesis in enumerate(best.hypotheses):
            for group in self.groups.values():
                larger = group[0]
                names = {u.name for u in hypothesis.unknowns}
                if not _same(larger, hypothesis) or not names < {u.name for u in larger.unknowns}:
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
                # the smaller one may owe its misfit to a worse path: give it the larger one's
                again = refine(
                    best.hypotheses, best.model, one.followers, best.fit.values, ANNEALING[3], 8, self.workers
                )
                explanation.attempts += [one, again]
                self.report(f"{one.label}: misfit {one.misfit:.3g}; without the added: {again.misfit:.3g}")
                if explained(again):
                    return


def _same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are about the same thing."""
    return one.name == other.name and one.channel == other.channel


def _single(hypothesis: Hypothesis) -> bool:
    """Whether it has one size beside shapes: the simplest variant of its effect; a drive has two gains."""
    return int((~hypothesis.shapes).sum()) == 1 or hypothesis.name == "soft_drive"


def _judged_elsewhere(groups: Sequence[Sequence[Hypothesis]]) -> list[Sequence[Hypothesis]]:
    """The simplest variants of the effects in ``_ELSEWHERE``, in that order."""
    single = [g for g in groups if g[0].name in _ELSEWHERE and _single(g[0])]
    fewest: dict[str, int] = {}
    for group in single:
        count = len(group[0].unknowns)
        fewest[group[0].name] = min(count, fewest.get(group[0].name, count))
    chosen = [g for g in single if len(g[0].unknowns) == fewest[g[0].name]]
    return sorted(chosen, key=lambda g: _ELSEWHERE.index(g[0].name))


def _ready(hypothesis: Hypothesis, i: int) -> float:
    """Where a further parameter begins: off, or its plausible value where that is infinite or a shape."""
    if hypothesis.shapes[i] or not np.isfinite(hypothesis.off[i]):
        return float(hypothesis.start[i])
    return float(hypothesis.off[i])


def explained(attempt: Attempt) -> bool:
    """Whether nothing is left to explain."""
    return attempt.scale <= 1.0 and attempt.level < EXPLAINED
