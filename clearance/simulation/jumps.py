"""When the next force sets in, with a jump or from a touch on: no Runge-Kutta step goes across that."""

from typing import Any

from clearance.compilation import kernel
from clearance.lanes import get, sine_cosine, square_root
from clearance.mechanism.choice import chosen
from clearance.mechanism.guide import until_shoe_strikes
from clearance.mechanism.jump import until_reached
from clearance.mechanism.load import until_process_changes
from clearance.mechanism.parameters import Family, Parameter
from clearance.simulation.eccentricity import (
    eccentricity_acceleration_b,
    eccentricity_acceleration_c,
    eccentricity_b,
    eccentricity_c,
    eccentricity_rate_b,
    eccentricity_rate_c,
)
from clearance.simulation.layout import Result, State

_TINY = 1e-30  # m^2: a journal exactly in the middle has no direction
_BEYOND = 1e-9  # m, a touch is foreseen no better; no force sets in there, it grows


@kernel
def _until_touch(penetration: Any, rate: Any, at: Any, moving: Any, pulled: Any, most: Any) -> Any:
    """Time [s] until a journal meets its bearing, from its eccentricity, its rate and acceleration (x, y)."""
    (ex, ey), (vx, vy), (ax, ay) = at, moving, pulled
    inverse_distance = 1.0 / square_root(ex * ex + ey * ey + _TINY)
    turning = vx * vx + vy * vy - rate * rate
    closing = (ex * ax + ey * ay + turning) * inverse_distance
    return until_reached(-penetration, _BEYOND, rate, closing, most)


@kernel
def until_jump(codes: Any, p: Any, s: Any, r: Any, h: Any) -> Any:
    """Time [s] until a force sets in or ends at once, at most ``h``; ``r`` is an evaluation of ``s``."""
    if chosen(codes, Family.JOINT_B) == 1:
        at, moving = eccentricity_b(p, s), eccentricity_rate_b(p, s)
        pulled = eccentricity_acceleration_b(p, s, r)
        penetration, rate = get(r, Result.PENETRATION_B), get(r, Result.PENETRATION_RATE_B)
        h = _until_touch(penetration, rate, at, moving, pulled, h)
    if chosen(codes, Family.JOINT_C) == 1:
        at, moving = eccentricity_c(p, s), eccentricity_rate_c(p, s)
        pulled = eccentricity_acceleration_c(p, s, r)
        penetration, rate = get(r, Result.PENETRATION_C), get(r, Result.PENETRATION_RATE_C)
        h = _until_touch(penetration, rate, at, moving, pulled, h)
    if chosen(codes, Family.PROCESS) == 1:
        h = until_process_changes(
            p,
            get(s, State.SLIDER_X) - get(s, State.FRAME_X),
            get(s, State.SLIDER_X_RATE) - get(s, State.FRAME_X_RATE),
            get(r, Result.SLIDER_X) - get(r, Result.FRAME_X),
            h,
        )
    if chosen(codes, Family.GUIDE) == 1:
        height = get(s, State.SLIDER_Y) - get(s, State.FRAME_Y) - get(p, Parameter.GUIDE_OFFSET)
        lift = get(s, State.SLIDER_Y_RATE) - get(s, State.FRAME_Y_RATE)
        rising = get(r, Result.SLIDER_Y) - get(r, Result.FRAME_Y)
        half = get(p, Parameter.SHOE_HALF_LENGTH)
        tilt_sine, tilt_cosine = sine_cosine(get(s, State.SLIDER_ANGLE))
        tilt, across = half * tilt_sine, half * tilt_cosine
        swing, gain = across * get(s, State.SLIDER_SPEED), across * get(r, Result.SLIDER)
        h = until_shoe_strikes(p, height + tilt, lift + swing, rising + gain, h)
        h = until_shoe_strikes(p, height - tilt, lift - swing, rising - gain, h)
    return h
