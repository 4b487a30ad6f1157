"""Schemes that advance the state by one step; no physics here.

Both take a step per lane, so that lanes in contact can take several short steps while the others take one
long step and then stand still: what a lane does never depends on its neighbours.
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from math import ceil
from typing import Any

from clearance.compilation import kernel, subroutine
from clearance.errors import InputError
from clearance.lanes import any_lane, get, maximum, put, where, zero
from clearance.mechanism.choice import chosen
from clearance.mechanism.parameters import Family, require
from clearance.simulation.equations import evaluate
from clearance.simulation.jumps import until_jump
from clearance.simulation.kinematics import project
from clearance.simulation.layout import COORDINATES, STATES, Result, State


class Scheme(IntEnum):
    """Integration schemes."""

    SEMI_IMPLICIT_EULER = 0
    RUNGE_KUTTA_4 = 1


@dataclass(frozen=True)
class Integrator:
    """How time advances.

    Attributes:
        scheme: ``semi_implicit_euler`` (the paper's equations 7 and 8, first order) or ``runge_kutta_4``.
        step: longest step [s]; a sampling period is divided into as few as it allows.
        contact_refinement: steps that replace one while a joint touches or is about to.
    """

    scheme: str = "semi_implicit_euler"
    step: float = 1e-5
    contact_refinement: int = 1

    def __post_init__(self) -> None:
        names = [scheme.name.lower() for scheme in Scheme]
        if self.scheme not in names:
            raise InputError(
                f"integrator.scheme = {self.scheme!r} is not one of {', '.join(names)}; "
                "change integrator.scheme"
            )
        require(self, 1e-8, 1e-3, step=self.step)
        require(self, 1, 1000, whole=True, contact_refinement=self.contact_refinement)

    @property
    def code(self) -> int:
        """The scheme as the compiled step knows it."""
        return int(Scheme[self.scheme.upper()])

    def substeps(self, sampling_period: float) -> int:
        """Steps in a sampling period [s]: the fewest that are no longer than ``step``."""
        return max(1, ceil(sampling_period / self.step - 1e-9))  # 1e-9: round-off must not add a step

    def within(self, sampling_period: float) -> "Integrator":
        """The same with the step that this leads to in a sampling period [s]."""
        return replace(self, step=sampling_period / self.substeps(sampling_period))


WORKSPACE = 2 * STATES


@kernel
def _free(codes: Any, i: int) -> bool:
    """Whether coordinate ``i`` is integrated, not computed from others by ``project``."""
    held = chosen(codes, Family.GUIDE) == 0
    both = chosen(codes, Family.JOINT_B) == 1 and chosen(codes, Family.JOINT_C) == 1
    neither = chosen(codes, Family.JOINT_B) == 0 and chosen(codes, Family.JOINT_C) == 0
    if i == State.CRANK_ANGLE:
        return True
    if i == State.FRAME_X or i == State.FRAME_Y:
        return chosen(codes, Family.FRAME) == 1
    if i == State.ROD_X or i == State.ROD_Y:
        return both
    if i == State.ROD_ANGLE:
        return not (neither and held)
    if i == State.SLIDER_X:
        return not neither
    if i == State.SLIDER_Y:
        return not (held or neither)
    if i == State.SLIDER_ANGLE:
        return not held
    return chosen(codes, Family.LINK) == 1


@kernel
def _euler(codes: Any, p: Any, s: Any, r: Any, h: Any) -> None:
    """Semi-implicit Euler: rates first, then coordinates with the new rates (equations 7 and 8)."""
    for i in range(COORDINATES):
        if _free(codes, i):
            rate = get(s, COORDINATES + i) + h * get(r, i)
            put(s, COORDINATES + i, rate)
            put(s, i, get(s, i) + h * rate)
    put(s, State.DRIVE_INTEGRAL, get(s, State.DRIVE_INTEGRAL) + h * get(r, Result.SPEED_ERROR))
    put(s, State.TIME, get(s, State.TIME) + h)
    project(codes, p, s)


@kernel
def _accumulate(codes: Any, w: Any, s: Any, r: Any, h: Any) -> None:
    """Add ``h`` times the derivative at (s, r) to the state kept in ``w``."""
    for i in range(COORDINATES):
        if _free(codes, i):
            put(w, i, get(w, i) + h * get(s, COORDINATES + i))
            put(w, COORDINATES + i, get(w, COORDINATES + i) + h * get(r, i))
    put(w, State.DRIVE_INTEGRAL, get(w, State.DRIVE_INTEGRAL) + h * get(r, Result.SPEED_ERROR))


@subroutine
def _stage(codes: Any, p: Any, s: Any, r: Any, w: Any, h: Any) -> None:
    """Move ``s`` to the start state (second half of ``w``) plus ``h`` times its own derivative."""
    for i in range(COORDINATES):
        if _free(codes, i):
            rate = get(s, COORDINATES + i)
            put(s, COORDINATES + i, get(w, STATES + COORDINATES + i) + h * get(r, i))
            put(s, i, get(w, STATES + i) + h * rate)
    integral = get(w, STATES + State.DRIVE_INTEGRAL)
    put(s, State.DRIVE_INTEGRAL, integral + h * get(r, Result.SPEED_ERROR))
    put(s, State.TIME, get(w, STATES + State.TIME) + h)
    project(codes, p, s)
    evaluate(codes, p, s, r)


@subroutine
def _runge_kutta(codes: Any, p: Any, s: Any, r: Any, w: Any, h: Any) -> None:
    """Classical Runge-Kutta of fourth order; ``r`` holds the first stage."""
    for i in range(State.TIME + 1):
        start = get(s, i)
        put(w, i, start)
        put(w, STATES + i, start)
    _accumulate(codes, w, s, r, h * (1.0 / 6.0))
    _stage(codes, p, s, r, w, 0.5 * h)
    _accumulate(codes, w, s, r, h * (1.0 / 3.0))
    _stage(codes, p, s, r, w, 0.5 * h)
    _accumulate(codes, w, s, r, h * (1.0 / 3.0))
    _stage(codes, p, s, r, w, h)
    _accumulate(codes, w, s, r, h * (1.0 / 6.0))
    for i in range(State.DRIVE_INTEGRAL + 1):
        put(s, i, get(w, i))
    project(codes, p, s)


@subroutine
def _runge_kutta_to_jumps(codes: Any, p: Any, s: Any, r: Any, w: Any, h: Any) -> None:
    """Advance by ``h``, in two steps that meet where a force sets in, if one does on the way.

    A step across that instant is of first order only, and a contact's memory would hold the approach speed of
    a later one.
    """
    first = until_jump(codes, p, s, r, h)
    _runge_kutta(codes, p, s, r, w, first)
    rest = h - first
    if any_lane(rest > 0.0):
        evaluate(codes, p, s, r)
        remember(codes, s, r)
        _runge_kutta(codes, p, s, r, w, rest)


@kernel
def remember(codes: Any, s: Any, r: Any) -> None:
    """Take over the contact memories that an evaluation found."""
    if chosen(codes, Family.JOINT_B) == 1:
        put(s, State.MEMORY_B, get(r, Result.MEMORY_B))
    if chosen(codes, Family.JOINT_C) == 1:
        put(s, State.MEMORY_C, get(r, Result.MEMORY_C))


@subroutine
def _advance(codes: Any, p: Any, s: Any, r: Any, w: Any, scheme: int, h: Any) -> None:
    if scheme == Scheme.SEMI_IMPLICIT_EULER:
        _euler(codes, p, s, r, h)
    else:
        _runge_kutta_to_jumps(codes, p, s, r, w, h)


@subroutine
def step(codes: Any, p: Any, s: Any, r: Any, w: Any, scheme: int, h: float, refinement: int) -> None:
    """Advance ``s`` by ``h`` [s].

    Args:
        codes: chosen laws.
        p: parameter vector.
        s: state, projected; on return the new state, projected.
        r: evaluation of ``s``, memories taken over; overwritten.
        w: workspace, ``WORKSPACE`` rows.
        scheme: a ``Scheme``.
        h: step [s].
        refinement: steps that replace one in lanes where a joint touches or is about to.
    """
    whole = zero(get(s, State.TIME)) + h
    if refinement == 1:
        _advance(codes, p, s, r, w, scheme, whole)
        return
    gap = zero(whole) - 1.0  # metres before the nearest touch within this step, negative if none
    if chosen(codes, Family.JOINT_B) == 1:
        rate = maximum(get(r, Result.PENETRATION_RATE_B), 0.0)
        gap = maximum(gap, get(r, Result.PENETRATION_B) + 2.0 * h * rate)
    if chosen(codes, Family.JOINT_C) == 1:
        rate = maximum(get(r, Result.PENETRATION_RATE_C), 0.0)
        gap = maximum(gap, get(r, Result.PENETRATION_C) + 2.0 * h * rate)
    near = gap > 0.0
    short = whole / refinement
    _advance(codes, p, s, r, w, scheme, where(near, short, whole))
    if any_lane(near):
        rest = where(near, short, zero(whole))
        for _ in range(1, refinement):
            evaluate(codes, p, s, r)
            remember(codes, s, r)
            _advance(codes, p, s, r, w, scheme, rest)
