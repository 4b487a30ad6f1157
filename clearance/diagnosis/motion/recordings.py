"""From recordings and settings as a user gives them to tracks, and to bounds of what is uncertain."""

from collections.abc import Mapping, Sequence
from typing import Any

from clearance.diagnosis.motion.track import Track
from clearance.errors import InputError
from clearance.mechanism.description import read_path, with_values
from clearance.mechanism.slider_crank import SliderCrank
from clearance.recording.channels import ACCELERATIONS
from clearance.recording.recording import Recording, at_one_rate

ENCODER_ZERO = ("known", "unknown")


def only_motion(recordings: Sequence[Recording]) -> bool:
    """Whether there are recordings and none of them has an accelerometer."""
    every = {channel for recording in recordings for channel in recording.channels}
    return bool(recordings) and not every & set(ACCELERATIONS)


def tracks_of(
    recordings: Mapping[str, Recording], held_out: Mapping[str, Recording]
) -> tuple[list[Track], list[Track]]:
    """Tracks to fit and tracks to judge by: without any given, the last third of each.

    Raises:
        InputError: rates that differ, or a recording that is too short or silent.
    """
    every = at_one_rate({**recordings, **held_out})
    fitted = [Track.of(every[name], name) for name in recordings]
    if held_out:
        return fitted, [Track.of(every[name], name) for name in held_out]
    cuts = [2 * len(track.values) // 3 for track in fitted]
    return (
        [track.part(0, cut) for track, cut in zip(fitted, cuts, strict=True)],
        [track.part(cut, len(track.values)) for track, cut in zip(fitted, cuts, strict=True)],
    )


def uncertain_bounds(given: Any, machine: SliderCrank) -> dict[str, tuple[float, float]]:
    """Bounds of the mechanism's uncertain values, by path; none where nothing is given.

    Raises:
        InputError: a path that the mechanism does not have, or bounds that are none.
    """
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InputError(
            f"uncertain = {given!r} is not a mapping of the mechanism's values to bounds, as in "
            "'{slider.mass: [0.05, 0.5]}'; change uncertain"
        )
    found: dict[str, tuple[float, float]] = {}
    for path, bounds in given.items():
        key = f"uncertain: {path}"
        if str(path) in ("joint_b.clearance", "joint_c.clearance"):
            raise InputError(
                f"{key} is fitted anyway where the slider's position shows it; take it out of uncertain"
            )
        nominal = read_path(machine, str(path))
        if isinstance(nominal, bool) or not isinstance(nominal, int | float):
            raise InputError(f"{key} is not a number of the mechanism; change uncertain")
        listed = isinstance(bounds, Sequence) and not isinstance(bounds, str)
        numbers = [b for b in bounds if isinstance(b, int | float)] if listed else []
        if len(numbers) != 2 or not numbers[0] < numbers[1]:
            raise InputError(f"{key}: {bounds!r} is not two rising numbers; change uncertain")
        for bound in numbers:
            with_values(machine, {str(path): float(bound)})
        found[str(path)] = (float(numbers[0]), float(numbers[1]))
    return found


def zero_is_known(given: object) -> bool:
    """Whether an encoder's zero that is off counts as a fault.

    Raises:
        InputError: neither known nor unknown.
    """
    if given not in ENCODER_ZERO:
        raise InputError(f"encoder_zero = {given!r} is neither known nor unknown; change encoder_zero")
    return given == "known"
