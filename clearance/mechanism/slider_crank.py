"""The planar slider-crank: its bodies, joints and laws, and the vectors that the compiled step reads.

x runs along the guide, A is the origin. Source of the nominal numbers: the paper's Tables 1 and 2.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from clearance.errors import InputError
from clearance.mechanism.applied_force import NoForce
from clearance.mechanism.drive import Drive, Smooth, SpeedControl
from clearance.mechanism.frame import FixedFrame, FlexibleFrame
from clearance.mechanism.guide import FrictionlessGuide, IdealGuide
from clearance.mechanism.joint import Joint
from clearance.mechanism.link import RigidRod
from clearance.mechanism.load import Idle, NoSpring
from clearance.mechanism.parameters import (
    FAMILIES,
    JOINT_STRIDE,
    PARAMETERS,
    Family,
    Law,
    Parameter,
    require,
    require_kind,
    require_list,
)

_LAWS = ("guide", "guide_friction", "link", "drive", "ripple", "spring", "process", "frame", "force")
_LONGEST = 10.0  # m


@dataclass(frozen=True)
class Link:
    """A rigid body between two joints.

    Attributes:
        mass: [kg].
        inertia: about the centre of mass [kg m^2].
        length: from the first to the second joint [m], 10 at most: a larger one was meant in millimetres.
        center_of_mass: from the first joint, as a fraction of the length [-].
    """

    mass: float
    inertia: float
    length: float
    center_of_mass: float = 0.5

    def __post_init__(self) -> None:
        require(self, strict=True, mass=self.mass, inertia=self.inertia)
        require(self, 0.0, _LONGEST, strict=True, length=self.length)
        require(self, -1.0, 2.0, center_of_mass=self.center_of_mass)


@dataclass(frozen=True)
class SliderCrank:
    """A slider-crank with its laws; immutable, so that a change is a new machine.

    Attributes:
        crank: from A to B.
        rod: from B to C.
        slider: C is its centre of mass; its length and ``center_of_mass`` have no effect: a loose guide has
            its own ``shoe_half_length``.
        guide_offset: height of the guide line above A [m].
        gravity: components along x and y [m/s^2].
        sensor_positions: of the accelerometers [m] along their link from its first joint: crank A, crank B,
            rod B, rod C; ``None`` puts them at the joints. On a bent rod (``link``) they move with it.
    """

    crank: Link = field(default_factory=lambda: Link(0.3, 1e-5, 0.05))
    rod: Link = field(default_factory=lambda: Link(0.21, 2.5e-4, 0.12))
    slider: Link = field(default_factory=lambda: Link(0.14, 1.05e-5, 0.015))
    guide_offset: float = 0.0
    gravity: tuple[float, float] = (0.0, 0.0)
    sensor_positions: tuple[float, float, float, float] | None = None
    joint_b: Joint = field(default_factory=Joint)
    joint_c: Joint = field(default_factory=Joint)
    guide: Law = field(default_factory=IdealGuide)
    guide_friction: Law = field(default_factory=FrictionlessGuide)
    link: Law = field(default_factory=RigidRod)
    drive: Drive = field(default_factory=SpeedControl)
    ripple: Law = field(default_factory=Smooth)
    spring: Law = field(default_factory=NoSpring)
    process: Law = field(default_factory=Idle)
    frame: Law = field(default_factory=FixedFrame)
    force: Law = field(default_factory=NoForce)

    def __post_init__(self) -> None:
        links = {"crank": self.crank, "rod": self.rod, "slider": self.slider}
        require_kind(self, Link, "give {mass: ..., inertia: ..., length: ...}", **links)
        require_kind(self, Joint, "give {clearance: ...}", joint_b=self.joint_b, joint_c=self.joint_c)
        for name in _LAWS:
            require_kind(self, Family[name.upper()], **{name: getattr(self, name)})
        require(self, -1.0, 1.0, guide_offset=self.guide_offset)
        reach = self.crank.length + abs(self.guide_offset)
        if self.rod.length <= reach:
            raise InputError(
                f"mechanism.rod.length = {self.rod.length:g} m cannot turn: it must exceed crank length + "
                f"offset = {reach:g} m; change mechanism.rod.length, .crank.length or .guide_offset"
            )
        require_list(self, 2, -1e3, 1e3, gravity=self.gravity)
        object.__setattr__(self, "gravity", tuple(self.gravity))
        if self.sensor_positions is not None:
            require_list(self, 4, -10.0, 10.0, sensor_positions=self.sensor_positions)
            object.__setattr__(self, "sensor_positions", tuple(self.sensor_positions))

    @property
    def laws(self) -> tuple[Law, ...]:
        """The machine's laws outside its joints."""
        return tuple(getattr(self, name) for name in _LAWS)

    def codes(self) -> np.ndarray:
        """(families,) int64: which member of each family is chosen."""
        return self._chosen.copy()

    @cached_property
    def _chosen(self) -> np.ndarray:
        codes = np.zeros(FAMILIES, dtype=np.int64)
        codes[Family.JOINT_B] = self.joint_b.loose
        codes[Family.JOINT_C] = self.joint_c.loose
        for joint in (self.joint_b, self.joint_c):
            if joint.loose:
                for law in (joint.friction, joint.film, joint.bearing):
                    codes[law.family] = max(codes[law.family], law.code)
        for law in self.laws:
            codes[law.family] = law.code
        return codes

    def parameters(self) -> np.ndarray:
        """(PARAMETERS,) float64: the numbers of bodies and laws in the layout of ``Parameter``."""
        return self._numbers.copy()

    @cached_property
    def _numbers(self) -> np.ndarray:
        values = np.zeros(PARAMETERS)
        positions = self.sensor_positions or (0.0, self.crank.length, 0.0, self.rod.length)
        crank_arm = self.crank.center_of_mass * self.crank.length
        rod_arm = self.rod.center_of_mass * self.rod.length
        held = isinstance(self.guide, IdealGuide)
        entries: dict[Parameter, Any] = {
            Parameter.GRAVITY_X: self.gravity[0],
            Parameter.GRAVITY_Y: self.gravity[1],
            Parameter.CRANK_LENGTH: self.crank.length,
            Parameter.CRANK_MASS: self.crank.mass,
            Parameter.CRANK_MOMENT: self.crank.mass * crank_arm,
            Parameter.CRANK_INVERSE_INERTIA: 1.0 / (self.crank.inertia + self.crank.mass * crank_arm**2),
            Parameter.ROD_MASS: self.rod.mass,
            Parameter.ROD_INVERSE_MASS: 1.0 / self.rod.mass,
            Parameter.ROD_INVERSE_INERTIA: 1.0 / self.rod.inertia,
            Parameter.ROD_TO_B: rod_arm,
            Parameter.ROD_TO_C: self.rod.length - rod_arm,
            Parameter.SLIDER_MASS: self.slider.mass,
            Parameter.SLIDER_INVERSE_MASS: 1.0 / self.slider.mass,
            Parameter.SLIDER_INVERSE_INERTIA: 0.0 if held else 1.0 / self.slider.inertia,
            Parameter.GUIDE_OFFSET: self.guide_offset,
            Parameter.SENSOR_CRANK_A: positions[0],
            Parameter.SENSOR_CRANK_B: positions[1],
            Parameter.SENSOR_ROD_B: positions[2],
            Parameter.SENSOR_ROD_C: positions[3],
        }
        for law in self.laws:
            entries.update(law.numbers())
        if isinstance(self.frame, FlexibleFrame):
            moving = self.frame.mass + self.crank.mass
            entries[Parameter.FRAME_INVERSE_MASS_X] = 1.0 / moving
            entries[Parameter.FRAME_INVERSE_MASS_Y] = 1.0 / (moving + (self.slider.mass if held else 0.0))
        for entry, value in entries.items():
            values[entry] = value
        for block, joint in ((0, self.joint_b), (JOINT_STRIDE, self.joint_c)):
            for entry, value in joint.numbers().items():
                values[entry + block] = value
        return values
