"""One case of a trial: what is true of it, and the machine that this makes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from math import pi
from typing import Any

from clearance.trial.exudyn_plant import ExudynPlant
from clearance.trial.plant import ExtraForce, Fault, Plant

KINDS = ("none", "effect", "instrument", "pair", "outside", "left_out", "beam", "triple")
SEVERAL = {"pair": 2, "triple": 3}
"""Kinds of cases with several things missing, and how many."""
UNNAMED = ("outside", "left_out")
"""Kinds of cases for which the tool has no name."""
KNOWN_FRAME = {"frequency": 60.0, "damping_ratio": 0.03, "mass": 20.0}
"""A frame on springs that the tool is told of: some cases stand on it, whatever is missing."""
_FOR_THE_PLANT = {"contact_stiffness": {"stiffness_scale": "scale"}}
_KINDS = {name: f"sensor_{name}" for name in ("gain", "misalignment", "delay", "bias")}
_VALUES = {"gain": "gain", "misalignment": "angle", "delay": "delay", "bias": "bias"}
_IN_SI = {"misalignment": pi / 180.0}
_SHARED_NAMES = {"damping_ratio": "damping"}  # a fault's name for it in the plant


@dataclass(frozen=True, kw_only=True)
class Session:
    """How one recording of a case was made.

    Attributes:
        speed_rpm: reference speed of the drive.
        start_angle: of the crank when the motion begins [rad].
        record_start: from there to the first sample [s].
        duration: of the recording [s].
    """

    speed_rpm: float
    start_angle: float
    record_start: float
    duration: float


@dataclass(frozen=True, kw_only=True)
class Case:
    """The truth of one case; names and parameters of effects and faults are those of docs/effects.md.

    Attributes:
        name: of its folder.
        kind: one of ``KINDS``.
        joint: ``B`` or ``C``.
        clearance: of that joint, radial [m].
        sensors: key of ``repertoire.SENSORS``.
        encoder: whether the crank's angle is recorded.
        noise: standard deviation over that of each channel.
        noise_seed: of the noise; each recording counts on from it.
        sessions: one a recording.
        known_frame: whether the machine stands on ``KNOWN_FRAME``, which the tool is told.
        effects: name to parameters; what is missing in the model.
        faults: of the instruments: name to ``channel`` and parameters.
        force: arguments of ``plant.ExtraForce`` with ``of``, a key of ``repertoire.FORCES``; or ``None``.
        without: hypotheses that are taken away from the tool.
        size: 0, 1, 2: small, medium, large.
        tolerances: within which the accelerometers are off, see ``draw.Scope``; the tool is told.
        off: channel to what its accelerometer does within these.
    """

    name: str
    kind: str
    joint: str
    clearance: float
    sensors: str
    encoder: bool
    noise: float
    noise_seed: int
    sessions: tuple[Session, ...]
    known_frame: bool = False
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    faults: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    force: Mapping[str, Any] | None = None
    without: tuple[str, ...] = ()
    size: int = 0
    tolerances: Mapping[str, float] = field(default_factory=dict)
    off: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of what the model lacks; a force without a name counts as ``force``."""
        return (*self.effects, *self.faults, *(("force",) if self.force else ()))

    def lacking(self, name: str) -> "Case":
        """The same case without one of the things that the model lacks."""
        return replace(
            self,
            effects={k: v for k, v in self.effects.items() if k != name},
            faults={k: v for k, v in self.faults.items() if k != name},
            force=None if name == "force" else self.force,
        )

    def plant(self, session: Session) -> Plant:
        """The machine of one recording: at its speed from the outset, so that it needs no ramp.

        The rod of a case of kind ``beam`` bends in one mode here; see ``beam``.
        """
        effects = {
            name: plant_values(name, values, session.speed_rpm) for name, values in self.effects.items()
        }
        if self.known_frame:
            effects["flexible_base"] = dict(KNOWN_FRAME)
        force = {k: v for k, v in self.force.items() if k != "of"} if self.force else None
        return Plant(
            joint=self.joint, clearance=self.clearance, speed_rpm=session.speed_rpm, ramp=0.0,
            effects=effects, extra=ExtraForce(**force) if force else None,
        )  # fmt: skip

    def beam(self, session: Session) -> ExudynPlant:
        """The machine of one recording of a case of kind ``beam``: its rod is one of beam elements."""
        rod = self.effects["rod_flexibility"]
        return ExudynPlant(
            clearance=self.clearance, speed_rpm=session.speed_rpm, start_angle=session.start_angle,
            rod_frequency=rod["frequency"], damping_ratio=rod["damping_ratio"],
        )  # fmt: skip

    def plant_faults(self) -> list[Fault]:
        """What the instruments do, as the plant's own faults."""
        own = [
            Fault(kind=_KINDS[name], channel=channel, **{_VALUES[name]: _IN_SI.get(name, 1.0) * value})
            for channel, values in self.off.items()
            for name, value in values.items()
        ]
        return [*own, *(_fault(name, dict(values)) for name, values in self.faults.items())]

    def public(self) -> dict[str, Any]:
        """What the tool is told besides the recordings."""
        told = {"joint": self.joint, "known_frame": self.known_frame, "without": list(self.without)}
        return told | ({"tolerances": dict(self.tolerances)} if self.tolerances else {})

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Case":
        """The reverse of ``to_json``."""
        sessions = tuple(Session(**one) for one in content["sessions"])
        return cls(**{**content, "sessions": sessions, "without": tuple(content["without"])})


def plant_values(name: str, values: Mapping[str, float], speed_rpm: float) -> dict[str, float]:
    """An effect's parameters under the plant's names.

    Args:
        name: of the effect.
        values: under the names of docs/effects.md.
        speed_rpm: nominal speed, of which a motor's no-load speed is a multiple.
    """
    renamed = {_FOR_THE_PLANT.get(name, {}).get(key, key): value for key, value in values.items()}
    if "no_load_ratio" in renamed:
        renamed["no_load_rpm"] = renamed.pop("no_load_ratio") * speed_rpm
    return renamed


def _fault(name: str, values: dict[str, Any]) -> Fault:
    renamed = {_SHARED_NAMES.get(key, key): value for key, value in values.items()}
    if "rate_error" in renamed:  # a sample lasts longer by it; the plant counts by how much the clock is fast
        renamed["rate_error"] = 1.0 / (1.0 + renamed["rate_error"]) - 1.0
    return Fault(kind=name, **renamed)
