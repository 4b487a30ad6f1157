"""Carry out a diagnosis and gather what it says: the contract's JSON and the report's evidence."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from clearance.diagnosis.effect import Effect
from clearance.diagnosis.explain import Explanation, Search, penalised
from clearance.diagnosis.fit import Model, Unknown
from clearance.diagnosis.follow import STRUCTURE
from clearance.diagnosis.hypothesis import Setting
from clearance.diagnosis.location import locate_joint
from clearance.diagnosis.measured import Measured
from clearance.diagnosis.mismatch import Innovations, innovations, interval, locate, root_mean_square, summary
from clearance.diagnosis.missing_force import FREE_FORM
from clearance.diagnosis.nominal_map import nominal_map
from clearance.diagnosis.search import ANNEALING, Attempt, explained, refine
from clearance.diagnosis.signature import signatures
from clearance.diagnosis.significance import p_value
from clearance.diagnosis.strategy import find_explanation
from clearance.diagnosis.trace import Trace, aligned
from clearance.diagnosis.verdict import (
    clearance_of,
    equivalents,
    estimates,
    located,
    probabilities,
    sentences,
    verdict_of,
    withdraw,
)
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.layout import Signal, State

if TYPE_CHECKING:
    from clearance.diagnosis.motion.search import Findings

METRIC = "root mean square of one-step prediction errors over a perfect model's, quietest nine tenths"
_SHOWN = 1500  # samples of an overlay
_HINTS = 15  # hypotheses of the ranking that were not fitted


@dataclass
class Outcome:
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
    explanation: "Explanation | Findings"


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
) -> Outcome:
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

    Raises:
        InputError: a recording that no machine of this kind could have made.
    """
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
    withdraw(explanation)
    search.report("judging on held-out recordings")
    best, nominal = explanation.best, explanation.nominal
    after = _held_out(held_out, search, best)
    before_attempt = _held_out(held_out, search, nominal, after) if best is not nominal else after
    errors_after = innovations(after, joint)
    errors_before = innovations(before_attempt, joint, after) if best is not nominal else errors_after
    fit = _fit_numbers(errors_before, errors_after)
    errors_fit = innovations(nominal, joint, best if explained(best) else None)
    where = summary(errors_fit)
    channels = [c for c, s in sorted(where["channels"].items(), key=lambda kv: -kv[1]) if s > 0.1][:3]
    verdict = verdict_of(explanation)
    body, direction = _place(best, where)
    numbers, clearance = estimates(best), clearance_of(explanation)
    curve, band = _free_form(best, numbers, setting)
    chance = probabilities(explanation)
    others = equivalents(explanation)
    score = explanation.hints[0].gain if explanation.hints else None
    diagnosis: dict[str, Any] = {
        "verdict": verdict,
        "summary": [
            *sentences(verdict, explanation, joint, fit, channels or list(where["channels"])[:1]),
            *located(joints),
        ],
        "mismatch": {
            "detected": verdict != "none", "score": score,
            "p_value": None if score is None else p_value(score), "body": body, "direction": direction,
            **where,
        },
        "effects": _effects(best, numbers, chance) if verdict not in ("none", "unknown") else [],
        "equivalent": [[h.name for h in a.hypotheses] for a in others] if len(others) > 1 else [],
        "next_experiment": _next_experiment(others, recordings),
        "free_form": curve,
        "fit": fit,
        "clearance": {
            "joint": joint, "misfit_by_joint": joints, "before_m": float(nominal.fit.values[0, 0]),
            "after_m": clearance.value, "low_m": clearance.low, "high_m": clearance.high,
        },
        "recordings": [
            {
                "name": one.name, "seconds": one.seconds, "rate_hz": one.chain.rate,
                "channels": list(one.channels), "speed_rpm": float(best.fit.values[r, -1]),
                "held_out_seconds": sum(o.seconds for o in held_out if o.name == one.name),
            }
            for r, one in enumerate(recordings)
        ],
        "warnings": [
            *(
                f"{one.name}: {', '.join(one.silent)} shows nothing but a constant and was left out"
                for one in recordings if one.silent
            ),
            *(
                [f"Not everything was tried: {search.stopped}."] if search.stopped else []
            ),
        ],
        "seconds": round(time.monotonic() - started, 1),
    }  # fmt: skip
    evidence: dict[str, Any] = {
        "where": locate(errors_fit, innovations(best, joint)),
        "ranking": _ranking(explanation, chance),
        "overlays": _overlays(before_attempt, after),
        "checks": _checks(errors_after),
        "clearance_profile": {
            "clearance_m": search.profile.clearance.tolist(),
            "misfit": search.profile.misfit.round(4).tolist(),
        },
        "missing_force": sorted(_missing_force(search, nominal), key=lambda one: one["body"] != body),
        "signatures": _signatures(held_out, before_attempt, after, nominal, best),
        "detectability": nominal_map(
            joint, numbers[0].value, float(best.fit.values[0, -1]), recordings[0].channels
        ),
        **({"free_form": {**curve, **band}} if curve else {}),
        "mechanism": {
            "crank_length": setting.machine.crank.length, "rod_length": setting.machine.rod.length,
            "offset": setting.machine.guide_offset,
        },
    }  # fmt: skip
    model = setting.model(best.hypotheses)
    return Outcome(diagnosis, evidence, model.machine(best.fit.values[0]), explanation)


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
        lambda v: model.machine(whole(v)),
        lambda v: model.instrument(whole(v)),
    )
    machine, instrument = model.machine(attempt.fit.values[0]), model.instrument(attempt.fit.values[0])
    found: Attempt | None
    if beside is not None and _alike(machine, beside.model.machine(beside.fit.values[0])):
        speeds = beside.fit.values[:, -1:]
        found = refine((), only_speed, beside.followers, speeds, ANNEALING[1], 8, search.workers, False)
    else:
        near = [abs(known.speed) for known in search.alignments]

        def one(measured: Measured) -> Trace:
            known = aligned(measured, machine, (0.5 * min(near), 2.0 * max(near)))
            return Trace.of(measured, known, machine, instrument)

        with ThreadPoolExecutor(search.workers) as pool:
            traces = list(pool.map(one, held_out))
        values = np.array([[trace.speed] for trace in traces])
        found = search.grown((), values, search.begin(traces, only_speed, values), model=only_speed)
    assert found is not None
    values = found.fit.values
    found.fit.values = np.concatenate(
        [np.repeat(shared[None], len(values), axis=0), found.fit.values], axis=1
    )
    return found


def _alike(one: SliderCrank, other: SliderCrank) -> bool:
    """Whether two machines have the same coordinates."""
    rows = list(STRUCTURE)
    return bool((one.codes()[rows] == other.codes()[rows]).all())


def _fit_numbers(before: Sequence[Innovations], after: Sequence[Innovations]) -> dict[str, Any]:
    low, high = interval(after)
    return {
        "metric": METRIC,
        "held_out": {
            "before": root_mean_square(before), "after": root_mean_square(after), "floor": 1.0, "low": low,
            "high": high,
        },
    }  # fmt: skip


def _place(best: Attempt, where: dict[str, Any]) -> tuple[str | None, str | None]:
    if not best.hypotheses:
        return None, None
    first = best.hypotheses[0]
    return first.body, first.direction


def _effects(best: Attempt, numbers: Sequence[Any], chance: dict[int, float]) -> list[dict[str, Any]]:
    found, place = [], 1
    for hypothesis in best.hypotheses:
        parameters = {}
        for i, unknown in enumerate(hypothesis.unknowns):
            number = numbers[place + i]
            unit = hypothesis.effect.parameter(unknown.name).unit if hypothesis.effect else ""
            off = float(hypothesis.off[i])
            parameters[unknown.name] = {
                "value": number.value, "unit": unit, "low": number.low, "high": number.high,
                "off": off if np.isfinite(off) else None,
            }  # fmt: skip
        place += len(hypothesis.unknowns)
        found.append(
            {
                "name": hypothesis.name, "kind": hypothesis.kind, "body": hypothesis.body,
                **({"channel": hypothesis.channel} if hypothesis.channel else {}),
                "direction": hypothesis.direction, "probability": round(chance[id(best)], 4),
                "parameters": parameters,
            }
        )  # fmt: skip
    return found


def _free_form(
    best: Attempt, numbers: Sequence[Any], setting: Setting
) -> tuple[dict[str, Any] | None, dict[str, Any]]:
    """The contract's curve, and its band for the report."""
    place = 1
    for hypothesis in best.hypotheses:
        count = len(hypothesis.unknowns)
        if hypothesis.name == FREE_FORM:
            found = numbers[place : place + count]
            law = hypothesis.apply(setting.machine, np.array([n.value for n in found])).force
            assert isinstance(law, TabulatedForce)
            spacing = 2.0 * np.pi / count if law.repeats else float(law.spacing or 0.0)
            knots = law.start + spacing * np.arange(count)
            curve = {
                "body": law.body, "direction": law.direction, "argument": law.argument,
                "unit": "N m" if law.direction in ("torque", "moment") else "N",
                "argument_unit": _UNITS.get(law.argument, "N"),
                "table": [[float(k), n.value] for k, n in zip(knots, found, strict=True)],
            }  # fmt: skip
            return curve, {"low": [n.low for n in found], "high": [n.high for n in found]}
        place += count
    return None, {}


_UNITS = {
    "crank_angle": "rad", "slider_position": "m", "slider_velocity": "m/s", "time": "s",
}  # fmt: skip
_BODIES = (("crank", "torque", "N m"), ("rod", "moment", "N m"), ("slider", "x", "N"))


def _missing_force(search: Search, nominal: Attempt) -> list[dict[str, Any]]:
    """Unknown forces beside the nominal model: what it lacks, over time, with 95 % bands."""
    free = search.loosened(nominal)
    found = []
    for trace, follower, one in zip(search.traces, free.followers, free.fit.passes, strict=True):
        middle = one.signals[:, one.signals.shape[1] // 2]
        angle = np.degrees(middle[:, Signal.CRANK_ANGLE] % (2.0 * np.pi))
        inputs = follower.path.inputs
        scatter = 1.4826 / np.sqrt(2.0) * np.median(np.abs(np.diff(inputs, axis=0)), axis=0)
        for i, (body, direction, unit) in enumerate(_BODIES):
            value, half = inputs[:, i], 1.96 * scatter[i]
            found.append(
                {
                    "recording": trace.measured.name, "body": body, "direction": direction, "unit": unit,
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
    held_out: Sequence[Measured], before: Attempt, after: Attempt, nominal: Attempt, best: Attempt
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
        held_out, speeds, angles, machines(nominal, before), machines(best, after),
        best.model.instrument(best.fit.values[0]), 1,
    )  # fmt: skip


def _ranking(explanation: Explanation, chance: dict[int, float]) -> list[dict[str, Any]]:
    samples = sum(p.samples for p in explanation.nominal.fit.passes)
    rows = []
    for attempt in sorted(explanation.attempts, key=penalised):
        numbers = estimates(attempt)
        effects = _effects(attempt, numbers, chance)
        fall = samples * (explanation.nominal.misfit - attempt.misfit)
        rows.append(
            {
                "name": " + ".join(h.label for h in attempt.hypotheses),
                "kind": attempt.hypotheses[-1].kind,
                "log_likelihood_gain": 0.5 * fall,
                "p_value": p_value(fall),
                "parameters": {k: v for e in effects for k, v in e["parameters"].items()},
                "asserted": attempt is explanation.best and explained(attempt),
                "note": f"misfit {attempt.misfit:.3g} (1 is perfect)",
            }
        )
    for hint in explanation.hints[:_HINTS]:
        if all(hint.label not in str(row["name"]) for row in rows):
            rows.append(
                {
                    "name": hint.label, "kind": hint.hypotheses[0].kind,
                    "log_likelihood_gain": 0.5 * hint.gain, "p_value": p_value(hint.gain), "parameters": {},
                    "asserted": False, "note": "not fitted: promises less than others",
                }
            )  # fmt: skip
    return rows


def _overlays(before: Attempt, after: Attempt) -> list[dict[str, Any]]:
    """Recorded beside the one-step predictions of both models, for the first held-out recording."""
    found = []
    one, two = before.fit.passes[0], after.fit.passes[0]
    measured = after.followers[0].measured
    n = min(_SHOWN // 10, len(two.predicted), len(one.predicted))
    shift = measured.values[:n]
    for i, channel in enumerate(measured.channels):
        same = before.followers[0].measured.values[:n, :, i]
        aligned = same.shape == shift[..., i].shape and bool(np.allclose(same, shift[..., i]))
        found.append(
            {
                "channel": channel, "unit": "m/s²" if measured.signals[i] < 10 else "",
                "time_s": (np.arange(n * 10) / measured.chain.rate).round(7).tolist(),
                "recorded": shift[..., i].ravel().round(4).tolist(),
                "before": one.predicted[:n, :, i].ravel().round(4).tolist() if aligned else None,
                "after": two.predicted[:n, :, i].ravel().round(4).tolist(),
            }
        )  # fmt: skip
    return found


def _checks(errors: Sequence[Innovations]) -> dict[str, Any]:
    """Whiteness and normalised innovation squared of the final model (Bar-Shalom et al. 2001, ch. 5)."""
    channels = errors[0].channels
    lags = range(1, 11)
    stacked = [one.values for one in errors]
    correlation: dict[str, list[float]] = {}
    for i, channel in enumerate(channels):
        correlation[channel] = []
        for lag in lags:
            top = sum(float((v[:-lag, i] * v[lag:, i]).sum()) for v in stacked)
            correlation[channel].append(top / max(sum(float((v[:, i] ** 2).sum()) for v in stacked), 1e-12))
    squares = np.concatenate([v.ravel() ** 2 for v in stacked])
    half = 1.96 * np.sqrt(2.0 / len(squares))
    return {
        "channels": list(channels),
        "whiteness": [correlation[c][0] for c in channels],
        "autocorrelation": correlation,
        "normalised_innovation_squared": {
            "value": float(squares.mean()), "low": 1.0 - half, "high": 1.0 + half,
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
