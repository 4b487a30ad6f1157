"""What a diagnosis of motion says: the contract's JSON, from what was found and how it stood the test."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.judging.mismatch import noticed
from clearance.diagnosis.motion.attempt import Attempt, Findings
from clearance.diagnosis.motion.fit import Fit
from clearance.diagnosis.motion.judged import Judged, over
from clearance.diagnosis.motion.model import encoder_zero
from clearance.diagnosis.motion.remainder import described
from clearance.diagnosis.motion.rest import angles
from clearance.diagnosis.motion.search import Search
from clearance.diagnosis.motion.track import Track
from clearance.diagnosis.motion.verdict import (
    clearance_of,
    effects,
    sentences,
    stands,
    uncertain_of,
    verdict_of,
    whole,
)
from clearance.diagnosis.motion.where import summary

_WHOLE = 0.95  # of the seconds that were recorded: less is said
METRIC = "root mean square of whole-run residuals over the noise of each channel"


def state(
    search: Search,
    findings: Findings,
    named: Sequence[Effect],
    zero_known: bool,
    before: Judged,
    after: Judged,
    beside: Judged | None,
) -> dict[str, Any]:
    """The contract's JSON, but for time and memory.

    Args:
        search: which is over.
        findings: of it.
        named: effects that were tried.
        zero_known: whether an encoder's zero that is off is a fault, not a matter of course.
        before: the nominal machine beside held-out recordings.
        after: the best one.
        beside: it with what it leaves as a force of free form, if there is one.
    """
    best, nominal, joint, enough = findings.best, findings.nominal, search.model.joint, findings.enough
    assert enough is not None
    floor = after.explained.noise
    held = {"before": before.score(floor), "after": after.score(floor), "floor": 1.0}
    held["low"], held["high"] = after.interval(floor)
    shown = held if beside is None else _with_table(findings, before, after, beside)
    bias = next((e for e in named if e.name == "sensor_bias"), None)
    zero = encoder_zero(bias) if bias is not None and zero_known else None
    alike = search.equivalents(findings, zero is not None) if stands(findings, held) else []
    verdict = verdict_of(findings, alike, zero, held)
    asserted = effects(findings, zero, _probability(search, findings))
    turned = angles(nominal.fit, search.tracks)
    where = summary(over(nominal.fit, search.tracks, enough), turned, enough.channels, search.tracks[0].rate)
    alone = findings.left is not None and not findings.left.beside
    numbers = findings.left.attempt.fit if findings.left is not None and alone else best.fit
    shows = noticed(where["channels"]) or list(enough.channels)[:1]
    clearance, (singles, combinations) = clearance_of(numbers, whole(findings, held)), uncertain_of(numbers)
    names = [
        *(t.name for t in best.terms), *([zero.name] if findings.zero and zero is not None else [])
    ]  # fmt: skip
    channels = [
        *(t.effect.channel or None for t in best.terms),
        *([zero.channel] if findings.zero and zero is not None else []),
    ]
    table = None if findings.left is None else described(findings.left)
    first = asserted[0][0] if asserted else None
    body, direction = (first.place(joint), first.direction) if first else (None, None)
    if table is not None and (verdict == "unknown" or first is None):
        body, direction = table["body"], table["direction"]
    return {
        "verdict": verdict,
        "summary": sentences(
            verdict, findings, asserted, alike, held, shown, shows, clearance, (singles, combinations)
        ),
        "mismatch": {
            "detected": verdict != "none", "p_value": None,
            "body": body, "direction": direction,
            **where,
        },
        "effects": [] if verdict in ("none", "unknown") else [described for _, _, described in asserted],
        "equivalent": [names, *([t.name for t in a.terms] for a in alike)] if alike else [],
        "equivalent_channels": [channels, *([t.effect.channel or None for t in a.terms] for a in alike)]
        if alike else [],
        "next_experiment": _next_experiment(alike, search.tracks),
        "free_form": table,
        "fit": {"metric": METRIC, "held_out": shown},
        "clearance": clearance,
        "uncertain": singles,
        "combinations": combinations,
        "recordings": [
            _about(name, search, best.fit, after.tracks, turned)
            for name in dict.fromkeys(track.name for track in search.tracks)
        ] + _only_held_out(search, after.tracks),
        "warnings": _warnings(search),
    }  # fmt: skip


def _with_table(findings: Findings, before: Judged, after: Judged, beside: Judged) -> dict[str, float]:
    """Errors on held-out recordings, after all with the table; ``named``: by names alone."""
    floor = beside.explained.noise
    low, high = beside.interval(floor)
    named = findings.left is not None and findings.left.beside
    return {
        "before": before.score(floor), **({"named": after.score(floor)} if named else {}),
        "after": beside.score(floor), "floor": 1.0, "low": low, "high": high,
    }  # fmt: skip


def _probability(search: Search, findings: Findings) -> float:
    """Of the best attempt among those with no more unknowns that are sure of their terms.

    It is exp(-difference / 2) of prices. What is richer may be cheaper and was passed over all the same:
    the search prefers fewer terms that do nearly as much.
    """
    richest = len(findings.best.fit.model.shared)
    others = [a for a in findings.attempts if search.sure(a) and len(a.fit.model.shared) <= richest]
    prices = np.array([a.price for a in (findings.best, findings.nominal, *others)])
    names = [a.label for a in (findings.best, findings.nominal, *others)]
    cheapest = {n: min(p for m, p in zip(names, prices, strict=True) if m == n) for n in names}
    weights = {n: float(np.exp(-0.5 * min(p - prices.min(), 1400.0))) for n, p in cheapest.items()}
    return weights[findings.best.label] / sum(weights.values())


def _about(
    name: str, search: Search, found: Fit, held_out: Sequence[Track], turned: Sequence[np.ndarray]
) -> dict[str, Any]:
    """One recording, of all its stretches."""
    places = [r for r, track in enumerate(search.tracks) if track.name == name]
    tracks = [search.tracks[r] for r in places]
    speeds = [np.ptp(turned[r]) / (len(turned[r]) - 1) * search.tracks[r].rate for r in places]
    sense = np.sign(sum(turned[r][-1] - turned[r][0] for r in places))
    return {
        "name": name, "seconds": sum(track.seconds for track in tracks), "rate_hz": tracks[0].rate,
        "channels": list(tracks[0].channels),
        "speed_rpm": float(sense * np.mean(speeds) * 30.0 / np.pi),
        "drive_speed_rpm": float(found.own[places, 3].mean()),
        "encoder_zero_rad": float(found.own[places, 4].mean()) if found.model.with_zero else None,
        "filtered": tracks[0].low_pass is not None,
        "stretch_seconds": tracks[0].seconds if search.turns is not None else None,
        "held_out_seconds": sum(o.seconds for o in held_out if o.name == name),
    }  # fmt: skip


def _only_held_out(search: Search, held_out: Sequence[Track]) -> list[dict[str, Any]]:
    """Recordings of which nothing was fitted."""
    fitted = {track.name for track in search.tracks}
    others = {track.name: track for track in held_out if track.name not in fitted}
    return [
        {
            "name": name, "seconds": 0.0, "rate_hz": track.rate, "channels": list(track.channels),
            "speed_rpm": None, "held_out_seconds": sum(o.seconds for o in held_out if o.name == name),
        }
        for name, track in others.items()
    ]  # fmt: skip


def _warnings(search: Search) -> list[str]:
    """What a user should know about the recordings."""
    silent = {track.name: ", ".join(track.silent) for track in search.tracks if track.silent}
    found = [
        f"{name}: left out, for showing nothing but a constant: {those}" for name, those in silent.items()
    ]
    recorded = {channel for track in search.tracks for channel in track.channels}
    turned = [channel for channel in search.linkage.turned if channel in recorded]
    if turned:
        scales = ", ".join(f"{channel}: -1.0" for channel in turned)
        found.append(
            f"{', '.join(turned)}: taken with the other sign, without which angle and position do not belong "
            "to this linkage; if that is right, say so in the YAML beside the files, "
            f"scale: {{{scales}}}, times a scale that is given there"
        )
    if search.turns is not None:
        found.append(
            f"The recordings are compared in stretches of {search.turns:g} turns, each with a beginning of "
            "its own: over more the machine goes astray from the model, pushed by what is not in it"
        )
        compared = sum(track.seconds for track in search.tracks)
        if compared < _WHOLE * search.recorded:
            found[-1] += (
                f"; {len(search.tracks)} of them, {compared:.3g} of {search.recorded:.3g} s, spread evenly"
            )
    if search.stopped:
        found.append(f"Not everything was tried: {search.stopped}.")
    return found


def _next_experiment(alike: Sequence[Attempt], tracks: Sequence[Track]) -> str | None:
    """What usually separates effects of motion; nothing is reckoned here."""
    if not alike:
        return None
    lacking = [c for c in ("crank_angle", "slider_position", "drive_torque") if c not in tracks[0].channels]
    usual = "record a clearly different speed, or a start from rest: delays and forces scale with it."
    return f"Record {lacking[0]} too, or {usual}" if lacking else usual.capitalize()
