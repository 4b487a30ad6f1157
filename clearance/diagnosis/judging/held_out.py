"""The nominal and the best machine beside recordings that neither was fitted to."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, Attempt, explained, refine, tightened
from clearance.diagnosis.following.onward import Way, best_of, go_on, together, ways_to_follow
from clearance.diagnosis.following.rattling import follow_rattling
from clearance.diagnosis.following.trace import Trace, traced_segments
from clearance.diagnosis.judging.likelihood import ask_likelihood
from clearance.diagnosis.judging.mismatch import Innovations, innovations, root_mean_square
from clearance.diagnosis.judging.verdict import equivalents, withdraw
from clearance.diagnosis.kinematics.agreement import aligned
from clearance.diagnosis.searching.balance import find_clock
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import LOOSE_GUIDE
from clearance.diagnosis.searching.search import PATIENCE, Search
from clearance.diagnosis.searching.significance import SURE, suspicious
from clearance.diagnosis.sensing.measured import Measured
from clearance.diagnosis.shooting.fit import Fit
from clearance.diagnosis.shooting.follow import alike
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.diagnosis.side_by_side import side_by_side
from clearance.errors import InputError
from clearance.mechanism.applied_force import NoForce, TabulatedForce
from clearance.mechanism.slider_crank import SliderCrank

_IMPACTS = 300.0  # fall of the cost: torn impacts alone brought 160 where nothing was missing, effects 494
_TRIFLE = 1.002  # times that error, where impacts speak against it
_HARMED = 0.99  # of the held-out error with it: what leaves less without was harmed by it


@dataclass(frozen=True)
class Judged:
    """Machines beside held-out recordings.

    Attributes:
        held_out: recordings, by the clock of the best machine.
        before: the nominal machine.
        after: the best one.
        errors_before: innovations of each.
        errors_after: likewise.
        withdrawn: labels of what explained the fitted recordings and harms here.
    """

    held_out: list[Measured]
    before: Attempt
    after: Attempt
    errors_before: list[Innovations]
    errors_after: list[Innovations]
    withdrawn: list[str]

    @property
    def shares(self) -> dict[str, float]:
        """Of recordings of which a part alone could be followed, that part."""
        each = zip(self.held_out, self.after.shares, strict=False)
        return {one.name: share for one, share in each if share < 1.0}


def ask(search: Search, explanation: Explanation) -> None:
    """Ask the likelihood how sure the numbers of what is asserted are; nothing is that may as well be off."""
    withdraw(explanation)
    while explained(explanation.best) and explanation.best.hypotheses:
        new = [one for one in equivalents(explanation) if one.reach is None]
        if not new:
            return
        for one in new:
            search.report(f"asking the likelihood how sure the numbers of {one.label} are")
            ask_likelihood(one, search.workers)
        withdraw(explanation)


def judge(held_out: Sequence[Measured], search: Search, explanation: Explanation) -> Judged:
    """The nominal and the best machine beside recordings that neither was fitted to.

    What the nominal machine, or a part of it, explains as well there is withdrawn: it was made of chance, or
    stands in the place of something else. What is right lowers the errors there as it does where it was
    fitted; or it does not show there (a sensor that clips at higher speeds alone). So a machine that does not
    explain what was fitted must be better there, not as good. What shows in impacts alone, as a contact's
    stiffness does, lowers the cost, of which they are a part, and not the errors of the quieter segments.
    What raises it by more than chance must lower these errors by more than a trifle: a restitution that put
    three torn impacts together where nothing was missing lowered them by 0.04 %. Physics beside a nominal
    machine in which no look sees anything unusual shows in impacts alone: what these say of it counts.
    """
    withdrawn: list[str] = []
    followed: list[tuple[Fit, Attempt]] = []  # on recordings without a clock: every round asks the same
    while True:
        best, nominal, joint = explanation.best, explanation.nominal, search.setting.joint
        own = [_clocked(one, search, best) for one in held_out]
        timed = any(one.period > 0.0 for one in own)

        def beside(
            attempt: Attempt, other: Attempt | None = None, own: list[Measured] = own, timed: bool = timed
        ) -> Attempt:
            if timed:
                return _held_out(own, search, attempt, other)
            for fit, known in followed:
                if fit is attempt.fit:  # the likelihood has not moved it since
                    return known
            followed.append((attempt.fit, _held_out(own, search, attempt, other)))
            return followed[-1][1]

        after = beside(best)
        errors_after = innovations(after, joint)
        if best is nominal:
            return Judged(own, after, after, errors_after, errors_after, withdrawn)
        before = beside(nominal, after)
        errors_before = innovations(before, joint, after)
        enough = None
        if best is not explanation.shown:
            others = ((part, beside(part, after)) for part in explanation.parts(best))
            for one, alone in [(nominal, before), *others]:
                errors = innovations(alone, joint, after)
                whole = min(alone.shares, default=1.0) == 1.0
                most = root_mean_square(errors_after) * (1.0 if explained(one) else _HARMED)
                gain = likelier(after, alone)
                most *= _TRIFLE if gain < -SURE else 1.0
                as_well = root_mean_square(errors) <= most and not gain > SURE
                if one is nominal and gain != 0.0 and _by_impacts(explanation):
                    as_well = not gain > _IMPACTS
                if explained(alone) and whole and as_well:
                    enough = one
                    break
        if enough is None:
            return Judged(own, before, after, errors_before, errors_after, withdrawn)
        search.report(f"{best.label}: held-out recordings are explained as well by {enough.label}")
        withdrawn.append(best.label)
        needed = enough.labels
        for attempt in explanation.standing[1:]:
            more = needed < attempt.labels if needed else attempt.labels == best.labels
            # there is no time to judge others, and what is not judged is not asserted
            attempt.withdrawn |= more or (search.late() and attempt is not enough)
        ask(search, explanation)


def _by_impacts(explanation: Explanation) -> bool:
    """Whether physics was found beside a nominal machine that looks as one does which lacks nothing."""
    physics = all(hypothesis.kind == "physics" for hypothesis in explanation.best.hypotheses)
    return physics and explained(explanation.nominal) and not suspicious(explanation)


def likelier(one: Attempt, other: Attempt) -> float:
    """By how much the cost of one attempt is below that of another on the same recordings; 0 on others."""
    samples = [[p.samples for p in each.fit.passes] for each in (one, other)]
    alike = one.scale == other.scale and samples[0] == samples[1]
    return float(other.fit.cost - one.fit.cost) if alike else 0.0


def _held_out(
    held_out: Sequence[Measured], search: Search, attempt: Attempt, beside: Attempt | None = None
) -> Attempt:
    """The attempt's machine beside recordings that it was not fitted to: only their speed is free.

    Args:
        held_out: recordings.
        search: that made the attempt.
        attempt: to judge.
        beside: another machine that was followed on them, from whose path to begin.
    """
    model, count = attempt.model, attempt.model.shared
    shared = attempt.fit.values[0, :count]

    def whole(values: np.ndarray) -> np.ndarray:
        return np.append(shared, values[-1])

    only_speed = Model(
        (Unknown("speed", 1e-3, own=True),),
        lambda v: _elsewhere(model.machine(whole(v))),
        lambda v: model.instrument(whole(v)),
    )
    own, instrument = model.machine(attempt.fit.values[0]), model.instrument(attempt.fit.values[0])
    machine = _elsewhere(own)
    if beside is not None and alike(machine, beside.model.machine(beside.fit.values[0])):
        speeds, paths = beside.fit.values[:, -1:], tightened(beside.followers)
        for follower in paths:
            follower.measured = follower.measured.judged(attempt.sensors)
        found = refine((), only_speed, paths, speeds, ANNEALING[1], 8, search.workers, False)
        found.shares = beside.shares
    else:
        # what explains its own recordings is looked for with patience in others, unless it is theirs alone
        patience = PATIENCE if explained(attempt) and not _passing(own) else 0

        def traced(measured: Measured) -> Trace:
            measured = measured.judged(attempt.sensors)
            try:
                known = aligned(measured, machine, speeds_of(measured, search))
                needed = traced_segments(measured, known.speed)
                return Trace.of(measured.part(0, needed), known, machine, instrument)
            except np.linalg.LinAlgError:
                raise _unmoved(measured) from None

        def followed(trace: Trace) -> Attempt:
            ways = _ways(search, attempt, trace, only_speed, patience)
            try:
                return best_of(ways, only_speed, search.patient_until)
            except np.linalg.LinAlgError:
                raise InputError(
                    f"held_out: {trace.measured.name} is not followed by any machine that was found; leave "
                    "it out: what was fitted is kept, unless finished=null"
                ) from None

        traces = side_by_side(traced, held_out, search.workers)
        each = side_by_side(followed, traces, search.workers, [trace.length for trace in traces])
        found = together(each, search.workers)
    values = found.fit.values
    found.fit.values = np.concatenate(
        [np.repeat(shared[None], len(values), axis=0), found.fit.values], axis=1
    )
    return found


def _ways(
    search: Search, attempt: Attempt, trace: Trace, model: Model, patience: int
) -> Iterator[Callable[[], Way | None]]:
    """Ways to follow what was held out of a recording; without patience one alone."""
    until, row = search.patient_until, np.array([trace.speed])
    places = ways_to_follow(trace, model, row, patience, until)
    if patience == 0:
        return places
    onward = partial(go_on, attempt, trace, model, until)
    if any(hypothesis.name == LOOSE_GUIDE for hypothesis in attempt.hypotheses):
        return chain([onward, partial(_between_rails, trace, model, row, until)], places)
    return chain([next(places), onward], places)


def _between_rails(trace: Trace, model: Model, row: np.ndarray, until: float) -> Way | None:
    found = follow_rattling(trace, model, row, lambda: time.monotonic() > until, until)
    return None if found is None else Way(*found)


def _elsewhere(machine: SliderCrank) -> SliderCrank:
    """The machine in another recording: a force over the time of one says nothing of others, and is off."""
    return replace(machine, force=NoForce()) if _passing(machine) else machine


def _passing(machine: SliderCrank) -> bool:
    """Whether its force is a table over the time of one recording, of which another shows nothing."""
    force = machine.force
    return isinstance(force, TabulatedForce) and force.argument == "time" and force.period is None


def _clocked(measured: Measured, search: Search, attempt: Attempt) -> Measured:
    """A recording that was held out, by the clock of an attempt's force over time, if it has one.

    The rest of a fitted recording goes on by its clock; another one's is found by the balance of work.
    """
    machine = attempt.model.machine(attempt.fit.values[0])
    if not isinstance(machine.force, TabulatedForce) or machine.force.period is None:
        return measured
    own = [f.measured.clock for f in attempt.followers if f.measured.name == measured.name]
    if not own:
        try:
            known = aligned(measured, machine, speeds_of(measured, search))
            own = [find_clock(measured, known, machine)]
        except np.linalg.LinAlgError:
            raise _unmoved(measured) from None
    return replace(measured, clock=own[0], period=machine.force.period)


def _unmoved(measured: Measured) -> InputError:
    return InputError(
        f"held_out: {measured.name} shows no motion of this mechanism; is it another machine's, or a sensor "
        "broken? Leave it out: what was fitted is kept, unless finished=null"
    )


def speeds_of(measured: Measured, search: Search) -> tuple[float, float]:
    """Among which that of a held-out recording is looked for [rad/s]: the rest of a fitted one has its."""
    own = any(one.name == measured.name for one in search.recordings)
    return speeds_near(search) if own else search.speed_range


def speeds_near(search: Search) -> tuple[float, float]:
    """Among which are those of the fitted recordings [rad/s], with room."""
    near = [abs(known.speed) for known in search.alignments]
    return 0.5 * min(near), 2.0 * max(near)
