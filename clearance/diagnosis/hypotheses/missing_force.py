"""What the unknown forces look like: as a time series, and as a curve of free form.

Beside a fitted model, unknown forces on crank, rod and slider kept the simulator on the recording. Whatever
acts there in truth shows in them, segment by segment. A force on one body is a pattern over the segments: the
forces on crank, rod and slider that would do the same. Regressing these on the patterns of a table of one
argument gives the force of free form; a few segments with a badly understood impact hardly count.

References: Huber 1964, Ann. Math. Stat. 35(1), 73-101 (robust regression); Schwarz 1978, Ann. Stat. 6(2)
(price of a parameter).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from clearance.diagnosis.hypotheses.free_form import (
    ARGUMENTS,
    KNOTS,
    Curve,
    arguments_of,
    contact_force_of,
    curve_over,
)
from clearance.diagnosis.kinematics.regression import cost_of, regressed
from clearance.diagnosis.kinematics.rigid_motion import tilt
from clearance.diagnosis.sensing.measured import Measured
from clearance.diagnosis.shooting.follow import EDGE, Follower
from clearance.diagnosis.shooting.stretch import INPUTS, Comparison, Pass
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.slider_crank import SliderCrank
from clearance.simulation.layout import Signal

_OUTLIER = 2.0  # of the scatter between neighbours, beyond which a segment counts linearly
_ITERATIONS = 8
_CORRELATED = 3.0  # neighbouring segments that count as one
_STRAIGHT = 0.1  # weight of a bend of the table beside a segment
_HALF = 0.5  # of a force's robust square: what leaves more of it is no function of an argument
_TURN = (KNOTS, 2 * KNOTS, 4 * KNOTS)  # of a torque's table over a turn
_CERTAIN, _STRONG = 0.1, 0.9  # of its size: no force is known better; quantile that tells this size

PLACES = (("crank", "torque"), ("rod", "moment"), ("slider", "x"))
"""Where the unknown forces act, in the order of ``INPUTS``."""


@dataclass(frozen=True)
class Seen:
    """Unknown forces of all recordings, segment by segment.

    Attributes:
        forces: (segments, inputs) in standard deviations of their scatter.
        scatter: (inputs,) between neighbouring segments [N m, N m, N].
        arguments: name to (segments,) values in the middle of the segments.
    """

    forces: np.ndarray
    scatter: np.ndarray
    arguments: dict[str, np.ndarray]


def observe_forces(
    passes: Sequence[Pass],
    inputs: Sequence[np.ndarray],
    machine: SliderCrank,
    joint: str,
    recordings: Sequence[Measured],
) -> Seen:
    """Gather the unknown forces and what they may depend on.

    Args:
        passes: of a fit with unknown forces.
        inputs: (segments, inputs) of each [N m, N m, N].
        machine: of the fit.
        joint: whose contact force counts.
        recordings: the stretches.
    """
    inner = slice(EDGE, -EDGE)
    rows = [one[inner] for one in inputs]
    neighbours = np.concatenate([np.diff(one, axis=0) for one in rows])
    scatter = np.maximum(1.4826 / np.sqrt(2.0) * np.median(np.abs(neighbours), axis=0), 1e-9)
    found = [arguments_along(one, machine, joint, own) for one, own in zip(passes, recordings, strict=True)]
    gathered = {name: np.concatenate([one[name] for one in found]) for name in ARGUMENTS}
    return Seen(np.concatenate(rows) / scatter, scatter, gathered)


def arguments_along(
    one: Comparison, machine: SliderCrank, joint: str, measured: Measured
) -> dict[str, np.ndarray]:
    """(segments,) values of each argument in the middle of a path's segments, its ends left out.

    The rod's angle is that of ideal joints: a clearance turns it by thousandths of a radian.
    """
    signals = one.signals[EDGE:-EDGE, one.signals.shape[1] // 2]
    return {
        "crank_angle": signals[:, Signal.CRANK_ANGLE] % (2.0 * np.pi),
        "rod_angle": tilt(machine.parameters(), signals[:, Signal.CRANK_ANGLE]),
        "slider_position": signals[:, Signal.SLIDER_POSITION],
        "slider_velocity": signals[:, Signal.SLIDER_VELOCITY],
        "contact_force": one.contacts[EDGE:-EDGE, :, 1 if joint == "B" else 3].mean(axis=1),
        "time": measured.begin + measured.segment * (np.arange(len(signals)) + EDGE + 0.5),
    }


def patterns(
    passes: Sequence[Pass], sigmas: Sequence[np.ndarray], columns: slice, scatter: np.ndarray
) -> np.ndarray:
    """(segments, inputs, columns) unknown forces that would do what a step of each column does.

    Args:
        passes: whose machine columns are asked for.
        sigmas: (inputs,) standard deviations of the unknown forces of each.
        columns: which of the passes' columns.
        scatter: (inputs,) unit of the result [N m, N m, N].
    """
    found = []
    for one, sigma in zip(passes, sigmas, strict=True):
        flow = np.nan_to_num(one.system[0][EDGE:-EDGE], nan=0.0, posinf=0.0, neginf=0.0)
        nz = flow.shape[1]
        own = flow[:, :, nz : nz + len(INPUTS)]
        found.append(
            np.linalg.pinv(own) @ flow[:, :, nz + len(INPUTS) :][:, :, columns] * (sigma / scatter)[:, None]
        )
    return np.concatenate(found)


@dataclass(frozen=True)
class Regression:
    """A pattern's size and what it explains.

    Attributes:
        coefficients: (columns,).
        deviations: (columns,) standard deviations.
        gain: fall of the robust cost, in units of the scatter, correlated neighbours counted once.
    """

    coefficients: np.ndarray
    deviations: np.ndarray
    gain: float


def regress(seen: Seen, pattern: np.ndarray) -> Regression:
    """Fit (segments, inputs, columns) patterns to the forces by iterated reweighting."""
    target = seen.forces.ravel()
    matrix = pattern.reshape(len(target), -1)
    size = np.sqrt((matrix**2).sum(axis=0))
    matrix = matrix / np.maximum(size, 1e-300)
    weight = _weight(target)
    x = np.zeros(matrix.shape[1])
    normal = np.eye(len(x))
    for _ in range(_ITERATIONS):
        normal = (matrix * weight[:, None]).T @ matrix + 1e-9 * np.eye(len(x))
        x = np.linalg.solve(normal, matrix.T @ (weight * target))
        weight = _weight(target - matrix @ x)
    left = target - matrix @ x
    gain = float(_cost(target).sum() - _cost(left).sum()) / _CORRELATED
    spread = np.sqrt(
        np.diag(np.linalg.inv(normal)) * _CORRELATED * max(1.0, float((weight * left**2).mean()))
    )
    unit = np.maximum(size, 1e-300)
    return Regression(x / unit, spread / unit, gain)


def _weight(left: np.ndarray) -> np.ndarray:
    return np.minimum(1.0, _OUTLIER / np.maximum(np.abs(left), _OUTLIER))


def _cost(left: np.ndarray) -> np.ndarray:
    size = np.abs(left)
    return np.where(size <= _OUTLIER, size**2, 2.0 * _OUTLIER * size - _OUTLIER**2)


def directions(joint: str) -> tuple[tuple[str, str], ...]:
    """Bodies and directions in which a force can be missing with an ideal guide and a frame at rest."""
    inside = f"joint_{joint.lower()}"
    return (
        ("crank", "torque"), ("rod", "x"), ("rod", "y"), ("rod", "moment"), ("slider", "x"),
        (inside, "normal"), (inside, "tangential"),
    )  # fmt: skip


def constant(machine: SliderCrank, body: str, direction: str, size: float) -> SliderCrank:
    """The machine with a constant force [N or N m]."""
    return replace(machine, force=TabulatedForce(body, direction, values=(size,)))


def proportional(machine: SliderCrank, body: str, direction: str, joint: str, size: float) -> SliderCrank:
    """The machine with a force proportional to that of a joint's contact [N/N or N m/N]."""
    law = TabulatedForce(body, direction, contact_force_of(joint), 0.0, 1.0, (0.0, size))
    return replace(machine, force=law)


def curves(seen: Seen, pattern: np.ndarray, joint: str, sizes: np.ndarray) -> list[Curve]:
    """Fit curves of every argument in every direction, best first.

    Over the contact's force they are straight lines here: it changes too fast within a segment for more. A
    torque on the crank over its angle has as many knots as it takes: motors and gears have high harmonics.

    Args:
        seen: unknown forces.
        pattern: (segments, inputs, 2 directions) of a constant force in each direction, then of one in each
            that is proportional to the contact's force.
        joint: B or C.
        sizes: (2 directions,) of those forces [N or N m, then the same for a newton of contact].
    """
    found = []
    count, places = len(seen.forces), directions(joint)
    for d, (body, direction) in enumerate(places):
        for argument in arguments_of(body):
            values, line = seen.arguments[argument], argument == "contact_force"
            column, several = d + line * len(places), list[Curve]()
            for knots in _TURN if (body, argument) == ("crank", "crank_angle") else (KNOTS,):
                curve = curve_over(values, body, direction, argument, knots)
                if knots > KNOTS:
                    curve = replace(curve, interpolation="cubic")
                each = np.ones((len(values), 1)) if line else curve.shares(values)
                fitted = regress(seen, pattern[:, :, column, None] * each[:, None, :])
                unit = sizes[column] * (curve.knots if line else 1.0)
                several.append(
                    replace(
                        curve, forces=fitted.coefficients * unit,
                        deviations=fitted.deviations * np.abs(unit), gain=fitted.gain,
                        price=float(each.shape[1] * np.log(count / _CORRELATED)),
                    )
                )  # fmt: skip
            found.append(min(several, key=_net))
    return sorted(found, key=_net)


def _net(curve: Curve) -> float:
    return curve.price - curve.gain


def as_function_of(force: np.ndarray, values: np.ndarray, curve: Curve) -> tuple[Curve, float]:
    """A force along a path as a function of an argument, and the share of it left out, both robust.

    What an effect does in a segment with an impact is no force that acts all along it.

    Args:
        force: (segments,) [N or N m].
        values: (segments,) of the argument.
        curve: its knots; where the path does not come it goes on straight.
    """
    own = curve.shares(values)
    straight = _STRAIGHT * np.diff(np.eye(len(curve.knots)), 2, axis=0)
    rows, right = np.concatenate([own, straight]), np.concatenate([force, np.zeros(len(straight))])
    level = force - np.median(force)
    size = float(np.quantile(np.abs(level), _STRONG) or np.abs(level).max())
    scatter = max(float(np.median(np.abs(np.diff(force)))), _CERTAIN * size, 1e-300)
    forces = regressed(rows, right, scatter)
    left = cost_of(force - own @ forces, scatter) / max(cost_of(level, scatter), 1e-300)
    return replace(curve, forces=forces), left


def effect_as_curves(
    passes: Sequence[Pass],
    followers: Sequence[Follower],
    machine: SliderCrank,
    place: tuple[str, str],
    joint: str,
) -> list[Curve]:
    """What an effect does on one body in one direction, as curves of the arguments that can say it.

    Args:
        passes: of the machine without the effect, beside paths of the one with it; their only column is the
            machine with it.
        followers: of each.
        machine: with the effect.
        place: body and direction, one of ``PLACES``.
        joint: whose contact force counts.

    Returns:
        Curves, the one that says it best first; none that leaves more than half out.
    """
    acting = PLACES.index(place)
    force = np.concatenate([
        _likened(one, acting) * follower.input_sigma[acting]
        for one, follower in zip(passes, followers, strict=True)
    ])  # fmt: skip
    each = [
        arguments_along(one, machine, joint, follower.measured)
        for one, follower in zip(passes, followers, strict=True)
    ]
    found = []
    for argument in arguments_of(place[0]):
        if argument == "time":  # what a machine does knows no clock
            continue
        values = np.concatenate([one[argument] for one in each])
        curve, left = as_function_of(force, values, curve_over(values, *place, argument))
        if left < _HALF:
            found.append((left, curve))
    return [curve for _, curve in sorted(found, key=lambda one: one[0])]


def _likened(one: Pass, acting: int) -> np.ndarray:
    """(segments,) size of one unknown force that does most of what the pass's only column does.

    Of all three at once, which turn the crank alike, a little that none of them does would be made of much.
    """
    flow = np.nan_to_num(one.system[0][EDGE:-EDGE], nan=0.0, posinf=0.0, neginf=0.0)
    own, column = flow[:, :, flow.shape[1] + acting], flow[:, :, -1]
    size: np.ndarray = (own * column).sum(axis=1) / np.maximum((own**2).sum(axis=1), 1e-300)
    return size
