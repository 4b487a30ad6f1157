"""The YAML beside a recording: what the user declares about a file that does not say it itself.

`run.yaml` belongs to `run.parquet` (or .csv, .h5, .mat). All keys are optional:

    columns: {"acc 1": rod_b_axial}        their name: our channel, or time
    ignore: [temperature]                  their columns that are no channels
    units: {rod_b_axial: g, time: ms}      our channel: unit of the file
    scale: {rod_b_axial: -1.0}             our channel: factor on top of the unit
    rate: 10000                            Hz, where there is no time column
    sensors: {rod_b_axial: {position: 0.01, mounting_angle: 2.0, gain: 1.0, ...}}
    chain: {base_rate: 100000, decimation: 10, filter_order: 8, ripple_db: 0.05, cutoff: 0.8}
    metadata: {machine: "press 7"}

`sensors` and `chain` describe: a prediction that is compared with the recording passes through the same
chain, a `position` (m along the link from its first joint) must be that of the machine or of the training,
and what can be undone (gain, bias, delay, mounting angle, a wide bandwidth) is undone where a recording is
read for `predict` and `diagnose` (``correction.py``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from clearance.errors import InputError
from clearance.recording.bounds import bounded, listing, resembling
from clearance.recording.chain import CHAIN_LIMITS, WHOLE, MeasurementChain
from clearance.recording.channels import TIME, require_channel, si_factor
from clearance.recording.recording import RATE_LIMITS
from clearance.recording.sensors import SensorChain, declared_sensor
from clearance.whole_files import write_yaml

KEYS = ("columns", "ignore", "units", "scale", "rate", "sensors", "chain", "metadata")
SUFFIXES = (".yaml", ".yml")
_LARGEST = 2**20  # bytes: a declaration is a page of text; more is some other file


@dataclass(frozen=True)
class Declaration:
    """The keys of the YAML beside a recording, checked; without a file, nothing is declared.

    Attributes:
        name: the YAML's file name, as messages call it.
        columns: their column name to our channel, or to `time`.
        ignore: their columns that are left out.
        units: our channel (or `time`) to the unit of the file.
        scale: our channel (or `time`) to a factor on top of the unit.
        rate: samples per second [Hz].
        sensors: our channel to its sensor's keys, as numbers.
        chain: the measurement chain, as numbers.
        metadata: anything else.
    """

    name: str
    columns: Mapping[str, str] = field(default_factory=dict)
    ignore: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    rate: float | None = None
    sensors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    chain: Mapping[str, float] = field(default_factory=dict)
    metadata: Mapping[str, Any] = field(default_factory=dict)


def read_declaration(recording: Path) -> Declaration:
    """Return what the YAML beside `recording` declares."""
    beside = [path for path in (recording.with_suffix(suffix) for suffix in SUFFIXES) if path.is_file()]
    if len(beside) > 1:
        raise InputError(f"{beside[0]}: {beside[1].name} lies beside it; keep one of the two")
    if not beside:
        return Declaration(recording.with_suffix(SUFFIXES[0]).name)
    path = beside[0]
    try:
        return _checked(path.name, _load(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_sensors(path: Path, sensors: Mapping[str, Mapping[str, float]], comment: str = "") -> None:
    """Write what sensors do as a YAML that may lie beside their recordings."""
    write_yaml(path, {"sensors": {name: dict(entry) for name, entry in sensors.items()}}, comment)


def _load(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(
                f"{path.stat().st_size} bytes are too many for a declaration; at most {_LARGEST}"
            )
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except InputError:
        raise
    # A broken YAML raises whatever its values trip over: wrong dates, unhashable keys, depth.
    except Exception as error:
        raise InputError(
            f"not readable as YAML ({' '.join(str(error).split())[:200]}); correct the file"
        ) from error
    return _mapping({} if content is None else content, "the file")


def _checked(name: str, content: Mapping[str, Any]) -> Declaration:
    unknown = [key for key in content if key not in KEYS]
    if unknown:
        raise InputError(
            f"unknown key {unknown[0]!r}{resembling(unknown[0], KEYS)}; allowed keys are {listing(KEYS)}"
        )
    given = {key: value for key, value in content.items() if value is not None}
    columns = {
        theirs: _channel_or_time(ours, f"columns.{theirs}")
        for theirs, ours in _mapping(given.get("columns", {}), "columns").items()
    }
    ignore = given.get("ignore", [])
    if not isinstance(ignore, list) or not all(isinstance(entry, str) for entry in ignore):
        raise InputError(f"ignore: {ignore!r} is not a list of column names; give [name, ...]")
    units = _mapping(given.get("units", {}), "units")
    for channel, unit in units.items():
        si_factor(unit, _channel_or_time(channel, f"units.{channel}"), f"units.{channel}")
    scale = {
        _channel_or_time(channel, f"scale.{channel}"): bounded(factor, f"scale.{channel}", -1e12, 1e12)
        for channel, factor in _mapping(given.get("scale", {}), "scale").items()
    }
    zero = [
        channel for channel, factor in scale.items() if factor == 0.0 or (channel == TIME and factor < 0.0)
    ]
    if zero:
        raise InputError(
            f"scale.{zero[0]}: {scale[zero[0]]:g} loses the signal; give a factor other than 0 (time: > 0)"
        )
    metadata = _mapping(given.get("metadata", {}), "metadata")
    for own in ("sensors", "chain"):
        if own in metadata:
            raise InputError(f"metadata.{own}: this name is kept for what {own} declares; give it another")
    rate = bounded(given["rate"], "rate", *RATE_LIMITS, "Hz") if "rate" in given else None
    return Declaration(
        name=name,
        columns=columns,
        ignore=tuple(ignore),
        units=units,
        scale=scale,
        rate=rate,
        sensors=_sensors(_mapping(given.get("sensors", {}), "sensors")),
        chain=_chain(_mapping(given.get("chain", {}), "chain")),
        metadata=metadata,
    )


def _sensors(content: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    sensors = {}
    for channel, entry in content.items():
        key = f"sensors.{require_channel(channel, f'sensors.{channel}')}"
        keys = {name: value for name, value in _mapping(entry, key).items() if value is not None}
        sensor = declared_sensor(keys, key)
        SensorChain({channel: sensor})  # a mounting angle is refused where it has no meaning
        numbers = {name: float(getattr(sensor, name)) for name in keys if name != "position"}
        if "position" in keys:
            numbers["position"] = bounded(keys["position"], f"{key}.position", -10.0, 10.0, "m")
        sensors[channel] = numbers
    return sensors


def _chain(content: Mapping[str, Any]) -> dict[str, float]:
    unknown = [key for key in content if key not in CHAIN_LIMITS]
    if unknown:
        raise InputError(
            f"chain: unknown key {unknown[0]!r}{resembling(unknown[0], CHAIN_LIMITS)}; "
            f"allowed keys are {listing(CHAIN_LIMITS)}"
        )
    chain: dict[str, Any] = {}
    for key, value in content.items():
        low, high, unit = CHAIN_LIMITS[key]
        number = bounded(value, f"chain.{key}", low, high, unit)
        if key in WHOLE and number != int(number):
            raise InputError(
                f"chain.{key}: {number:g} is not whole; give a whole number from {low:g} to {high:g}"
            )
        chain[key] = int(number) if key in WHOLE else number
    MeasurementChain(**chain)  # an odd order is refused
    return chain


def require_chain(content: Mapping[str, Any]) -> None:
    """Refuse a chain, as a file's header has it, whose values are no numbers that a chain can have."""
    for key, limits in CHAIN_LIMITS.items():
        if key in content:
            bounded(content[key], f"chain.{key}", *limits)


def _mapping(value: object, key: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{key}: {str(value)[:60]!r} is not a mapping; give `name: value` pairs")
    wrong = [name for name in value if not isinstance(name, str)]
    if wrong:
        raise InputError(f"{key}: the name {wrong[0]!r} is not text; put it in quotes")
    return value


def _channel_or_time(name: object, where: str) -> str:
    return TIME if name == TIME else require_channel(name, where)
