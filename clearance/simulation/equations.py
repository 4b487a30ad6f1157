"""The equations of motion, in textbook order.

Kinematics -> gap -> normal force -> tangential force -> applied forces -> reactions of the ideal joints ->
accelerations. Bodies are described in inertial coordinates, so that their mass matrix is (nearly) diagonal;
the reactions of ideal joints follow from the condition that both sides of a joint accelerate alike (two
equations a joint). ``kinematics.project`` then removes what rounding and the scheme leave of the constraints:
a constrained coordinate is computed from the free ones, never integrated.

All functions take one run (1-D arrays) or ``WIDTH`` runs (2-D arrays), see ``clearance.lanes``. ``codes``
chooses the laws (``Family``) and is the same for all lanes; ``p`` is the parameter vector.
"""

from typing import Any

from clearance.compilation import kernel, subroutine
from clearance.lanes import absolute, get, maximum, put, sine_cosine, square_root, where, zero
from clearance.mechanism.applied_force import TRACTION_SPEED, applied, choose_argument, closeness, look_up
from clearance.mechanism.bearing import worn_surface
from clearance.mechanism.choice import chosen
from clearance.mechanism.contact import APPROACH_FLOOR, normal_force
from clearance.mechanism.drive import drive_torque, ripple_torque, speed_error
from clearance.mechanism.film import film_damping
from clearance.mechanism.friction import smoothed_sign
from clearance.mechanism.guide import guide_friction, shoe_force
from clearance.mechanism.load import process_force, spring_force
from clearance.mechanism.parameters import JOINT_STRIDE, Family, Parameter
from clearance.simulation.eccentricity import (
    eccentricity_b,
    eccentricity_c,
    eccentricity_rate_b,
    eccentricity_rate_c,
)
from clearance.simulation.layout import Result, State

_TINY = 1e-60  # m^2, added under the square root of a distance: a centred journal has no direction
_REACTION_PASSES = 4  # of the fixed point between the guide's reaction and the friction it causes


@kernel
def _sliding(
    nx: Any, ny: Any, vx: Any, vy: Any, reach: Any, radius: Any, journal_spin: Any, bearing_spin: Any
) -> Any:
    """Speed of the journal's surface over the bearing's where they are nearest, counterclockwise [m/s].

    ``reach``: how far the journal's centre is from the bearing's, along the normal [m].
    """
    return vy * nx - vx * ny + radius * journal_spin - (reach + radius) * bearing_spin


@kernel
def _joint(
    codes: Any,
    p: Any,
    block: int,
    memory: Any,
    ex: Any,
    ey: Any,
    vx: Any,
    vy: Any,
    journal_spin: Any,
    bearing_spin: Any,
    bearing_sine: Any,
    bearing_cosine: Any,
) -> Any:
    """Forces inside a loose joint.

    Args:
        codes: chosen laws.
        p: parameter vector.
        block: offset of the joint's block.
        memory: approach speed at first touch, 0 while apart [m/s].
        ex: eccentricity in x, journal centre minus bearing centre [m].
        ey: eccentricity in y [m].
        vx: rate of ``ex`` [m/s].
        vy: rate of ``ey`` [m/s].
        journal_spin: angular speed of the journal's body [rad/s].
        bearing_spin: angular speed of the bearing's body [rad/s].
        bearing_sine: sine of the angle of the bearing's body.
        bearing_cosine: its cosine.

    Returns:
        Force on the journal (x, y) [N], moment on the journal's and on the bearing's body about the centres
        [N m], penetration [m], its rate [m/s], normal force [N], new memory [m/s].
    """
    distance = square_root(ex * ex + ey * ey + _TINY)
    inverse_distance = 1.0 / distance
    nx, ny = ex * inverse_distance, ey * inverse_distance
    clearance = get(p, block + Parameter.JOINT_CLEARANCE)
    penetration = distance - clearance
    rate, reach = vx * nx + vy * ny, distance
    if chosen(codes, Family.BEARING) == 1:
        penetration, nx, ny = worn_surface(p, block, ex, ey, distance, bearing_sine, bearing_cosine)
        rate = (vx + bearing_spin * ey) * nx + (vy - bearing_spin * ex) * ny
        reach = ex * nx + ey * ny
    approach = where(memory > 0.0, memory, maximum(rate, APPROACH_FLOOR))
    normal = normal_force(
        penetration,
        rate,
        approach,
        get(p, block + Parameter.JOINT_STIFFNESS),
        get(p, block + Parameter.JOINT_HYSTERESIS),
    )
    fx, fy = -normal * nx, -normal * ny
    journal_moment, bearing_moment = zero(fx), zero(fx)
    if chosen(codes, Family.FRICTION) == 1 or chosen(codes, Family.BEARING) == 1:
        radius = get(p, block + Parameter.JOINT_JOURNAL_RADIUS)
        if chosen(codes, Family.FRICTION) == 1:
            sliding = _sliding(nx, ny, vx, vy, reach, radius, journal_spin, bearing_spin)
            direction = smoothed_sign(sliding, get(p, block + Parameter.JOINT_FRICTION_SPEED))
            tangential = -get(p, block + Parameter.JOINT_FRICTION) * normal * direction
            fx, fy = fx - tangential * ny, fy + tangential * nx
        journal_moment = radius * (nx * fy - ny * fx)
        bearing_moment = (ey + radius * ny) * fx - (ex + radius * nx) * fy
    if chosen(codes, Family.FILM) == 1:
        damping = film_damping(distance / clearance, get(p, block + Parameter.JOINT_FILM_DAMPING))
        film_x, film_y = -damping * vx, -damping * vy
        fx, fy = fx + film_x, fy + film_y
        bearing_moment = bearing_moment + ey * film_x - ex * film_y
    remembered = where(penetration > 0.0, approach, zero(approach))
    return fx, fy, journal_moment, bearing_moment, penetration, rate, normal, remembered


@kernel
def _push_on_journal(
    p: Any,
    entry: int,
    table: Any,
    ex: Any,
    ey: Any,
    vx: Any,
    vy: Any,
    radius: Any,
    journal_spin: Any,
    bearing_spin: Any,
) -> Any:
    """Applied force on a journal: its normal part at ``entry``, then the tangential part and the damping.

    Returns:
        Force on the journal (x, y) [N], moment on the journal's and on the bearing's body about the centres
        [N m].
    """
    distance = square_root(ex * ex + ey * ey + _TINY)
    nx, ny = ex / distance, ey / distance
    sliding = _sliding(nx, ny, vx, vy, distance, radius, journal_spin, bearing_spin)
    along = applied(p, entry, table)
    across = -applied(p, entry + 1, table) * smoothed_sign(sliding, TRACTION_SPEED)
    damping = applied(p, entry + 2, table)
    slow_x, slow_y = -damping * vx, -damping * vy
    fx, fy = along * nx - across * ny + slow_x, along * ny + across * nx + slow_y
    return fx, fy, radius * across, ey * slow_x - ex * slow_y - (distance + radius) * across


@kernel
def _ground_response(
    p: Any, inverse_inertia: Any, sine: Any, cosine: Any, fx: Any, fy: Any, torque: Any
) -> Any:
    """Acceleration of frame (x, y) and crank under forces on the frame and a torque on the crank.

    The crank's pivot moves with the frame, which couples the three; where the frame stands fast its inverse
    masses are zero and only the crank turns.
    """
    moment = get(p, Parameter.CRANK_MOMENT)
    wx, wy = get(p, Parameter.FRAME_INVERSE_MASS_X), get(p, Parameter.FRAME_INVERSE_MASS_Y)
    turn = (torque + moment * (sine * wx * fx - cosine * wy * fy)) * inverse_inertia
    return wx * (fx + moment * sine * turn), wy * (fy - moment * cosine * turn), turn


@kernel
def _solve2(a: Any, b: Any, c: Any, x: Any, y: Any) -> Any:
    """Solve [[a, b], [b, c]] u = [x, y]."""
    inverse = 1.0 / (a * c - b * b)
    return (c * x - b * y) * inverse, (a * y - b * x) * inverse


@subroutine
def evaluate(codes: Any, p: Any, s: Any, r: Any) -> None:
    """Fill ``r`` (rows ``Result``) from the state ``s`` (rows ``State``, projected).

    The rows from ``Result.FORCE_B_X`` on, which no scheme needs, are left out where ``r`` has no room for
    them.
    """
    # kinematics
    frame_x, frame_y = get(s, State.FRAME_X), get(s, State.FRAME_Y)
    frame_vx, frame_vy = get(s, State.FRAME_X_RATE), get(s, State.FRAME_Y_RATE)
    crank_speed, rod_speed = get(s, State.CRANK_SPEED), get(s, State.ROD_SPEED)
    slider_x, slider_y = get(s, State.SLIDER_X), get(s, State.SLIDER_Y)
    slider_vx, slider_vy = get(s, State.SLIDER_X_RATE), get(s, State.SLIDER_Y_RATE)
    sine, cosine = get(s, State.CRANK_SINE), get(s, State.CRANK_COSINE)
    rod_sine, rod_cosine = get(s, State.ROD_SINE), get(s, State.ROD_COSINE)
    gravity_x, gravity_y = get(p, Parameter.GRAVITY_X), get(p, Parameter.GRAVITY_Y)
    crank_length, crank_moment = get(p, Parameter.CRANK_LENGTH), get(p, Parameter.CRANK_MOMENT)
    to_b, to_c = get(p, Parameter.ROD_TO_B), get(p, Parameter.ROD_TO_C)
    inverse_mass = get(p, Parameter.ROD_INVERSE_MASS)
    inverse_rod_inertia = get(p, Parameter.ROD_INVERSE_INERTIA)
    inverse_slider_mass = get(p, Parameter.SLIDER_INVERSE_MASS)
    held = chosen(codes, Family.GUIDE) == 0
    loose_b, loose_c = chosen(codes, Family.JOINT_B) == 1, chosen(codes, Family.JOINT_C) == 1
    framed = chosen(codes, Family.FRAME) == 1
    nothing = zero(crank_speed)

    # gap and forces of the loose joints
    force_bx, force_by = nothing, nothing
    force_cx, force_cy = nothing, nothing
    crank_torque, rod_moment, slider_moment = nothing, nothing, nothing
    normal_b, normal_c = nothing, nothing
    if loose_b:
        ex, ey = eccentricity_b(p, s)
        vx, vy = eccentricity_rate_b(p, s)
        memory = get(s, State.MEMORY_B)
        force_bx, force_by, crank_torque, rod_moment, penetration, rate, normal, remembered = _joint(
            codes, p, 0, memory, ex, ey, vx, vy, crank_speed, rod_speed, rod_sine, rod_cosine
        )
        put(r, Result.PENETRATION_B, penetration)
        put(r, Result.PENETRATION_RATE_B, rate)
        put(r, Result.NORMAL_FORCE_B, normal)
        normal_b = normal
        put(r, Result.MEMORY_B, remembered)
    if loose_c:
        ex, ey = eccentricity_c(p, s)
        vx, vy = eccentricity_rate_c(p, s)
        memory = get(s, State.MEMORY_C)
        slider_sine, slider_cosine = nothing, nothing + 1.0
        if not held and chosen(codes, Family.BEARING) == 1:
            slider_sine, slider_cosine = sine_cosine(get(s, State.SLIDER_ANGLE))
        slider_speed = get(s, State.SLIDER_SPEED)
        force_cx, force_cy, moment, slider_moment, penetration, rate, normal, remembered = _joint(
            codes,
            p,
            JOINT_STRIDE,
            memory,
            ex,
            ey,
            vx,
            vy,
            rod_speed,
            slider_speed,
            slider_sine,
            slider_cosine,
        )
        rod_moment = rod_moment + moment
        put(r, Result.PENETRATION_C, penetration)
        put(r, Result.PENETRATION_RATE_C, rate)
        put(r, Result.NORMAL_FORCE_C, normal)
        put(r, Result.MEMORY_C, remembered)
        normal_c = normal

    # a force of free form: its table, and its parts that act inside loose joints and turn bodies
    table = nothing
    if chosen(codes, Family.FORCE) > 0:
        if chosen(codes, Family.FORCE) == 1:
            close_b, close_c = nothing, nothing
            if loose_b:
                ex, ey = eccentricity_b(p, s)
                close_b = closeness(ex, ey, get(p, Parameter.JOINT_CLEARANCE))
            if loose_c:
                ex, ey = eccentricity_c(p, s)
                close_c = closeness(ex, ey, get(p, JOINT_STRIDE + Parameter.JOINT_CLEARANCE))
            argument = choose_argument(
                p,
                get(s, State.CRANK_ANGLE),
                crank_speed,
                get(s, State.ROD_ANGLE),
                rod_speed,
                slider_x - frame_x,
                slider_vx - frame_vx,
                frame_x,
                frame_vx,
                normal_b,
                normal_c,
                get(s, State.TIME),
                close_b,
                close_c,
            )
            table = look_up(p, argument)
        crank_torque = crank_torque + applied(p, Parameter.FORCE_CRANK_TORQUE, table)
        rod_moment = rod_moment + applied(p, Parameter.FORCE_ROD_MOMENT, table)
        slider_moment = slider_moment + applied(p, Parameter.FORCE_SLIDER_MOMENT, table)
        if loose_b:
            ex, ey = eccentricity_b(p, s)
            vx, vy = eccentricity_rate_b(p, s)
            radius = get(p, Parameter.JOINT_JOURNAL_RADIUS)
            push_x, push_y, on_journal, on_bearing = _push_on_journal(
                p, Parameter.FORCE_B_NORMAL, table, ex, ey, vx, vy, radius, crank_speed, rod_speed
            )
            force_bx, force_by = force_bx + push_x, force_by + push_y
            crank_torque, rod_moment = crank_torque + on_journal, rod_moment + on_bearing
        if loose_c:
            ex, ey = eccentricity_c(p, s)
            vx, vy = eccentricity_rate_c(p, s)
            radius = get(p, JOINT_STRIDE + Parameter.JOINT_JOURNAL_RADIUS)
            push_x, push_y, on_journal, on_bearing = _push_on_journal(
                p,
                Parameter.FORCE_C_NORMAL,
                table,
                ex,
                ey,
                vx,
                vy,
                radius,
                rod_speed,
                get(s, State.SLIDER_SPEED),
            )
            force_cx, force_cy = force_cx + push_x, force_cy + push_y
            rod_moment, slider_moment = rod_moment + on_journal, slider_moment + on_bearing

    # applied forces: drive, loads, guide, frame, gravity
    error = nothing
    torque = nothing
    if chosen(codes, Family.DRIVE) == 1:
        error = speed_error(p, get(s, State.TIME), crank_speed)
        torque = drive_torque(p, error, get(s, State.DRIVE_INTEGRAL))
    if chosen(codes, Family.RIPPLE) == 1:
        torque = torque + ripple_torque(p, get(s, State.CRANK_ANGLE))
    put(r, Result.SPEED_ERROR, error)
    put(r, Result.DRIVE_TORQUE, torque)
    crank_torque = crank_torque + torque + crank_moment * (cosine * gravity_y - sine * gravity_x)
    if loose_b:
        crank_torque = crank_torque + crank_length * (cosine * force_by - sine * force_bx)
    load = nothing
    if chosen(codes, Family.SPRING) == 1:
        load = load + spring_force(p, slider_x - frame_x)
    if chosen(codes, Family.PROCESS) == 1:
        load = load + process_force(p, slider_x - frame_x)
    # the spring and the process are held by the frame, which feels their reaction
    frame_fx, frame_fy = nothing, nothing
    if framed:
        spin2 = crank_moment * crank_speed * crank_speed
        mass = get(p, Parameter.CRANK_MASS)
        stiffness, damping = get(p, Parameter.FRAME_STIFFNESS), get(p, Parameter.FRAME_DAMPING)
        frame_fx = (
            spin2 * cosine + mass * gravity_x + force_bx - stiffness * frame_x - damping * frame_vx - load
        )
        frame_fy = spin2 * sine + mass * gravity_y + force_by - stiffness * frame_y - damping * frame_vy
        if chosen(codes, Family.FORCE) > 0:
            frame_fx = frame_fx + applied(p, Parameter.FORCE_FRAME_X, table)
            frame_fy = frame_fy + applied(p, Parameter.FORCE_FRAME_Y, table)
    slider_fx = load - force_cx + get(p, Parameter.SLIDER_MASS) * gravity_x
    slider_fy = -force_cy + get(p, Parameter.SLIDER_MASS) * gravity_y
    if chosen(codes, Family.FORCE) > 0:
        slider_fx = slider_fx + applied(p, Parameter.FORCE_SLIDER_X, table)
        slider_fy = slider_fy + applied(p, Parameter.FORCE_SLIDER_Y, table)
    reaction = -slider_fy
    rubbed = nothing
    if not held:
        half = get(p, Parameter.SHOE_HALF_LENGTH)
        tilt_sine, tilt_cosine = sine_cosine(get(s, State.SLIDER_ANGLE))
        height = slider_y - frame_y - get(p, Parameter.GUIDE_OFFSET)
        lift, spin = slider_vy - frame_vy, get(s, State.SLIDER_SPEED)
        front = shoe_force(p, height + half * tilt_sine, lift + half * tilt_cosine * spin)
        back = shoe_force(p, height - half * tilt_sine, lift - half * tilt_cosine * spin)
        reaction = front + back
        rubbed = absolute(front) + absolute(back)  # a tilted shoe is pressed against both rails
        slider_fy = slider_fy + reaction
        frame_fy = frame_fy - reaction
        slider_moment = slider_moment + half * tilt_cosine * (front - back)

    # rod: forces of the loose joints, weight, inertial terms of its bending
    rod_mass = get(p, Parameter.ROD_MASS)
    rod_fx, rod_fy = force_cx - force_bx + rod_mass * gravity_x, force_cy - force_by + rod_mass * gravity_y
    if chosen(codes, Family.FORCE) > 0:
        rod_fx = rod_fx + applied(p, Parameter.FORCE_ROD_X, table)
        rod_fy = rod_fy + applied(p, Parameter.FORCE_ROD_Y, table)
    if loose_b:
        rod_moment = rod_moment + to_b * (rod_cosine * force_by - rod_sine * force_bx)
    if loose_c:
        rod_moment = rod_moment + to_c * (rod_cosine * force_cy - rod_sine * force_cx)
    inverse_transverse_mass = inverse_mass
    mode_push = nothing
    if chosen(codes, Family.LINK) == 1:
        coupling = get(p, Parameter.ROD_MODE_COUPLING)
        mode, mode_rate = get(s, State.ROD_MODE), get(s, State.ROD_MODE_RATE)
        inertial = coupling * rod_speed * rod_mass
        along, across = 2.0 * inertial * mode_rate, inertial * rod_speed * mode
        rod_fx = rod_fx + along * rod_cosine - across * rod_sine
        rod_fy = rod_fy + along * rod_sine + across * rod_cosine
        # modal force over half the mass: springs, centrifugal softening, weight
        mode_push = (
            (rod_speed * rod_speed - get(p, Parameter.ROD_MODE_STIFFNESS)) * mode
            - get(p, Parameter.ROD_MODE_DAMPING) * mode_rate
            + 2.0 * coupling * (rod_cosine * gravity_y - rod_sine * gravity_x)
        )
        inverse_transverse_mass = inverse_mass / (1.0 - 2.0 * coupling * coupling)
    extra = inverse_transverse_mass - inverse_mass

    # mobilities: accelerations of the joints' two sides per unit of reaction
    inverse_inertia = get(p, Parameter.CRANK_INVERSE_INERTIA)
    if framed:
        wx, wy = get(p, Parameter.FRAME_INVERSE_MASS_X), get(p, Parameter.FRAME_INVERSE_MASS_Y)
        coupled = wx * sine * sine + wy * cosine * cosine
        inverse_inertia = inverse_inertia / (1.0 - crank_moment * crank_moment * coupled * inverse_inertia)
    b_xx, b_xy, b_yy = nothing, nothing, nothing
    c_xx, c_xy, c_yy = nothing, nothing, nothing
    bc_xy, bc_yy = nothing, nothing
    if not loose_b:
        if framed:
            ax, ay, turn = _ground_response(
                p, inverse_inertia, sine, cosine, nothing + 1.0, nothing, -crank_length * sine
            )
            b_xx, b_xy = ax - crank_length * sine * turn, ay + crank_length * cosine * turn
            ax, ay, turn = _ground_response(
                p, inverse_inertia, sine, cosine, nothing, nothing + 1.0, crank_length * cosine
            )
            b_yy = ay + crank_length * cosine * turn
        else:
            share = crank_length * crank_length * inverse_inertia
            b_xx, b_xy, b_yy = share * sine * sine, -share * sine * cosine, share * cosine * cosine
        swing = extra + to_b * to_b * inverse_rod_inertia
        b_xx = b_xx + inverse_mass + swing * rod_sine * rod_sine
        b_xy = b_xy - swing * rod_sine * rod_cosine
        b_yy = b_yy + inverse_mass + swing * rod_cosine * rod_cosine
    if not loose_c:
        swing = extra + to_c * to_c * inverse_rod_inertia
        c_xx = inverse_slider_mass + inverse_mass + swing * rod_sine * rod_sine
        c_xy = -swing * rod_sine * rod_cosine
        c_yy = inverse_mass + swing * rod_cosine * rod_cosine
        if not held:
            c_yy = c_yy + inverse_slider_mass
        elif framed:
            ax, ay, turn = _ground_response(p, inverse_inertia, sine, cosine, nothing, nothing + 1.0, nothing)
            c_yy = c_yy + ay
            bc_xy, bc_yy = ax - crank_length * sine * turn, ay + crank_length * cosine * turn

    # accelerations without reactions, the reactions, accelerations; friction on the guide's own reaction
    # needs that reaction, which needs the friction: a few passes, since the coefficient is small
    passes = 1
    if chosen(codes, Family.GUIDE_FRICTION) == 1 and held and (framed or not loose_c):
        passes = _REACTION_PASSES
    spin2 = crank_length * crank_speed * crank_speed
    rod_spin2 = rod_speed * rod_speed
    friction = nothing
    frame_ax, frame_ay, crank_turn = nothing, nothing, nothing
    rod_ax, rod_ay, rod_turn, mode_acceleration = nothing, nothing, nothing, nothing
    slider_ax, slider_ay = nothing, nothing
    reaction_bx, reaction_by, reaction_cx, reaction_cy = force_bx, force_by, force_cx, force_cy
    for _ in range(passes):
        if chosen(codes, Family.GUIDE_FRICTION) == 1:
            friction = guide_friction(p, slider_vx - frame_vx, reaction if held else rubbed)
        fx, fy = frame_fx - friction, frame_fy
        if held:
            fy = fy + slider_fy
        if framed:
            frame_ax, frame_ay, crank_turn = _ground_response(
                p, inverse_inertia, sine, cosine, fx, fy, crank_torque
            )
        else:
            crank_turn = crank_torque * inverse_inertia
        across = rod_fy * rod_cosine - rod_fx * rod_sine
        if chosen(codes, Family.LINK) == 1:
            coupling = get(p, Parameter.ROD_MODE_COUPLING)
            sideways = extra * across - inverse_transverse_mass * rod_mass * coupling * mode_push
        else:
            sideways = nothing
        rod_ax = inverse_mass * rod_fx - sideways * rod_sine
        rod_ay = inverse_mass * rod_fy + sideways * rod_cosine
        rod_turn = rod_moment * inverse_rod_inertia
        slider_ax = (slider_fx + friction) * inverse_slider_mass
        slider_ay = frame_ay if held else slider_fy * inverse_slider_mass
        # relative accelerations of the ideal joints' two sides
        bx, by, cx, cy = nothing, nothing, nothing, nothing
        if not loose_b:
            bx = frame_ax - crank_length * sine * crank_turn - spin2 * cosine
            by = frame_ay + crank_length * cosine * crank_turn - spin2 * sine
            bx = bx - rod_ax - to_b * (rod_sine * rod_turn + rod_spin2 * rod_cosine)
            by = by - rod_ay + to_b * (rod_cosine * rod_turn - rod_spin2 * rod_sine)
        if not loose_c:
            cx = rod_ax - to_c * (rod_sine * rod_turn + rod_spin2 * rod_cosine) - slider_ax
            cy = rod_ay + to_c * (rod_cosine * rod_turn - rod_spin2 * rod_sine) - slider_ay
        pull_bx, pull_by, pull_cx, pull_cy = nothing, nothing, nothing, nothing
        if not loose_b and loose_c:
            pull_bx, pull_by = _solve2(b_xx, b_xy, b_yy, -bx, -by)
        elif loose_b and not loose_c:
            pull_cx, pull_cy = _solve2(c_xx, c_xy, c_yy, -cx, -cy)
        elif not loose_b and not loose_c:
            # both ideal: eliminate B from [[B, X], [X', C]]; the rod carries B's reaction to C
            link = extra - to_b * to_c * inverse_rod_inertia
            x_xx = -inverse_mass - link * rod_sine * rod_sine
            x_off = link * rod_sine * rod_cosine
            x_xy, x_yx = x_off - bc_xy, x_off
            x_yy = -inverse_mass - link * rod_cosine * rod_cosine - bc_yy
            u_xx, u_yx = _solve2(b_xx, b_xy, b_yy, x_xx, x_yx)
            u_xy, u_yy = _solve2(b_xx, b_xy, b_yy, x_xy, x_yy)
            zx, zy = _solve2(b_xx, b_xy, b_yy, bx, by)
            pull_cx, pull_cy = _solve2(
                c_xx - x_xx * u_xx - x_yx * u_yx,
                c_xy - x_xx * u_xy - x_yx * u_yy,
                c_yy - x_xy * u_xy - x_yy * u_yy,
                x_xx * zx + x_yx * zy - cx,
                x_xy * zx + x_yy * zy - cy,
            )
            pull_bx = -zx - u_xx * pull_cx - u_xy * pull_cy
            pull_by = -zy - u_yx * pull_cx - u_yy * pull_cy
        # add what the reactions do
        if not loose_b or not loose_c:
            lever = crank_length * (cosine * pull_by - sine * pull_bx)
            if framed:
                fy = pull_by
                if held:
                    fy = fy - pull_cy
                ax, ay, turn = _ground_response(p, inverse_inertia, sine, cosine, pull_bx, fy, lever)
                frame_ax, frame_ay, crank_turn = frame_ax + ax, frame_ay + ay, crank_turn + turn
            else:
                crank_turn = crank_turn + lever * inverse_inertia
            fx, fy = pull_cx - pull_bx, pull_cy - pull_by
            sideways = extra * (fy * rod_cosine - fx * rod_sine)
            across = across + fy * rod_cosine - fx * rod_sine
            rod_ax = rod_ax + inverse_mass * fx - sideways * rod_sine
            rod_ay = rod_ay + inverse_mass * fy + sideways * rod_cosine
            swing = to_b * (rod_cosine * pull_by - rod_sine * pull_bx)
            swing = swing + to_c * (rod_cosine * pull_cy - rod_sine * pull_cx)
            rod_turn = rod_turn + swing * inverse_rod_inertia
            slider_ax = slider_ax - pull_cx * inverse_slider_mass
            slider_ay = frame_ay if held else slider_ay - pull_cy * inverse_slider_mass
        if chosen(codes, Family.LINK) == 1:
            sideways = rod_ay * rod_cosine - rod_ax * rod_sine
            mode_acceleration = mode_push - 2.0 * get(p, Parameter.ROD_MODE_COUPLING) * sideways
        reaction_bx, reaction_by = force_bx + pull_bx, force_by + pull_by
        reaction_cx, reaction_cy = force_cx + pull_cx, force_cy + pull_cy
        if held:
            reaction = get(p, Parameter.SLIDER_MASS) * (slider_ay - gravity_y) + reaction_cy
            if chosen(codes, Family.FORCE) > 0:
                reaction = reaction - applied(p, Parameter.FORCE_SLIDER_Y, table)
    put(r, Result.FRAME_X, frame_ax)
    put(r, Result.FRAME_Y, frame_ay)
    put(r, Result.CRANK, crank_turn)
    put(r, Result.ROD_X, rod_ax)
    put(r, Result.ROD_Y, rod_ay)
    put(r, Result.ROD, rod_turn)
    put(r, Result.SLIDER_X, slider_ax)
    put(r, Result.SLIDER_Y, slider_ay)
    put(r, Result.SLIDER, slider_moment * get(p, Parameter.SLIDER_INVERSE_INERTIA))
    put(r, Result.ROD_MODE, mode_acceleration)
    if r.shape[0] > Result.FORCE_B_X:
        put(r, Result.FORCE_B_X, reaction_bx)
        put(r, Result.FORCE_B_Y, reaction_by)
        put(r, Result.FORCE_C_X, reaction_cx)
        put(r, Result.FORCE_C_Y, reaction_cy)
        put(r, Result.GUIDE_REACTION, reaction)
        put(r, Result.GUIDE_FRICTION, friction)
        put(r, Result.LOAD, load)
