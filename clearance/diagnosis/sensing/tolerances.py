"""How far accelerometers may be off, each by itself: what data sheets and mounts leave open."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from math import sqrt
from typing import Any

from clearance.diagnosis.sensing.instrument import FAULTY_CHANNELS, OTHER_AXIS, Instrument
from clearance.diagnosis.sensing.restoration import STILL
from clearance.errors import InputError


@dataclass(frozen=True)
class Open:
    """One thing that one accelerometer may do.

    Attributes:
        fault: attribute of ``Instrument``.
        channel: whose.
        neutral: value of a faultless one.
        tolerance: distance from it that 95 of 100 keep.
    """

    fault: str
    channel: str
    neutral: float
    tolerance: float


@dataclass(frozen=True)
class Tolerances:
    """Limits that 95 of 100 accelerometers keep; 0: they are exact.

    Attributes:
        gain: relative error of it [-].
        misalignment: angle between its axis and the nominal one [deg].
        delay: time by which it is late or early [s].
        bias: offset [m/s²].

    Raises:
        InputError: a number that is negative or too large to be a tolerance.
    """

    gain: float = 0.0
    misalignment: float = 0.0
    delay: float = 0.0
    bias: float = 0.0

    def __post_init__(self) -> None:
        for name, (most, unit) in _MOST.items():
            value = getattr(self, name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (number and (value == 0.0 or _LEAST * most <= value <= most)):
                raise InputError(
                    f"tolerances.{name} = {value!r} is not between 0 and {most:g} {unit}; change "
                    f"tolerances.{name}"
                )

    @staticmethod
    def given(content: Mapping[str, Any] | None) -> "Tolerances":
        """From what a user gave.

        Raises:
            InputError: a name or number that is none of a tolerance.
        """
        unknown = [str(name) for name in content or {} if name not in _MOST]
        if unknown:
            raise InputError(f"tolerances: {unknown[0]} is unknown; choose from {', '.join(_MOST)}")
        return Tolerances(**content) if content else NOTHING_LEFT_OPEN

    def open(self, channels: Sequence[str]) -> tuple[Open, ...]:
        """What the accelerometers among some channels may do; an axis alone cannot be turned back.

        A time by which all of them are late is a path's that begins later. So delays are counted from a
        recorded crank angle, and where there is none from one accelerometer's, the others then being twice as
        uncertain (variance).
        """
        found = []
        heard = [channel for channel in channels if channel in FAULTY_CHANNELS]
        moving = [channel for channel in heard if channel not in STILL] or heard
        reference = moving[0] if moving and ENCODER not in channels else None
        for entry in fields(self):
            tolerance, late = float(getattr(self, entry.name)), entry.name == "delay"
            for channel in heard if tolerance > 0.0 else ():
                across = OTHER_AXIS.get(channel, ("", 0.0))[0]
                if entry.name == "misalignment" and across not in channels and across not in STILL:
                    continue
                if late and channel == reference:
                    continue
                wide = sqrt(2.0) if late and reference is not None else 1.0
                neutral = 1.0 if entry.name == "gain" else 0.0
                found.append(Open(entry.name, channel, neutral, wide * tolerance))
        return tuple(found)


def instrument_of(what: Sequence[Open], values: Iterable[float]) -> Instrument:
    """Accelerometers that do this."""
    settings: dict[str, dict[str, float]] = {}
    for one, value in zip(what, values, strict=True):
        settings.setdefault(one.fault, {})[one.channel] = float(value)
    return Instrument(**settings)  # type: ignore[arg-type]


def values_of(what: Sequence[Open], instrument: Instrument) -> list[float]:
    """What accelerometers do; ``instrument_of`` goes back."""
    return [float(getattr(instrument, one.fault).get(one.channel, one.neutral)) for one in what]


HALF = 0.5
"""Of a tolerance, which 95 of 100 keep: the standard deviation of what it limits."""
ENCODER = "crank_angle"
_LEAST = 1e-6  # of the largest tolerance: below, nothing is open
_MOST = {"gain": (0.2, "[-]"), "misalignment": (15.0, "deg"), "delay": (1e-3, "s"), "bias": (100.0, "m/s^2")}
NOTHING_LEFT_OPEN = Tolerances()
"""Of exact sensors."""
