"""What a diagnosis says: the contract's JSON, from what the search found and how it stood the test."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from clearance.diagnosis.following.attempt import EXPLAINED, Attempt, explained
from clearance.diagnosis.hypotheses.clipping import unasked
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.judging.contradiction import contradictions
from clearance.diagnosis.judging.detectability import seen_beside
from clearance.diagnosis.judging.free_form import free_form_of
from clearance.diagnosis.judging.held_out import Judged, likelier
from clearance.diagnosis.judging.impacts import LEAST_RATE
from clearance.diagnosis.judging.mismatch import Innovations, interval, noticed, root_mean_square, summary
from clearance.diagnosis.judging.play import clearance_of
from clearance.diagnosis.judging.sensors import advice, calibrated_sensors, largest
from clearance.diagnosis.judging.separation import advised, experiments
from clearance.diagnosis.judging.true_seconds import by_true_seconds
from clearance.diagnosis.judging.verdict import (
    FITTED,
    basis_of,
    borne_out,
    effects_of,
    gone,
    lost,
    place_of,
    probabilities,
    rivals,
    unconfirmed,
    verdict_of,
)
from clearance.diagnosis.judging.words import located, sentences
from clearance.diagnosis.searching.argument import predicted
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import null_scores, p_value
from clearance.diagnosis.sensing.measured import Measured

_RATE = 1e4  # Hz, at which strikes are told apart
METRIC = (
    "root mean square of one-step prediction errors over a perfect model's, quietest nine tenths; one above "
    "4 standard deviations counts as twice its root"
)


def state(
    search: Search,
    explanation: Explanation,
    judged: Judged,
    errors: Sequence[Innovations],
    held_out: Sequence[Measured],
    joints: dict[str, float],
    stopped: str,
) -> dict[str, Any]:
    """The contract's JSON, but for time and memory.

    Args:
        search: which is over.
        explanation: what it found.
        judged: on held-out recordings.
        errors: innovations of the nominal machine where it was fitted.
        held_out: the recordings as they were given.
        joints: the nominal machine's misfit by joint.
        stopped: why not everything was tried; empty if it was.
    """
    setting, joint, best = search.setting, search.setting.joint, explanation.best
    # it may have been followed better since
    joints = {**joints, joint: min(joints[joint], explanation.nominal.misfit)}
    where, after = summary(errors), judged.after
    verdict, basis = verdict_of(explanation, after), basis_of(explanation, after)
    open_question = verdict == "unknown" and not explained(best)
    # at the strikes of a slider that the motion shows loose
    struck = gone(after, EXPLAINED) if basis == FITTED else []
    missed = lost(after) if verdict not in ("none", "unknown") and not struck else []
    fit = {"metric": METRIC, "held_out": _held_out(judged, struck, missed)}
    body, direction = place_of(explanation, after)
    (clearance, rests_on), others = clearance_of(explanation), rivals(verdict, explanation)
    named = effects_of(best, probabilities(explanation), basis) if verdict not in ("none", "unknown") else []
    sensors = calibrated_sensors(best) if explained(best) else {}  # what is missing would bend them
    further = _next_experiments(search, explanation, others)
    score = explanation.hints[0].gain if explanation.hints else None
    shows = noticed(where["channels"])
    simulations = 0 if explanation.simulated is None else len(explanation.simulated)
    return {
        "verdict": verdict,
        "summary": [
            *(contradictions(search) if open_question else []),
            *sentences(verdict, explanation, joint, fit, shows or list(where["channels"])[:1], after),
            *located(joints),
            *([largest(sensors)] if sensors else []),
            *([further["next_experiment"]] if further["next_experiment"] else []),
        ],
        "mismatch": {
            "detected": verdict != "none" and not unconfirmed(explanation, after), "score": score,
            "p_value": None if score is None else p_value(score, explanation.simulated),
            "simulations": simulations, "compared_with": simulations or len(null_scores()),
            "body": body, "direction": direction,
            **where,
        },
        "effects": named,
        "equivalent": [[h.name for h in a.hypotheses] for a in others] if len(others) > 1 else [],
        "equivalent_channels": [[h.channel for h in a.hypotheses] for a in others] if len(others) > 1 else [],
        **further,
        "free_form": _free_form(explanation, setting),
        "sensors": sensors,
        "smallest_seen": seen_beside(search, explanation),
        "fit": fit,
        "clearance": {
            "joint": joint, "misfit_by_joint": joints,
            "before_m": float(explanation.nominal.fit.values[0, 0]),
            "after_m": clearance.value, "low_m": clearance.low, "high_m": clearance.high, "basis": rests_on,
        },
        "recordings": [
            {
                "name": one.name, "seconds": one.seconds, "rate_hz": one.chain.rate,
                "channels": list(one.channels),
                "speed_rpm": by_true_seconds(best, known.speed) * 30.0 / np.pi,
                "held_out_seconds": sum(o.seconds for o in judged.held_out if o.name == one.name),
            }
            for one, known in zip(search.recordings, search.alignments, strict=True)
        ] + [
            {
                "name": one.name, "seconds": 0.0, "rate_hz": one.chain.rate, "channels": list(one.channels),
                "speed_rpm": None, "held_out_seconds": one.seconds,
            }
            for one in judged.held_out if one.name not in {fitted.name for fitted in search.recordings}
        ],
        "warnings": [
            *_of_signals([*search.recordings, *held_out]),
            *_of_limits(unasked(search.recordings, search.groups.values())),
            *_of_judging(explanation, judged, struck, missed),
            *([f"Not everything was tried: {stopped}."] if stopped else []),
            *(_of_recordings(search) if open_question else []),
        ],
    }  # fmt: skip


def _free_form(explanation: Explanation, setting: Setting) -> dict[str, Any] | None:
    """The force without a name, and what it leaves of parts left out, as a function of which argument."""
    found = free_form_of(explanation.best, setting, explanation.shaken)
    return found and {**found, "left_out": predicted(explanation)}


def _held_out(judged: Judged, struck: Sequence[str], missed: Sequence[str]) -> dict[str, Any]:
    """Errors on held-out recordings; of those that were lost it is said, and what the others are."""
    low, high = interval(judged.errors_after)
    held: dict[str, Any] = {
        "before": root_mean_square(judged.errors_before), "after": root_mean_square(judged.errors_after),
        "floor": 1.0, "low": low, "high": high,
    }  # fmt: skip
    gain = 0.5 * likelier(judged.after, judged.before)
    if judged.after is not judged.before and gain != 0.0:
        held["log_likelihood_gain"] = gain
    if judged.withdrawn:
        held["candidates"] = 1 + len(judged.withdrawn)
    if struck:
        held["lost"] = struck
    if missed:
        each = zip(judged.errors_after, judged.after.followers, strict=True)
        held["followed"] = root_mean_square([e for e, one in each if one.measured.name not in missed])
    if judged.shares:
        held["shares"] = {name: round(share, 3) for name, share in judged.shares.items()}
    return held


def _of_signals(recordings: Sequence[Measured]) -> list[str]:
    """Warnings of what was not taken as it was recorded."""
    each = {one.name: one for one in recordings}.values()
    return [
        *(
            f"{one.name}: left out, for showing nothing but a constant, or one for a time: "
            f"{', '.join(one.silent)}"
            for one in each if one.silent
        ),
        *(
            f"{one.name}: accelerations have no noise to speak of there, as simulations have none; 1 % "
            "of the signal was added, or errors of the simulator would count as something missing."
            for one in each if one.noiseless
        ),
    ]  # fmt: skip


def _of_recordings(search: Search) -> list[str]:
    """What the recordings themselves may be the reason of, where nothing explains them."""
    rate = search.recordings[0].chain.rate
    slow = (
        f"At {rate:g} Hz strikes of the journal run together, and paths through a wide clearance are lost: "
        f"record at {_RATE:g} Hz or more."
    )
    return [*([slow] if rate < LEAST_RATE else []), *advice(search.recordings)]


def _of_limits(limits: Mapping[str, float]) -> list[str]:
    """Warnings of sensors that stop at a limit without a hypothesis that says so."""
    return [
        f"{channel} stops at {limit:.4g} m/s², and sensor_saturation is not among the hypotheses: what is "
        "cut off there counts as if it had been measured; add it to hypotheses, or leave the channel out."
        for channel, limit in limits.items()
    ]


def _of_judging(
    explanation: Explanation, judged: Judged, struck: Sequence[str], missed: Sequence[str]
) -> list[str]:
    """Warnings of what held-out recordings do not bear out."""
    best = explanation.best
    followed = explained(best) and best is not explanation.shown
    changed = followed and not borne_out(explanation, judged.after)
    return [
        *(["What explains the fitted recordings does not explain the held-out ones."] if changed else []),
        *(
            f"{label} is not asserted: held-out recordings are explained as well with less."
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
    ]


def _next_experiments(search: Search, explanation: Explanation, rivals: Sequence[Attempt]) -> dict[str, Any]:
    """Recordings that would separate explanations which do equally well, and the best of them in words."""
    if len(rivals) < 2:
        return {"next_experiment": None, "experiments": []}
    if any(h.name == "timebase" for one in rivals for h in one.hypotheses):
        return {"next_experiment": "Set the recorder's clock beside another one.", "experiments": []}
    found = experiments(explanation, rivals, search.recordings, search.late)
    said = advised(found, not search.late())
    return {"next_experiment": said, "experiments": [asdict(one) for one in found]}
