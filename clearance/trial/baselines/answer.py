"""A baseline's answer in the form of a diagnosis, so that the same score judges it."""

from collections.abc import Mapping, Sequence
from typing import Any

from clearance.diagnosis.hypotheses.effect import Effect
from clearance.trial.baselines.runs import Bench, Fit

_SURE = 1.96  # standard deviations of a 95 % interval


def answer(
    bench: Bench,
    clearance: tuple[float, float | None],
    effects: Sequence[tuple[Effect, Mapping[str, Any]]],
    detected: bool,
    place: tuple[str | None, str | None] = (None, None),
    score: float | None = None,
) -> dict[str, Any]:
    """A verdict by the contract; what a baseline does not say is left empty.

    Args:
        bench: what was fitted.
        clearance: value and standard deviation, or ``None`` where that is not known [m].
        effects: that are asserted, with their parameters, see ``parameters``.
        detected: whether anything is said to be missing.
        place: body and direction, where no effect is asserted.
        score: how strongly.
    """
    kinds = {effect.kind for effect, _ in effects}
    verdict = (
        "none" if not detected else "unknown" if not effects else "mixed" if len(kinds) > 1 else kinds.pop()
    )
    body, direction = place
    if effects:
        body, direction = effects[0][0].place(bench.joint), effects[0][0].direction
    value, spread = clearance
    return {
        "verdict": verdict,
        "mismatch": {"detected": detected, "score": score, "body": body, "direction": direction},
        "effects": [
            {"name": e.name, "kind": e.kind, "channel": e.channel, "parameters": dict(values)}
            for e, values in effects
        ],
        "equivalent": [],
        "free_form": None,
        "fit": {"held_out": {"before": None, "after": None, "floor": None}},
        "clearance": {
            "joint": bench.joint, "before_m": value, "after_m": value,
            "low_m": None if spread is None else value - _SURE * spread,
            "high_m": None if spread is None else value + _SURE * spread,
        },
    }  # fmt: skip


def parameters(effect: Effect, found: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """An effect's parameters with their intervals."""
    return {
        name: {
            "value": value, "low": value - _SURE * spread, "high": value + _SURE * spread,
            "unit": effect.parameter(name).unit,
        }
        for name, (value, spread) in found.items()
    }  # fmt: skip


def clearance_of(fit: Fit) -> tuple[float, float]:
    """A fit's clearance [m] and its standard deviation."""
    return float(fit.values[0]), float(fit.spread[0])
