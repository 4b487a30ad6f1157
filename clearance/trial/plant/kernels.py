"""Compiled part of the plant: equations of motion, integration, sensing; no code shared with the simulator.

Maximal coordinates: x, y and angle of the centre of mass of crank, rod and slider, the frame's x and y, and
one bending mode. Joints and guide are constraints with Lagrange multipliers (force on the first of the two
bodies that a constraint names), found from the Schur complement of the mass matrix. Fourth-order Runge-Kutta;
the step in which a journal touches is split at the touch, one in which another force jumps in sixteen.
Positions and speeds are put back on the constraints at each sample.

The bending mode is eta sin(pi s / L) between the pins: mean deflection 2/pi eta, modal mass half the rod's.
Moments on the pins' journals do not bend the rod, and its sensors keep the axes of the line from B to C.

One file on purpose: Numba's cache notices a change only in the file that holds the cached function.
Reference: Shabana, Dynamics of Multibody Systems, ch. 3 (multipliers), ch. 5 (floating frame of a bent rod).
"""

from enum import IntEnum, auto
from math import atan2, cos, exp, pi, sin, sqrt, tanh
from typing import Any

import numpy as np
from numba import njit

COORDINATES = 12
STATE = 25  # coordinates, their rates, integral of the speed error
APPROACH_FLOOR = 1e-3  # m/s
FILM_LIMIT = 0.99  # of the clearance: beyond, the film grows no stiffer
SPLIT = 16  # parts of a step in which a force jumps
HARMONICS = 6  # of a periodic extra force


class Q(IntEnum):
    """Coordinates; the rate of each is ``COORDINATES`` further on. SI units, inertial axes."""

    CRANK_X = 0
    CRANK_Y = auto()
    CRANK = auto()
    ROD_X = auto()
    ROD_Y = auto()
    ROD = auto()
    SLIDER_X = auto()
    SLIDER_Y = auto()
    SLIDER = auto()
    FRAME_X = auto()
    FRAME_Y = auto()
    MODE = auto()


class P(IntEnum):
    """Parameters; SI units."""

    GRAVITY_X = 0
    GRAVITY_Y = auto()
    CRANK_MASS = auto()
    CRANK_INERTIA = auto()
    CRANK_TO_A = auto()  # m, along the crank from its centre of mass (negative)
    CRANK_TO_B = auto()
    ROD_MASS = auto()
    ROD_INERTIA = auto()
    ROD_TO_B = auto()
    ROD_TO_C = auto()
    SLIDER_MASS = auto()
    SLIDER_INERTIA = auto()
    OFFSET = auto()
    LOOSE_B = auto()  # flags: 0 or 1
    LOOSE_C = auto()
    LOOSE_GUIDE = auto()
    FRAME_MASS = auto()  # 0: stands fast
    FRAME_STIFFNESS = auto()
    FRAME_DAMPING = auto()
    MODE_SHARE = auto()  # mean deflection per unit of the mode: 2/pi, 0 for a rigid rod
    MODE_OMEGA2 = auto()
    MODE_DAMPING = auto()
    MODE_SECOND = auto()  # 1: with the terms of the bent rod in its rotation and stretch, 0: without
    KP = auto()
    KI = auto()
    SPEED = auto()
    RAMP = auto()
    RIPPLE = auto()
    RIPPLE_ORDER = auto()
    RIPPLE_PHASE = auto()
    SPRING = auto()
    SPRING_FREE = auto()
    PROCESS = auto()
    PROCESS_START = auto()
    PROCESS_END = auto()
    SHOE_GAP = auto()
    SHOE_STIFFNESS = auto()
    SHOE_DAMPING = auto()
    SHOE_HALF = auto()
    GUIDE_RUBS = auto()  # flag
    GUIDE_COULOMB = auto()
    GUIDE_VISCOUS = auto()
    GUIDE_STRIBECK = auto()
    GUIDE_STRIBECK_SPEED = auto()
    GUIDE_MU = auto()
    GUIDE_SMOOTHING = auto()
    EXTRA_KIND = auto()
    EXTRA_TARGET = auto()
    EXTRA_ARGUMENT = auto()
    EXTRA_SIZE = auto()
    EXTRA_CENTRE = auto()
    EXTRA_WIDTH = auto()
    EXTRA_PHASE = auto()
    EXTRA_TABLE = auto()  # cosine and sine of each harmonic
    JOINT_B = 70  # after 2 * HARMONICS entries of the table
    JOINT_C = 82


class J(IntEnum):
    """Entries of one joint's block of the parameters."""

    CLEARANCE = 0
    STIFFNESS = auto()
    HYSTERESIS = auto()
    RADIUS = auto()
    MU = auto()
    SMOOTHING = auto()
    FILM = auto()
    WEAR = auto()
    WEAR_ORDER = auto()
    WEAR_PHASE = auto()


PARAMETERS = P.JOINT_C + 12


class R(IntEnum):
    """What an evaluation leaves behind besides the derivative."""

    TORQUE = 0
    DEPTH_B = auto()  # m, penetration
    RATE_B = auto()
    NORMAL_B = auto()
    GAP_X_B = auto()  # m, journal centre minus bearing centre
    GAP_Y_B = auto()
    DEPTH_C = auto()
    RATE_C = auto()
    NORMAL_C = auto()
    GAP_X_C = auto()
    GAP_Y_C = auto()
    REACTION = auto()  # N, of the guide on the slider, +y
    FRICTION = auto()  # N, of the guide on the slider, +x
    EXTRA = auto()
    LOAD = auto()
    REGIME = auto()  # which forces that begin or end with a jump act: 1 process, 2 and 4 the shoe's ends


RESULTS = len(R)


class G(IntEnum):
    """Geometry and mobility of one evaluation, kept for the projection."""

    CRANK_COS = 0
    CRANK_SIN = auto()
    ROD_COS = auto()
    ROD_SIN = auto()
    ALONG = auto()  # 1/kg: rod's acceleration along itself per force along it
    MIXED = auto()  # 1/(kg m): turning per force along (only a bent rod)
    TURN = auto()  # 1/(kg m^2)
    ACROSS = auto()  # 1/kg


GEOMETRY = len(G)


@njit(cache=True, nogil=True, error_model="numpy")
def _soft_sign(v: float, v0: float) -> float:
    return v / sqrt(v * v + v0 * v0)


@njit(cache=True, nogil=True, error_model="numpy")
def _joint_force(
    p: Any, o: int, memory: float, ex: float, ey: float, vx: float, vy: float,
    journal_spin: float, bearing_spin: float, bearing_angle: float,
) -> Any:  # fmt: skip
    """Force on the journal, moments on journal's and bearing's body, gap; ``o`` is the joint's block."""
    distance = sqrt(ex * ex + ey * ey)
    if distance < 1e-15:
        return 0.0, 0.0, 0.0, 0.0, -p[o + J.CLEARANCE], 0.0, 0.0
    nx, ny = ex / distance, ey / distance
    depth = distance - p[o + J.CLEARANCE]
    if p[o + J.WEAR] != 0.0:
        angle = p[o + J.WEAR_ORDER] * (atan2(ey, ex) - bearing_angle) + p[o + J.WEAR_PHASE]
        slope = -p[o + J.WEAR] * p[o + J.WEAR_ORDER] * sin(angle) / distance
        stretch = sqrt(1.0 + slope * slope)
        depth = (depth - p[o + J.WEAR] * cos(angle)) / stretch
        # outward normal: radial minus slope times tangential (-ny, nx)
        nx, ny = (nx + slope * ny) / stretch, (ny - slope * nx) / stretch
    # rate relative to the turning bearing, along the normal
    rate = (vx + bearing_spin * ey) * nx + (vy - bearing_spin * ex) * ny
    fx, fy, journal_moment, normal = 0.0, 0.0, 0.0, 0.0
    radius = p[o + J.RADIUS]
    if memory > 0.0 and depth > 0.0:
        normal = p[o + J.STIFFNESS] * depth * sqrt(depth) * (1.0 + p[o + J.HYSTERESIS] * rate / memory)
        normal = max(normal, 0.0)
        rub = 0.0
        if p[o + J.MU] != 0.0:
            sliding = vy * nx - vx * ny + radius * journal_spin
            sliding -= bearing_spin * (ex * nx + ey * ny + radius)
            rub = -p[o + J.MU] * normal * _soft_sign(sliding, p[o + J.SMOOTHING])
        fx, fy = -normal * nx - rub * ny, -normal * ny + rub * nx
        journal_moment = radius * rub
    bearing_moment = -((ex + radius * nx) * fy - (ey + radius * ny) * fx)
    if p[o + J.FILM] != 0.0:
        ratio = min(distance / p[o + J.CLEARANCE], FILM_LIMIT)
        damping = p[o + J.FILM] * (1.0 - ratio * ratio) ** -1.5
        fx -= damping * vx
        fy -= damping * vy
        bearing_moment += damping * (ex * vy - ey * vx)
    return fx, fy, journal_moment, bearing_moment, depth, rate, normal


@njit(cache=True, nogil=True, error_model="numpy")
def extra_law(p: Any, x: float) -> float:
    """The extra force [N or N m] at its argument ``x``; see ``plant.extra``."""
    kind = int(p[P.EXTRA_KIND])
    size = p[P.EXTRA_SIZE]
    u = (x - p[P.EXTRA_CENTRE]) / p[P.EXTRA_WIDTH]
    if kind == 1:
        return -size * u * u * u
    if kind == 2:
        return -size * u * abs(u)
    if kind == 3:
        return size * tanh(20.0 * sin(2.0 * pi * u + p[P.EXTRA_PHASE]))
    if kind == 4:
        return size * exp(-0.5 * u * u)
    if kind == 5:
        return -size * (u - 1.0) if u > 1.0 else (-size * (u + 1.0) if u < -1.0 else 0.0)
    if kind == 6:
        force = 0.0
        for k in range(HARMONICS):
            angle = 2.0 * pi * (k + 1) * u
            force += p[P.EXTRA_TABLE + 2 * k] * cos(angle) + p[P.EXTRA_TABLE + 2 * k + 1] * sin(angle)
        return size * force
    if kind == 7:
        return -size * max(u, 0.0) * max(u, 0.0)
    if kind == 8:
        return -size * exp(min(u, 20.0))
    if kind == 9:
        return size * exp(8.0 * (cos(2.0 * pi * u + p[P.EXTRA_PHASE]) - 1.0))
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _shoe_force(p: Any, height: float, rate: float) -> float:
    depth = abs(height) - p[P.SHOE_GAP]
    if depth <= 0.0:
        return 0.0
    side = 1.0 if height > 0.0 else -1.0
    return -side * max(p[P.SHOE_STIFFNESS] * depth + p[P.SHOE_DAMPING] * side * rate, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _factor(S: Any, n: int) -> None:
    """Overwrite the lower triangle of the symmetric S by the unit L of L D L'; the diagonal keeps 1/D."""
    for j in range(n):
        inverse = 1.0 / S[j, j]
        for i in range(j + 1, n):
            share = S[i, j] * inverse
            for k in range(j + 1, i + 1):
                S[i, k] -= share * S[k, j]
        for i in range(j + 1, n):
            S[i, j] *= inverse
        S[j, j] = inverse


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(S: Any, n: int, b: Any) -> None:
    """Solve with the factors in S; b is overwritten."""
    for i in range(n):
        for k in range(i):
            b[i] -= S[i, k] * b[k]
    for i in range(n):
        b[i] *= S[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= S[k, i] * b[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _rod_mobility(g: Any, first: float, second: float) -> Any:
    """Acceleration of a point on the rod per force on another; both by their distance from the centre."""
    c, s = g[G.ROD_COS], g[G.ROD_SIN]
    a, b = g[G.MIXED] * second, g[G.MIXED] * first
    across = g[G.ACROSS] + first * second * g[G.TURN]
    along = g[G.ALONG]
    return (
        along * c * c - (a + b) * c * s + across * s * s,
        (along - across) * c * s + a * c * c - b * s * s,
        (along - across) * c * s - a * s * s + b * c * c,
        along * s * s + (a + b) * c * s + across * c * c,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _schur(p: Any, g: Any, S: Any) -> int:
    """Fill the lower triangle of G M^-1 G' in the order A, B, C, guide; returns its size."""
    inverse_mass, inverse_inertia = 1.0 / p[P.CRANK_MASS], 1.0 / p[P.CRANK_INERTIA]
    c, s = g[G.CRANK_COS], g[G.CRANK_SIN]
    frame = 1.0 / p[P.FRAME_MASS] if p[P.FRAME_MASS] > 0.0 else 0.0
    to_a, to_b = p[P.CRANK_TO_A], p[P.CRANK_TO_B]
    swing = to_a * to_a * inverse_inertia
    S[0, 0] = inverse_mass + swing * s * s + frame
    S[1, 0] = -swing * s * c
    S[1, 1] = inverse_mass + swing * c * c + frame
    n = 2
    tight_b, tight_c = p[P.LOOSE_B] == 0.0, p[P.LOOSE_C] == 0.0
    if tight_b:
        swing = to_a * to_b * inverse_inertia
        S[2, 0] = inverse_mass + swing * s * s
        S[2, 1] = S[3, 0] = -swing * s * c
        S[3, 1] = inverse_mass + swing * c * c
        swing = to_b * to_b * inverse_inertia
        xx, _, yx, yy = _rod_mobility(g, p[P.ROD_TO_B], p[P.ROD_TO_B])
        S[2, 2] = inverse_mass + swing * s * s + xx
        S[3, 2] = -swing * s * c + yx
        S[3, 3] = inverse_mass + swing * c * c + yy
        n = 4
    if tight_c:
        for i in range(2):
            for j in range(n):
                S[n + i, j] = 0.0
        if tight_b:
            xx, xy, yx, yy = _rod_mobility(g, p[P.ROD_TO_C], p[P.ROD_TO_B])
            S[n, 2], S[n, 3], S[n + 1, 2], S[n + 1, 3] = -xx, -xy, -yx, -yy
        xx, _, yx, yy = _rod_mobility(g, p[P.ROD_TO_C], p[P.ROD_TO_C])
        S[n, n] = xx + 1.0 / p[P.SLIDER_MASS]
        S[n + 1, n] = yx
        S[n + 1, n + 1] = yy + 1.0 / p[P.SLIDER_MASS]
        n += 2
    if p[P.LOOSE_GUIDE] == 0.0:
        for j in range(n):
            S[n, j] = 0.0
        S[n, 1] = frame
        if tight_c:
            S[n, n - 1] = -1.0 / p[P.SLIDER_MASS]
        S[n, n] = 1.0 / p[P.SLIDER_MASS] + frame
        n += 1
    _factor(S, n)
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _push_rod(p: Any, g: Any, fx: float, fy: float, moment: float, out: Any) -> None:
    """Add what a force and a moment at the rod's centre do to its accelerations."""
    c, s = g[G.ROD_COS], g[G.ROD_SIN]
    along_force, across_force = fx * c + fy * s, fy * c - fx * s
    along = g[G.ALONG] * along_force + g[G.MIXED] * moment
    across = g[G.ACROSS] * across_force
    out[Q.ROD_X] += along * c - across * s
    out[Q.ROD_Y] += along * s + across * c
    out[Q.ROD] += g[G.MIXED] * along_force + g[G.TURN] * moment
    out[Q.MODE] -= 2.0 * p[P.MODE_SHARE] * across


@njit(cache=True, nogil=True, error_model="numpy")
def _respond(p: Any, g: Any, multipliers: Any, out: Any) -> None:
    """Add M^-1 G' times the multipliers to accelerations (or, for the projection, to speeds or positions)."""
    ax, ay = multipliers[0], multipliers[1]
    bx, by, cx, cy = 0.0, 0.0, 0.0, 0.0
    n = 2
    if p[P.LOOSE_B] == 0.0:
        bx, by = multipliers[2], multipliers[3]
        n = 4
    if p[P.LOOSE_C] == 0.0:
        cx, cy = multipliers[n], multipliers[n + 1]
        n += 2
    guide = multipliers[n] if p[P.LOOSE_GUIDE] == 0.0 else 0.0
    c, s = g[G.CRANK_COS], g[G.CRANK_SIN]
    moment = p[P.CRANK_TO_A] * (c * ay - s * ax) + p[P.CRANK_TO_B] * (c * by - s * bx)
    out[Q.CRANK_X] += (ax + bx) / p[P.CRANK_MASS]
    out[Q.CRANK_Y] += (ay + by) / p[P.CRANK_MASS]
    out[Q.CRANK] += moment / p[P.CRANK_INERTIA]
    c, s = g[G.ROD_COS], g[G.ROD_SIN]
    moment = p[P.ROD_TO_C] * (c * cy - s * cx) - p[P.ROD_TO_B] * (c * by - s * bx)
    _push_rod(p, g, cx - bx, cy - by, moment, out)
    out[Q.SLIDER_X] -= cx / p[P.SLIDER_MASS]
    out[Q.SLIDER_Y] += (guide - cy) / p[P.SLIDER_MASS]
    if p[P.FRAME_MASS] > 0.0:
        out[Q.FRAME_X] -= ax / p[P.FRAME_MASS]
        out[Q.FRAME_Y] -= (ay + guide) / p[P.FRAME_MASS]


@njit(cache=True, nogil=True, error_model="numpy")
def _residual(p: Any, g: Any, x: Any, o: int, spin: Any, of_rates: bool, b: Any) -> int:
    """What violates the constraints, with ``x[o:]`` positions, speeds or accelerations; returns their number.

    Args:
        p: parameters.
        g: geometry.
        x: vector that holds the coordinates (or their derivatives).
        o: where they begin in ``x``.
        spin: (2,) angular speeds of crank and rod, for the centripetal part of accelerations; else zero.
        of_rates: whether ``x`` holds derivatives, not positions.
        b: the residuals, written.
    """
    c, s = g[G.CRANK_COS], g[G.CRANK_SIN]
    # an arm is turned by the angle (positions), or its tip moves by the rate of the angle (derivatives)
    if of_rates:
        turn, spin2 = x[o + Q.CRANK], spin[0] * spin[0]
        ux, uy = -turn * s - spin2 * c, turn * c - spin2 * s
    else:
        ux, uy = c, s
    b[0] = x[o + Q.CRANK_X] + p[P.CRANK_TO_A] * ux - x[o + Q.FRAME_X]
    b[1] = x[o + Q.CRANK_Y] + p[P.CRANK_TO_A] * uy - x[o + Q.FRAME_Y]
    c, s = g[G.ROD_COS], g[G.ROD_SIN]
    if of_rates:
        turn, spin2 = x[o + Q.ROD], spin[1] * spin[1]
        wx, wy = -turn * s - spin2 * c, turn * c - spin2 * s
    else:
        wx, wy = c, s
    n = 2
    if p[P.LOOSE_B] == 0.0:
        b[2] = x[o + Q.CRANK_X] + p[P.CRANK_TO_B] * ux - x[o + Q.ROD_X] - p[P.ROD_TO_B] * wx
        b[3] = x[o + Q.CRANK_Y] + p[P.CRANK_TO_B] * uy - x[o + Q.ROD_Y] - p[P.ROD_TO_B] * wy
        n = 4
    if p[P.LOOSE_C] == 0.0:
        b[n] = x[o + Q.ROD_X] + p[P.ROD_TO_C] * wx - x[o + Q.SLIDER_X]
        b[n + 1] = x[o + Q.ROD_Y] + p[P.ROD_TO_C] * wy - x[o + Q.SLIDER_Y]
        n += 2
    if p[P.LOOSE_GUIDE] == 0.0:
        b[n] = x[o + Q.SLIDER_Y] - x[o + Q.FRAME_Y] - (0.0 if of_rates else p[P.OFFSET])
        n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def project(p: Any, s: Any, g: Any, S: Any, spin: Any, b: Any) -> None:
    """One Newton step back on the constraints, weighted by mass; ``g`` and ``S`` belong to ``s``."""
    spin[0] = spin[1] = 0.0
    for level in range(2):
        n = _residual(p, g, s, level * COORDINATES, spin, level == 1, b)
        for i in range(n):
            b[i] = -b[i]
        _solve(S, n, b)
        _respond(p, g, b, s[level * COORDINATES : (level + 1) * COORDINATES])


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(
    p: Any, t: float, s: Any, memory: Any, d: Any, r: Any, g: Any, S: Any, spin: Any, b: Any
) -> None:
    """Derivative of the state.

    Args:
        p: parameters.
        t: time [s].
        s: state.
        memory: (2,) approach speeds at first touch of B and C [m/s]; 0 while apart, then they feel nothing.
        d: derivative, written.
        r: forces and gaps, written.
        g: geometry and mobility, written.
        S: (7, 7) factors of the constraints' mobility, written.
        spin: (2,) scratch.
        b: (14,) scratch; the multipliers on return.
    """
    c, sn = cos(s[Q.CRANK]), sin(s[Q.CRANK])
    rc, rs = cos(s[Q.ROD]), sin(s[Q.ROD])
    g[G.CRANK_COS], g[G.CRANK_SIN], g[G.ROD_COS], g[G.ROD_SIN] = c, sn, rc, rs
    v = COORDINATES
    omega, rod_omega = s[v + Q.CRANK], s[v + Q.ROD]
    slider_omega = s[v + Q.SLIDER]
    mass, rod_mass, slider_mass = p[P.CRANK_MASS], p[P.ROD_MASS], p[P.SLIDER_MASS]
    crank_b, rod_b, rod_c = p[P.CRANK_TO_B], p[P.ROD_TO_B], p[P.ROD_TO_C]
    gx, gy = p[P.GRAVITY_X], p[P.GRAVITY_Y]
    crank_fx, crank_fy, crank_m = mass * gx, mass * gy, 0.0
    rod_fx, rod_fy, rod_m = rod_mass * gx, rod_mass * gy, 0.0
    slider_fx, slider_fy, slider_m = slider_mass * gx, slider_mass * gy, 0.0
    frame_fx, frame_fy = 0.0, 0.0

    if p[P.LOOSE_B] != 0.0:
        ex = s[Q.CRANK_X] + crank_b * c - s[Q.ROD_X] - rod_b * rc
        ey = s[Q.CRANK_Y] + crank_b * sn - s[Q.ROD_Y] - rod_b * rs
        vx = s[v + Q.CRANK_X] - crank_b * sn * omega - s[v + Q.ROD_X] + rod_b * rs * rod_omega
        vy = s[v + Q.CRANK_Y] + crank_b * c * omega - s[v + Q.ROD_Y] - rod_b * rc * rod_omega
        fx, fy, mj, mb, depth, rate, normal = _joint_force(
            p, P.JOINT_B, memory[0], ex, ey, vx, vy, omega, rod_omega, s[Q.ROD]
        )
        crank_fx += fx
        crank_fy += fy
        crank_m += crank_b * (c * fy - sn * fx) + mj
        rod_fx -= fx
        rod_fy -= fy
        rod_m += mb - rod_b * (rc * fy - rs * fx)
        r[R.DEPTH_B], r[R.RATE_B], r[R.NORMAL_B] = depth, rate, normal
        r[R.GAP_X_B], r[R.GAP_Y_B] = ex, ey
    if p[P.LOOSE_C] != 0.0:
        ex = s[Q.ROD_X] + rod_c * rc - s[Q.SLIDER_X]
        ey = s[Q.ROD_Y] + rod_c * rs - s[Q.SLIDER_Y]
        vx = s[v + Q.ROD_X] - rod_c * rs * rod_omega - s[v + Q.SLIDER_X]
        vy = s[v + Q.ROD_Y] + rod_c * rc * rod_omega - s[v + Q.SLIDER_Y]
        fx, fy, mj, mb, depth, rate, normal = _joint_force(
            p, P.JOINT_C, memory[1], ex, ey, vx, vy, rod_omega, slider_omega, s[Q.SLIDER]
        )
        rod_fx += fx
        rod_fy += fy
        rod_m += rod_c * (rc * fy - rs * fx) + mj
        slider_fx -= fx
        slider_fy -= fy
        slider_m += mb
        r[R.DEPTH_C], r[R.RATE_C], r[R.NORMAL_C] = depth, rate, normal
        r[R.GAP_X_C], r[R.GAP_Y_C] = ex, ey

    # drive
    ramp = min(t / p[P.RAMP], 1.0) if p[P.RAMP] > 0.0 else 1.0
    error = p[P.SPEED] * ramp - omega
    torque = p[P.KP] * error + p[P.KI] * s[STATE - 1]
    if p[P.RIPPLE] != 0.0:
        torque += p[P.RIPPLE] * cos(p[P.RIPPLE_ORDER] * s[Q.CRANK] + p[P.RIPPLE_PHASE])
    crank_m += torque

    # loads, held by the frame
    x, vx = s[Q.SLIDER_X] - s[Q.FRAME_X], s[v + Q.SLIDER_X] - s[v + Q.FRAME_X]
    load = -p[P.SPRING] * (x - p[P.SPRING_FREE])
    regime = 0.0
    if p[P.PROCESS] != 0.0 and p[P.PROCESS_START] <= x <= p[P.PROCESS_END]:
        load -= p[P.PROCESS]
        regime += 1.0
    extra = 0.0
    if p[P.EXTRA_KIND] != 0.0:
        which = int(p[P.EXTRA_ARGUMENT])
        argument = x
        if which == 2:
            argument = vx
        elif which == 3:
            argument = s[Q.CRANK]
        elif which == 4:
            argument = t
        elif which == 5:
            argument = s[Q.ROD]
        extra = extra_law(p, argument)
        target = int(p[P.EXTRA_TARGET])
        if target == 1:
            load += extra
        elif target == 2:
            rod_m += extra
        elif target == 3:
            crank_m += extra
        elif target == 4:
            frame_fx += extra
    slider_fx += load
    frame_fx -= load + p[P.FRAME_STIFFNESS] * s[Q.FRAME_X] + p[P.FRAME_DAMPING] * s[v + Q.FRAME_X]
    frame_fy -= p[P.FRAME_STIFFNESS] * s[Q.FRAME_Y] + p[P.FRAME_DAMPING] * s[v + Q.FRAME_Y]

    # loose guide: the shoe's two ends
    reaction, rubbed = 0.0, 0.0
    held = p[P.LOOSE_GUIDE] == 0.0
    if not held:
        height = s[Q.SLIDER_Y] - s[Q.FRAME_Y] - p[P.OFFSET]
        lift = s[v + Q.SLIDER_Y] - s[v + Q.FRAME_Y]
        reach, rise = p[P.SHOE_HALF] * cos(s[Q.SLIDER]), p[P.SHOE_HALF] * sin(s[Q.SLIDER])
        front = _shoe_force(p, height + rise, lift + reach * slider_omega)
        back = _shoe_force(p, height - rise, lift - reach * slider_omega)
        regime += 2.0 * (front != 0.0) + 4.0 * (back != 0.0)
        reaction, rubbed = front + back, abs(front) + abs(back)
        slider_fy += reaction
        frame_fy -= reaction
        slider_m += reach * (front - back)

    # the rod's mobility: a bent rod couples stretch with turning, the mode lightens it across
    share, bend, bend_rate = p[P.MODE_SHARE], s[Q.MODE], s[v + Q.MODE]
    lever = p[P.MODE_SECOND] * rod_mass * share * bend
    inertia = p[P.ROD_INERTIA] + p[P.MODE_SECOND] * 0.5 * rod_mass * bend * bend
    determinant = rod_mass * inertia - lever * lever
    g[G.ALONG], g[G.MIXED], g[G.TURN] = inertia / determinant, lever / determinant, rod_mass / determinant
    g[G.ACROSS] = 1.0 / (rod_mass * (1.0 - 2.0 * share * share))
    push = 0.0
    if share != 0.0:
        push = (rod_omega * rod_omega - p[P.MODE_OMEGA2]) * bend - p[P.MODE_DAMPING] * bend_rate
        push += 2.0 * share * (gy * rc - gx * rs)
        along = 2.0 * rod_mass * share * bend_rate * rod_omega
        across = rod_mass * share * (bend * rod_omega * rod_omega - push)
        rod_fx += along * rc - across * rs
        rod_fy += along * rs + across * rc
        rod_m -= p[P.MODE_SECOND] * rod_mass * bend * bend_rate * rod_omega + lever * (gx * rc + gy * rs)

    friction, dry, slide = 0.0, 0.0, 0.0
    if p[P.GUIDE_RUBS] != 0.0:
        ratio = vx / p[P.GUIDE_STRIBECK_SPEED]
        dry = p[P.GUIDE_COULOMB] + p[P.GUIDE_STRIBECK] * exp(-ratio * ratio)
        slide = _soft_sign(vx, p[P.GUIDE_SMOOTHING])
        if not held:
            dry += p[P.GUIDE_MU] * rubbed
        friction = -dry * slide - p[P.GUIDE_VISCOUS] * vx
        slider_fx += friction
        frame_fx -= friction

    # accelerations without reactions
    for i in range(COORDINATES):
        d[i] = s[v + i]
        d[v + i] = 0.0
    d[v + Q.CRANK_X] = crank_fx / mass
    d[v + Q.CRANK_Y] = crank_fy / mass
    d[v + Q.CRANK] = crank_m / p[P.CRANK_INERTIA]
    accelerations = d[v : 2 * v]
    _push_rod(p, g, rod_fx, rod_fy, rod_m, accelerations)
    d[v + Q.MODE] += push
    d[v + Q.SLIDER_X] = slider_fx / slider_mass
    d[v + Q.SLIDER_Y] = slider_fy / slider_mass
    if not held:
        d[v + Q.SLIDER] = slider_m / p[P.SLIDER_INERTIA]
    frame = 1.0 / p[P.FRAME_MASS] if p[P.FRAME_MASS] > 0.0 else 0.0
    d[v + Q.FRAME_X] = frame_fx * frame
    d[v + Q.FRAME_Y] = frame_fy * frame
    d[STATE - 1] = error

    n = _schur(p, g, S)
    spin[0], spin[1] = omega, rod_omega
    _residual(p, g, d, v, spin, True, b)
    for i in range(n):
        b[i] = -b[i]
    _solve(S, n, b)
    if held:
        reaction = b[n - 1]
        if p[P.GUIDE_MU] != 0.0 and p[P.GUIDE_RUBS] != 0.0:
            # the reaction N = N0 + q f and its friction f = -mu |N| slide, solved together
            unit = b[7:]
            for i in range(n):
                unit[i] = 0.0
            unit[0] = -frame
            if p[P.LOOSE_C] == 0.0:
                unit[n - 3] = 1.0 / slider_mass
            _solve(S, n, unit)
            feedback = p[P.GUIDE_MU] * slide * unit[n - 1]
            reaction = reaction / (1.0 + feedback) if reaction > 0.0 else reaction / (1.0 - feedback)
            more = -p[P.GUIDE_MU] * abs(reaction) * slide
            friction += more
            d[v + Q.SLIDER_X] += more / slider_mass
            d[v + Q.FRAME_X] -= more * frame
            for i in range(n):
                b[i] += more * unit[i]
    _respond(p, g, b, accelerations)
    r[R.TORQUE] = torque
    r[R.REACTION] = reaction
    r[R.FRICTION] = friction
    r[R.EXTRA] = extra
    r[R.LOAD] = load
    r[R.REGIME] = regime


@njit(cache=True, nogil=True, error_model="numpy")
def _runge_kutta(
    p: Any, t: float, h: float, s: Any, d: Any, memory: Any, out: Any, k: Any, r: Any, g: Any, S: Any,
    spin: Any, b: Any, total: Any,
) -> None:  # fmt: skip
    """Advance ``s`` with derivative ``d`` by ``h`` into ``out``."""
    for i in range(STATE):
        total[i] = s[i] + h / 6.0 * d[i]
        out[i] = s[i] + 0.5 * h * d[i]
    evaluate(p, t + 0.5 * h, out, memory, k, r, g, S, spin, b)
    for i in range(STATE):
        total[i] += h / 3.0 * k[i]
        out[i] = s[i] + 0.5 * h * k[i]
    evaluate(p, t + 0.5 * h, out, memory, k, r, g, S, spin, b)
    for i in range(STATE):
        total[i] += h / 3.0 * k[i]
        out[i] = s[i] + h * k[i]
    evaluate(p, t + h, out, memory, k, r, g, S, spin, b)
    for i in range(STATE):
        out[i] = total[i] + h / 6.0 * k[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _crossing(low: float, low_rate: float, high: float, high_rate: float, h: float) -> float:
    """Time in [0, h] at which a cubic through two values and slopes crosses zero upwards."""
    below, above = 0.0, 1.0
    for _ in range(60):
        u = 0.5 * (below + above)
        w = 1.0 - u
        value = w * w * ((1.0 + 2.0 * u) * low + u * h * low_rate)
        value += u * u * ((1.0 + 2.0 * w) * high - w * h * high_rate)
        if value > 0.0:
            above = u
        else:
            below = u
    return 0.5 * (below + above) * h


@njit(cache=True, nogil=True, error_model="numpy")
def _sense(p: Any, s: Any, d: Any, r: Any, g: Any, y: Any) -> None:
    """Ten proper accelerations in body axes, and the other channels."""
    v = COORDINATES
    gx, gy = p[P.GRAVITY_X], p[P.GRAVITY_Y]
    c, sn = g[G.CRANK_COS], g[G.CRANK_SIN]
    ax, ay = d[v + Q.CRANK_X] - gx, d[v + Q.CRANK_Y] - gy
    along, across = ax * c + ay * sn, ay * c - ax * sn
    turn, spin = d[v + Q.CRANK], s[v + Q.CRANK]
    y[0] = across + p[P.CRANK_TO_A] * turn
    y[1] = along - p[P.CRANK_TO_A] * spin * spin
    y[2] = across + p[P.CRANK_TO_B] * turn
    y[3] = along - p[P.CRANK_TO_B] * spin * spin
    c, sn = g[G.ROD_COS], g[G.ROD_SIN]
    ax, ay = d[v + Q.ROD_X] - gx, d[v + Q.ROD_Y] - gy
    along, across = ax * c + ay * sn, ay * c - ax * sn
    turn, spin = d[v + Q.ROD], s[v + Q.ROD]
    y[4] = across + p[P.ROD_TO_B] * turn
    y[5] = along - p[P.ROD_TO_B] * spin * spin
    y[6] = across + p[P.ROD_TO_C] * turn
    y[7] = along - p[P.ROD_TO_C] * spin * spin
    c, sn = cos(s[Q.SLIDER]), sin(s[Q.SLIDER])
    ax, ay = d[v + Q.SLIDER_X] - gx, d[v + Q.SLIDER_Y] - gy
    y[8] = ay * c - ax * sn
    y[9] = ax * c + ay * sn
    y[10] = s[Q.CRANK]
    y[11] = s[v + Q.CRANK]
    y[12] = r[R.TORQUE]
    y[13] = s[Q.SLIDER_X] - s[Q.FRAME_X]
    y[14] = s[v + Q.SLIDER_X] - s[v + Q.FRAME_X]


@njit(cache=True, nogil=True, error_model="numpy")
def integrate(
    p: np.ndarray, start: float, s: np.ndarray, memory: np.ndarray, step: float, every: int,
    signals: np.ndarray, truth: np.ndarray,
) -> int:  # fmt: skip
    """Integrate and keep every ``every``-th step.

    Args:
        p: (PARAMETERS,).
        start: time of the first sample [s].
        s: (STATE,) state there, overwritten by that at the end.
        memory: (2,) approach speeds at first touch of B and C [m/s], overwritten likewise; 0 while apart.
        step: [s].
        every: steps from one sample to the next.
        signals: (samples, 15) written.
        truth: (samples or 0, RESULTS) written where it has rows.

    Returns:
        Samples written: all, or up to the first that is not finite.
    """
    given = s
    d, d1, k = np.zeros(STATE), np.zeros(STATE), np.zeros(STATE)
    s1, total = np.zeros(STATE), np.zeros(STATE)
    r, r1 = np.zeros(RESULTS), np.zeros(RESULTS)
    g, S, spin, b = np.zeros(GEOMETRY), np.zeros((7, 7)), np.zeros(2), np.zeros(14)
    early = np.zeros(2)
    depth_row, flag = (R.DEPTH_B, R.DEPTH_C), (P.LOOSE_B, P.LOOSE_C)
    evaluate(p, start, s, memory, d, r, g, S, spin, b)
    for n in range(signals.shape[0]):
        project(p, s, g, S, spin, b)
        _sense(p, s, d, r, g, signals[n])
        if truth.shape[0] > 0:
            for i in range(RESULTS):
                truth[n, i] = r[i]
        for m in range(every):
            now, rest, piece = start + (n * every + m) * step, step, step
            while rest > 1e-9 * step:
                h = min(piece, rest)
                _runge_kutta(p, now, h, s, d, memory, s1, k, r1, g, S, spin, b, total)
                evaluate(p, now + h, s1, memory, d1, r1, g, S, spin, b)
                if r1[R.REGIME] != r[R.REGIME] and piece == step:
                    piece = step / SPLIT  # a force jumped somewhere in this step
                    continue
                touch = 2.0 * h
                for j in range(2):
                    o = depth_row[j]
                    early[j] = 2.0 * h
                    if p[flag[j]] != 0.0 and memory[j] == 0.0 and r1[o] > 0.0:
                        early[j] = _crossing(min(r[o], 0.0), r[o + 1], r1[o], r1[o + 1], h)
                        touch = min(touch, early[j])
                if touch <= h:
                    # go to the touch alone, keep its approach speed, then go on
                    h = touch
                    _runge_kutta(p, now, h, s, d, memory, s1, k, r1, g, S, spin, b, total)
                    evaluate(p, now + h, s1, memory, d1, r1, g, S, spin, b)
                    for j in range(2):
                        if early[j] == touch:
                            memory[j] = max(r1[depth_row[j] + 1], APPROACH_FLOOR)
                s, s1 = s1, s
                d, d1 = d1, d
                r, r1 = r1, r
                now += h
                rest -= h
            for j in range(2):
                if memory[j] > 0.0 and r[depth_row[j]] <= 0.0:
                    memory[j] = 0.0
        check = 0.0
        for i in range(STATE):
            check += s[i]
        if not np.isfinite(check):
            return n + 1
    if s is not given:
        given[:] = s
    return signals.shape[0]
