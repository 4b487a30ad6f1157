"""Is the corrected model right? The verdict's machine beside the true one, where nobody has looked.

The held-out error is the tool's own word. Here the machine that a verdict describes starts from the true
state at instants after the recordings' ends, and what it does over 5 ms is compared with the truth. A tool
that has seen its held-out data, or fits noise, claims the floor and is far from it here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from clearance.trial.case import Case, plant_values
from clearance.trial.chart import Z
from clearance.trial.plant import FloatArray, Plant
from clearance.trial.simulate import responses_of, scenes_of
from clearance.trial.visibility import Scene, response, unexplained

ARGUMENTS = {
    "crank_angle": "rad",
    "crank_speed": "rad/s",
    "rod_angle": "rad",
    "slider_position": "m",
    "slider_velocity": "m/s",
    "contact_force": "N",
    "time": "s",
}
"""What a force of free form may be a function of, and in which unit it is given."""
NO_CURVE = (0.0, 1.0)
"""Likeness of no force at all."""


def left_over(case: Case, secrets: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> float | None:
    """What the verdict leaves unexplained, over the detection threshold; state and speed are refitted.

    Instruments' faults that the verdict names are taken as right. ``None`` where the verdict describes no
    machine: a force in free form, no clearance, or numbers that no machine can have or run with.
    """
    found = diagnosis["clearance"]["after_m"]
    if diagnosis["verdict"] == "unknown" or found is None:
        return None
    try:
        claimed = [_claimed(case, plant, diagnosis) for plant in map(case.plant, case.sessions)]
    except (ValueError, ArithmeticError):  # a root of a negative stiffness, a square beyond all numbers
        return None
    moved = [_with_clearance(scene, case.joint, case.clearance, found) for scene in scenes_of(secrets)]
    true = responses_of(case, secrets)
    try:
        changes = [
            one - response(claimed[scene.session], scene) for one, scene in zip(true, moved, strict=True)
        ]
        return unexplained(moved, changes, claimed, np.array(secrets["spread"]), clearance=False)
    except FloatingPointError:  # the machine flies apart, or does not reach from A to its guide
        return None


def _claimed(case: Case, true: Plant, diagnosis: Mapping[str, Any]) -> Plant:
    """The plant that a verdict describes, at the true speed.

    Raises:
        ValueError: if there is no such plant; or an ``ArithmeticError``.
    """
    effects: dict[str, Mapping[str, float]] = {
        one["name"]: plant_values(
            one["name"], {key: p["value"] for key, p in one["parameters"].items()}, true.speed_rpm
        )
        for one in diagnosis["effects"]
        if one["kind"] == "physics"
    }
    drive, motor = effects.get("soft_drive", {}), true.effects.get("soft_drive", {})
    if "stall_torque" in drive and "no_load_rpm" in motor:
        # of each recording alone, so that no verdict repeats it: the true one, as any other drive's speed
        effects["soft_drive"] = {**drive, "no_load_rpm": motor["no_load_rpm"]}
    if case.known_frame and "flexible_base" in true.effects:
        effects.setdefault("flexible_base", true.effects["flexible_base"])
    return replace(true, effects=effects, extra=None, clearance=float(diagnosis["clearance"]["after_m"]))


def _with_clearance(scene: Scene, joint: str, old: float, new: float) -> Scene:
    """The same state in a joint of another clearance: as deep in contact, or as far across the gap."""
    state = scene.state.copy()
    first = Z.GAP_B_X if joint == "B" else Z.GAP_C_X
    gap: FloatArray = state[first : first + 2]
    distance = float(np.hypot(*gap))
    if distance > 0.0:
        state[first : first + 2] = gap * ((distance + new - old) / distance if distance > old else new / old)
    return replace(scene, state=state)


def beside(
    curve: Mapping[str, Sequence[float]] | None, free_form: Mapping[str, Any] | None
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Argument, true force and that of a verdict, (samples,) each, along the true motion.

    ``None`` where the truth is no single force, or the verdict has none. Of a torque what varies of both: a
    constant one is the drive's.

    Args:
        curve: the true ``force`` and the arguments it may be a function of; see ``simulate.Simulated``.
        free_form: ``argument`` and ``table`` (argument, force) of the verdict; over time ``clocks``, what the
            table's clock shows where each recording begins, and its ``period``.
    """
    if curve is None or not free_form or free_form.get("argument") not in ARGUMENTS:
        return None
    table = np.array(free_form["table"], dtype=float)
    if table.ndim != 2 or len(table) < 2 or table.shape[1] < 2:
        return None
    table = table[np.argsort(table[:, 0])]
    argument, force = np.array(curve[free_form["argument"]]), np.array(curve["force"])
    period = free_form.get("period")
    if free_form["argument"] == "time" and free_form.get("clocks"):
        steps = np.diff(argument)
        session = np.append(0, np.cumsum(np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)))
        clocks = np.array(free_form["clocks"], dtype=float)
        argument = argument + clocks[np.minimum(session, len(clocks) - 1)]
    if free_form["argument"] == "crank_angle":
        period = 2.0 * np.pi
    if period:
        argument = table[0, 0] + np.mod(argument - table[0, 0], period)
        table = np.vstack([table, table[0] + [period, 0.0]])
    found = np.interp(argument, table[:, 0], table[:, 1])  # beyond its ends it stays as there
    if free_form.get("direction") == "torque":  # what is constant in one is the drive's: no table has it
        found, force = found - found.mean(), force - force.mean()
    return argument, force, found


def likeness(
    curve: Mapping[str, Sequence[float]] | None, free_form: Mapping[str, Any] | None
) -> tuple[float, float] | None:
    """Correlation of a free-form force with the true one, and its error over that, along the true motion.

    The error is a root mean square. 0 and 1 where the verdict has no such force, ``None`` where the truth is
    no single force. The arguments are those of ``beside``.
    """
    if curve is None:
        return None
    both = beside(curve, free_form)
    if both is None:
        return NO_CURVE
    _, force, found = both
    if len(force) < 10 or found.std() == 0.0 or force.std() == 0.0:
        return NO_CURVE
    error = float(np.sqrt(((found - force) ** 2).mean() / (force**2).mean()))
    return float(np.corrcoef(found, force)[0, 1]), error
