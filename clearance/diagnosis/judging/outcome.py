"""Carry out a diagnosis and gather what it says: the contract's JSON and the report's evidence."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from clearance.diagnosis.following.attempt import EXPLAINED, Attempt, explained
from clearance.diagnosis.following.trace import check_length
from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.calibration import simulated_scores
from clearance.diagnosis.judging.detectability import seen_beside
from clearance.diagnosis.judging.evidence import gather_evidence
from clearance.diagnosis.judging.held_out import ask, judge, speeds_near
from clearance.diagnosis.judging.mismatch import Innovations, innovations, interval, root_mean_square, summary
from clearance.diagnosis.judging.play import clearance_of
from clearance.diagnosis.judging.sensors import advice, calibration_of, largest
from clearance.diagnosis.judging.true_seconds import machine_of, true_speed
from clearance.diagnosis.judging.verdict import (
    FITTED,
    basis_of,
    effects_of,
    free_form_of,
    gone,
    lost,
    place_of,
    probabilities,
    rivals,
    unconfirmed,
    verdict_of,
)
from clearance.diagnosis.judging.words import located, sentences
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.location import locate_joint
from clearance.diagnosis.searching.rattling import between_rails
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import p_value, usual
from clearance.diagnosis.searching.strategy import find_explanation
from clearance.diagnosis.sensing.measured import Measured
from clearance.mechanism.slider_crank import SliderCrank
from clearance.provenance import peak_memory

METRIC = "root mean square of one-step prediction errors over a perfect model's, quietest nine tenths"
_SEARCH = 0.8  # of the time limit, after which nothing new is tried
_SOUGHT = 0.9  # of it, until when lost paths are looked for in what was held out
_PATIENCE = (0.1, 0.2)  # of it, for which they are at least, and at most
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
        time_limit: that all of it should take [s]: after four fifths of it nothing new is tried.
        finished: folder in which fits are kept for another run on the same recordings.
        simulations: of the refitted nominal machine, by which to tell how unusual the recordings are.

    Raises:
        InputError: a recording that no machine of this kind could have made.
    """
    for one in (*recordings, *held_out):
        check_length(one)
    started, searching = time.monotonic(), True
    deadline = started + _SEARCH * time_limit

    def say(message: str) -> None:
        now = time.monotonic()
        left = f", at most {max(deadline - now, 0.0):.0f} left" if searching and deadline < np.inf else ""
        report(f"[{now - started:.0f} s{left}] {message}")

    search, explanation, joints = locate_joint(
        recordings, settings, effects, speed_range, workers, say, deadline, finished
    )
    setting, joint = search.setting, search.setting.joint
    keep(explanation)
    try:
        find_explanation(search, explanation, most, keep)
        stopped = search.stopped
        search.stopped, search.deadline = "", started + time_limit  # of judging
    except KeyboardInterrupt:
        search.stopped = stopped = "it was interrupted"
        say("interrupted: what was found so far is judged and written; once more ends it at once")
    searching = False  # what comes now takes a minute at most as a rule
    if explanation.rails is not None and not explained(explanation.best):
        explanation.shown = between_rails(search, explanation.rails)
    if simulations:
        _calibrate(search, explanation, simulations)
    ask(search, explanation)
    search.report("judging on held-out recordings")
    now = time.monotonic()
    search.patient_until = now if search.stopped else now + patience(now - started, time_limit)
    judged = judge(held_out, search, explanation)
    best, nominal, after = explanation.best, explanation.nominal, judged.after
    fit = _fit_numbers(judged.errors_before, judged.errors_after)
    errors_fit = innovations(nominal, joint, best if explained(best) else None)
    where = summary(errors_fit)
    channels = [c for c, s in sorted(where["channels"].items(), key=lambda kv: -kv[1]) if s > 0.1][:3]
    verdict = verdict_of(explanation, after)
    basis = basis_of(explanation, after)
    # at the strikes of a slider that the motion shows loose
    struck = gone(after, EXPLAINED) if basis == FITTED else []
    missed = lost(after) if verdict not in ("none", "unknown") and not struck else []
    if struck:
        fit["held_out"]["lost"] = struck
    if missed:
        fit["held_out"]["followed"] = root_mean_square(
            [
                errors
                for errors, follower in zip(judged.errors_after, after.followers, strict=True)
                if follower.measured.name not in missed
            ]
        )
    if judged.shares:
        fit["held_out"]["shares"] = {name: round(share, 3) for name, share in judged.shares.items()}
    body, direction = place_of(explanation, after)
    (clearance, rests_on), others = clearance_of(explanation), rivals(verdict, explanation)
    named = effects_of(best, probabilities(explanation), basis) if verdict not in ("none", "unknown") else []
    here, sensors = seen_beside(search, best), calibration_of(best)
    score = explanation.hints[0].gain if explanation.hints else None
    diagnosis: dict[str, Any] = {
        "verdict": verdict,
        "summary": [
            *sentences(verdict, explanation, joint, fit, channels or list(where["channels"])[:1], after),
            *located(joints),
            *([largest(sensors)] if sensors and explained(best) else []),
        ],
        "mismatch": {
            "detected": verdict != "none" and not unconfirmed(explanation, after), "score": score,
            "p_value": None if score is None else p_value(score, explanation.simulated),
            "simulations": 0 if explanation.simulated is None else len(explanation.simulated),
            "body": body, "direction": direction,
            **where,
        },
        "effects": named,
        "equivalent": [[h.name for h in a.hypotheses] for a in others] if len(others) > 1 else [],
        "next_experiment": _next_experiment(others, recordings),
        "free_form": free_form_of(best, setting, explanation.shaken),
        "sensors": sensors,
        "smallest_seen": here,
        "fit": fit,
        "clearance": {
            "joint": joint, "misfit_by_joint": joints, "before_m": float(nominal.fit.values[0, 0]),
            "after_m": clearance.value, "low_m": clearance.low, "high_m": clearance.high, "basis": rests_on,
        },
        "recordings": [
            {
                "name": one.name, "seconds": one.seconds, "rate_hz": one.chain.rate,
                "channels": list(one.channels), "speed_rpm": true_speed(best, r),
                "held_out_seconds": sum(o.seconds for o in judged.held_out if o.name == one.name),
            }
            for r, one in enumerate(recordings)
        ],
        "warnings": [
            *(
                f"{one.name}: left out, for showing nothing but a constant: {', '.join(one.silent)}"
                for one in {o.name: o for o in (*recordings, *held_out)}.values() if one.silent
            ),
            *(
                f"{one.name}: its accelerations have no noise to speak of, as simulations have none; 1 % "
                "of the signal was added, or errors of the simulator would count as something missing."
                for one in {o.name: o for o in (*recordings, *held_out)}.values() if one.noiseless
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
                f"{name}: {share:.0%} of what is followed otherwise could be followed of it when held out; "
                "its errors are of that part."
                for name, share in judged.shares.items()
            ),
            *(
                f"{name}: what was held out of it could not be followed to its end, and its errors are in "
                "the held-out number; other held-out recordings are explained."
                for name in missed
            ),
            *(
                f"{name}: what was held out of it was lost at the slider's strikes, and its errors are in "
                "the held-out number."
                for name in struck
            ),
            *(
                [f"Not everything was tried: {stopped}."] if stopped else []
            ),
            *(
                advice(recordings) if verdict == "unknown" and not explained(best) else []
            ),
        ],
        "seconds": round(time.monotonic() - started, 1),
        "peak_memory_mib": round(peak_memory()),
    }  # fmt: skip
    search.report(f"verdict: {verdict}; gathering what the report shows")
    evidence = gather_evidence(
        search, explanation, judged.held_out, judged.before, after, errors_fit, here, verdict
    )
    return Outcome(diagnosis, evidence, machine_of(best, setting, clearance.value), explanation)


def patience(spent: float, time_limit: float) -> float:
    """How long lost paths are looked for in what was held out [s], after so long [s] of a time limit [s]."""
    least, most = _PATIENCE
    if time_limit == np.inf:
        return np.inf
    return min(most * time_limit, max(least * time_limit, _SOUGHT * time_limit - spent))


def _calibrate(search: Search, explanation: Explanation, simulations: int) -> None:
    """Simulate the nominal machine; where what it explains is as usual there, nothing is asserted."""
    explanation.simulated = simulated_scores(search, explanation.nominal, speeds_near(search), simulations)
    if explained(explanation.nominal) and usual(explanation):
        search.report("simulations of the machine, lacking nothing, look as suspicious as the recordings")
        for attempt in explanation.attempts:
            attempt.withdrawn = True


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
