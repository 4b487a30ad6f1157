"""Eccentricity of the journals: journal centre minus bearing centre, its rate and acceleration (x, y)."""

from typing import Any

from clearance.compilation import kernel
from clearance.lanes import get
from clearance.mechanism.parameters import Parameter
from clearance.simulation.layout import Result, State


@kernel
def eccentricity_b(p: Any, s: Any) -> Any:
    """Of B, the crank's journal in the rod [m]."""
    length, reach = get(p, Parameter.CRANK_LENGTH), get(p, Parameter.ROD_TO_B)
    ex = get(s, State.FRAME_X) + length * get(s, State.CRANK_COSINE)
    ey = get(s, State.FRAME_Y) + length * get(s, State.CRANK_SINE)
    ex = ex - get(s, State.ROD_X) + reach * get(s, State.ROD_COSINE)
    return ex, ey - get(s, State.ROD_Y) + reach * get(s, State.ROD_SINE)


@kernel
def eccentricity_rate_b(p: Any, s: Any) -> Any:
    """Of B [m/s]."""
    length, reach = get(p, Parameter.CRANK_LENGTH), get(p, Parameter.ROD_TO_B)
    speed, spin = get(s, State.CRANK_SPEED), get(s, State.ROD_SPEED)
    vx = get(s, State.FRAME_X_RATE) - length * speed * get(s, State.CRANK_SINE)
    vy = get(s, State.FRAME_Y_RATE) + length * speed * get(s, State.CRANK_COSINE)
    vx = vx - get(s, State.ROD_X_RATE) - reach * spin * get(s, State.ROD_SINE)
    return vx, vy - get(s, State.ROD_Y_RATE) + reach * spin * get(s, State.ROD_COSINE)


@kernel
def eccentricity_acceleration_b(p: Any, s: Any, r: Any) -> Any:
    """Of B [m/s^2]; ``r`` is an evaluation of ``s``."""
    length, reach = get(p, Parameter.CRANK_LENGTH), get(p, Parameter.ROD_TO_B)
    sine, cosine = get(s, State.CRANK_SINE), get(s, State.CRANK_COSINE)
    squared, turn = get(s, State.CRANK_SPEED) * get(s, State.CRANK_SPEED), get(r, Result.CRANK)
    swing_x, swing_y = _swing(s, r, reach)
    ax = get(r, Result.FRAME_X) - length * (turn * sine + squared * cosine) - get(r, Result.ROD_X)
    ay = get(r, Result.FRAME_Y) + length * (turn * cosine - squared * sine) - get(r, Result.ROD_Y)
    return ax + swing_x, ay + swing_y


@kernel
def eccentricity_c(p: Any, s: Any) -> Any:
    """Of C, the rod's journal in the slider [m]."""
    reach = get(p, Parameter.ROD_TO_C)
    ex = get(s, State.ROD_X) + reach * get(s, State.ROD_COSINE) - get(s, State.SLIDER_X)
    return ex, get(s, State.ROD_Y) + reach * get(s, State.ROD_SINE) - get(s, State.SLIDER_Y)


@kernel
def eccentricity_rate_c(p: Any, s: Any) -> Any:
    """Of C [m/s]."""
    reach, spin = get(p, Parameter.ROD_TO_C), get(s, State.ROD_SPEED)
    vx = get(s, State.ROD_X_RATE) - reach * spin * get(s, State.ROD_SINE) - get(s, State.SLIDER_X_RATE)
    vy = get(s, State.ROD_Y_RATE) + reach * spin * get(s, State.ROD_COSINE)
    return vx, vy - get(s, State.SLIDER_Y_RATE)


@kernel
def eccentricity_acceleration_c(p: Any, s: Any, r: Any) -> Any:
    """Of C [m/s^2]; ``r`` is an evaluation of ``s``."""
    swing_x, swing_y = _swing(s, r, get(p, Parameter.ROD_TO_C))
    ax = get(r, Result.ROD_X) + swing_x - get(r, Result.SLIDER_X)
    return ax, get(r, Result.ROD_Y) + swing_y - get(r, Result.SLIDER_Y)


@kernel
def _swing(s: Any, r: Any, reach: Any) -> Any:
    """Acceleration (x, y) along the rod by its turning, over a length towards C [m/s^2]."""
    sine, cosine = get(s, State.ROD_SINE), get(s, State.ROD_COSINE)
    squared, turn = get(s, State.ROD_SPEED) * get(s, State.ROD_SPEED), get(r, Result.ROD)
    return -reach * (turn * sine + squared * cosine), reach * (turn * cosine - squared * sine)
