"""Carry out a diagnosis and gather what it says: the contract's JSON and the report's evidence."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from clearance.diagnosis.following.attempt import explained
from clearance.diagnosis.following.trace import check_length
from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Setting
from clearance.diagnosis.judging.calibration import simulated_scores
from clearance.diagnosis.judging.evidence import gather_evidence
from clearance.diagnosis.judging.held_out import ask, judge, speeds_near
from clearance.diagnosis.judging.mismatch import innovations
from clearance.diagnosis.judging.statement import state
from clearance.diagnosis.judging.true_seconds import machine_of
from clearance.diagnosis.judging.verdict import cushioned
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.location import align_plausibly, locate_joint
from clearance.diagnosis.searching.rattling import between_rails
from clearance.diagnosis.searching.scrutiny import look_beside_nominal
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import usual
from clearance.diagnosis.searching.strategy import find_explanation
from clearance.diagnosis.sensing.measured import Measured
from clearance.mechanism.slider_crank import SliderCrank
from clearance.provenance import peak_memory

SEARCHED = 0.8  # of the time limit, after which nothing new is tried
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
    deadline = started + SEARCHED * time_limit

    def say(message: str) -> None:
        now = time.monotonic()
        left = f", at most {max(deadline - now, 0.0):.0f} left" if searching and deadline < np.inf else ""
        report(f"[{now - started:.0f} s{left}] {message}")

    machine = settings[0].with_clearance(SOME_CLEARANCE)
    for one in held_out:  # before minutes are spent on what was fitted
        if all(one.name != fitted.name for fitted in recordings):
            align_plausibly(one, machine, speed_range)
    search, explanation, joints = locate_joint(
        recordings, settings, effects, speed_range, workers, say, deadline, finished
    )
    keep(explanation)
    search.most = most
    try:
        find_explanation(search, explanation, keep)
        stopped = search.stopped
        search.stopped, search.deadline = "", started + time_limit  # of judging
    except KeyboardInterrupt:
        search.stopped = stopped = "it was interrupted"
        say("interrupted: what was found so far is judged and written; once more ends it at once")
    searching = False  # what comes now takes a minute at most as a rule
    if explained(explanation.nominal):
        look_beside_nominal(search, explanation)  # an interruption may have come before the first look
    if explanation.rails is not None and not explained(explanation.best):
        explanation.shown = between_rails(search, explanation.rails)
    before = time.monotonic()
    if simulations and not search.stopped:
        _calibrate(search, explanation, simulations)
    apart = time.monotonic() - before  # which the time limit leaves out
    search.deadline += apart
    ask(search, explanation)
    search.report("judging on held-out recordings")
    now = time.monotonic()
    search.patient_until = now if search.stopped else now + patience(now - started - apart, time_limit)
    judged = judge(held_out, search, explanation)
    best = explanation.best
    errors = innovations(explanation.nominal, search.setting.joint, best if explained(best) else None)
    diagnosis = state(search, explanation, judged, errors, held_out, joints, stopped)
    diagnosis |= {"seconds": round(time.monotonic() - started, 1), "peak_memory_mib": round(peak_memory())}
    search.report(diagnosis["summary"][0])
    search.report(f"verdict: {diagnosis['verdict']}; gathering what the report shows")
    evidence = gather_evidence(
        search, explanation, judged.held_out, judged.before, judged.after, errors,
        diagnosis["smallest_seen"], diagnosis["verdict"],
    )  # fmt: skip
    # where a gap was closed that the motion shows to be wide, what was found belongs to the closed one
    clearance = best.fit.values[0, 0] if cushioned(explanation) else diagnosis["clearance"]["after_m"]
    return Outcome(diagnosis, evidence, machine_of(best, search.setting, clearance), explanation)


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
