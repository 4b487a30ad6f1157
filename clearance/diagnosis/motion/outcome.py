"""Carry out a diagnosis of motion alone and gather what it says, for the contract and the report."""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.evidence import SHOWN
from clearance.diagnosis.judging.mismatch import whiteness
from clearance.diagnosis.judging.outcome import Outcome
from clearance.diagnosis.judging.words import HELPS
from clearance.diagnosis.motion.attempt import Findings
from clearance.diagnosis.motion.beginning import begin
from clearance.diagnosis.motion.course import Course
from clearance.diagnosis.motion.fit import Fit
from clearance.diagnosis.motion.judged import Judged, over, scaled
from clearance.diagnosis.motion.linkage import link
from clearance.diagnosis.motion.model import gather
from clearance.diagnosis.motion.rest import angles
from clearance.diagnosis.motion.search import Search
from clearance.diagnosis.motion.statement import state
from clearance.diagnosis.motion.track import Track
from clearance.diagnosis.motion.verdict import estimates, stands
from clearance.diagnosis.motion.where import maps
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank
from clearance.provenance import peak_memory
from clearance.recording.channels import si_unit

_ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_UNLIKELY = 0.25  # share of a channel's variance that the mechanism must explain


def diagnose(
    tracks: Sequence[Track],
    held_out: Sequence[Track],
    setting: Setting,
    named: Sequence[Effect],
    uncertain: Mapping[str, tuple[float, float]],
    zero_known: bool,
    speed_range: tuple[float, float],
    seconds: float,
    workers: int,
    most: int,
    report: Callable[[str], None],
    keep: Callable[[Findings], None] = lambda _: None,
    finished: Path | None = None,
) -> Outcome[Findings]:
    """Find what the nominal machine lacks, from how its crank turns and its slider moves.

    Args:
        tracks: to fit; names are chosen by these alone.
        held_out: to judge by; a force of free form is kept where it helps here, too.
        setting: the nominal machine and the joint.
        named: effects to try.
        uncertain: paths of the mechanism that are known only roughly, to their bounds.
        zero_known: whether an encoder's zero that is off is a fault, not a matter of course.
        speed_range: [rad/s], where no channel tells the speed.
        seconds: after which nothing new is tried.
        workers: threads.
        most: effects at once.
        report: called with progress.
        keep: called after each stage with what was found so far.
        finished: folder of fits that need not be made again; ``None``: none are kept.

    Raises:
        InputError: a recording that no machine of this kind could have made, or play in the other joint.
    """
    started = time.monotonic()
    machine, joint = setting.with_clearance(0.0), setting.joint
    _refuse_other_play(machine)
    linkage = link(tracks, machine, gather(named, machine, joint, tracks, list(uncertain), 1.0), joint)
    tracks, held_out = ([linkage.oriented(track) for track in some] for some in (tracks, held_out))
    guesses = [begin(track, speed_range) for track in (*tracks, *held_out)][: len(tracks)]
    turns = float(np.mean([abs(guess[3]) for guess in guesses])) / 60.0
    terms = gather(named, machine, joint, tracks, list(uncertain), max(turns, 0.1))
    search = Search(
        tracks, machine, joint, terms, dict(uncertain), linkage, speed_range, seconds, workers, report,
        finished,
    )  # fmt: skip
    with _interruptible(search):
        findings = Course(search, most).run(keep)
    _require_plausible(findings, search)
    report(f"[{time.monotonic() - started:.0f} s] judging on held-out recordings")
    best, nominal = findings.best, findings.nominal
    after = Judged(best, held_out, search, speed_range)
    before = Judged(nominal, held_out, search, speed_range) if best is not nominal else after
    beside = _with_table(search, findings, before, after, held_out, speed_range)
    diagnosis = state(search, findings, named, zero_known, before, after, beside)
    diagnosis |= {"seconds": round(time.monotonic() - started, 1), "peak_memory_mib": round(peak_memory())}
    final = findings.left.attempt if findings.left else best
    machine = _corrected(final.fit, setting, diagnosis["clearance"]["after_m"])
    evidence = _evidence(search, findings, before, beside or after, diagnosis["verdict"])
    return Outcome(diagnosis, evidence | {"free_form": diagnosis["free_form"]}, machine, findings)


def _refuse_other_play(machine: SliderCrank) -> None:
    """At an encoder's rate nothing inside a clearance is resolved: the run is that of ideal joints."""
    for place in ("joint_b", "joint_c"):
        clearance = getattr(machine, place).clearance
        if clearance > 0.0:
            raise InputError(
                f"mechanism.{place}.clearance = {clearance:g}: recordings without accelerometers are "
                "compared with ideal joints, and only the clearance of joint= is fitted; set "
                f"mechanism.{place}.clearance=0"
            )


def _with_table(
    search: Search,
    findings: Findings,
    before: Judged,
    after: Judged,
    held_out: Sequence[Track],
    speed_range: tuple[float, float],
) -> Judged | None:
    """A force of free form that was found, beside held-out recordings; dropped if it does not help there.

    So is one that stands in the place of names, where these explain what was held out.
    """
    floor = after.explained.noise
    named = stands(findings, {"before": before.score(floor), "after": after.score(floor)})
    if findings.left is None or (named and not findings.left.beside):
        findings.left = None
        return None
    beside = Judged(findings.left.attempt, held_out, search, speed_range)
    noise = beside.explained.noise
    if beside.score(noise) < HELPS * after.score(noise):
        return beside
    findings.left = None
    return None


@contextmanager
def _interruptible(search: Search) -> Iterator[None]:
    """Within it Ctrl-C, SIGTERM and SIGHUP end the search as the time limit does; a second one the process.

    Not one that is ignored, as nohup has it.
    """

    def stop(number: int, frame: object) -> None:
        search.stopped = "it was interrupted"
        signal.signal(number, signal.default_int_handler)
        search.report("interrupted: what was found so far is judged and written; once more ends it at once")

    if threading.current_thread() is not threading.main_thread():  # signals are the main thread's
        yield
        return
    heard = [one for one in _ENDINGS if signal.getsignal(one) is not signal.SIG_IGN]
    before = {number: signal.signal(number, stop) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _corrected(found: Fit, setting: Setting, clearance: float | None) -> SliderCrank:
    """The machine with what was found; what recordings do not show of it stays as it was."""
    corrected, _ = found.model.apply(found.shared)
    guess = found.model.guess(found.shared, found.own[0])
    if guess is not None:
        corrected = replace(corrected, drive=guess.machine.drive)
    if clearance is None:
        clearance = getattr(setting.machine, f"joint_{setting.joint.lower()}").clearance
    return Setting(corrected, setting.joint).with_clearance(clearance)


def _evidence(
    search: Search, findings: Findings, before: Judged, after: Judged, verdict: str
) -> dict[str, Any]:
    """What the report draws."""
    best, nominal = findings.left.attempt if findings.left else findings.best, findings.nominal
    enough, machine = findings.enough, search.model.machine
    assert enough is not None
    return {
        "where": maps(
            over(nominal.fit, search.tracks, enough), over(best.fit, search.tracks, enough),
            (angles(nominal.fit, search.tracks), angles(best.fit, search.tracks)), enough.channels,
            search.tracks[0].rate,
        ),
        "ranking": _ranking(findings, verdict),
        "overlays": _overlays(before, after),
        "checks": whiteness(
            after.explained.channels,
            scaled(after.fit, after.tracks, after.explained, after.explained.noise),
        ),
        "noise": dict(zip(enough.channels, enough.noise.tolist(), strict=True)),
        "mechanism": {
            "crank_length": machine.crank.length, "rod_length": machine.rod.length,
            "offset": machine.guide_offset,
        },
    }  # fmt: skip


def _require_plausible(findings: Findings, search: Search) -> None:
    """No verdict on a machine that is not this one."""
    pairs = list(zip(search.tracks, findings.best.fit.residuals, strict=True))
    for name, channels in {track.name: track.channels for track in search.tracks}.items():
        values = np.concatenate([track.values for track in search.tracks if track.name == name])
        squares = np.concatenate([rest**2 for track, rest in pairs if track.name == name])
        for i, channel in enumerate(channels):
            if not channel.startswith("slider_"):
                continue
            left = float(squares[:, i].mean() / np.maximum(values[:, i].var(), 1e-300))
            if not left < 1.0 - _UNLIKELY:
                raise InputError(
                    f"{name}: this mechanism explains {max(0.0, 1.0 - left):.0%} of {channel}; is it "
                    "another machine's, are columns swapped or in other units, or is its speed outside "
                    "speed_range?"
                )


def _ranking(findings: Findings, verdict: str) -> list[dict[str, Any]]:
    rows: dict[str, dict[str, Any]] = {}
    for attempt in sorted([findings.best, *findings.attempts, *findings.instead], key=lambda a: a.price):
        if not attempt.terms or attempt.label in rows:
            continue
        kinds = {term.effect.kind for term in attempt.terms}
        rows[attempt.label] = {
            "name": attempt.label,
            "kind": kinds.pop() if len(kinds) == 1 else "mixed",
            "log_likelihood_gain": 0.5 * (findings.nominal.fit.cost - attempt.fit.cost),
            "p_value": None,
            "parameters": {
                name: {
                    "value": e.value, "low": e.low, "high": e.high, "unit": term.effect.parameter(name).unit,
                }
                for term in attempt.terms for name, e in estimates(attempt, term).items()
            },
            "asserted": attempt is findings.best and verdict != "unknown",
            "note": "",
        }  # fmt: skip
    for label, gain in sorted(findings.screened.items(), key=lambda kv: -kv[1])[:20]:
        if all(label not in name for name in rows):
            rows[label] = {
                "name": label, "kind": "instrument" if label.startswith("sensor_") else "physics",
                "log_likelihood_gain": 0.5 * max(gain, 0.0), "p_value": None, "parameters": {},
                "asserted": False, "note": "screened only: gain as the linearised model foresees it",
            }  # fmt: skip
    return list(rows.values())


def _overlays(before: Judged, after: Judged) -> list[dict[str, Any]]:
    """Recorded beside both models, for the first held-out recording."""
    track = after.tracks[0]
    recorded = track.values[track.judged][:SHOWN]
    found = []
    for i, channel in enumerate(track.channels):
        one = {
            name: recorded[:, i] - judged.fit.residuals[0][:SHOWN, i]
            for name, judged in (("before", before), ("after", after))
        }
        found.append(
            {
                "channel": channel, "unit": si_unit(channel),
                "time_s": (track.judged.start + np.arange(len(recorded))) / track.rate,
                "recorded": recorded[:, i], **one,
            }
        )  # fmt: skip
    return found
