"""What the comparison with Exudyn is asked for, checked before anything is measured.

Its model of the machine has the nominal laws alone: with any others the two would differ in more than code.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from clearance.errors import InputError
from clearance.mechanism.drive import SpeedControl
from clearance.mechanism.joint import CLEARANCE_RANGE
from clearance.mechanism.parameters import Family
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.bounds import bounded, whole
from clearance.recording.synthesis import Campaign

_WITHOUT = "or leave Exudyn out with comparison=null"
_LIMITS = (1e-6, 0.99 * CLEARANCE_RANGE[1])  # m; the runs beside the first have up to 0.15 % more
_MOST_HYSTERESIS = 1.5  # where the restitution that Exudyn is given comes to 0


def comparable(
    campaign: Campaign, clearances: object, speed_rpm: object, duration: object, repeats: object
) -> dict[str, Any]:
    """The arguments of ``comparison.compare``, whose documentation explains them, as numbers.

    Raises:
        InputError: one is out of range, or the machine has what the Exudyn model lacks.
    """
    machine, step = campaign.mechanism, campaign.integrator.step
    if isinstance(clearances, str) or not isinstance(clearances, Sequence) or not clearances:
        raise InputError(
            f"comparison.clearances = {clearances!r} is not a list of one clearance [m] or more; "
            "change comparison.clearances"
        )
    whole(repeats, "comparison.repeats", 1)
    drive = machine.drive
    if not isinstance(drive, SpeedControl):
        raise InputError(
            f"drive = {type(drive).__name__}: the Exudyn model has a speed-controlled one; write "
            f"drive=speed_control, {_WITHOUT}"
        )
    if drive.ramp < step:
        raise InputError(
            f"drive.ramp = {drive.ramp:g} s: the Exudyn model needs a step of {step:g} s or more to come to "
            f"speed; change drive.ramp, {_WITHOUT}"
        )
    lacking = ", ".join(_lacking(machine))
    if lacking:
        raise InputError(
            f"{lacking}: the Exudyn model lacks this, and would be compared with another machine; leave it "
            f"nominal, {_WITHOUT}"
        )
    return {
        "clearances": [bounded(one, "comparison.clearances", *_LIMITS, "m") for one in clearances],
        "speed_rpm": bounded(speed_rpm, "comparison.speed_rpm", -2e4, 2e4, "rpm"),
        "duration": bounded(duration, "comparison.duration", drive.ramp + step, 3600.0, "s"),
        "repeats": repeats,
    }


def _lacking(machine: SliderCrank) -> Iterator[str]:
    """What the Exudyn model lacks, each as a key and its value."""
    joint = machine.joint_c
    if machine.joint_b.loose:
        yield f"mechanism.joint_b.clearance = {machine.joint_b.clearance:g} m"
    for law in (joint.friction, joint.film, joint.bearing, *machine.laws):
        if law.code != 0 and law.family is not Family.DRIVE:
            yield f"{law.family.name.lower()} = {type(law).__name__}"
    if joint.contact.hysteresis >= _MOST_HYSTERESIS:
        yield f"contact.restitution = {joint.contact.restitution:g} of {type(joint.contact).__name__}"
    if any(machine.gravity):
        yield f"mechanism.gravity = {list(machine.gravity)}"
    if machine.guide_offset != 0.0:
        yield f"mechanism.guide_offset = {machine.guide_offset:g} m"
