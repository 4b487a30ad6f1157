"""Constrained coordinates from the free ones, and what ideal sensors feel: no forces here."""

from math import pi
from typing import Any

from clearance.compilation import kernel, subroutine
from clearance.lanes import arcsine, get, maximum, minimum, put, sine_cosine, square_root, zero
from clearance.mechanism.choice import chosen
from clearance.mechanism.parameters import Family, Parameter
from clearance.simulation.layout import Result, Signal, State


@subroutine
def project(codes: Any, p: Any, s: Any) -> None:
    """Compute the constrained coordinates and rates of ``s`` from the free ones, and the angles' sines.

    Free are: the frame where it is sprung; the crank's angle; of rod and slider what the joints leave. A rod
    on an ideal joint takes its place from that joint; with both joints ideal and an ideal guide, the rod's
    angle and the slider follow from the crank in closed form.
    """
    sine, cosine = sine_cosine(get(s, State.CRANK_ANGLE))
    put(s, State.CRANK_SINE, sine)
    put(s, State.CRANK_COSINE, cosine)
    crank_speed = get(s, State.CRANK_SPEED)
    nothing = zero(crank_speed)
    frame_x, frame_y = get(s, State.FRAME_X), get(s, State.FRAME_Y)
    frame_vx, frame_vy = get(s, State.FRAME_X_RATE), get(s, State.FRAME_Y_RATE)
    crank_length = get(p, Parameter.CRANK_LENGTH)
    to_b, to_c = get(p, Parameter.ROD_TO_B), get(p, Parameter.ROD_TO_C)
    held = chosen(codes, Family.GUIDE) == 0
    loose_b, loose_c = chosen(codes, Family.JOINT_B) == 1, chosen(codes, Family.JOINT_C) == 1
    offset = get(p, Parameter.GUIDE_OFFSET)
    if held:  # at rest with the frame: written at every step only where that moves
        put(s, State.SLIDER_Y, frame_y + offset)
        put(s, State.SLIDER_Y_RATE, frame_vy)
        put(s, State.SLIDER_ANGLE, nothing)
        put(s, State.SLIDER_SPEED, nothing)
    bx, by = frame_x + crank_length * cosine, frame_y + crank_length * sine
    bvx = frame_vx - crank_length * sine * crank_speed
    bvy = frame_vy + crank_length * cosine * crank_speed
    if held and not loose_b and not loose_c:
        length = to_b + to_c
        rod_sine = (frame_y + offset - by) / length
        rod_cosine = square_root(1.0 - rod_sine * rod_sine)
        rod_speed = (frame_vy - bvy) / (length * rod_cosine)
        put(s, State.ROD_ANGLE, arcsine(rod_sine))
        put(s, State.ROD_SPEED, rod_speed)
    else:
        rod_sine, rod_cosine = sine_cosine(get(s, State.ROD_ANGLE))
        rod_speed = get(s, State.ROD_SPEED)
    put(s, State.ROD_SINE, rod_sine)
    put(s, State.ROD_COSINE, rod_cosine)
    if not loose_b:
        put(s, State.ROD_X, bx + to_b * rod_cosine)
        put(s, State.ROD_Y, by + to_b * rod_sine)
        put(s, State.ROD_X_RATE, bvx - to_b * rod_sine * rod_speed)
        put(s, State.ROD_Y_RATE, bvy + to_b * rod_cosine * rod_speed)
        if not loose_c:
            length = to_b + to_c
            put(s, State.SLIDER_X, bx + length * rod_cosine)
            put(s, State.SLIDER_X_RATE, bvx - length * rod_sine * rod_speed)
            if not held:
                put(s, State.SLIDER_Y, by + length * rod_sine)
                put(s, State.SLIDER_Y_RATE, bvy + length * rod_cosine * rod_speed)
    elif not loose_c:
        put(s, State.ROD_X, get(s, State.SLIDER_X) - to_c * rod_cosine)
        put(s, State.ROD_Y, get(s, State.SLIDER_Y) - to_c * rod_sine)
        put(s, State.ROD_X_RATE, get(s, State.SLIDER_X_RATE) + to_c * rod_sine * rod_speed)
        put(s, State.ROD_Y_RATE, get(s, State.SLIDER_Y_RATE) - to_c * rod_cosine * rod_speed)


@kernel
def _bulge(p: Any, place: Any) -> Any:
    """How far the bent rod stands off the line of its pins at a place from B [m], per unit of its mode.

    sin(pi s / L) between the pins (``link.FlexibleRod``); what sticks out beyond them stays straight.
    """
    length = get(p, Parameter.ROD_TO_B) + get(p, Parameter.ROD_TO_C)
    between = minimum(maximum(place, 0.0), length)
    sine, cosine = sine_cosine(between * (pi / length))
    return sine + (place - between) * (pi / length) * cosine


@subroutine
def sense(codes: Any, p: Any, s: Any, r: Any, y: Any, row: int) -> None:
    """Write what ideal sensors feel (rows ``Signal``) into ``y`` from row ``row`` on.

    Accelerometers feel acceleration minus gravity, in the axes of their body: axial from the link's first to
    its second joint, transverse a quarter turn further. Those on a bent rod move with it, but are not tilted:
    its slope is below three thousandths from 300 Hz on.
    """
    gravity_x, gravity_y = get(p, Parameter.GRAVITY_X), get(p, Parameter.GRAVITY_Y)
    sine, cosine = get(s, State.CRANK_SINE), get(s, State.CRANK_COSINE)
    speed = get(s, State.CRANK_SPEED)
    turn = get(r, Result.CRANK)
    ax, ay = get(r, Result.FRAME_X) - gravity_x, get(r, Result.FRAME_Y) - gravity_y
    across, along = ay * cosine - ax * sine, ax * cosine + ay * sine
    place = get(p, Parameter.SENSOR_CRANK_A)
    put(y, row + Signal.CRANK_A_TRANSVERSE, across + place * turn)
    put(y, row + Signal.CRANK_A_AXIAL, along - place * speed * speed)
    place = get(p, Parameter.SENSOR_CRANK_B)
    put(y, row + Signal.CRANK_B_TRANSVERSE, across + place * turn)
    put(y, row + Signal.CRANK_B_AXIAL, along - place * speed * speed)
    sine, cosine = get(s, State.ROD_SINE), get(s, State.ROD_COSINE)
    speed = get(s, State.ROD_SPEED)
    turn = get(r, Result.ROD)
    ax, ay = get(r, Result.ROD_X) - gravity_x, get(r, Result.ROD_Y) - gravity_y
    across, along = ay * cosine - ax * sine, ax * cosine + ay * sine
    place = get(p, Parameter.SENSOR_ROD_B) - get(p, Parameter.ROD_TO_B)
    put(y, row + Signal.ROD_B_TRANSVERSE, across + place * turn)
    put(y, row + Signal.ROD_B_AXIAL, along - place * speed * speed)
    place = get(p, Parameter.SENSOR_ROD_C) - get(p, Parameter.ROD_TO_B)
    put(y, row + Signal.ROD_C_TRANSVERSE, across + place * turn)
    put(y, row + Signal.ROD_C_AXIAL, along - place * speed * speed)
    if chosen(codes, Family.LINK) == 1:
        mode, mode_rate = get(s, State.ROD_MODE), get(s, State.ROD_MODE_RATE)
        across = get(r, Result.ROD_MODE) - speed * speed * mode
        along = -turn * mode - 2.0 * speed * mode_rate
        share = _bulge(p, get(p, Parameter.SENSOR_ROD_B))
        cell = row + Signal.ROD_B_TRANSVERSE
        put(y, cell, get(y, cell) + share * across)
        cell = row + Signal.ROD_B_AXIAL
        put(y, cell, get(y, cell) + share * along)
        share = _bulge(p, get(p, Parameter.SENSOR_ROD_C))
        cell = row + Signal.ROD_C_TRANSVERSE
        put(y, cell, get(y, cell) + share * across)
        cell = row + Signal.ROD_C_AXIAL
        put(y, cell, get(y, cell) + share * along)
    ax, ay = get(r, Result.SLIDER_X) - gravity_x, get(r, Result.SLIDER_Y) - gravity_y
    if chosen(codes, Family.GUIDE) == 1:
        sine, cosine = sine_cosine(get(s, State.SLIDER_ANGLE))
        ax, ay = ax * cosine + ay * sine, ay * cosine - ax * sine
    put(y, row + Signal.SLIDER_VERTICAL, ay)
    put(y, row + Signal.SLIDER_HORIZONTAL, ax)
    put(y, row + Signal.CRANK_ANGLE, get(s, State.CRANK_ANGLE))
    put(y, row + Signal.CRANK_SPEED, get(s, State.CRANK_SPEED))
    put(y, row + Signal.DRIVE_TORQUE, get(r, Result.DRIVE_TORQUE))
    put(y, row + Signal.SLIDER_POSITION, get(s, State.SLIDER_X) - get(s, State.FRAME_X))
    put(y, row + Signal.SLIDER_VELOCITY, get(s, State.SLIDER_X_RATE) - get(s, State.FRAME_X_RATE))
