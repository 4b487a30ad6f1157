"""One case scored: what was said beside what is true."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clearance.trial.case import UNNAMED, Case
from clearance.trial.claim import NO_CURVE, beside, left_over, likeness
from clearance.trial.repertoire import EFFECTS, FORCES, PLACES, Place
from clearance.trial.reveal import Revealed

_TURNING = ("phase",)  # parameters that repeat after 2π
_POINTS = 64  # of a curve that are kept
_SPREAD = "nearest models"  # what a clearance rests on whose span is no 95 % interval


def score_case(one: Revealed) -> dict[str, Any]:
    """A row of the result: plain data; see ``summary`` for what its entries add up to."""
    case, said = one.case, one.diagnosis
    row: dict[str, Any] = {
        "name": case.name, "kind": case.kind, "item": item_of(case), "size": case.size, "joint": case.joint,
        "clearance_m": case.clearance, "sensors": case.sensors, "encoder": case.encoder, "noise": case.noise,
        "missing": list(case.missing), "visibility": one.secrets["visibility"],
        "visible": all(v >= 1.0 for v in one.secrets["visibility"].values()),
        "seconds": one.seconds, "failure": one.failure, "tries": one.tries,
        "memory_mib": (said or {}).get("peak_memory_mib"),
    }  # fmt: skip
    asked = case.kind in UNNAMED and one.secrets["curve"] is not None
    if said is None:
        alike = NO_CURVE if asked else None
        return row | {"verdict": None, "right": False, "why": one.failure} | _likeness(alike)
    names, rightly = [effect["name"] for effect in said["effects"]], _rightly(case, said)
    named = _named(case, said)
    row |= {
        "verdict": said["verdict"],
        "named": names,
        "rightly": rightly,
        "detected": said["verdict"] != "none" and (said.get("mismatch") or {}).get("detected") is not False,
        "score": (said.get("mismatch") or {}).get("score"),
        "named_or_equivalent": named,
        "first_and_alone": named and sorted(names) == sorted(case.missing) and not _alternatives(said),
        "channel_right": _channel_right(case, said),
        "spurious": len(rightly) < len(names),
        **_places_right(case, said),
        "parameters": parameters(case, said["effects"]),
        "clearance": _clearance(case, said["clearance"]),
        "held_out": _held_out(said["fit"]["held_out"]),
        **_likeness(likeness(one.secrets["curve"], _curve_of(case, said)) if asked else None),
        "curve": _points(one.secrets["curve"], _curve_of(case, said)) if asked else None,
        "left_over": left_over(case, one.secrets, said),
    }
    why = _why(case, row)
    return row | {"right": why is None, "why": why}


def item_of(case: Case) -> str:
    """What a case stands for in a table: the missing effect, ``pair``, or where an unnamed force acts."""
    if case.kind in ("effect", "instrument", "left_out"):
        return case.missing[0]
    return str(case.force["of"]) if case.force else case.kind


def _alternatives(said: Mapping[str, Any]) -> list[set[str]]:
    """Names of the explanations that cannot be told from the one that is asserted, which comes first."""
    return [set(names) for names in (said.get("equivalent") or [])[1:]]


def _rightly(case: Case, said: Mapping[str, Any]) -> list[str]:
    """What is missing and was asserted; a fault in another channel is another one."""
    return [effect["name"] for effect in said["effects"] if _is_missing(case, effect)]


def _is_missing(case: Case, effect: Mapping[str, Any]) -> bool:
    name = effect["name"]
    elsewhere = "channel" in case.faults.get(name, {}) and not _in_channel(case, effect)
    return name in case.missing and not elsewhere


def _in_channel(case: Case, effect: Mapping[str, Any]) -> bool:
    return bool(effect.get("channel") == case.faults[effect["name"]]["channel"])


def _named(case: Case, said: Mapping[str, Any]) -> bool:
    """Everything missing is asserted, or is one of the explanations that cannot be told from what is.

    Those say no channel: one of the same names as what is asserted makes nothing right, nor does a fault
    where none is asserted in its channel. Where nothing is asserted, nothing is named.
    """
    truth = set(case.missing)
    if not truth or case.kind in UNNAMED or not said["effects"]:
        return False
    if truth <= set(_rightly(case, said)):
        return True
    accused = {effect.get("channel") for effect in said["effects"]}
    heard = all(fault["channel"] in accused for fault in case.faults.values() if "channel" in fault)
    asserted = {effect["name"] for effect in said["effects"]}
    return heard and truth != asserted and truth in _alternatives(said)


def _channel_right(case: Case, said: Mapping[str, Any]) -> bool | None:
    """Whether faults that were named rightly were seen in the right channel; ``None`` where none was."""
    found = [
        _in_channel(case, effect)
        for effect in said["effects"]
        if "channel" in case.faults.get(effect["name"], {})
    ]
    return all(found) if found else None


def _places(case: Case) -> list[Place]:
    if case.force:
        return [FORCES[case.force["of"]].place]
    return [PLACES[name] for name in case.missing]


def _places_right(case: Case, said: Mapping[str, Any]) -> dict[str, bool | None]:
    """Whether the mismatch is on a body where something is missing, and in the direction of it there.

    ``None`` where nothing is missing.
    """
    if not case.missing:
        return {"body_right": None, "direction_right": None}
    place = said.get("mismatch") or {}
    body, direction = str(place.get("body")), str(place.get("direction"))
    return {"body_right": _at_place(case, body), "direction_right": _at_place(case, body, direction)}


def _likeness(alike: tuple[float, float] | None) -> dict[str, float | None]:
    correlation, error = (None, None) if alike is None else alike
    return {"curve_correlation": correlation, "curve_error": error}


def _points(true: Mapping[str, Sequence[float]], found: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Some of the points at which two forces are compared, by their argument; enough for a picture."""
    both = beside(true, found)
    if found is None or both is None or len(both[0]) == 0:
        return None
    order = np.argsort(both[0])
    some = order[np.linspace(0, len(order) - 1, min(_POINTS, len(order))).round().astype(int)]
    points = {
        name: [float(f"{value:.4g}") for value in values[some]]
        for name, values in zip(("argument", "true", "found"), both, strict=True)
    }
    return {"over": found["argument"], "direction": found.get("direction")} | points


def _curve_of(case: Case, said: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The free-form force of a verdict ``unknown``, if it acts where something is missing."""
    curve: Mapping[str, Any] = said.get("free_form") or {}
    here = _at_place(case, str(curve.get("body")), str(curve.get("direction")))
    return curve if here and said["verdict"] == "unknown" else None


def _at_place(case: Case, body: str, direction: str | None = None) -> bool:
    """Whether something that is missing acts on a body, and, where it is given, in that direction."""
    joints = {
        "{joint}": f"joint_{case.joint.lower()}",
        "{other_joint}": "joint_c" if case.joint == "B" else "joint_b",
    }
    return any(
        body in {joints.get(one, one) for one in place.bodies}
        and (direction is None or direction in place.directions)
        for place in _places(case)
    )


def parameters(case: Case, effects: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The parameters of effects that are rightly named, beside the truth; one it lacks is off there.

    Where the form that was named has no such value in the true one (a motor for a drive's gains), ``true`` is
    ``None``, and the parameter is missed.
    """
    rows = []
    for effect in effects:
        if not _is_missing(case, effect):
            continue
        name = effect["name"]
        truth = {**case.effects.get(name, {}), **case.faults.get(name, {})}
        for key, given in effect["parameters"].items():
            true: Any = truth.get(key, _off(name, key))
            other_form = true is None and name == "soft_drive"
            known = other_form or isinstance(true, int | float)
            if not known or given.get("low") is None or given.get("high") is None:
                continue
            if given["low"] == given["high"] == true:  # a whole number, told and not estimated; else a miss
                continue
            unit = np.pi / 180.0 if given.get("unit") == "deg" else 1.0
            value, low, high = (float(given[k]) * unit for k in ("value", "low", "high"))
            row = {"effect": name, "parameter": key, "true": None, "value": value, "low": low, "high": high}
            if other_form:
                rows.append(row | {"covered": False, "error": None})
                continue
            if key in _TURNING:
                true += 2.0 * np.pi * round((value - true) / (2.0 * np.pi))
            rows.append(row | {
                "true": float(true), "covered": bool(low <= true <= high),
                "error": float(abs(value - true) / abs(true)) if true != 0.0 else None,
            })  # fmt: skip
    return rows


def _off(name: str, key: str) -> float | None:
    """What a parameter is where the effect has another form; ``None`` where it has no such value."""
    if name not in EFFECTS or name == "soft_drive":
        return None
    for variant in EFFECTS[name]:
        if key in variant.sizes:
            return float(variant.off.get(key, 0.0))
    return None


def _held_out(given: Mapping[str, Any]) -> dict[str, Any]:
    """As it was said; recordings of which a part was lost by their file's name, not by whose folder."""
    if "shares" not in given:
        return dict(given)
    return {**given, "shares": {Path(path).name: share for path, share in given["shares"].items()}}


def _clearance(case: Case, given: Mapping[str, Any]) -> dict[str, Any] | None:
    """Beside the truth; the spread of models of which none explains is no interval, and covers nothing."""
    if given.get("after_m") is None:
        return None
    low, high = given.get("low_m"), given.get("high_m")
    covered = None
    if low is not None and high is not None and given.get("basis") != _SPREAD:
        covered = bool(low <= case.clearance <= high)
    return {
        "value": given["after_m"], "before": given.get("before_m"), "low": low, "high": high,
        "covered": covered,
        "error": abs(given["after_m"] / case.clearance - 1.0),
    }  # fmt: skip


def _why(case: Case, row: Mapping[str, Any]) -> str | None:
    """A word on why a verdict is wrong; ``None`` where it is right."""
    said = " and ".join(row["named"]) or row["verdict"]
    if case.kind == "none":
        return None if row["verdict"] == "none" else f"false alarm: {said}"
    if row["verdict"] == "none":
        faint = min(row["visibility"].values())
        return "missed below the threshold" if faint < 1.0 else f"missed, {faint:.1f} times the threshold"
    if case.kind in UNNAMED:
        if row["verdict"] != "unknown":
            return f"named {said}, where no name is right"
        return None if row["body_right"] else "unknown, rightly, but on the wrong body"
    if row["named_or_equivalent"]:
        return None
    if row["channel_right"] is False and set(case.missing) <= set(row["named"]):
        return "the right fault in the wrong channel"
    return "seen, but not named" if row["verdict"] == "unknown" else f"named {said} instead"
