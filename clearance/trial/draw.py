"""Cases drawn from a seed: circumstances first, then, from another stream, what is missing."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np

from clearance.errors import InputError
from clearance.recording.bounds import whole
from clearance.trial.case import KINDS, SEVERAL, Case, Session
from clearance.trial.repertoire import EFFECTS, FAULTS, FORCES, LEFT_OUT, SENSORS, Variant

Generator = np.random.Generator
_JITTER = 0.15  # a size is drawn within this share of the repertoire's, so that none is a round number
_DECOY = 0.15  # of the cases with all their hypotheses needed lose another one: losing one tells little
OFF = {"gain": 0.2, "misalignment": 15.0, "delay": 1e-3, "bias": 100.0}
"""What an accelerometer may do within its tolerance, and the largest one: [-], deg, s, m/s²."""
_USUAL = tuple(kind for kind in KINDS if kind not in ("beam", "triple"))  # a beam needs Exudyn, a triple time
_WHOLE = frozenset({"order", "seed"})
_LIVE = ("rod_b_transverse", "rod_b_axial", "rod_c_transverse", "rod_c_axial", "slider_horizontal")


@dataclass(frozen=True)
class Scope:
    """How cases are drawn.

    Attributes:
        cases: how many.
        shares: kind to its share, of any sum.
        clearance_range: [m], drawn evenly on a logarithmic scale.
        speed_range: [rpm].
        seconds: range of a recording's length [s].
        recordings: of each case, at different speeds.
        noise: level to its share, of any sum.
        sensors: set to its share, of any sum.
        encoder: share of the cases with an encoder.
        known_frame: share of the cases that stand on a frame that is known to move, whatever is missing.
        items: of each kind, those that may be missing; all if none, or for several too few, are named.
        sizes: 0, 1 or 2, of which each is drawn.
        tolerances: ``gain`` [-], ``misalignment`` [deg], ``delay`` [s] and ``bias`` [m/s²] within which every
            accelerometer is off, of which the tool is told the limits; empty: all are exact.
    """

    cases: int = 12
    shares: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(_USUAL, 1.0))
    clearance_range: Sequence[float] = (5e-5, 1e-3)
    speed_range: Sequence[float] = (500.0, 1000.0)
    seconds: Sequence[float] = (0.6, 1.0)
    recordings: int = 2
    noise: Sequence[Sequence[float]] = ((0.01, 4.0), (0.05, 1.0))
    sensors: Mapping[str, float] = field(default_factory=lambda: {"all": 1.0})
    encoder: float = 0.7
    known_frame: float = 0.1
    items: Sequence[str] = ()
    sizes: Sequence[int] = (0, 1, 2)
    tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, least, most in (("cases", 1, 10_000), ("recordings", 1, 8)):
            whole(getattr(self, name), f"scope.{name}", least, most)
        for name, allowed in (("shares", KINDS), ("sensors", tuple(SENSORS))):
            given = getattr(self, name)
            by_name = isinstance(given, Mapping)
            wrong = [key for key in given if key not in allowed] if by_name else []
            if wrong:
                raise InputError(
                    f"{name}.{wrong[0]} is unknown; choose from {', '.join(allowed)}; change scope.{name}"
                )
            if not by_name or not _are_shares(given.values()):
                raise InputError(
                    f"{name} = {given} must be shares of at least 0, not all 0; change scope.{name}"
                )
        every = (*EFFECTS, *FAULTS, *FORCES)
        for name, choices in (("items", every), ("sizes", (0, 1, 2))):
            given = getattr(self, name)
            listed = isinstance(given, list | tuple) and (given or name == "items")
            wrong = [one for one in given if one not in choices] if listed else [given]
            if wrong:
                raise InputError(
                    f"{name}: {wrong[0]!r} is unknown; list some of {', '.join(map(str, choices))}; change "
                    f"scope.{name}"
                )
        if not isinstance(self.tolerances, Mapping):
            raise InputError(
                f"tolerances = {self.tolerances!r}: give limits by name, or {{}}; change scope.tolerances"
            )
        for name, tolerance in self.tolerances.items():
            if name not in OFF or not _is_number(tolerance) or not 0.0 < tolerance <= OFF[name]:
                allowed_ones = ", ".join(f"{one} up to {most:g}" for one, most in OFF.items())
                raise InputError(
                    f"tolerances.{name} = {tolerance!r}: above 0, choose from {allowed_ones}; change "
                    "scope.tolerances"
                )
        levels = [one for one in _listed(self.noise) if _are_numbers(one, 2) and 0.0 <= one[0] < 1.0]
        if len(levels) != len(_listed(self.noise)) or not _are_shares([share for _, share in levels]):
            raise InputError(
                f"noise = {self.noise} must be pairs of a level in [0, 1) and a share of at least 0, not all "
                "0; change scope.noise"
            )
        for name in ("encoder", "known_frame"):
            value = getattr(self, name)
            if not _is_number(value) or not 0.0 <= value <= 1.0:
                raise InputError(f"{name} = {value!r} is no share in [0, 1]; change scope.{name}")
        limits = (("clearance_range", 1e-6, 2e-3), ("speed_range", 100.0, 3000.0), ("seconds", 0.2, 60.0))
        for name, low, high in limits:
            given = getattr(self, name)
            if not _are_numbers(given, 2) or not low <= given[0] <= given[1] <= high:
                raise InputError(
                    f"{name} = {given} is not a rising pair in [{low:g}, {high:g}]; change scope.{name}"
                )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _listed(value: Any) -> Sequence[Any]:
    """A list as it is; of anything else one entry, which is none of what a list may have."""
    return value if isinstance(value, list | tuple) else [value]


def _are_numbers(given: Any, count: int) -> bool:
    return isinstance(given, list | tuple) and len(given) == count and all(map(_is_number, given))


def _are_shares(given: Collection[Any]) -> bool:
    """Whether these are numbers of at least 0, and not all 0."""
    return all(_is_number(one) and one >= 0.0 for one in given) and sum(given) > 0.0


class Drawing:
    """All cases of a scope and a seed, in an order that tells nothing.

    Circumstances and what is missing come from separate streams; only a force on the frame needs a
    circumstance, a frame that moves, which other cases have too.
    """

    def __init__(self, scope: Scope, seed: int) -> None:
        self.scope, self.seed = scope, seed
        order = np.random.default_rng([seed, 0])
        self._wanted = _schedule(scope, order)
        order.shuffle(self._wanted)

    def case(self, index: int, attempt: int = 0) -> Case:
        """One case; another attempt draws the same kind of thing again."""
        kind, item, size = self._wanted[index]
        circumstances = _circumstances(self.scope, np.random.default_rng([self.seed, 1, index, attempt]))
        missing = _missing(
            kind,
            item,
            size,
            circumstances,
            self.scope.items,
            np.random.default_rng([self.seed, 2, index, attempt]),
        )
        limits = dict(self.scope.tolerances)
        off = _off(limits, circumstances["sensors"], np.random.default_rng([self.seed, 3, index, attempt]))
        about = {**circumstances, **missing, "tolerances": limits, "off": off}
        return Case(name=f"case_{index + 1:04d}", kind=kind, size=size, **about)


def counts(shares: Mapping[str, float], total: int) -> dict[str, int]:
    """Whole numbers that add up to ``total``, as near to the shares as can be (largest remainders)."""
    exact = {key: total * share / sum(shares.values()) for key, share in shares.items()}
    found = {key: int(value) for key, value in exact.items()}
    for key in sorted(exact, key=lambda k: found[k] - exact[k])[: total - sum(found.values())]:
        found[key] += 1
    return found


def _schedule(scope: Scope, rng: Generator) -> list[tuple[str, str, int]]:
    """Kind, item and size of each case: all items before one comes twice, all its sizes in turn."""
    items: dict[str, list[str]] = {
        "none": [""], "effect": list(EFFECTS), "instrument": list(FAULTS), "pair": [""],
        "outside": list(FORCES), "left_out": list(LEFT_OUT), "beam": ["rod_flexibility"],
        "triple": [""],
    }  # fmt: skip
    wanted = []
    for kind, count in counts(scope.shares, scope.cases).items():
        names = [name for name in items[kind] if name in scope.items] or items[kind]
        order, first = rng.permutation(len(names)), rng.integers(0, len(scope.sizes), len(names))
        for n in range(count):
            round_, place = divmod(n, len(names))
            chosen = order[place]
            size = scope.sizes[(first[chosen] + round_) % len(scope.sizes)]
            wanted.append((kind, names[chosen], int(size)))
    return wanted


def _circumstances(scope: Scope, rng: Generator) -> dict[str, Any]:
    low, high = scope.speed_range
    cells = np.linspace(low, high, scope.recordings + 1)
    speeds = rng.permutation([rng.uniform(a, b) for a, b in pairwise(cells)])
    sessions = tuple(
        Session(
            speed_rpm=float(speed), start_angle=float(rng.uniform(0.0, 2.0 * pi)),
            record_start=float(round(rng.uniform(0.25, 0.45), 4)),
            duration=float(round(rng.uniform(scope.seconds[0], scope.seconds[1]), 3)),
        )
        for speed in speeds
    )  # fmt: skip
    return {
        "joint": str(rng.choice(["B", "C"])),
        "clearance": float(np.exp(rng.uniform(*np.log(scope.clearance_range)))),
        "sensors": _one_of(scope.sensors, rng),
        "encoder": bool(rng.random() < scope.encoder),
        "noise": _one_of({level: share for level, share in scope.noise}, rng),
        "noise_seed": int(rng.integers(2**31)),
        "sessions": sessions,
        "known_frame": bool(rng.random() < scope.known_frame),
    }


def _off(tolerances: Mapping[str, float], sensors: str, rng: Generator) -> dict[str, dict[str, float]]:
    """What every accelerometer does: two standard deviations are a tolerance, and none is further off."""
    neutral = {"gain": 1.0}
    return {
        channel: {
            name: neutral.get(name, 0.0) + limit * float(np.clip(0.5 * rng.normal(), -1.0, 1.0))
            for name, limit in tolerances.items()
        }
        for channel in (SENSORS[sensors] if tolerances else ())
    }


def _one_of(shares: Mapping[Any, float], rng: Generator) -> Any:
    keys = list(shares)
    weights = np.array([shares[key] for key in keys], dtype=float)
    return keys[int(rng.choice(len(keys), p=weights / weights.sum()))]


def _missing(
    kind: str, item: str, size: int, circumstances: Mapping[str, Any], items: Sequence[str], rng: Generator
) -> dict[str, Any]:
    """What is missing, and which hypotheses are taken away."""
    effects: dict[str, dict[str, float]] = {}
    faults: dict[str, dict[str, Any]] = {}
    found: dict[str, Any] = {"effects": effects, "faults": faults}
    clearance = circumstances["clearance"]
    possible = [name for name in EFFECTS if not (name == "flexible_base" and circumstances["known_frame"])]
    if kind in SEVERAL:
        wanted = [name for name in possible if name in items]
        possible = wanted if len(wanted) >= SEVERAL[kind] else possible
        *first, last = (possible[i] for i in rng.permutation(len(possible))[: SEVERAL[kind]])
        effects.update({name: _effect(name, size, clearance, rng) for name in first})
        if rng.random() < 0.25:
            name = str(rng.choice([name for name in FAULTS if name in items] or list(FAULTS)))
            faults[name] = _fault(name, size, circumstances, rng)
        else:
            effects[last] = _effect(last, size, clearance, rng)
    elif kind in ("effect", "left_out", "beam"):
        effects[item] = _effect(item, size, clearance, rng)
        if item == "flexible_base":
            found["known_frame"] = False
        if kind == "beam":  # what its plant can do
            found |= {"joint": "C", "known_frame": False}
    elif kind == "instrument":
        faults[item] = _fault(item, size, circumstances, rng)
    elif kind == "outside":
        force = FORCES[item]
        shape = str(rng.choice(list(force.shapes)))
        values = _values(force.shapes[shape], size, clearance, rng)
        found["force"] = {
            "of": item,
            "target": force.target,
            "argument": force.argument,
            "kind": shape,
            **values,
        }
        if item == "frame":
            found["known_frame"] = True
    if kind == "left_out":
        found["without"] = (item,)
    elif rng.random() < _DECOY:
        found["without"] = (str(rng.choice([name for name in LEFT_OUT if name not in effects])),)
    return found


def _effect(name: str, size: int, clearance: float, rng: Generator) -> dict[str, float]:
    return _values(EFFECTS[name][rng.integers(len(EFFECTS[name]))], size, clearance, rng)


def _fault(name: str, size: int, circumstances: Mapping[str, Any], rng: Generator) -> dict[str, Any]:
    values: dict[str, Any] = _values(FAULTS[name], size, circumstances["clearance"], rng)
    if name != "timebase":
        values["channel"] = str(rng.choice([c for c in _LIVE if c in SENSORS[circumstances["sensors"]]]))
    return values


def _values(variant: Variant, size: int, clearance: float, rng: Generator) -> dict[str, float]:
    values: dict[str, float] = {}
    sign = -1.0 if variant.signed and rng.random() < 0.5 else 1.0
    for name, sizes in variant.sizes.items():
        off = variant.off.get(name, 0.0)
        value = off + sign * (sizes[size] - off) * np.exp(rng.uniform(-_JITTER, _JITTER))
        if name in variant.of_clearance:
            value *= clearance
        values[name] = float(value)
    for name, choices in variant.shape.items():
        if name in _WHOLE:
            values[name] = int(rng.choice(choices))
        elif isinstance(choices, tuple):
            values[name] = float(rng.uniform(*choices))
        else:
            values[name] = float(rng.choice(choices))
    return values
