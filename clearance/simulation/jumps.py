"""When the next force sets in, with a jump or from a touch on: no Runge-Kutta step goes across that."""

from typing import Any

from clearance.compilation import kernel
from clearance.lanes import get, sine_cosine, square_root
from clearance.mechanism.choice import chosen
from clearance.mechanism.guide import until_shoe_strikes
from clearance.mechanism.jump import until_reached
from clearance.mechanism.load import until_process_changes
from clearance.mechanism.parameters import Family, Parameter
from clearance.simulation.layout import Result, State

_TINY = 1e-30  # m^2: a journal exactly in the middle has no direction
_BEYOND = 1e-9  # m, a touch is foreseen no better; no force sets in there, it grows


@kernel
def _until_touch(
    penetration: Any, rate: Any, ex: Any, ey: Any, vx: Any, vy: Any, ax: Any, ay: Any, most: Any
) -> Any:
    """Time [s] until a journal meets its bearing, from its eccentricity, its rate and acceleration."""
    inverse_distance = 1.0 / square_root(ex * ex + ey * ey + _TINY)
    turning = vx * vx + vy * vy - rate * rate
    closing = (ex * ax + ey * ay + turning) * inverse_distance
    return until_reached(-penetration, _BEYOND, rate, closing, most)


@kernel
def until_jump(codes: Any, p: Any, s: Any, r: Any, h: Any) -> Any:
    """Time [s] until a force sets in or ends at once, at most ``h``; ``r`` is an evaluation of ``s``."""
    sine, cosine = get(s, State.ROD_SINE), get(s, State.ROD_COSINE)
    spin, turn = get(s, State.ROD_SPEED), get(r, Result.ROD)
    if chosen(codes, Family.JOINT_B) == 1:
        length, reach = get(p, Parameter.CRANK_LENGTH), get(p, Parameter.ROD_TO_B)
        crank_sine, crank_cosine = get(s, State.CRANK_SINE), get(s, State.CRANK_COSINE)
        speed, change = get(s, State.CRANK_SPEED), get(r, Result.CRANK)
        h = _until_touch(
            get(r, Result.PENETRATION_B),
            get(r, Result.PENETRATION_RATE_B),
            get(s, State.FRAME_X) + length * crank_cosine - get(s, State.ROD_X) + reach * cosine,
            get(s, State.FRAME_Y) + length * crank_sine - get(s, State.ROD_Y) + reach * sine,
            get(s, State.FRAME_X_RATE) - length * speed * crank_sine
            - get(s, State.ROD_X_RATE) - reach * spin * sine,
            get(s, State.FRAME_Y_RATE) + length * speed * crank_cosine
            - get(s, State.ROD_Y_RATE) + reach * spin * cosine,
            get(r, Result.FRAME_X) - length * (change * crank_sine + speed * speed * crank_cosine)
            - get(r, Result.ROD_X) - reach * (turn * sine + spin * spin * cosine),
            get(r, Result.FRAME_Y) + length * (change * crank_cosine - speed * speed * crank_sine)
            - get(r, Result.ROD_Y) + reach * (turn * cosine - spin * spin * sine),
            h,
        )  # fmt: skip
    if chosen(codes, Family.JOINT_C) == 1:
        reach = get(p, Parameter.ROD_TO_C)
        h = _until_touch(
            get(r, Result.PENETRATION_C),
            get(r, Result.PENETRATION_RATE_C),
            get(s, State.ROD_X) + reach * cosine - get(s, State.SLIDER_X),
            get(s, State.ROD_Y) + reach * sine - get(s, State.SLIDER_Y),
            get(s, State.ROD_X_RATE) - reach * spin * sine - get(s, State.SLIDER_X_RATE),
            get(s, State.ROD_Y_RATE) + reach * spin * cosine - get(s, State.SLIDER_Y_RATE),
            get(r, Result.ROD_X) - reach * (turn * sine + spin * spin * cosine) - get(r, Result.SLIDER_X),
            get(r, Result.ROD_Y) + reach * (turn * cosine - spin * spin * sine) - get(r, Result.SLIDER_Y),
            h,
        )
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
