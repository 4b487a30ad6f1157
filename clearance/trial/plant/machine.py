"""The plant: a slider-crank with named effects and, if wanted, a force that has no name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import asin, cos, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clearance.trial.plant.effects import HYSTERESIS, apply, complete
from clearance.trial.plant.extra import ExtraForce
from clearance.trial.plant.kernels import (
    COORDINATES,
    PARAMETERS,
    RESULTS,
    STATE,
    J,
    P,
    Q,
    R,
    integrate,
)
from clearance.trial.plant.measurement import CHANNELS, MARGIN, Fault, measure

FloatArray = NDArray[np.float64]
BASE_RATE = 100_000.0  # Hz, of the signals


@dataclass(frozen=True, eq=False)
class Instant:
    """Where a plant is at one time: what it needs to go on.

    Attributes:
        time: [s].
        state: (STATE,) columns ``kernels.Q``, their rates, the drive's integral.
        memory: (2,) approach speeds at first touch of B and C [m/s]; 0 while apart.
    """

    time: float
    state: FloatArray
    memory: FloatArray


@dataclass(frozen=True, eq=False)
class Run:
    """What happened inside the plant.

    Attributes:
        signals: (samples, 15) at 100 kHz from time 0, columns ``CHANNELS``, unfiltered, SI units.
        truth: (samples or 0, RESULTS) forces and gaps of each sample, columns ``kernels.R``: drive torque;
            penetration, its rate, contact force and eccentricity of B and of C; guide reaction and friction;
            extra force; load along the slider.
    """

    signals: FloatArray
    truth: FloatArray

    def true(self, name: str) -> FloatArray:
        """(samples,) one column of the truth by its name in ``kernels.R``, such as ``"NORMAL_C"``."""
        return self.truth[:, R[name]]


@dataclass(frozen=True, kw_only=True)
class Plant:
    """A slider-crank whose truth is known; the defaults are the nominal machine of docs/mechanism.md.

    Attributes:
        joint: the joint with clearance, ``none``, ``B``, ``C`` or ``both``; effects in the joint are there.
        clearance: radial [m]; a pair (B, C) for ``both`` if they differ.
        speed_rpm: reference speed [rpm].
        effects: name of the effect in docs/effects.md to its parameters.
        extra: a force that no effect describes, or ``None``.
        crank: mass [kg], inertia about the centre of mass [kg m²], length [m]; the centre is at mid-length.
        rod: likewise.
        slider: mass [kg], inertia [kg m²]; C is its centre of mass.
        gravity: along x and y [m/s²]; the effect ``gravity`` adds to it.
        kp: gain of the speed error [N m s/rad].
        ki: gain of its integral [N m/rad].
        ramp: duration of the reference's rise from 0 [s].
        restitution: of Lankarani and Nikravesh's law [-], unless the effect ``restitution`` says otherwise.
        journal_radius: [m].
        step: of the integration [s]; 1e-5 must be a multiple of it.
    """

    joint: str = "C"
    clearance: float | tuple[float, float] = 3e-4
    speed_rpm: float = 700.0
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    extra: ExtraForce | None = None
    crank: tuple[float, float, float] = (0.3, 1e-5, 0.05)
    rod: tuple[float, float, float] = (0.21, 2.5e-4, 0.12)
    slider: tuple[float, float] = (0.14, 1.05e-5)
    gravity: tuple[float, float] = (0.0, 0.0)
    kp: float = 5.0
    ki: float = 200.0
    ramp: float = 0.5
    restitution: float = 0.9
    journal_radius: float = 0.01
    step: float = 1e-6

    def __post_init__(self) -> None:
        if self.joint not in ("none", "B", "C", "both"):
            raise ValueError(f"Plant.joint = {self.joint!r}; choose from none, B, C, both")
        if self.joint != "both" and not isinstance(self.clearance, int | float):
            raise ValueError(f"Plant.clearance = {self.clearance}: a pair needs joint = 'both'")
        self.parameters()

    def clearances(self) -> tuple[float, float]:
        """Radial clearance of B and C [m], 0 where the joint is ideal."""
        given = self.clearance if isinstance(self.clearance, tuple) else (self.clearance, self.clearance)
        b = given[0] if self.joint in ("B", "both") else 0.0
        c = given[1] if self.joint in ("C", "both") else 0.0
        if "second_clearance" in self.effects:
            other = float(complete("second_clearance", self.effects["second_clearance"])["clearance"])
            if self.joint not in ("B", "C"):
                raise ValueError(f"second_clearance needs joint B or C, not {self.joint!r}")
            b, c = (other, c) if self.joint == "C" else (b, other)
        return b, c

    def parameters(self) -> FloatArray:
        """(PARAMETERS,) what the compiled step reads.

        Raises:
            ValueError: if an effect or a parameter is unknown or cannot be.
        """
        effects = {name: complete(name, given) for name, given in self.effects.items()}
        p = np.zeros(PARAMETERS)
        p[P.GRAVITY_X], p[P.GRAVITY_Y] = self.gravity
        p[P.CRANK_MASS], p[P.CRANK_INERTIA] = self.crank[:2]
        p[P.CRANK_TO_A], p[P.CRANK_TO_B] = -0.5 * self.crank[2], 0.5 * self.crank[2]
        p[P.ROD_MASS], p[P.ROD_INERTIA] = self.rod[:2]
        p[P.ROD_TO_B], p[P.ROD_TO_C] = -0.5 * self.rod[2], 0.5 * self.rod[2]
        p[P.SLIDER_MASS], p[P.SLIDER_INERTIA] = self.slider
        p[P.KP], p[P.KI], p[P.RAMP] = self.kp, self.ki, self.ramp
        p[P.SPEED] = self.speed_rpm * pi / 30.0
        b, c = self.clearances()
        contact = effects.get("restitution", {"restitution": self.restitution, "law": "lankarani_nikravesh"})
        scale = effects.get("contact_stiffness", {"scale": 1.0})["scale"]
        for o, flag, clearance in ((P.JOINT_B, P.LOOSE_B, b), (P.JOINT_C, P.LOOSE_C, c)):
            if clearance > 0.0:
                sigma = (1.0 - 0.3**2) / 200e9
                bearing = self.journal_radius + clearance
                p[flag], p[o + J.CLEARANCE], p[o + J.RADIUS] = 1.0, clearance, self.journal_radius
                p[o + J.STIFFNESS] = (
                    scale * 4.0 / (3.0 * 2.0 * sigma) * sqrt(self.journal_radius * bearing / clearance)
                )
                p[o + J.HYSTERESIS] = HYSTERESIS[contact["law"]](contact["restitution"])
        diagnosed = {"none": (), "B": (P.JOINT_B,), "C": (P.JOINT_C,), "both": (P.JOINT_B, P.JOINT_C)}
        apply(p, tuple(int(o) for o in diagnosed[self.joint]), effects)
        if self.extra is not None:
            if self.extra.target == "frame_x" and p[P.FRAME_MASS] == 0.0:
                raise ValueError("an extra force on frame_x needs the effect flexible_base")
            self.extra.write(p)
        return p

    def start(self, angle: float = 0.0, speed_rpm: float = 0.0) -> FloatArray:
        """(STATE,) the ideal mechanism at a crank angle [rad] and speed [rpm], journals centred."""
        p = self.parameters()
        omega = speed_rpm * pi / 30.0
        length, rod_length = self.crank[2], self.rod[2]
        rod_angle = asin((p[P.OFFSET] - length * sin(angle)) / rod_length)
        rod_omega = -length * cos(angle) * omega / (rod_length * cos(rod_angle))
        b, b_rate = length * _unit(angle), length * omega * _turned(angle)
        s = np.zeros(STATE)
        places: list[tuple[Q, FloatArray, FloatArray]] = [
            (Q.CRANK_X, 0.5 * b, 0.5 * b_rate),
            (
                Q.ROD_X,
                b - p[P.ROD_TO_B] * _unit(rod_angle),
                b_rate - p[P.ROD_TO_B] * rod_omega * _turned(rod_angle),
            ),
            (
                Q.SLIDER_X,
                b + rod_length * _unit(rod_angle),
                b_rate + rod_length * rod_omega * _turned(rod_angle),
            ),
        ]
        for first, place, rate in places:
            s[first : first + 2] = place
            s[COORDINATES + first : COORDINATES + first + 2] = rate
        s[Q.CRANK], s[COORDINATES + Q.CRANK] = angle, omega
        s[Q.ROD], s[COORDINATES + Q.ROD] = rod_angle, rod_omega
        return s

    def run(
        self, duration: float, start_angle: float = 0.0, start_speed_rpm: float = 0.0, truth: bool = False
    ) -> Run:
        """Simulate from time 0, when the reference begins to rise.

        Args:
            duration: [s].
            start_angle: of the crank [rad].
            start_speed_rpm: of the crank [rpm]; rod and slider move as in the ideal mechanism.
            truth: whether to keep forces and gaps.

        Raises:
            FloatingPointError: if the state becomes non-finite.
        """
        begin = Instant(0.0, self.start(start_angle, start_speed_rpm), np.zeros(2))
        return self.go_on(begin, duration, truth)[0]

    def go_on(self, instant: Instant, duration: float, truth: bool = False) -> tuple[Run, Instant]:
        """Simulate from any instant; return what happened and where it ended.

        Raises:
            FloatingPointError: if the state becomes non-finite.
        """
        every = round(1.0 / (BASE_RATE * self.step))
        if every < 1 or abs(every * self.step * BASE_RATE - 1.0) > 1e-9:
            raise ValueError(f"Plant.step = {self.step:g} s must divide {1.0 / BASE_RATE:g} s")
        samples = round(duration * BASE_RATE)
        signals = np.zeros((samples, len(CHANNELS)))
        kept = np.zeros((samples if truth else 0, RESULTS))
        state, memory = instant.state.copy(), instant.memory.copy()
        done = integrate(self.parameters(), instant.time, state, memory, self.step, every, signals, kept)
        if done < samples or not np.isfinite(signals).all():
            at = instant.time + done / BASE_RATE
            raise FloatingPointError(f"not finite at {at:g} s; effects {dict(self.effects)}")
        return Run(signals, kept), Instant(instant.time + samples / BASE_RATE, state, memory)

    def recording(
        self,
        duration: float,
        record_start: float = 1.0,
        channels: Sequence[str] = CHANNELS,
        rate: float = 10_000.0,
        noise: float = 0.01,
        seed: int = 0,
        encoder_counts: int | None = 4096,
        faults: Sequence[Fault] = (),
        start_angle: float = 0.0,
        start_speed_rpm: float = 0.0,
    ) -> dict[str, FloatArray]:
        """What a logger would have kept, through the measurement chain of docs/mechanism.md.

        Args:
            duration: length of the recording [s].
            record_start: time of its first sample after the start of the motion [s], at least 0.01.
            channels: names out of ``CHANNELS``.
            rate: [Hz]; 100 kHz over a whole number.
            noise: standard deviation of white noise, as a fraction of each channel's.
            seed: of the noise.
            encoder_counts: per turn, for the crank's angle; ``None`` for a perfect one.
            faults: of the instruments.
            start_angle: see ``run``.
            start_speed_rpm: see ``run``.

        Returns:
            ``time`` [s], from 0, then the channels; the crank's angle starts within the first turn.
        """
        stretch = 1.0 + max([abs(fault.rate_error) for fault in faults] + [0.0])
        run = self.run(record_start + duration * stretch + MARGIN, start_angle, start_speed_rpm)
        return measure(
            run.signals,
            BASE_RATE,
            duration,
            record_start,
            channels,
            rate,
            noise,
            seed,
            encoder_counts,
            faults,
        )


def _unit(angle: float) -> FloatArray:
    return np.array([cos(angle), sin(angle)])


def _turned(angle: float) -> FloatArray:
    return np.array([-sin(angle), cos(angle)])
