"""Carry out a diagnosis and gather what it says: the contract's JSON and the report's evidence."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, Attempt, explained, refine
from clearance.diagnosis.following.onward import follow_again, go_on
from clearance.diagnosis.following.trace import Trace, check_length
from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.calibration import simulated_scores
from clearance.diagnosis.judging.detectability import seen_beside
from clearance.diagnosis.judging.evidence import gather_evidence
from clearance.diagnosis.judging.likelihood import ask_likelihood
from clearance.diagnosis.judging.mismatch import Innovations, innovations, interval, root_mean_square, summary
from clearance.diagnosis.judging.verdict import (
    basis_of,
    clearance_of,
    effects_of,
    equivalents,
    free_form_of,
    lost,
    place_of,
    probabilities,
    verdict_of,
    withdraw,
)
from clearance.diagnosis.judging.words import located, sentences
from clearance.diagnosis.kinematics.agreement import aligned
from clearance.diagnosis.searching.balance import find_clock
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import LOOSE_GUIDE
from clearance.diagnosis.searching.location import locate_joint
from clearance.diagnosis.searching.rattling import between_rails, fit_rattling
from clearance.diagnosis.searching.search import PATIENCE, Search
from clearance.diagnosis.searching.significance import p_value, usual
from clearance.diagnosis.searching.strategy import find_explanation
from clearance.diagnosis.sensing.measured import Measured
from clearance.diagnosis.shooting.follow import alike
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.mechanism.applied_force import NoForce, TabulatedForce
from clearance.mechanism.slider_crank import SliderCrank

METRIC = "root mean square of one-step prediction errors over a perfect model's, quietest nine tenths"
Found = TypeVar("Found")


@dataclass
class Outcome(Generic[Found]):
    """Everything that a diagnosis found.

    Attributes:
        diagnosis: the contract's JSON.
        evidence: what the report draws.
        machine: corrected.
        explanation: all attempts.
    """

    diagnosis: dict[str, Any]
    evidence: dict[str, Any]
    machine: SliderCrank
    explanation: Found


def diagnose(
    recordings: Sequence[Measured],
    held_out: Sequence[Measured],
    settings: Sequence[Setting],
    effects: Sequence[Effect],
    speed_range: tuple[float, float],
    workers: int,
    most: int,
    report: Callable[[str], None],
    keep: Callable[[Explanation], None] = lambda _: None,
    time_limit: float = np.inf,
    finished: Path | None = None,
    simulations: int = 0,
) -> Outcome[Explanation]:
    """Find what the nominal machine lacks.

    Args:
        recordings: to fit; selection sees only these.
        held_out: to judge by.
        settings: the nominal machine, with each joint that may have the clearance.
        effects: to make hypotheses of.
        speed_range: [rad/s].
        workers: threads.
        most: effects at once.
        report: called with progress.
        keep: called after each stage with what was found so far.
        time_limit: after which nothing new is tried [s].
        finished: folder in which fits are kept for another run on the same recordings.
        simulations: of the refitted nominal machine, by which to tell how unusual the recordings are.

    Raises:
        InputError: a recording that no machine of this kind could have made.
    """
    for one in (*recordings, *held_out):
        check_length(one)
    started = time.monotonic()

    def say(message: str) -> None:
        report(f"[{time.monotonic() - started:.0f} s] {message}")

    search, explanation, joints = locate_joint(
        recordings, settings, effects, speed_range, workers, say, started + time_limit, finished
    )
    setting, joint = search.setting, search.setting.joint
    keep(explanation)
    try:
        find_explanation(search, explanation, most, keep)
    except KeyboardInterrupt:
        search.stopped = "it was interrupted"
        say("interrupted: what was found so far is judged and written; once more ends it at once")
    if explanation.rails is not None and not explained(explanation.best):
        explanation.shown = between_rails(search, explanation.rails)
    if simulations:
        _calibrate(search, explanation, simulations)
    _ask(search, explanation)
    search.report("judging on held-out recordings")
    judged = _judge(held_out, search, explanation)
    best, nominal, after = explanation.best, explanation.nominal, judged.after
    fit = _fit_numbers(judged.errors_before, judged.errors_after)
    errors_fit = innovations(nominal, joint, best if explained(best) else None)
    where = summary(errors_fit)
    channels = [c for c, s in sorted(where["channels"].items(), key=lambda kv: -kv[1]) if s > 0.1][:3]
    verdict = verdict_of(explanation, after)
    missed = lost(after) if verdict not in ("none", "unknown") else []
    if missed:
        fit["held_out"]["followed"] = root_mean_square(
            [
                errors
                for errors, follower in zip(judged.errors_after, after.followers, strict=True)
                if follower.measured.name not in missed
            ]
        )
    body, direction = place_of(explanation, after)
    clearance, others = clearance_of(explanation), equivalents(explanation)
    named = (
        effects_of(best, probabilities(explanation), basis_of(explanation))
        if verdict not in ("none", "unknown")
        else []
    )
    here = seen_beside(search, best)
    score = explanation.hints[0].gain if explanation.hints else None
    diagnosis: dict[str, Any] = {
        "verdict": verdict,
        "summary": [
            *sentences(verdict, explanation, joint, fit, channels or list(where["channels"])[:1]),
            *located(joints),
        ],
        "mismatch": {
            "detected": verdict != "none", "score": score,
            "p_value": None if score is None else p_value(score, explanation.simulated),
            "simulations": 0 if explanation.simulated is None else len(explanation.simulated),
            "body": body, "direction": direction,
            **where,
        },
        "effects": named,
        "equivalent": [[h.name for h in a.hypotheses] for a in others] if len(others) > 1 else [],
        "next_experiment": _next_experiment(others, recordings),
        "free_form": free_form_of(best, setting),
        "smallest_seen": here,
        "fit": fit,
        "clearance": {
            "joint": joint, "misfit_by_joint": joints, "before_m": float(nominal.fit.values[0, 0]),
            "after_m": clearance.value, "low_m": clearance.low, "high_m": clearance.high,
        },
        "recordings": [
            {
                "name": one.name, "seconds": one.seconds, "rate_hz": one.chain.rate,
                "channels": list(one.channels), "speed_rpm": float(best.fit.values[r, -1]),
                "held_out_seconds": sum(o.seconds for o in judged.held_out if o.name == one.name),
            }
            for r, one in enumerate(recordings)
        ],
        "warnings": [
            *(
                f"{one.name}: {', '.join(one.silent)} shows nothing but a constant and was left out"
                for one in recordings if one.silent
            ),
            *(
                ["What explains the fitted recordings does not explain the held-out ones."]
                if verdict != verdict_of(explanation) else []
            ),
            *(
                f"{label} explains the fitted recordings, but held-out ones are explained as well with less."
                for label in judged.withdrawn
            ),
            *(
                f"{name}: what was held out of it could not be followed to its end, and its errors are in "
                "the held-out number; other held-out recordings are explained."
                for name in missed
            ),
            *(
                [f"Not everything was tried: {search.stopped}."] if search.stopped else []
            ),
        ],
        "seconds": round(time.monotonic() - started, 1),
    }  # fmt: skip
    search.report(f"verdict: {verdict}; gathering what the report shows")
    evidence = gather_evidence(search, explanation, judged.held_out, judged.before, after, errors_fit, here)
    model = setting.model(best.hypotheses)
    return Outcome(diagnosis, evidence, model.machine(best.fit.values[0]), explanation)


def _calibrate(search: Search, explanation: Explanation, simulations: int) -> None:
    """Simulate the nominal machine; where what it explains is as usual there, nothing is asserted."""
    explanation.simulated = simulated_scores(search, explanation.nominal, _speeds(search), simulations)
    if explained(explanation.nominal) and usual(explanation):
        search.report("simulations of the machine, lacking nothing, look as suspicious as the recordings")
        for attempt in explanation.attempts:
            attempt.withdrawn = True


def _ask(search: Search, explanation: Explanation) -> None:
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


@dataclass(frozen=True)
class _Judged:
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


def _judge(held_out: Sequence[Measured], search: Search, explanation: Explanation) -> _Judged:
    """The nominal and the best machine beside recordings that neither was fitted to.

    What the nominal machine, or a part of it, explains as well there is withdrawn: it was made of chance, or
    stands in the place of something else. What is right lowers the errors there as it does where it was
    fitted.
    """
    withdrawn: list[str] = []
    while True:
        best, nominal, joint = explanation.best, explanation.nominal, search.setting.joint
        own = [_clocked(one, search, best) for one in held_out]
        after = _held_out(own, search, best)
        errors_after = innovations(after, joint)
        if best is nominal:
            return _Judged(own, after, after, errors_after, errors_after, withdrawn)
        before = _held_out(own, search, nominal, after)
        errors_before = innovations(before, joint, after)
        enough = None
        if best is not explanation.shown:
            others = ((part, _held_out(own, search, part, after)) for part in explanation.parts(best))
            for one, alone in [(nominal, before), *others]:
                errors = innovations(alone, joint, after)
                if explained(alone) and root_mean_square(errors) <= root_mean_square(errors_after):
                    enough = one
                    break
        if enough is None:
            return _Judged(own, before, after, errors_before, errors_after, withdrawn)
        search.report(f"{best.label}: held-out recordings are explained as well by {enough.label}")
        withdrawn.append(best.label)
        needed = {h.label for h in enough.hypotheses}
        for attempt in explanation.standing[1:]:
            more = needed < {h.label for h in attempt.hypotheses} if needed else attempt is best
            attempt.withdrawn |= more
        _ask(search, explanation)


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
    found: Attempt | None
    if beside is not None and alike(machine, beside.model.machine(beside.fit.values[0])):
        speeds = beside.fit.values[:, -1:]
        found = refine((), only_speed, beside.followers, speeds, ANNEALING[1], 8, search.workers, False)
    else:

        def one(measured: Measured) -> Trace:
            known = aligned(measured, machine, _speeds(search))
            return Trace.of(measured, known, machine, instrument)

        with ThreadPoolExecutor(search.workers) as pool:
            traces = list(pool.map(one, held_out))
        values = np.array([[trace.speed] for trace in traces])
        # what explains its own recordings is looked for with patience in others, unless it is theirs alone
        right = explained(attempt) and not _passing(own)
        found = None
        if right and any(h.name == LOOSE_GUIDE for h in attempt.hypotheses):
            found = go_on(attempt, traces, only_speed, search.workers)
            found = found or fit_rattling(traces, only_speed, values, search.workers)
        if found is None:
            starts = search.begin(traces, only_speed, values, PATIENCE if right else 0)
            found = search.grown((), values, starts, model=only_speed, patient=right)
            assert found is not None
            if right and not explained(found):
                other = go_on(attempt, traces, only_speed, search.workers)
                found = other if other is not None and other.misfit < found.misfit else found
            if right and not explained(found):
                found = follow_again(found, traces, only_speed, search.workers)
    values = found.fit.values
    found.fit.values = np.concatenate(
        [np.repeat(shared[None], len(values), axis=0), found.fit.values], axis=1
    )
    return found


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
        own = [find_clock(measured, aligned(measured, machine, _speeds(search)), machine)]
    return replace(measured, clock=own[0], period=machine.force.period)


def _speeds(search: Search) -> tuple[float, float]:
    """Among which the speed of another recording is looked for [rad/s]."""
    near = [abs(known.speed) for known in search.alignments]
    return 0.5 * min(near), 2.0 * max(near)


def _fit_numbers(before: Sequence[Innovations], after: Sequence[Innovations]) -> dict[str, Any]:
    low, high = interval(after)
    return {
        "metric": METRIC,
        "held_out": {
            "before": root_mean_square(before), "after": root_mean_square(after), "floor": 1.0, "low": low,
            "high": high,
        },
    }  # fmt: skip


def _next_experiment(others: Sequence[Attempt], recordings: Sequence[Measured]) -> str | None:
    if len(others) < 2:
        return None
    lacking = [
        c
        for c in ("slider_horizontal", "slider_vertical", "crank_b_transverse")
        if c not in recordings[0].channels
    ]
    if lacking:
        return f"record {lacking[0]} too: these explanations differ there"
    return "record at a clearly different speed: contact, friction and gravity scale differently with it"
