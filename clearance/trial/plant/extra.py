"""Forces that no named effect describes: what a plant may hide beyond the diagnosis's list."""

from dataclasses import dataclass

import numpy as np

from clearance.trial.plant.kernels import HARMONICS, PARAMETERS, P, extra_law

KINDS = {
    "cubic_spring": 1,
    "quadratic_drag": 2,
    "square_wave": 3,
    "bump": 4,
    "dead_band_spring": 5,
    "random_periodic": 6,
    "one_sided_quadratic": 7,
    "exponential_wall": 8,
    "pulse_train": 9,
}
TARGETS = {"slider_x": 1, "rod_moment": 2, "crank_torque": 3, "frame_x": 4}
ARGUMENTS = {
    "slider_position": 1,
    "slider_velocity": 2,
    "crank_angle": 3,
    "time": 4,
    "rod_angle": 5,
}


@dataclass(frozen=True, kw_only=True)
class ExtraForce:
    """A force F(x) of one argument x: ``size`` times a shape of u = (x - centre) / width.

    The shapes: ``cubic_spring`` -u³; ``quadratic_drag`` -u|u|; ``square_wave`` tanh(20 sin(2πu + phase)),
    flanks of about 2 % of the period; ``bump`` exp(-u²/2); ``dead_band_spring`` nothing for |u| < 1, then
    -(|u| - 1) sign(u); ``random_periodic`` six harmonics of period ``width`` with random amplitudes falling
    as 1/k, drawn from ``seed``, largest value 1; ``one_sided_quadratic`` -max(u, 0)²; ``exponential_wall``
    -exp(u), u at most 20; ``pulse_train`` exp(8 (cos(2πu + phase) - 1)).

    A force on the slider is held by the frame, which feels its reaction; a moment on the rod or a force on
    the frame comes from outside.

    Attributes:
        target: ``slider_x``, ``frame_x`` [N]; ``rod_moment``, ``crank_torque`` [N m].
        argument: ``slider_position``, ``slider_velocity`` [m, m/s, relative to A], ``crank_angle``,
            ``rod_angle`` [rad], ``time`` [s].
        kind: one of ``KINDS``.
        size: [N] or [N m].
        centre: of the argument [its unit].
        width: of the argument [its unit], positive; the period where the force repeats.
        phase: [rad].
        seed: of the random kind.
    """

    target: str
    argument: str
    kind: str
    size: float
    centre: float = 0.0
    width: float = 1.0
    phase: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, table in (("target", TARGETS), ("argument", ARGUMENTS), ("kind", KINDS)):
            if getattr(self, name) not in table:
                given = getattr(self, name)
                raise ValueError(f"ExtraForce.{name} = {given!r}; choose from {', '.join(table)}")
        if not self.width > 0.0:
            raise ValueError(f"ExtraForce.width = {self.width:g} must be positive")

    def write(self, p: np.ndarray) -> None:
        """Write the force into a plant's parameters."""
        p[P.EXTRA_KIND], p[P.EXTRA_TARGET] = KINDS[self.kind], TARGETS[self.target]
        p[P.EXTRA_ARGUMENT], p[P.EXTRA_SIZE] = ARGUMENTS[self.argument], self.size
        p[P.EXTRA_CENTRE], p[P.EXTRA_WIDTH], p[P.EXTRA_PHASE] = self.centre, self.width, self.phase
        table = np.random.default_rng(self.seed).standard_normal((HARMONICS, 2))
        table /= np.arange(1, HARMONICS + 1)[:, None]
        angle = np.linspace(0.0, 2.0 * np.pi, 721)[:, None] * np.arange(1, HARMONICS + 1)
        shape = np.cos(angle) @ table[:, 0] + np.sin(angle) @ table[:, 1]
        p[P.EXTRA_TABLE : P.EXTRA_TABLE + 2 * HARMONICS] = (table / np.abs(shape).max()).ravel()

    def value(self, argument: np.ndarray) -> np.ndarray:
        """The force [N or N m] at values of the argument: what a free-form estimate should find."""
        p = np.zeros(PARAMETERS)
        self.write(p)
        flat = np.asarray(argument, dtype=float).ravel()
        return np.array([extra_law(p, x) for x in flat]).reshape(np.shape(argument))
