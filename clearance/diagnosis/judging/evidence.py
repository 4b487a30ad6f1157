"""What the report draws: where it shows, what was tried, and both models beside the recordings."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.missing_force import PLACES
from clearance.diagnosis.judging.free_form import free_form_of
from clearance.diagnosis.judging.mismatch import Innovations, innovations, locate, whiteness
from clearance.diagnosis.judging.nominal_map import nominal_map
from clearance.diagnosis.judging.signature import signatures
from clearance.diagnosis.judging.verdict import effects_of, probabilities
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import p_value
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.diagnosis.shooting.follow import alike
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import si_unit
from clearance.simulation.layout import Signal, State

SHOWN = 1500  # samples of an overlay
_DRAWS = 100  # of unknown forces from what is known of them: their scatter is the band
_HINTS = 15  # hypotheses of the ranking that were not fitted
_UNITS = {"torque": "N m", "moment": "N m", "x": "N"}


def gather_evidence(
    search: Search,
    explanation: Explanation,
    held_out: Sequence[Measured],
    before: Attempt,
    after: Attempt,
    errors: Sequence[Innovations],
    here: Sequence[dict[str, Any]],
    verdict: str,
) -> dict[str, Any]:
    """Everything that the report draws beside the diagnosis.

    Args:
        search: that ended.
        explanation: what it found.
        held_out: recordings that it was not fitted to.
        before: the nominal machine beside them.
        after: the best machine beside them.
        errors: of the nominal machine beside the recordings that were fitted.
        here: the smallest sizes of effects that these would have shown.
        verdict: of the diagnosis.
    """
    best, nominal, setting = explanation.best, explanation.nominal, search.setting
    body = best.hypotheses[0].body if best.hypotheses else ""
    clearance, speed = best.fit.values[0, [0, -1]]
    # the nominal machine's own path is torn where much is missing; another one's shows what is
    same = alike(best.model.machine(best.fit.values[0]), nominal.model.machine(nominal.fit.values[0]))
    sound = all(hypothesis.fault is None for hypothesis in best.hypotheses)
    along = best if explained(best) and same and sound else nominal
    curve = free_form_of(best, setting, explanation.shaken)
    judged = innovations(after, setting.joint)
    return {
        "where": locate(errors, innovations(best, setting.joint)),
        "ranking": _ranking(explanation, verdict),
        "overlays": _overlays(before, after),
        "checks": whiteness(judged[0].channels, [one.values for one in judged]),
        "clearance_profile": {
            "clearance_m": search.profile.clearance.tolist(),
            "misfit": search.profile.misfit.round(4).tolist(),
        },
        "missing_force": sorted(_missing_force(search, along), key=lambda one: one["body"] != body),
        "signatures": _signatures(held_out, before, after, nominal, best, search.workers),
        "detectability": nominal_map(
            setting, float(clearance), float(speed), search.recordings[0].channels, here
        ),
        **({"free_form": curve} if curve else {}),
        "mechanism": {
            "crank_length": setting.machine.crank.length, "rod_length": setting.machine.rod.length,
            "offset": setting.machine.guide_offset,
        },
    }  # fmt: skip


def _missing_force(search: Search, along: Attempt) -> list[dict[str, Any]]:
    """Unknown forces beside the nominal model on the paths of an attempt: what it lacks, with 95 % bands."""
    free = search.loosened(along)
    random = np.random.default_rng(0)
    found = []
    for trace, follower, one in zip(search.traces, free.followers, free.fit.passes, strict=True):
        if not follower.path.inputs.any():  # no force was found with which it is followed better
            continue
        middle = one.signals[:, one.signals.shape[1] // 2]
        angle = np.degrees(middle[:, Signal.CRANK_ANGLE] % (2.0 * np.pi))
        inputs, count = follower.path.inputs, len(follower.input_sigma)
        drawn = np.array([one.draw(random)[:, -count:] for _ in range(_DRAWS)])
        deviation = drawn.std(axis=0) * follower.input_sigma
        for i, (body, direction) in enumerate(PLACES):
            value, half = inputs[:, i], 1.96 * deviation[:, i]
            found.append(
                {
                    "recording": trace.measured.name, "body": body, "direction": direction,
                    "unit": _UNITS[direction],
                    "time_s": (follower.measured.segment * np.arange(len(value))).round(6).tolist(),
                    "value": value.round(5).tolist(), "low": (value - half).round(5).tolist(),
                    "high": (value + half).round(5).tolist(),
                    "crank_angle_deg": angle.round(2).tolist(),
                    "slider_position_m": middle[:, Signal.SLIDER_POSITION].round(6).tolist(),
                    "slider_velocity_m_s": middle[:, Signal.SLIDER_VELOCITY].round(5).tolist(),
                }
            )  # fmt: skip
    return found


def _signatures(
    held_out: Sequence[Measured],
    before: Attempt,
    after: Attempt,
    nominal: Attempt,
    best: Attempt,
    workers: int,
) -> dict[str, Any]:
    """Phase averages, spectra and impacts of held-out recordings and of free runs of both machines."""

    def machines(attempt: Attempt, judged: Attempt) -> list[SliderCrank]:
        return [attempt.model.machine(row) for row in judged.fit.values]

    starts = [f.path.nodes[0] for f in after.followers]
    speeds = [float(f.path.nodes[:, State.CRANK_SPEED].mean()) for f in after.followers]
    angles = [
        float(node[State.CRANK_ANGLE]) - speed * one.segment * (f.measured.first - one.first)
        for node, speed, one, f in zip(starts, speeds, held_out, after.followers, strict=True)
    ]
    return signatures(
        [one.judged(best.sensors) for one in held_out], speeds, angles,
        machines(nominal, before), machines(best, after), best.model.instrument(best.fit.values[0]), workers,
    )  # fmt: skip


def _ranking(explanation: Explanation, verdict: str) -> list[dict[str, Any]]:
    samples, chance = sum(p.samples for p in explanation.nominal.fit.passes), probabilities(explanation)
    rows = []
    best = explanation.best
    tried = {id(a): a for a in [*explanation.attempts, explanation.shown] if a is not None}
    for attempt in sorted(tried.values(), key=explanation.price):
        effects = effects_of(attempt, chance)
        fall = samples * (explanation.nominal.misfit - attempt.misfit)
        rows.append(
            {
                "name": " + ".join(h.label for h in attempt.hypotheses),
                "kind": _kind(attempt),
                "log_likelihood_gain": 0.5 * fall,
                "p_value": None,  # chance is known of what a look promises, not of what a fit takes away
                "parameters": _parameters(attempt, effects),
                "asserted": attempt is best and (verdict != "unknown" or attempt is explanation.shown),
                "note": f"misfit {attempt.misfit:.3g} (1 is perfect)"
                + (
                    "; withdrawn: may as well be off, or another one does as well or better"
                    if attempt.withdrawn
                    else ""
                ),
            }
        )
    for hint in explanation.hints[:_HINTS]:
        if all(hint.label not in str(row["name"]) for row in rows):
            rows.append(
                {
                    "name": hint.label, "kind": hint.hypotheses[0].kind,
                    "log_likelihood_gain": 0.5 * hint.gain,
                    "p_value": p_value(hint.gain, explanation.simulated), "parameters": {},
                    "asserted": False, "note": "no fit was kept: others promise more, or it was given up",
                }
            )  # fmt: skip
    return rows


def _kind(attempt: Attempt) -> str:
    kinds = {hypothesis.kind for hypothesis in attempt.hypotheses}
    return kinds.pop() if len(kinds) == 1 else "mixed"


def _parameters(attempt: Attempt, effects: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Of all effects of an attempt; where two have one of the same name, with the effect that it is of."""
    names = [name for effect in effects for name in effect["parameters"]]
    found = {}
    for hypothesis, effect in zip(attempt.hypotheses, effects, strict=True):
        whose = " of ".join(filter(None, (hypothesis.name, hypothesis.channel)))
        for name, value in effect["parameters"].items():
            found[f"{whose}: {name}" if names.count(name) > 1 else name] = value
    return found


def _overlays(before: Attempt, after: Attempt) -> list[dict[str, Any]]:
    """Recorded beside the one-step predictions of both models, for the first held-out recording."""
    found = []
    one, two = before.fit.passes[0], after.fit.passes[0]
    measured = after.followers[0].measured
    n = min(SHOWN // SAMPLES, len(two.predicted), len(one.predicted))
    shift, recorded = measured.values[:n], measured.as_recorded().values[:n]
    others = before.followers[0].measured.as_recorded().values[:n]
    seen = measured.seen(two.predicted, after.model.instrument(after.fit.values[0]))
    for i, channel in enumerate(measured.channels):
        aligned = others.shape == recorded.shape and bool(np.allclose(others[..., i], recorded[..., i]))
        found.append(
            {
                "channel": channel, "unit": si_unit(channel),
                "time_s": (np.arange(n * SAMPLES) / measured.chain.rate).round(7).tolist(),
                "recorded": shift[..., i].ravel().tolist(),
                "before": one.predicted[:n, :, i].ravel().tolist() if aligned else None,
                "after": seen[:n, :, i].ravel().tolist(),
            }
        )  # fmt: skip
    return found
