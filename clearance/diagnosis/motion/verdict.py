"""From findings to what is asserted: verdict, numbers with intervals, plain words."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

from clearance.diagnosis.hypotheses.effect import Effect, rounded_alike
from clearance.diagnosis.judging.verdict import Estimate
from clearance.diagnosis.judging.words import HELPS, acting
from clearance.diagnosis.motion.attempt import Attempt, Findings, Remainder
from clearance.diagnosis.motion.fit import Fit
from clearance.diagnosis.motion.model import Term
from clearance.diagnosis.motion.remainder import described
from clearance.diagnosis.motion.rest import Explained, nearly_all

_Z = 1.96  # of a 95 % interval
_SEEN = 3.3  # standard deviations from which on a clearance counts as seen
_CONFIRMED = 1.3  # held-out error over its floor, up to which the recordings there are explained
_COUNTS = 0.02  # of a combination of uncertain values, in their ranges: one that takes less part is not told
_APART = 1e-3  # chance of zeros as different, below which each recording has its own
_KNOWN = 0.05  # of its range: an uncertain value is known when its deviation is below


def estimates(attempt: Attempt, term: Term) -> dict[str, Estimate]:
    """A term's parameters."""
    values, deviations = attempt.parameters(term)
    middle, low, high = (term.values(values + z * deviations) for z in (0.0, -_Z, _Z))
    return {name: Estimate(middle[name], low[name], high[name]) for name in middle}


def whole(findings: Findings, held: Mapping[str, float]) -> bool:
    """Whether what was found leaves nothing but noise; arguments as of ``stands``."""
    assert findings.enough is not None
    return bool(findings.enough.enough and held["after"] <= _CONFIRMED)


def stands(findings: Findings, held: Mapping[str, float]) -> bool:
    """Whether what was found explains the recordings: nothing but noise is left, or next to nothing.

    A real machine always does something that no model has. Where names take away nearly all of a large
    mismatch, that it comes back with the crank's angle does not make them wrong.

    Args:
        findings: of the search.
        held: ``before`` and ``after``, errors on held-out recordings over their floor.
    """
    if whole(findings, held):
        return True
    return bool(findings.best.terms) and nearly_all(held["before"], held["after"])


def verdict_of(
    findings: Findings, equivalents: Sequence[Attempt], zero: Effect | None, held: Mapping[str, float]
) -> str:
    """None, physics, instrument, mixed, unknown or ambiguous.

    Args:
        findings: of the search.
        equivalents: what cannot be told from its best.
        zero: as of ``effects``.
        held: as of ``stands``: what does not explain held-out recordings, too, is not asserted.
    """
    if not stands(findings, held):
        return "unknown"
    kinds = {term.effect.kind for term in findings.best.terms}
    if findings.zero and zero is not None:
        kinds.add("instrument")
    if not kinds:
        return "none"
    if equivalents:
        return "ambiguous"
    return "mixed" if len(kinds) > 1 else kinds.pop()


def effects(
    findings: Findings, zero: Effect | None, chance: float
) -> list[tuple[Effect, dict[str, Estimate], dict[str, Any]]]:
    """What is asserted: each effect with its numbers, and as the contract writes it; the surest first.

    Args:
        findings: of the search.
        zero: the encoder's zero as an effect, where it is to be asserted.
        chance: probability of the set.
    """
    best = findings.best
    found = []
    for term in sorted(best.terms, key=lambda t: -best.sureness(t)):
        off = {u.name: term.off[i] for i, u in enumerate(term.unknowns)}
        outer = {u.name: u.outer(off[u.name]) if np.isfinite(off[u.name]) else None for u in term.unknowns}
        found.append((term.effect, estimates(best, term), outer))
    if zero is not None and findings.zero:
        found.append((zero, {"bias": _zero(findings.zeros)}, {"bias": 0.0}))
    return [
        (effect, numbers, _described(effect, numbers, off, best, chance)) for effect, numbers, off in found
    ]


def _zero(zeros: Mapping[str, tuple[float, float]]) -> Estimate:
    """The encoder's zero: the weighted mean of all recordings; where they disagree what all say."""
    values, deviations = np.array(list(zeros.values())).T
    weight = deviations**-2.0
    mean, deviation = float((weight * values).sum() / weight.sum()), float(weight.sum() ** -0.5)
    apart = float((weight * (values - mean) ** 2).sum())
    if len(values) > 1 and chi2.sf(apart, len(values) - 1) < _APART:
        return Estimate(
            mean, float((values - _Z * deviations).min()), float((values + _Z * deviations).max())
        )
    return Estimate(mean, mean - _Z * deviation, mean + _Z * deviation)


def _described(
    effect: Effect, numbers: Mapping[str, Estimate], off: Mapping[str, Any], best: Attempt, chance: float
) -> dict[str, Any]:
    described: dict[str, Any] = {
        "name": effect.name, "kind": effect.kind, "body": effect.place(best.fit.model.joint),
        "direction": effect.direction, "probability": round(chance, 4),
        "parameters": {
            name: {
                "value": e.value, "unit": effect.parameter(name).unit, "low": e.low, "high": e.high,
                "off": off[name],
            }
            for name, e in numbers.items()
        },
    }  # fmt: skip
    if effect.channel:
        described["channel"] = effect.channel
    return described


def clearance_of(fit: Fit, enough: bool) -> dict[str, Any]:
    """The clearance as the contract writes it: a number where it is seen, else its upper bound.

    Args:
        fit: of the best attempt.
        enough: as ``whole`` says: anything else makes a fraction of a millimetre, too.
    """
    found: dict[str, Any] = {
        "joint": fit.model.joint,
        "before_m": None,
        "after_m": None,
        "low_m": 0.0,
        "high_m": None,
    }
    if not fit.model.with_clearance:
        return found
    place = len(fit.model.fixed_unknowns) - 1
    value, deviation = float(fit.shared[place]), float(fit.deviations[place])
    found["high_m"] = value + _Z * deviation
    if enough and value > _SEEN * deviation:
        found |= {"after_m": value, "low_m": max(value - _Z * deviation, 0.0)}
    return found


def uncertain_of(fit: Fit) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The machine's uncertain values, and the combinations of those that are not known one by one.

    The covariance of the values that stay wide is split into its directions; what is narrow among them is a
    combination that the recordings determine. Reference: Walter & Pronzato 1997, Identification of Parametric
    Models from Experimental Data, ch. 2 (identifiability).
    """
    unknowns = [u for u in fit.model.fixed_unknowns if u.prior is not None]
    covariance = fit.covariance[: len(unknowns), : len(unknowns)]
    widths = np.array([u.prior[1] for u in unknowns if u.prior is not None])
    deviations = np.sqrt(np.diag(covariance))
    known = deviations < _KNOWN * widths
    singles = []
    for i, u in enumerate(unknowns):
        inner = fit.shared[i] + np.array([0.0, -_Z, _Z]) * deviations[i]
        value, low, high = (u.outer(float(v)) for v in inner)
        singles.append(
            {"path": u.name, "value": value, "low": low, "high": high, "determined": bool(known[i])}
        )
    wide = np.flatnonzero(~known)
    combinations: list[dict[str, Any]] = []
    if len(wide) > 1:
        scaled = covariance[np.ix_(wide, wide)] / np.outer(widths[wide], widths[wide])
        variances, directions = np.linalg.eigh(scaled)
        for variance, direction in zip(variances, directions.T, strict=True):
            if variance**0.5 > _KNOWN:
                continue
            values = np.array([singles[i]["value"] for i in wide])
            slope = np.array([values[k] if unknowns[i].log else 1.0 for k, i in enumerate(wide)])
            weights = direction / widths[wide] / slope
            scale = weights[np.argmax(np.abs(weights))]
            weights = weights / scale
            middle, half = float(weights @ values), float(_Z * variance**0.5 / abs(scale))
            counts = np.abs(direction) > _COUNTS  # in the widths of each: units differ
            shares = {unknowns[i].name: float(w) for i, w in zip(wide[counts], weights[counts], strict=True)}
            combinations.append(
                {"weights": shares, "value": middle, "low": middle - half, "high": middle + half}
            )
    return singles, combinations


def sentences(
    verdict: str,
    findings: Findings,
    asserted: Sequence[tuple[Effect, dict[str, Estimate], dict[str, Any]]],
    equivalents: Sequence[Attempt],
    held: Mapping[str, float],
    shown: Mapping[str, float],
    channels: Sequence[str],
    clearance: Mapping[str, Any],
    uncertain: tuple[list[dict[str, Any]], list[dict[str, Any]]],
) -> list[str]:
    """The diagnosis in plain words, the headline first; ``shown``: ``held`` with a table of what is left."""
    joint = findings.best.fit.model.joint
    lines = []
    if verdict == "none":
        lines.append(
            "Nothing is missing that these recordings could show: what the model leaves is noise "
            f"(held-out error {held['after']:.2f}, floor 1.00)."
        )
    for effect, numbers, _ in asserted:
        lines.append(
            effect.describe(
                {name: effect.parameter(name).text(e.value, e.low, e.high) for name, e in numbers.items()},
                joint,
            )
        )
    assert findings.enough is not None
    if verdict == "unknown":
        if findings.left is not None and not findings.left.beside:
            lines = []
        lines = [f"The nearest explanation is not enough: {line[0].lower()}{line[1:]}" for line in lines]
        lines.insert(0, _unknown_words(findings, held))
    elif not whole(findings, held):
        lines.append(_left_words(findings.enough, held["after"]))
        if findings.left is not None:
            lines.append(f"What these names leave {_table_words(findings.left)}")
    if equivalents:
        lines += [_alike_words(findings.best, other) for other in equivalents]
    if asserted or findings.left is not None:
        lines.append(f"It shows in {', '.join(channels)}. {_gain_words(shown)}")
    lines += [_clearance_words(clearance), *_uncertain_words(*uncertain)]
    return lines


def _unknown_words(findings: Findings, held: Mapping[str, float]) -> str:
    """The headline where no names explain."""
    assert findings.enough is not None
    if findings.left is not None:
        return f"Something is missing that has no name here: it {_table_words(findings.left)}"
    if findings.enough.enough:
        return (
            "What explains the fitted recordings does not explain those that were held out: their error is "
            f"{held['after']:.3g} (floor 1.00)."
        )
    return f"Something is missing that none of the tried hypotheses explains. {_comes_back(findings.enough)}"


def _table_words(left: Remainder) -> str:
    """Of what is left, as a force without a name."""
    table = described(left)
    largest = max(abs(force) for _, force in table["table"])
    return (
        f"goes with {acting(table['body'], table['direction'])} that depends on "
        f"{table['argument'].replace('_', ' ')}, of {largest:.3g} {table['unit']} at most; its table is in "
        "corrected.yaml."
    )


def _gain_words(shown: Mapping[str, float]) -> str:
    """What becomes of the held-out error, by names and with a table."""
    before, after = f"{shown['before']:.3g}", f"{shown['after']:.3g}"
    falls = "falls" if shown["after"] < HELPS * shown["before"] else "goes"
    if "named" in shown:
        return (
            f"Held-out error {falls} from {before} to {shown['named']:.3g} by names and to {after} with the "
            "table (floor 1.00)."
        )
    return f"With it, held-out error {falls} from {before} to {after} (floor 1.00)."


def _alike_words(best: Attempt, other: Attempt) -> str:
    """What explains as well, without what both explanations share."""
    shared = {term.place for term in best.terms} & {term.place for term in other.terms}
    ours, theirs = (
        " with ".join(term.label for term in one.terms if term.place not in shared) for one in (best, other)
    )
    return f"With these sensors {ours or 'it'} cannot be told from {theirs or 'nothing more'}."


def _left_words(enough: Explained, after: float) -> str:
    """Of what names that stand leave in fitted recordings, or else in held-out ones."""
    if enough.enough:
        return f"Fitted recordings show nothing else; held-out errors are {after:.3g} (floor 1.00)."
    return _comes_back(enough)


def _comes_back(enough: Explained) -> str:
    worst = enough.channels[int(np.argmax(enough.level))]
    return (
        "What is left comes back with the crank's angle or drifts; in "
        f"{worst} it is {enough.level.max():.3g} times the noise."
    )


def _clearance_words(clearance: Mapping[str, Any]) -> str:
    joint, high = clearance["joint"], clearance["high_m"]
    if high is None:
        return f"The clearance of joint {joint} cannot be seen here: no channel shows the slider's position."
    if clearance["after_m"] is None:
        return (
            f"The clearance of joint {joint} cannot be seen here: up to {1e3 * high:.3g} mm would not show."
        )
    return (
        f"The slider's position shows a clearance in joint {joint} of {1e3 * clearance['after_m']:.3g} mm "
        f"({1e3 * clearance['low_m']:.3g} to {1e3 * high:.3g})."
    )


def _with_interval(one: Mapping[str, Any]) -> str:
    value, low, high = rounded_alike(one["value"], one["low"], one["high"])
    return f"{value} ({low} to {high})"


def _uncertain_words(
    singles: Sequence[Mapping[str, Any]], combinations: Sequence[Mapping[str, Any]]
) -> list[str]:
    lines = []
    for one in singles:
        if one["determined"]:
            lines.append(f"{one['path']} is {_with_interval(one)}.")
    unknown = [str(one["path"]) for one in singles if not one["determined"]]
    if unknown:
        lines.append(f"These recordings do not tell {', '.join(unknown)} one by one.")
    for one in combinations:
        terms = " ".join(
            f"{'+' if weight > 0 else '-'} {abs(weight):.3g} × {path}"
            for path, weight in one["weights"].items()
        )
        lines.append(
            f"What they tell is {terms.removeprefix('+ ')} = {_with_interval(one)}, near these values."
        )
    return lines
