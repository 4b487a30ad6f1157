"""How plainly something missing shows: from the same state, over 5 ms, after refitting what is not known.

The detection threshold: from the same state, after refitting state, clearance and speed, a channel changes by
3 % of its standard deviation. A *visibility* is that change over 3 %: sizes at 1 are at the threshold. The
refit is linear, by finite differences at each instant; an impact that moves within the 5 ms counts at first
order only.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clearance.trial.chart import SIZE, Z, free, instant_of
from clearance.trial.plant import ACCELERATIONS, BASE_RATE, FloatArray, Plant

WINDOW = 5e-3  # s
THRESHOLD = 0.03  # of a channel's standard deviation
STILL = 1e-6  # of the liveliest channel: what moves less does not move
_BLOCK = 10  # samples at 100 kHz that are averaged to one
# Changes for the finite differences. A journal at rest presses 1e-7 m deep: a thousandth of that.
_POSITION, _RATE, _SHARE = 1e-10, 1e-7, 1e-7
_SINGULAR = 1e-9  # of the largest singular value: what changes less in a direction cannot be refitted by it


@dataclass(frozen=True, eq=False)
class Scene:
    """An instant of one recording, in coordinates that any plant can begin from.

    Attributes:
        session: index of the recording.
        time: [s].
        state: (SIZE,) see ``chart.Z``.
        memory: (2,) approach speeds at first touch of B and C [m/s].
    """

    session: int
    time: float
    state: FloatArray
    memory: FloatArray


def response(plant: Plant, scene: Scene) -> FloatArray:
    """(50, 10) accelerations over 5 ms [m/s²] from a scene's state, averaged over 0.1 ms."""
    instant = instant_of(plant, scene.time, scene.state, scene.memory)
    return averaged(plant.go_on(instant, WINDOW)[0].signals[:, : len(ACCELERATIONS)])


def averaged(signals: FloatArray) -> FloatArray:
    """(n, ...) means over 0.1 ms of signals at 100 kHz."""
    rows = len(signals) // _BLOCK
    means: FloatArray = signals[: rows * _BLOCK].reshape(rows, _BLOCK, -1).mean(axis=1)
    return means


def unexplained(
    scenes: Sequence[Scene],
    changes: Sequence[FloatArray],
    plants: Sequence[Plant],
    spread: FloatArray,
    clearance: bool = True,
) -> float:
    """What a refit leaves of changes of the signals, over the threshold, in the channel that shows it most.

    Args:
        scenes: instants.
        changes: (50, 10) [m/s²] for each of them: the signals minus those of the session's plant.
        plants: of the sessions; what they know is refitted.
        spread: (10,) standard deviations [m/s²]; channels with 0 are not looked at.
        clearance: whether the clearance is refitted too, besides state and speed.
    """
    live = np.flatnonzero(spread > 0.0)
    shared = len(plants) + clearance
    rest, columns = [], []
    for scene, change in zip(scenes, changes, strict=True):
        own, common = _derivatives(plants[scene.session], scene, clearance)
        local = _unit(_scaled(own, spread, live))
        basis, sizes, _ = np.linalg.svd(local, full_matrices=False)
        basis = basis[:, sizes > _SINGULAR * max(sizes.max(), 1e-300)]
        target = (change[:, live] / spread[live]).ravel()
        table = np.zeros((len(target), shared))
        scaled = _scaled(common, spread, live)  # as large as they are: one change for all scenes
        table[:, scene.session] = scaled[:, 0]
        if clearance:
            table[:, -1] = scaled[:, 1]
        rest.append(target - basis @ (basis.T @ target))
        columns.append(table - basis @ (basis.T @ table))
    target, table = np.concatenate(rest), _unit(np.concatenate(columns))
    left = target - table @ np.linalg.lstsq(table, target, rcond=_SINGULAR)[0]
    by_channel = np.sqrt((left.reshape(-1, len(live)) ** 2).mean(axis=0))
    return float(by_channel.max() / THRESHOLD)


def _scaled(columns: FloatArray, spread: FloatArray, live: NDArray[np.intp]) -> FloatArray:
    """(rows, columns) in standard deviations."""
    table: FloatArray = (columns[:, :, live] / spread[live]).reshape(len(columns), -1).T
    return table


def _unit(table: FloatArray) -> FloatArray:
    """(rows, columns) each of length 1, where only its direction matters."""
    length = np.linalg.norm(table, axis=0)
    unit: FloatArray = table / np.where(length > 0.0, length, 1.0)
    return unit


def _derivatives(plant: Plant, scene: Scene, clearance: bool) -> tuple[FloatArray, FloatArray]:
    """Changes of the response: with the state (states, 50, 10), with speed and clearance (1 or 2, 50, 10)."""
    base = response(plant, scene)

    def moved(entry: int, by: float) -> FloatArray:
        state = scene.state.copy()
        state[entry] += by
        return response(plant, replace(scene, state=state)) - base

    coordinates = free(plant)
    own = [moved(z, _POSITION) for z in coordinates] + [moved(len(Z) + z, _RATE) for z in coordinates]
    own.append(moved(SIZE - 1, _RATE))
    others = [replace(plant, speed_rpm=plant.speed_rpm * (1.0 + _SHARE))]
    if clearance:
        others.append(replace(plant, clearance=float(np.max(plant.clearance)) * (1.0 + _SHARE)))
    return np.array(own), np.array([response(other, scene) - base for other in others])


def later(signals: FloatArray, rate_error: float) -> FloatArray:
    """(n, channels) signals at 100 kHz as a recorder shows them whose samples last ``rate_error`` longer."""
    times = np.arange(len(signals)) / BASE_RATE
    return np.stack([np.interp(times * (1.0 + rate_error), times, column) for column in signals.T], axis=1)
