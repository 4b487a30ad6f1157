"""Where the mechanism must have been: its path from the accelerations themselves, with hardly any physics.

Accelerometers on crank, rod and slider show how the journal moves in its bearing: integrating twice tells its
place for some milliseconds, and the force that the joint must carry tells on which side of the bearing it
rests while it is loaded. A smoother over all samples puts both together. Neither needs to know what moves the
slider or turns the crank, so the path is right even where the simulator lacks something, and the clearance at
which the two agree best is near the true one.

Reference: iterated extended Kalman smoother, Bell 1994, SIAM J. Optim. 4(3), 626-636; unknown accelerations
as white inputs, Gillijns & De Moor 2007, Automatica 43(1), 111-116.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import uniform_filter1d

from clearance.diagnosis.kinematics.bore import Bore
from clearance.diagnosis.kinematics.carried import NEEDED, Carried
from clearance.diagnosis.kinematics.lift import Across, Lift, lift
from clearance.diagnosis.kinematics.rigid_motion import (
    CRANK_ANGLE,
    CRANK_SPEED,
    FIRST_JOINT,
    GRAVITY_X,
    GRAVITY_Y,
    TORQUE,
    Felt,
    feel,
    slopes,
)
from clearance.diagnosis.kinematics.shaking import AT_A, shakes
from clearance.diagnosis.kinematics.smoother import smooth
from clearance.diagnosis.kinematics.swaying import sway, told
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.mechanism.parameters import JOINT_STRIDE, Parameter
from clearance.simulation.layout import STATES, Signal, State
from clearance.simulation.shooting import ECCENTRICITY_B, ECCENTRICITY_C

_ITERATIONS = 6
_LOADED = 0.25  # of the typical joint force: below, the journal may be anywhere
_RADIAL, _ACROSS = 0.03, 0.5  # of the clearance: how far a loaded journal may be from where its force points
_OUTLIER = 2.0  # doubts beyond which what a sample says of the journal loses weight (Cauchy)
_CONTACT = (
    0.15,
    0.9,
    0.04,
)  # of the typical force, of the clearance, m/s: a node in contact has more, more, less
_INSIDE = 0.9995  # of the clearance: largest eccentricity of a journal that does not touch
_SMEAR = 0.02  # of the local acceleration
_CLIPPED = 1e8  # times the variance: a value at its sensor's limit says nothing
_SWAYING = 0.05  # of the frame's motion, where it follows from its parameters
_SHAKEN = 0.2  # of the inertia forces over the mass of the frame
_TURNING, _MOVING = 400.0, 2000.0  # rad/s^2, m/s^2: typical accelerations
_BALANCE, _TORQUE_DRIFT = 0.02, 3.0  # N m; N m/s^0.5: how well the crank's torque balances, how it varies
_AT_C = {Signal.ROD_C_TRANSVERSE, Signal.ROD_C_AXIAL}
_GRAVITY = 5.0  # m/s^2 that the mechanism may lack


@dataclass(frozen=True)
class Reconstruction:
    """A path through a recording.

    Attributes:
        nodes: (segments, STATES) as ``shooting`` takes them.
        misfit: mean square over samples and channels in units of the noise, large ones counted as 9.
        force: typical force in the joint [N].
        speed: that the drive seems to be asked for [rad/s].
        across: what is seen of the slider's motion across its guide, where sensors tell.
        carried: what a loose joint C carries, likewise.
        turning: (4, samples) angle [rad], speed [rad/s] and acceleration [rad/s^2] of the crank, torque that
            the motion needs [N m]; no samples where it was read from a file.
    """

    nodes: np.ndarray
    misfit: float
    force: float
    speed: float
    turning: np.ndarray = field(default_factory=lambda: np.zeros((4, 0)))
    across: Across | None = None
    carried: Carried | None = None


def reconstruct(
    measured: Measured,
    parameters: np.ndarray,
    joints: Sequence[str],
    speed: float,
    angle: float,
    samples: int | None = None,
) -> Reconstruction:
    """Reconstruct the path of a machine whose joints have the clearances in ``parameters``.

    Args:
        measured: the recording.
        parameters: (PARAMETERS,) of the machine.
        joints: loose ones, B, C or both in this order.
        speed: mean crank speed [rad/s].
        angle: crank angle at the first sample [rad].
        samples: of the recording to use; all if ``None``.

    Raises:
        LinAlgError: the links do not reach.
    """
    values = measured.values.reshape(-1, len(measured.signals))[:samples]
    count, loose = len(values), len(joints)
    period = 1.0 / measured.chain.rate
    states, forced = FIRST_JOINT + 4 * loose, 1 + 2 * loose
    state, inputs = np.zeros((count, states)), np.zeros((count, forced))
    state[:, CRANK_ANGLE] = angle + speed * period * np.arange(count)
    state[:, CRANK_SPEED] = speed
    bores = [Bore.of(parameters, joint) for joint in joints]
    start = np.zeros(states)
    start[[CRANK_ANGLE, CRANK_SPEED]] = angle, speed
    spread = np.zeros(states)
    spread[[CRANK_ANGLE, CRANK_SPEED, TORQUE]] = 0.05, 0.03 * abs(speed), 3.0
    spread[[GRAVITY_X, GRAVITY_Y]] = _GRAVITY
    drift = np.array([_TURNING] + [_MOVING] * (2 * loose))
    for j, bore in enumerate(bores):
        gap = bore.clearance
        spread[FIRST_JOINT + 4 * j : FIRST_JOINT + 4 * j + 4] = gap, 200.0 * gap, gap, 200.0 * gap
    shaken = parameters[Parameter.SENSOR_CRANK_A] == 0.0 and shakes(measured, angle, speed)
    gives_way = parameters[Parameter.FRAME_INVERSE_MASS_X] > 0.0
    swaying = None
    if gives_way and not shaken and told(measured):
        swaying = sway(measured, angle, speed, parameters)
    if swaying is not None:
        swaying = swaying[:count]
    noise = _noise(values, measured, parameters, speed, shaken, swaying)
    target, sight = np.zeros((count, 2 * loose)), np.zeros((count, 2 * loose, 2))
    doubt = np.full((count, 2 * loose), np.inf)
    clock = measured.begin + period * np.arange(count) if measured.period > 0.0 else None
    plays = parameters[Parameter.GUIDE_STIFFNESS] > 0.0 and parameters[Parameter.GUIDE_GAP] > 0.0
    above = np.zeros((loose, 2, count))  # height of each bearing over the guide line, and its rate
    felt = feel(parameters, joints, measured.signals, state, inputs, clock=clock)
    lifted: Lift | None = None
    for iteration in range(_ITERATIONS):
        steady = _steadied(measured, values, felt, state, shaken, swaying)
        if plays and iteration > 1:  # from the forces of a path that is nearly right: they tell the side
            across, through = _across(parameters, measured, steady, felt, state, joints)
            gap, stiffness = parameters[Parameter.GUIDE_GAP], parameters[Parameter.GUIDE_STIFFNESS]
            lifted = None if across is None else lift(across, gap, stiffness, period)
            if through is not None and lifted is not None:
                # the path is that of the rod's end, which is smooth: only where the bearing is follows
                above[loose - 1], lifted = np.stack([lifted.height, lifted.rate]), None
        if iteration:
            for j in range(loose):
                rests = _resting(felt, bores[j], state, j, above[j, 0], iteration > 1, iteration > 2)
                target[:, 2 * j : 2 * j + 2], sight[:, 2 * j : 2 * j + 2], doubt[:, 2 * j : 2 * j + 2] = rests
        rows = np.column_stack([felt.signals, felt.imbalance])
        slope = slopes(parameters, joints, measured.signals, state, inputs, lifted, clock)
        seen = np.column_stack([steady, np.zeros(count)]) - rows
        seen += (slope @ np.concatenate([state, inputs], axis=1)[:, :, None])[:, :, 0]
        smoothed = smooth(
            period, start, spread**2, drift**2, _TORQUE_DRIFT**2 * period, slope, seen, noise, sight, target,
            doubt**2,
        )  # fmt: skip
        state, inputs = smoothed[:, :states].copy(), smoothed[:, states:].copy()
        felt = feel(parameters, joints, measured.signals, state, inputs, lifted, clock)
        if not (np.isfinite(smoothed).all() and np.isfinite(felt.signals).all()):
            raise np.linalg.LinAlgError("the links do not reach")
    steady = _steadied(measured, values, felt, state, shaken, swaying)
    error = (steady - felt.signals) ** 2 / noise[:, :-1]
    cost = np.minimum(error, 9.0).mean()
    for j in range(loose):
        cost += _strain(*_resting(felt, bores[j], state, j, above[j, 0], True, False), state, j)
    nodes = np.zeros((-(-count // SAMPLES), STATES))
    nodes[:, State.CRANK_ANGLE] = state[::SAMPLES, CRANK_ANGLE]
    nodes[:, State.CRANK_SPEED] = state[::SAMPLES, CRANK_SPEED]
    integral, asked = _drive(parameters, state, period)
    nodes[:, State.DRIVE_INTEGRAL] = integral[::SAMPLES]
    force, railed = 0.0, bool(above.any())
    for j, bore in enumerate(bores):
        state[:, FIRST_JOINT + 4 * j + 2] -= above[j, 0]
        state[:, FIRST_JOINT + 4 * j + 3] -= above[j, 1]
        force = _write(nodes, felt, state, j, bore)
    if lifted is not None:
        nodes[:, State.SLIDER_Y] = parameters[Parameter.GUIDE_OFFSET] + lifted.height[::SAMPLES]
        nodes[:, State.SLIDER_Y_RATE] = lifted.rate[::SAMPLES]
    elif railed:
        nodes[:, State.SLIDER_Y] = parameters[Parameter.GUIDE_OFFSET] + above[loose - 1, 0, ::SAMPLES]
        nodes[:, State.SLIDER_Y_RATE] = above[loose - 1, 1, ::SAMPLES]
    elif parameters[Parameter.GUIDE_STIFFNESS] > 0.0:
        weight = parameters[Parameter.SLIDER_MASS] * (parameters[Parameter.GRAVITY_Y] + state[:, GRAVITY_Y])
        _lay(nodes, parameters, weight - felt.force_c[:, 1], period)
    across, through = _across(parameters, measured, steady, felt, state, joints)
    weightless = state.copy()  # what gravity the sensors feel beside the machine's is a force that it lacks
    weightless[:, [GRAVITY_X, GRAVITY_Y]] = 0.0
    imbalance = feel(parameters, joints, measured.signals, weightless, inputs, lifted, clock).imbalance
    turning = np.stack([
        state[:, CRANK_ANGLE], state[:, CRANK_SPEED], inputs[:, 0], state[:, TORQUE] - imbalance,
    ])  # fmt: skip
    return Reconstruction(nodes, float(cost), force, asked, turning, across, through)


def _steadied(
    measured: Measured,
    values: np.ndarray,
    felt: Felt,
    state: np.ndarray,
    shaken: bool,
    swaying: np.ndarray | None,
) -> np.ndarray:
    """(samples, channels) felt against the frame, as the crank's sensors at A feel it or as it sways."""
    at, crank, steady = measured.signals.index, state[:, CRANK_ANGLE], values.copy()
    if shaken:
        axial, across = values[:, at(Signal.CRANK_A_AXIAL)], values[:, at(Signal.CRANK_A_TRANSVERSE)]
        x = np.cos(crank) * axial - np.sin(crank) * across
        y = np.sin(crank) * axial + np.cos(crank) * across
    elif swaying is not None:
        x, y = swaying.real, swaying.imag
    else:
        return values
    turned = {"crank": crank, "rod": felt.rod_angle, "slider": np.zeros_like(crank)}
    for column, signal in enumerate(measured.signals[: measured.filtered]):
        link, *_, direction = Signal(signal).name.lower().split("_")
        sine, cosine = np.sin(turned[link]), np.cos(turned[link])
        along = direction in ("axial", "horizontal")
        steady[:, column] -= cosine * x + sine * y if along else cosine * y - sine * x
    return steady


def _across(
    p: np.ndarray,
    measured: Measured,
    values: np.ndarray,
    felt: Felt,
    state: np.ndarray,
    joints: Sequence[str],
) -> tuple[Across | None, Carried | None]:
    """What is seen of the slider's motion across its guide, and through which loose joint C.

    Where C is ideal the rod's sensors there feel what the slider does, and the rod's angle turns it.
    """
    at, sigma, told = measured.signals.index, measured.sigma, set(measured.signals)
    gravity = p[Parameter.GRAVITY_Y] + state[:, GRAVITY_Y]
    if Signal.SLIDER_VERTICAL in told:
        vertical, doubt = values[:, at(Signal.SLIDER_VERTICAL)], float(sigma[at(Signal.SLIDER_VERTICAL)])
    elif not _ends_at_c(p):
        return None, None
    elif "C" in joints:
        if not told >= set(NEEDED):
            return None, None
        period = 1.0 / measured.chain.rate
        through = Carried.of(
            p, measured.signals, values, sigma, felt.rod_angle, felt.along, gravity, period
        )  # fmt: skip
        return through.across(float(p[JOINT_STRIDE + Parameter.JOINT_CLEARANCE])), through
    elif not told >= _AT_C:
        return None, None
    else:
        across, along = at(Signal.ROD_C_TRANSVERSE), at(Signal.ROD_C_AXIAL)
        sine, cosine = np.sin(felt.rod_angle), np.cos(felt.rod_angle)
        vertical = cosine * values[:, across] + sine * values[:, along]
        doubt = float(np.hypot(sigma[across], sigma[along] * sine.std()))
    push = p[Parameter.SLIDER_MASS] * vertical + felt.force_c[:, 1]
    return Across.own(vertical + gravity, push, doubt), None


def _ends_at_c(p: np.ndarray) -> bool:
    return bool(np.isclose(p[Parameter.SENSOR_ROD_C], p[Parameter.ROD_TO_B] + p[Parameter.ROD_TO_C]))


def _noise(
    values: np.ndarray,
    measured: Measured,
    p: np.ndarray,
    speed: float,
    shaken: bool,
    swaying: np.ndarray | None,
) -> np.ndarray:
    """(samples, channels + 1) variances: the sensors', and what the filter smears where axes turn.

    Axes turn while a filtered impact rings. A filtered product is not the product of what is filtered. What a
    frame that moves adds is known as well as the sensors at A tell, or as its own parameters.
    """
    filtered = values[:, : measured.filtered]
    moving = filtered - filtered.mean(axis=0)
    local = uniform_filter1d(moving**2, 2 * SAMPLES, axis=0).max(axis=1, initial=0.0)
    smear = _SMEAR**2 * np.maximum(local - np.median(local), 0.0)
    at_a = [measured.channels.index(channel) for channel in AT_A] if shaken else []
    if shaken:
        shaking = measured.sigma[at_a].max()
    else:
        shaking = _shaking(p, speed) if swaying is None else _SWAYING * float(np.abs(swaying).std())
    noise = np.zeros((len(values), len(measured.sigma) + 1))
    noise[:, :-1] = measured.sigma**2
    noise[:, : measured.filtered] += smear[:, None] + shaking**2
    noise[:, :-1][measured.clipped.reshape(-1, len(measured.sigma))[: len(values)]] *= _CLIPPED
    torque = p[Parameter.CRANK_LENGTH] * (p[Parameter.ROD_MASS] + p[Parameter.SLIDER_MASS])
    noise[:, -1] = _BALANCE**2 + smear * torque**2
    return noise


def _shaking(p: np.ndarray, speed: float) -> float:
    """Typical acceleration of the frame [m/s^2]: a share of what the links' inertia forces would give it."""
    force = (p[Parameter.ROD_MASS] + p[Parameter.SLIDER_MASS]) * p[Parameter.CRANK_LENGTH] * speed**2
    return _SHAKEN * float(force * p[Parameter.FRAME_INVERSE_MASS_X])


def _drive(p: np.ndarray, state: np.ndarray, period: float) -> tuple[np.ndarray, float]:
    """(samples,) integral of the drive's speed error [rad] that suits the torque best, and its speed."""
    proportional, integral = p[Parameter.DRIVE_PROPORTIONAL], p[Parameter.DRIVE_INTEGRAL_GAIN]
    if proportional <= 0.0:
        return np.zeros(len(state)), float(state[:, CRANK_SPEED].mean())
    time = period * np.arange(len(state))
    turned = state[:, CRANK_ANGLE] - state[0, CRANK_ANGLE]
    rest = state[:, TORQUE] + proportional * state[:, CRANK_SPEED] + integral * turned
    columns = np.stack([proportional + integral * time, np.full(len(state), integral)], axis=1)
    asked, first = np.linalg.lstsq(columns, rest, rcond=None)[0]
    return first + asked * time - turned, float(asked)


def _resting(
    felt: Felt, bore: Bore, state: np.ndarray, j: int, above: np.ndarray, placed: bool, settled: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What force and gap say about the eccentricity: target, direction seen, doubt [m], along and across.

    Once the journal is ``placed``, it tells which of several places with a normal it is at. Once the path has
    ``settled``, a sample that contradicts it weighs little: around an impact the filter rings,
    and the force seems to point the other way.
    """
    push = bore.force(felt)
    size = np.hypot(*push.T)
    typical = float(np.median(size))
    loaded = size > _LOADED * typical
    place = state[:, [FIRST_JOINT + 4 * j, FIRST_JOINT + 4 * j + 2]].copy()
    place[:, 1] -= above
    distance = np.maximum(np.hypot(*place.T), 1e-9)
    normal = np.where(loaded[:, None], push / np.maximum(size, 1e-9)[:, None], place / distance[:, None])
    outside = ~loaded & (distance > bore.radius(normal, felt))
    depth = (size / bore.stiffness) ** (2.0 / 3.0)
    target = bore.rest(normal, felt, place if placed else None).T
    target[:, 0] += np.where(loaded, depth, 0.0)
    sight = np.stack([normal, np.stack([-normal[:, 1], normal[:, 0]], axis=1)], axis=1)
    doubt = np.full((len(size), 2), np.inf)
    doubt[loaded | outside, 0] = _RADIAL * bore.clearance
    doubt[loaded, 1] = _ACROSS * bore.clearance * np.maximum(1.0, 0.3 * typical / size[loaded])
    if settled:
        miss = (np.einsum("tki,ti->tk", sight, place) - target) / doubt
        doubt *= 1.0 + (np.abs(miss).sum(axis=1, keepdims=True) / _OUTLIER) ** 2
    return target + sight[:, :, 1] * above[:, None], sight, doubt


def _strain(target: np.ndarray, sight: np.ndarray, doubt: np.ndarray, state: np.ndarray, j: int) -> float:
    """Mean cost of a journal that is not where its force and its bearing want it."""
    place = state[:, [FIRST_JOINT + 4 * j, FIRST_JOINT + 4 * j + 2]]
    miss = (np.einsum("tki,ti->tk", sight, place) - target) / doubt
    return float(np.log1p((miss / _OUTLIER) ** 2).sum(axis=1).mean())


def _write(nodes: np.ndarray, felt: Felt, state: np.ndarray, j: int, bore: Bore) -> float:
    """Write a journal into the nodes, in contact where it carries force; return the typical force [N]."""
    first, gap = FIRST_JOINT + 4 * j, bore.clearance
    place, rate = state[:, [first, first + 2]] / gap, state[:, [first + 1, first + 3]] / gap
    size = np.hypot(*bore.force(felt).T)
    typical = float(np.median(size))
    distance = np.maximum(np.hypot(*place.T), 1e-9)
    out = place / distance[:, None]
    radius, tilt = bore.radius(out, felt) / gap, bore.tilt(out, felt)
    sine, cosine = np.sin(tilt), np.cos(tilt)
    normal = np.stack(
        [cosine * out[:, 0] + sine * out[:, 1], cosine * out[:, 1] - sine * out[:, 0]], axis=1
    )  # fmt: skip
    approach = (rate * normal).sum(axis=1)
    share, near, slow = _CONTACT
    touching = (size > share * typical) & (distance > near * radius) & (np.abs(approach) * gap < slow)
    depth = (size / bore.stiffness) ** (2.0 / 3.0) / gap / cosine
    place = out * np.where(touching, radius + depth, np.minimum(distance, _INSIDE * radius))[:, None]
    rate = np.where(touching[:, None], rate - approach[:, None] * normal, rate)
    memory, last = np.zeros(len(size)), 5e-3
    for i in range(1, len(size)):
        if touching[i]:
            if not touching[i - 1]:
                last = max(float(approach[max(i - 2, 0) : i + 1].max()) * gap, 1e-3)
            memory[i] = last
    x, y = ECCENTRICITY_B if bore.joint == "B" else ECCENTRICITY_C
    to_rate = int(State.FRAME_X_RATE)
    nodes[:, [x, y]] = place[::SAMPLES]
    nodes[:, [x + to_rate, y + to_rate]] = rate[::SAMPLES]
    nodes[:, State.MEMORY_B if bore.joint == "B" else State.MEMORY_C] = memory[::SAMPLES]
    return typical


def _lay(nodes: np.ndarray, p: np.ndarray, push: np.ndarray, period: float) -> None:
    """Write the height of a slider that is loose in its guide: it lies where (samples,) forces [N] press."""
    size = np.abs(push)
    loaded = size > _LOADED * np.median(size)
    depth = 0.5 * size / p[Parameter.GUIDE_STIFFNESS]  # of both ends of the shoe
    lift = np.sign(push) * (p[Parameter.GUIDE_GAP] + depth)
    time = np.arange(len(push))
    lift = np.interp(time, time[loaded], lift[loaded])
    nodes[:, State.SLIDER_Y] = p[Parameter.GUIDE_OFFSET] + lift[::SAMPLES]
    nodes[:, State.SLIDER_Y_RATE] = np.gradient(lift, period)[::SAMPLES]
