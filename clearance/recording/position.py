"""Where the accelerometers are along their links: as a recording declares it, and as a machine has it.

A sensor elsewhere than a model was trained with, or than a simulator has it, looks like another machine.
"""

from collections.abc import Mapping
from typing import Any

from clearance.recording.bounds import bounded
from clearance.recording.recording import Recording

_SAME = 1e-4  # m: closer, nobody measures where a sensor is
_POINTS = ("crank_a", "crank_b", "rod_b", "rod_c")  # in the order of mechanism.sensor_positions
_AXES = ("transverse", "axial")


def declared_positions(recording: Recording) -> dict[str, float]:
    """Where the YAML beside a recording says that its accelerometers are: channel to m along the link.

    Raises:
        InputError: a position in the file's own metadata is no number from -10 to 10.
    """
    return {
        name: bounded(entry["position"], f"sensors.{name}.position", -10.0, 10.0, "m")
        for name, entry in recording.metadata.get("sensors", {}).items()
        if "position" in entry and name in recording.channels
    }


def mounted(settings: Mapping[str, Any]) -> dict[str, float]:
    """Where a campaign's machines have their accelerometers: channel to m along the link.

    Args:
        settings: of the campaign, as ``describe`` gives them.

    Returns:
        Nothing where it is not known, or differs from run to run.
    """
    machine = settings.get("mechanism")
    drawn = settings.get("random") or {}
    if not machine or any(
        path.startswith(("sensor_positions", "crank.length", "rod.length")) for path in drawn
    ):
        return {}
    places = machine["sensor_positions"] or (0.0, machine["crank"]["length"], 0.0, machine["rod"]["length"])
    return {
        f"{point}_{axis}": float(place)
        for point, place in zip(_POINTS, places, strict=True)
        for axis in _AXES
    }


def elsewhere(declared: Mapping[str, float], known: Mapping[str, float]) -> list[str]:
    """The channels whose accelerometer is not where it is known to be."""
    return [n for n, place in declared.items() if n in known and abs(place - known[n]) > _SAME]
