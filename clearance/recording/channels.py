"""The channels a recording may carry, their units, and the sets of sensors a model reads.

Channel names, axes and sensor sets are those of Tables 3 and 9 of Nguyen et al. (2026). Axial points from the
first joint of a link to its second (A to B, B to C), transverse is axial turned by +90 degrees; the slider's
horizontal and vertical axes stand in the same relation. Everything inside the project is SI.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from clearance.errors import InputError
from clearance.recording.bounds import listing, resembling

TIME = "time"
STANDARD_GRAVITY = 9.80665  # m/s², exact by definition (3rd CGPM, 1901)


@dataclass(frozen=True)
class Channel:
    """One signal: name, SI unit, the body it is measured on, and its number in Table 3 (accelerations)."""

    name: str
    unit: str
    body: str
    identifier: int | None = None


_ACCELERATION_BODIES = (
    ("crank_a_transverse", "crank"),
    ("crank_a_axial", "crank"),
    ("crank_b_transverse", "crank"),
    ("crank_b_axial", "crank"),
    ("rod_b_transverse", "rod"),
    ("rod_b_axial", "rod"),
    ("rod_c_transverse", "rod"),
    ("rod_c_axial", "rod"),
    ("slider_vertical", "slider"),
    ("slider_horizontal", "slider"),
)
_OTHERS = (
    Channel("crank_angle", "rad", "crank"),
    Channel("crank_speed", "rad/s", "crank"),
    Channel("drive_torque", "N m", "crank"),
    Channel("slider_position", "m", "slider"),
    Channel("slider_velocity", "m/s", "slider"),
)

ACCELERATIONS: tuple[str, ...] = tuple(name for name, _ in _ACCELERATION_BODIES)
OTHER_CHANNELS: tuple[str, ...] = tuple(channel.name for channel in _OTHERS)
CHANNELS: Mapping[str, Channel] = MappingProxyType(
    {
        **{
            name: Channel(name, "m/s^2", body, identifier)
            for identifier, (name, body) in enumerate(_ACCELERATION_BODIES, start=1)
        },
        **{channel.name: channel for channel in _OTHERS},
    }
)

# Each pair is (first axis, first axis turned by +90 degrees) of one measuring point.
AXIS_PAIRS: tuple[tuple[str, str], ...] = (
    ("crank_a_axial", "crank_a_transverse"),
    ("crank_b_axial", "crank_b_transverse"),
    ("rod_b_axial", "rod_b_transverse"),
    ("rod_c_axial", "rod_c_transverse"),
    ("slider_horizontal", "slider_vertical"),
)

_TURN = 2.0 * math.pi
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "m/s^2": {
            "m/s^2": 1.0,
            "m/s2": 1.0,
            "m/s²": 1.0,
            "m/s**2": 1.0,
            "cm/s^2": 1e-2,
            "mm/s^2": 1e-3,
            "mm/s2": 1e-3,
            "mm/s²": 1e-3,
            "mm/s**2": 1e-3,
            "g": STANDARD_GRAVITY,
            "mg": STANDARD_GRAVITY * 1e-3,
        },
        "rad": {
            "rad": 1.0,
            "deg": _TURN / 360.0,
            "°": _TURN / 360.0,
            "rev": _TURN,
            "turn": _TURN,
            "turns": _TURN,
        },
        "rad/s": {
            "rad/s": 1.0,
            "deg/s": _TURN / 360.0,
            "°/s": _TURN / 360.0,
            "rpm": _TURN / 60.0,
            "1/min": _TURN / 60.0,
            "rev/s": _TURN,
        },
        "N m": {"N m": 1.0, "N*m": 1.0, "N·m": 1.0, "Nm": 1.0, "mN m": 1e-3, "mNm": 1e-3},
        "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
        "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
        "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0},
    }
)


def require_channel(name: object, where: str = "channel") -> str:
    """Return `name` if it is a known channel; `where` is what the message calls its place."""
    if not isinstance(name, str) or name not in CHANNELS:
        hint = resembling(str(name), CHANNELS)
        raise InputError(
            f"{where}: {name!r} is not a channel{hint}; choose from {listing(CHANNELS, len(CHANNELS))}"
        )
    return name


def si_unit(channel: str) -> str:
    """Return the SI unit of a channel, or of `time`."""
    return "s" if channel == TIME else CHANNELS[require_channel(channel)].unit


def si_factor(unit: object, channel: str, where: str = "unit") -> float:
    """Return what a value in `unit` is multiplied by to have the SI unit of `channel` (or of `time`)."""
    accepted = UNITS[si_unit(channel)]
    if isinstance(unit, str) and unit.strip() in accepted:
        return accepted[unit.strip()]
    other = next((quantity for quantity, table in UNITS.items() if str(unit).strip() in table), None)
    reason = f"is not a unit of {channel} but measures {other}" if other else "is not a known unit"
    raise InputError(f"{where}: {unit!r} {reason}; for {channel} choose from {listing(accepted)}")


@dataclass(frozen=True)
class SensorSet:
    """The channels a model reads, in order (Table 9).

    Attributes:
        name: what the set is called in results.
        channels: names out of `CHANNELS`, at least one, none twice.
    """

    name: str
    channels: tuple[str, ...]

    def __post_init__(self) -> None:
        key = f"sensors.channels (set {self.name!r})"
        if isinstance(self.channels, str):
            raise InputError(f"{key}: {self.channels!r} is one name; give a list such as [{self.channels}]")
        names = tuple(require_channel(name, key) for name in self.channels)
        if not names:
            raise InputError(f"{key}: no channel is listed; choose from {listing(CHANNELS, len(CHANNELS))}")
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"{key}: {listing(twice)} is listed more than once; list each channel once")
        object.__setattr__(
            self, "channels", names
        )  # a configuration's own list type would travel into results
