"""One case scored: what was said beside what is true."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from clearance.trial.case import UNNAMED, Case
from clearance.trial.claim import NO_CURVE, left_over, likeness
from clearance.trial.repertoire import EFFECTS, FORCES, PLACES, Place
from clearance.trial.reveal import Revealed

_TURNING = ("phase",)  # parameters that repeat after 2π


def score_case(one: Revealed) -> dict[str, Any]:
    """A row of the result: plain data; see ``summary`` for what its entries add up to."""
    case, said = one.case, one.diagnosis
    row: dict[str, Any] = {
        "name": case.name, "kind": case.kind, "item": item_of(case), "size": case.size, "joint": case.joint,
        "clearance_m": case.clearance, "sensors": case.sensors, "encoder": case.encoder, "noise": case.noise,
        "missing": list(case.missing), "visibility": one.secrets["visibility"],
        "visible": all(v >= 1.0 for v in one.secrets["visibility"].values()),
        "seconds": one.seconds, "failure": one.failure,
        "memory_mib": (said or {}).get("peak_memory_mib"),
    }  # fmt: skip
    asked = case.kind in UNNAMED and one.secrets["curve"] is not None
    if said is None:
        alike = NO_CURVE if asked else None
        return row | {"verdict": None, "right": False, "why": one.failure} | _likeness(alike)
    names = [effect["name"] for effect in said["effects"]]
    row |= {
        "verdict": said["verdict"],
        "named": names,
        "detected": said["verdict"] != "none" and (said.get("mismatch") or {}).get("detected") is not False,
        "score": (said.get("mismatch") or {}).get("score"),
        "named_or_equivalent": _named(case, said),
        "first_and_alone": _named(case, said) and set(names) == set(case.missing) and not _rivals(case, said),
        "channel_right": _channel_right(case, said),
        "spurious": any(name not in case.missing for name in names),
        **_places_right(case, said),
        "parameters": parameters(case, said["effects"]),
        "clearance": _clearance(case, said["clearance"]),
        "held_out": said["fit"]["held_out"],
        **_likeness(likeness(one.secrets["curve"], _curve_of(case, said)) if asked else None),
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
    return [set(names) for names in said.get("equivalent") or []]


def _named(case: Case, said: Mapping[str, Any]) -> bool:
    """Everything missing is asserted, or is one of the explanations that cannot be told apart.

    A fault in the wrong channel is another one; equivalents say no channel.
    """
    truth = set(case.missing)
    if not truth or case.kind in UNNAMED:
        return False
    asserted = truth <= {effect["name"] for effect in said["effects"]}
    return (asserted and _channel_right(case, said) is not False) or truth in _alternatives(said)


def _rivals(case: Case, said: Mapping[str, Any]) -> bool:
    return any(names != set(case.missing) for names in _alternatives(said))


def _channel_right(case: Case, said: Mapping[str, Any]) -> bool | None:
    """Whether faults that were named rightly were seen in the right channel; ``None`` where none was."""
    found = [
        effect.get("channel") == case.faults[effect["name"]]["channel"]
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
    """The parameters of effects that are rightly named, beside the truth; one it lacks is off there."""
    rows = []
    for effect in effects:
        name = effect["name"]
        truth = {**case.effects.get(name, {}), **case.faults.get(name, {})}
        if not truth:
            continue
        for key, given in effect["parameters"].items():
            true = truth.get(key, _off(name, key))
            if not isinstance(true, int | float) or given.get("low") is None or given.get("high") is None:
                continue
            if given["low"] == given["high"] == true:  # a whole number, told and not estimated; else a miss
                continue
            unit = np.pi / 180.0 if given.get("unit") == "deg" else 1.0
            value, low, high = (float(given[k]) * unit for k in ("value", "low", "high"))
            if key in _TURNING:
                true += 2.0 * np.pi * round((value - true) / (2.0 * np.pi))
            rows.append({
                "effect": name, "parameter": key, "true": float(true), "value": value, "low": low,
                "high": high, "covered": bool(low <= true <= high),
                "error": float(abs(value - true) / abs(true)) if true != 0.0 else None,
            })  # fmt: skip
    return rows


def _off(name: str, key: str) -> float | None:
    """What a parameter is where the effect has another form; ``None`` where forms cannot be compared."""
    if name not in EFFECTS or name == "soft_drive":
        return None
    for variant in EFFECTS[name]:
        if key in variant.sizes:
            return float(variant.off.get(key, 0.0))
    return None


def _clearance(case: Case, given: Mapping[str, Any]) -> dict[str, Any] | None:
    if given.get("after_m") is None:
        return None
    low, high = given.get("low_m"), given.get("high_m")
    covered = None if low is None or high is None else bool(low <= case.clearance <= high)
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
