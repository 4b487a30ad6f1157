"""The mechanism once more, for comparison: independent code on purpose, nothing imported from clearance.

Maximal coordinates: x, y and angle of the centre of mass of crank, rod and slider, and every joint a
constraint with its Lagrange multiplier. SciPy's DOP853 integrates piecewise from touch to parting, so the
contact law is smooth within every piece and the approach speed is the one at the instant of touch.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

APPROACH_SPEED_FLOOR = 1e-3
CRANK, ROD, SLIDER = 0, 3, 6  # first coordinate of each body in (x, y, angle) x 3


@dataclass(frozen=True)
class Machine:
    """Nominal numbers of the mechanism [SI]; joint is "none", "B" or "C"."""

    joint: str = "none"
    clearance: float = 0.0
    factor: float = 0.75 * (1.0 - 0.9**2)  # Lankarani-Nikravesh, e = 0.9
    speed: float = 500.0 * 2.0 * np.pi / 60.0
    crank: tuple = (0.3, 1e-5, 0.05)  # mass, inertia about the centre of mass, length
    rod: tuple = (0.21, 2.5e-4, 0.12)
    slider: tuple = (0.14, 1.05e-5)
    offset: float = 0.0
    centres: tuple = (0.5, 0.5)  # of mass, as a share of crank and rod
    gravity: tuple = (0.0, 0.0)
    ramp: float = 0.5
    gains: tuple = (5.0, 200.0)
    journal_radius: float = 0.01

    @property
    def stiffness(self):
        effective_modulus = 200e9 / (2.0 * (1.0 - 0.3**2))
        curvature = 1.0 / self.journal_radius - 1.0 / (self.journal_radius + self.clearance)
        return 4.0 / 3.0 * effective_modulus / np.sqrt(curvature)


def rotate(angle, along):
    """A body-fixed vector (along, 0), its derivative by the angle, and its second derivative."""
    arm = along * np.array([np.cos(angle), np.sin(angle)])
    return arm, np.array([-arm[1], arm[0]]), -arm


def point(coordinates, body, along):
    """Position (2,), Jacobian (2, 9) and centripetal direction (2,) of a point on a body's axis."""
    arm, turned, centripetal = rotate(coordinates[body + 2], along)
    jacobian = np.zeros((2, 9))
    jacobian[0, body] = jacobian[1, body + 1] = 1.0
    jacobian[:, body + 2] = turned
    return coordinates[body : body + 2] + arm, jacobian, centripetal


def arms(machine):
    """Where the ends of crank and rod lie on their axes, from the centre of mass."""
    bodies = zip(machine.centres, (machine.crank, machine.rod), strict=True)
    return [(-share * body[2], (1.0 - share) * body[2]) for share, body in bodies]


def attachment_points(machine, coordinates):
    """A and B on the crank, B and C on the rod, C on the slider."""
    (crank_a, crank_b), (rod_b, rod_c) = arms(machine)
    return {
        "crank_a": (CRANK, *point(coordinates, CRANK, crank_a)),
        "crank_b": (CRANK, *point(coordinates, CRANK, crank_b)),
        "rod_b": (ROD, *point(coordinates, ROD, rod_b)),
        "rod_c": (ROD, *point(coordinates, ROD, rod_c)),
        "slider_c": (SLIDER, *point(coordinates, SLIDER, 0.0)),
    }


def journal_and_bearing(machine):
    return ("crank_b", "rod_b") if machine.joint == "B" else ("rod_c", "slider_c")


def gap(machine, coordinates, velocities):
    """Penetration, its rate, and the generalised force of a unit normal force."""
    points = attachment_points(machine, coordinates)
    (_, journal, journal_jacobian, _), (_, bearing, bearing_jacobian, _) = (
        points[name] for name in journal_and_bearing(machine)
    )
    eccentricity = journal - bearing
    length = np.linalg.norm(eccentricity)
    if length == 0.0:
        return -machine.clearance, 0.0, np.zeros(9)
    along = (eccentricity / length) @ (journal_jacobian - bearing_jacobian)
    return length - machine.clearance, along @ velocities, -along


def accelerations(machine, time, coordinates, velocities, integral, approach_speed):
    """Second derivatives (9,) from the augmented system [M G'; G 0] (a, -lambda) = (Q, gamma)."""
    masses = np.concatenate(
        [np.array(body)[[0, 0, 1]] for body in (machine.crank, machine.rod, machine.slider)]
    )
    points = attachment_points(machine, coordinates)
    pairs = [("crank_a", None)]
    pairs += [("crank_b", "rod_b")] if machine.joint != "B" else []
    pairs += [("rod_c", "slider_c")] if machine.joint != "C" else []
    rows, right = [], []
    for first, second in pairs:
        body, _, jacobian, centripetal = points[first]
        row, gamma = jacobian.copy(), -centripetal * velocities[body + 2] ** 2
        if second is not None:
            body, _, jacobian, centripetal = points[second]
            row, gamma = row - jacobian, gamma + centripetal * velocities[body + 2] ** 2
        rows.append(row)
        right.append(gamma)
    guide = np.zeros((2, 9))
    guide[0, SLIDER + 1] = guide[1, SLIDER + 2] = 1.0
    rows.append(guide)
    right.append(np.zeros(2))
    constraint, gamma = np.vstack(rows), np.concatenate(right)

    force = np.zeros(9)
    for body in (CRANK, ROD, SLIDER):
        force[body : body + 2] = masses[body] * np.array(machine.gravity)
    error = machine.speed * min(time / machine.ramp, 1.0) - velocities[CRANK + 2]
    force[CRANK + 2] += machine.gains[0] * error + machine.gains[1] * integral
    if approach_speed > 0.0:
        depth, rate, direction = gap(machine, coordinates, velocities)
        law = machine.stiffness * max(depth, 0.0) ** 1.5 * (1.0 + machine.factor * rate / approach_speed)
        force += max(law, 0.0) * direction

    count = len(gamma)
    augmented = np.zeros((9 + count, 9 + count))
    augmented[:9, :9] = np.diag(masses)
    augmented[:9, 9:] = constraint.T
    augmented[9:, :9] = constraint
    return np.linalg.solve(augmented, np.concatenate([force, gamma]))[:9]


def assemble(machine, crank_angle):
    """Coordinates (9,) at a crank angle, journals centred."""
    crank_length, rod_length = machine.crank[2], machine.rod[2]
    joint_b = crank_length * np.array([np.cos(crank_angle), np.sin(crank_angle)])
    rod_angle = np.arcsin((machine.offset - joint_b[1]) / rod_length)
    rod = rod_length * np.array([np.cos(rod_angle), np.sin(rod_angle)])
    centre_crank, centre_rod = machine.centres[0] * joint_b, joint_b + machine.centres[1] * rod
    return np.array([*centre_crank, crank_angle, *centre_rod, rod_angle, *(joint_b + rod), 0.0])


def reassemble(machine, state):
    """The state (19,) put back on its constraints: angles, slider and drive are kept, the rest follows.

    The augmented system holds the constraints at acceleration level only, so errors of position grow as t².
    """
    state = state.copy()
    coordinates, velocities = state[:9], state[9:18]
    if machine.joint == "none":
        exact = ideal_kinematics(
            coordinates[2], velocities[2], 0.0, machine.crank[2], machine.rod[2], machine.offset
        )
        coordinates[ROD + 2], velocities[ROD + 2] = exact["rod_angle"], exact["rod_speed"]
        coordinates[SLIDER], velocities[SLIDER] = exact["slider_position"], exact["slider_velocity"]
    coordinates[SLIDER + 1 :], velocities[SLIDER + 1 :] = (machine.offset, 0.0), 0.0
    (crank_a, crank_b), (rod_b, rod_c) = arms(machine)
    steps = [(CRANK, crank_a, None, 0.0)]
    steps += [(ROD, rod_c, SLIDER, 0.0)] if machine.joint == "B" else [(ROD, rod_b, CRANK, crank_b)]
    for body, own, other, arm in steps:
        target, target_velocity = np.zeros(2), np.zeros(2)
        if other is not None:
            target, jacobian, _ = point(coordinates, other, arm)
            target_velocity = jacobian @ velocities
        reached, jacobian, _ = point(coordinates, body, own)
        coordinates[body : body + 2] += target - reached
        velocities[body : body + 2] += target_velocity - jacobian @ velocities
    return state


def integrate(machine, times, rtol=1e-10):
    """Run from rest; returns coordinates, velocities, accelerations (n, 9) at `times`, and the touches."""
    state = np.concatenate([assemble(machine, 0.0), np.zeros(10)])
    # Absolute tolerances: far below a penetration (1e-6 m) and the speeds in contact (1e-3 m/s).
    atol = np.concatenate([np.full(9, 1e-14), np.full(9, 1e-11), [1e-13]])
    now, approach_speed, touches = 0.0, 0.0, []
    results = np.full((len(times), 28), np.nan)

    def right_hand_side(time, y):
        acceleration = accelerations(machine, time, y[:9], y[9:18], y[18], approach_speed)
        error = machine.speed * min(time / machine.ramp, 1.0) - y[9 + CRANK + 2]
        return np.concatenate([y[9:18], acceleration, [error]])

    def crossing(_, y):
        return gap(machine, y[:9], y[9:18])[0]

    def depth_and_rate(y):
        return gap(machine, y[:9], y[9:18])[:2]

    crossing.terminal = True
    doubted = -1.0
    while now < times[-1]:
        in_contact = approach_speed > 0.0
        crossing.direction = -1.0 if in_contact else 1.0
        end = min(times[-1], now + 5e-3)  # short pieces: see `reassemble`
        piece = solve_ivp(
            right_hand_side,
            (now, end),
            state,
            method="DOP853",
            rtol=rtol,
            atol=atol,
            first_step=min(
                1e-9, end - now
            ),  # short enough to show on which side of the crossing the piece starts
            max_step=1e-4,  # no touch is stepped over
            events=crossing if machine.joint != "none" else None,
            dense_output=True,
        )
        assert piece.success, piece.message
        if (
            machine.joint != "none"
            and doubted != now
            and (depth_and_rate(piece.y[:, 1])[0] > 0.0) != in_contact
        ):
            # A touch or parting so slow that it turns back at once: the events would not see its end.
            doubted = now
            approach_speed = 0.0 if in_contact else max(depth_and_rate(state)[1], APPROACH_SPEED_FLOOR)
            continue
        for index in np.flatnonzero((times >= now) & (times <= piece.t[-1])):
            y = piece.sol(times[index])
            results[index] = np.concatenate(
                [y[:18], right_hand_side(times[index], y)[9:18], [approach_speed]]
            )
        now, state = piece.t[-1], piece.y[:, -1]
        if piece.status == 0:
            state = reassemble(machine, state)
        elif in_contact:
            approach_speed = 0.0
        else:
            approach_speed = max(depth_and_rate(state)[1], APPROACH_SPEED_FLOOR)
            touches.append((now, approach_speed))
    return results[:, :9], results[:, 9:18], results[:, 18:27], touches


def ideal_kinematics(crank_angle, crank_speed, crank_acceleration, crank=0.05, rod=0.12, offset=0.0):
    """Closed form of the ideal slider-crank, from sin(rod angle) = (offset - r sin θ)/l; arrays allowed.

    Returns a dictionary: rod_angle, rod_speed, rod_acceleration, slider_position, slider_velocity,
    slider_acceleration, and channels (..., 10) in the order of docs/mechanism.md.
    """
    theta, omega, alpha = (np.asarray(x, dtype=float) for x in (crank_angle, crank_speed, crank_acceleration))
    sine = (offset - crank * np.sin(theta)) / rod
    cosine = np.sqrt(1.0 - sine**2)
    sine_dot = -crank / rod * np.cos(theta) * omega
    sine_ddot = -crank / rod * (np.cos(theta) * alpha - np.sin(theta) * omega**2)
    rod_speed = sine_dot / cosine
    rod_acceleration = sine_ddot / cosine + sine * rod_speed**2 / cosine
    position = crank * np.cos(theta) + rod * cosine
    velocity = -crank * np.sin(theta) * omega - rod * sine * rod_speed
    acceleration = (
        -crank * (np.sin(theta) * alpha + np.cos(theta) * omega**2)
        - rod * (sine * rod_acceleration + cosine * rod_speed**2)
    )  # fmt: skip
    # B in the crank's axes, turned into the rod's by the angle between them; C moves along x only.
    transverse, axial = crank * alpha, -crank * omega**2
    between = np.arcsin(sine) - theta
    zero = np.zeros(np.broadcast(theta, omega, alpha).shape)
    channels = [
        zero,
        zero,
        transverse + zero,
        axial + zero,
        transverse * np.cos(between) - axial * np.sin(between),
        transverse * np.sin(between) + axial * np.cos(between),
        -acceleration * sine,
        acceleration * cosine,
        zero,
        acceleration,
    ]
    return {
        "rod_angle": np.arcsin(sine),
        "rod_speed": rod_speed,
        "rod_acceleration": rod_acceleration,
        "slider_position": position,
        "slider_velocity": velocity,
        "slider_acceleration": acceleration,
        "channels": np.stack(channels, axis=-1),
    }


def channels(machine, coordinates, velocities, acceleration):
    """Ten proper accelerations (n, 10) of the maximal-coordinate model, in the order of docs/mechanism.md."""
    gravity = np.array(machine.gravity)
    columns = []
    for body, ends in zip((CRANK, ROD), arms(machine), strict=True):
        angle, speed, turn = coordinates[:, body + 2], velocities[:, body + 2], acceleration[:, body + 2]
        centre = acceleration[:, body : body + 2] - gravity
        axial = centre[:, 0] * np.cos(angle) + centre[:, 1] * np.sin(angle)
        transverse = centre[:, 1] * np.cos(angle) - centre[:, 0] * np.sin(angle)
        for arm in ends:
            columns += [transverse + arm * turn, axial - arm * speed**2]
    columns += [acceleration[:, SLIDER + 1] - gravity[1], acceleration[:, SLIDER] - gravity[0]]
    return np.stack(columns, axis=-1)


def rebound(factor):
    """Speed ratio e' of a single impact: 1 + e' = ln[(1 + χ)/(1 - χ e')]/χ."""
    if factor == 0.0:
        return 1.0

    def residual(ratio):
        return np.log((1.0 + factor) / (1.0 - factor * ratio)) / factor - 1.0 - ratio

    return brentq(residual, 0.0, min(1.0, (1.0 - 1e-12) / factor), xtol=1e-14)
