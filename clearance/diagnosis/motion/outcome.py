"""Carry out a diagnosis of motion alone and gather what it says, for the contract and the report."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.mismatch import whiteness
from clearance.diagnosis.judging.outcome import Outcome
from clearance.diagnosis.motion.attempt import Attempt, Findings
from clearance.diagnosis.motion.beginning import begin
from clearance.diagnosis.motion.fit import Fit, fit
from clearance.diagnosis.motion.model import Model, encoder_zero, gather
from clearance.diagnosis.motion.rest import Explained, angles, explained
from clearance.diagnosis.motion.search import Search
from clearance.diagnosis.motion.track import Track
from clearance.diagnosis.motion.verdict import (
    clearance_of,
    effects,
    estimates,
    sentences,
    uncertain_of,
    verdict_of,
)
from clearance.diagnosis.motion.where import maps, summary
from clearance.errors import InputError
from clearance.provenance import peak_memory
from clearance.recording.channels import si_unit

METRIC = "root mean square of whole-run residuals over the noise of each channel"
_SHOWN = 1500  # samples of an overlay
_DRAWS = 400  # of the interval
_BLOCKS = 20  # parts of the held-out recordings that are drawn
_UNLIKELY = 0.25  # share of a channel's variance that the mechanism must explain


def diagnose(
    tracks: Sequence[Track],
    held_out: Sequence[Track],
    setting: Setting,
    named: Sequence[Effect],
    uncertain: Mapping[str, tuple[float, float]],
    zero_known: bool,
    speed_range: tuple[float, float],
    workers: int,
    most: int,
    report: Callable[[str], None],
    keep: Callable[[Findings], None] = lambda _: None,
) -> Outcome[Findings]:
    """Find what the nominal machine lacks, from how its crank turns and its slider moves.

    Args:
        tracks: to fit; selection sees only these.
        held_out: to judge by.
        setting: the nominal machine and the joint.
        named: effects to try.
        uncertain: paths of the mechanism that are known only roughly, to their bounds.
        zero_known: whether an encoder's zero that is off is a fault, not a matter of course.
        speed_range: [rad/s], where no channel tells the speed.
        workers: threads.
        most: effects at once.
        report: called with progress.
        keep: called after each stage with what was found so far.

    Raises:
        InputError: a recording that no machine of this kind could have made.
    """
    started = time.monotonic()
    machine, joint = setting.with_clearance(0.0), setting.joint
    guesses = [begin(track, speed_range) for track in tracks]
    turns = float(np.mean([abs(guess[3]) for guess in guesses])) / 60.0
    terms = gather(named, machine, joint, tracks, list(uncertain), max(turns, 0.1))
    search = Search(tracks, machine, joint, terms, dict(uncertain), speed_range, workers, report)
    findings = search.run(most, keep)
    _require_plausible(findings, search)
    report(f"[{time.monotonic() - started:.0f} s] judging on held-out recordings")
    best, nominal = findings.best, findings.nominal
    after = _Judged(best, held_out, search, speed_range)
    before = _Judged(nominal, held_out, search, speed_range) if best is not nominal else after
    floor = after.explained.noise
    held = {"before": before.score(floor), "after": after.score(floor), "floor": 1.0}
    held["low"], held["high"] = after.interval(floor)
    alike = search.equivalents(findings)
    bias = next((e for e in named if e.name == "sensor_bias"), None)
    zero = encoder_zero(bias) if bias is not None and zero_known else None
    verdict = verdict_of(findings, alike, zero, held["after"])
    asserted = effects(findings, zero, _probability(findings))
    assert findings.enough is not None
    noise = findings.enough.noise
    rests = _over(nominal.fit, search.tracks, findings.enough)
    turned = angles(nominal.fit, search.tracks)
    rate = search.tracks[0].rate
    where = summary(rests, turned, findings.enough.channels, rate)
    shown = [c for c, s in sorted(where["channels"].items(), key=lambda kv: -kv[1]) if s > 0.1][:3]
    shown = shown or list(findings.enough.channels)[:1]
    clearance = clearance_of(best.fit)
    singles, combinations = uncertain_of(best.fit)
    names = [
        *([t.name for t in best.terms]), *([zero.name] if findings.zero and zero is not None else [])
    ]  # fmt: skip
    first = asserted[0][0] if asserted else None
    claimed = [] if verdict in ("none", "unknown") else [described for _, _, described in asserted]
    diagnosis: dict[str, Any] = {
        "verdict": verdict,
        "summary": sentences(
            verdict, findings, asserted, alike, held, shown, clearance, (singles, combinations)
        ),
        "mismatch": {
            "detected": verdict != "none", "p_value": None,
            "body": first.place(joint) if first else None, "direction": first.direction if first else None,
            **where,
        },
        "effects": claimed,
        "equivalent": [names, *([t.name for t in a.terms] for a in alike)] if alike else [],
        "next_experiment": _next_experiment(alike, tracks),
        "free_form": None,
        "fit": {"metric": METRIC, "held_out": held},
        "clearance": clearance,
        "uncertain": singles,
        "combinations": combinations,
        "recordings": [
            _about(track, r, best.fit, held_out, turned[r]) for r, track in enumerate(search.tracks)
        ],
        "warnings": [
            f"{track.name}: left out, for showing nothing but a constant: {', '.join(track.silent)}"
            for track in tracks if track.silent
        ],
        "seconds": round(time.monotonic() - started, 1),
        "peak_memory_mib": round(peak_memory()),
    }  # fmt: skip
    evidence = {
        "where": maps(
            rests, _over(best.fit, search.tracks, findings.enough), (turned, angles(best.fit, search.tracks)),
            findings.enough.channels, rate,
        ),
        "ranking": _ranking(findings),
        "overlays": _overlays(before, after),
        "checks": whiteness(
            after.explained.channels, _scaled(after.fit, after.tracks, after.explained, floor)
        ),
        "noise": dict(zip(findings.enough.channels, noise.tolist(), strict=True)),
        "mechanism": {
            "crank_length": machine.crank.length, "rod_length": machine.rod.length,
            "offset": machine.guide_offset,
        },
    }  # fmt: skip
    corrected, _ = best.fit.model.apply(best.fit.shared)
    guess = best.fit.model.guess(best.fit.shared, best.fit.own[0])
    if guess is not None:
        corrected = replace(corrected, drive=guess.machine.drive)
    seen = clearance["after_m"]
    if seen is None:  # what recordings do not show stays as it was
        seen = getattr(setting.machine, f"joint_{joint.lower()}").clearance
    corrected = Setting(corrected, joint).with_clearance(seen)
    return Outcome(diagnosis, evidence, corrected, findings)


class _Judged:
    """An attempt beside recordings that it was not fitted to: only start and drive's speed are free."""

    def __init__(
        self, attempt: Attempt, held_out: Sequence[Track], search: Search, speeds: tuple[float, float]
    ) -> None:
        model = attempt.fit.model
        machine, instrument = model.apply(attempt.fit.shared)
        fixed = Model(
            machine, model.joint, with_zero=model.with_zero, instrument=instrument,
            known_clearance=model.clearance(attempt.fit.shared),
        )  # fmt: skip
        filtered = search.tracks[0].low_pass is not None
        self.tracks = [
            t if t.declared else replace(t, low_pass=t.usual_low_pass if filtered else None) for t in held_out
        ]
        start = np.array([begin(track, speeds) for track in self.tracks])
        start[:, 4] = attempt.fit.own[0, 4]
        self.fit: Fit = fit(fixed, self.tracks, np.zeros(0), start, start, search.workers, staged=True)
        self.explained: Explained = explained(self.fit, self.tracks)

    def squares(self, noise: np.ndarray) -> np.ndarray:
        """(samples,) mean over channels of squared residuals over noise."""
        return np.concatenate(
            [(r**2).mean(axis=1) for r in _scaled(self.fit, self.tracks, self.explained, noise)]
        )

    def score(self, noise: np.ndarray) -> float:
        """Root mean square over the noise."""
        return float(np.sqrt(self.squares(noise).mean()))

    def interval(self, noise: np.ndarray) -> tuple[float, float]:
        """95 % interval of the score by drawing blocks (Kuensch 1989)."""
        generator = np.random.default_rng(0)
        means = np.array([part.mean() for part in np.array_split(self.squares(noise), _BLOCKS)])
        drawn = means[generator.integers(0, _BLOCKS, (_DRAWS, _BLOCKS))].mean(axis=1)
        low, high = np.sqrt(np.quantile(drawn, [0.025, 0.975]))
        return float(low), float(high)


def _scaled(found: Fit, tracks: Sequence[Track], about: Explained, noise: np.ndarray) -> list[np.ndarray]:
    """Residuals over the noise; channels that a recording lacks count as noise."""
    scaled = []
    for track, rest in zip(tracks, found.residuals, strict=True):
        values = np.ones((len(rest), len(about.channels)))
        for i, channel in enumerate(about.channels):
            if channel in track.channels:
                values[:, i] = rest[:, track.channels.index(channel)] / noise[i]
        scaled.append(values)
    return scaled


def _over(found: Fit, tracks: Sequence[Track], about: Explained) -> list[np.ndarray]:
    return _scaled(found, tracks, about, about.noise)


def _require_plausible(findings: Findings, search: Search) -> None:
    """No verdict on a machine that is not this one."""
    for track, rest in zip(search.tracks, findings.best.fit.residuals, strict=True):
        for i, channel in enumerate(track.channels):
            if not channel.startswith("slider_"):
                continue
            left = float((rest[:, i] ** 2).mean() / np.maximum(track.values[:, i].var(), 1e-300))
            if not left < 1.0 - _UNLIKELY:
                raise InputError(
                    f"{track.name}: this mechanism explains {max(0.0, 1.0 - left):.0%} of {channel}; is it "
                    "another machine's, are columns swapped or in other units, or is its speed outside "
                    "speed_range?"
                )


def _probability(findings: Findings) -> float:
    """Of the best attempt among all: exp(-difference / 2) of prices."""
    prices = np.array([a.price for a in (findings.best, findings.nominal, *findings.attempts)])
    names = [a.label for a in (findings.best, findings.nominal, *findings.attempts)]
    cheapest = {n: min(p for m, p in zip(names, prices, strict=True) if m == n) for n in names}
    weights = {n: float(np.exp(-0.5 * min(p - prices.min(), 1400.0))) for n, p in cheapest.items()}
    return weights[findings.best.label] / sum(weights.values())


def _ranking(findings: Findings) -> list[dict[str, Any]]:
    rows: dict[str, dict[str, Any]] = {}
    for attempt in sorted([findings.best, *findings.attempts, *findings.instead], key=lambda a: a.price):
        if not attempt.terms or attempt.label in rows:
            continue
        rows[attempt.label] = {
            "name": attempt.label,
            "kind": attempt.terms[-1].effect.kind,
            "log_likelihood_gain": 0.5 * (findings.nominal.fit.cost - attempt.fit.cost),
            "p_value": None,
            "parameters": {
                name: {
                    "value": e.value, "low": e.low, "high": e.high, "unit": term.effect.parameter(name).unit,
                }
                for term in attempt.terms for name, e in estimates(attempt, term).items()
            },
            "asserted": attempt is findings.best,
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


def _overlays(before: _Judged, after: _Judged) -> list[dict[str, Any]]:
    """Recorded beside both models, for the first held-out recording."""
    track = after.tracks[0]
    recorded = track.values[track.judged][:_SHOWN]
    found = []
    for i, channel in enumerate(track.channels):
        one = {
            name: recorded[:, i] - judged.fit.residuals[0][:_SHOWN, i]
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


def _about(track: Track, r: int, found: Fit, held_out: Sequence[Track], turned: np.ndarray) -> dict[str, Any]:
    return {
        "name": track.name, "seconds": track.seconds, "rate_hz": track.rate, "channels": list(track.channels),
        "speed_rpm": float((turned[-1] - turned[0]) / (len(turned) - 1) * track.rate * 30.0 / np.pi),
        "drive_speed_rpm": float(found.own[r, 3]),
        "encoder_zero_rad": float(found.own[r, 4]) if found.model.with_zero else None,
        "filtered": track.low_pass is not None,
        "held_out_seconds": sum(o.seconds for o in held_out if o.name == track.name),
    }  # fmt: skip


def _next_experiment(alike: Sequence[Attempt], tracks: Sequence[Track]) -> str | None:
    """What usually separates effects of motion; nothing is reckoned here."""
    if not alike:
        return None
    lacking = [c for c in ("crank_angle", "slider_position", "drive_torque") if c not in tracks[0].channels]
    usual = "record a clearly different speed, or a start from rest: delays and forces scale with it."
    return f"Record {lacking[0]} too, or {usual}" if lacking else usual.capitalize()
