"""The nodes of Exudyn's model read as what sensors feel and as the plant's coordinates."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import NamedTuple

import numpy as np

from clearance.trial.chart import SIZE, Z
from clearance.trial.plant import CHANNELS, FloatArray, Plant
from clearance.trial.plant.kernels import APPROACH_FLOOR


@dataclass(frozen=True, eq=False)
class ExudynRun:
    """What happened inside the machine.

    Attributes:
        signals: (samples, 15) at 100 kHz from time 0, columns ``CHANNELS``, unfiltered, SI units. A flexible
            rod's sensors turn with its tangent at B and at C.
        states: (samples, SIZE) columns ``chart.Z``; the mode of a flexible rod is the first sine's share in
            its deflection from the line between its ends.
        memory: (samples,) approach speed at C's first touch [m/s], 0 while apart.
    """

    signals: FloatArray
    states: FloatArray
    memory: FloatArray


class Motion(NamedTuple):
    """A node's coordinates, their rates and accelerations, (samples, coordinates) each."""

    place: FloatArray
    rate: FloatArray
    acceleration: FloatArray


class _Point(NamedTuple):
    """Place, velocity and acceleration of a point, (samples, 2) each; angle of its link there (samples,)."""

    place: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    angle: FloatArray


def run_of(
    machine: Plant,
    crank: Motion,
    rod: Sequence[Motion],
    slider: Motion,
    flywheel: Motion,
    contact: FloatArray,
) -> ExudynRun:
    """Signals and states.

    Args:
        machine: its dimensions, clearance and gains.
        crank: centre of mass and angle.
        rod: likewise, or of a flexible one each node's place and slope, from B to C.
        slider: its position.
        flywheel: the angle by which the reference has turned.
        contact: (samples, 4) Exudyn's data of the contact: the third is the approach speed at first touch.
    """
    if len(rod) == 1:
        end_b, end_c = (_on_link(rod[0], side * machine.rod[2]) for side in (-0.5, 0.5))
    else:
        end_b, end_c = _on_beam(rod[0]), _on_beam(rod[-1])
    angle, speed = crank.place[:, 2], crank.rate[:, 2]
    lead, faster = flywheel.place[:, 0] - (angle - angle[0]), flywheel.rate[:, 0] - speed
    table = dict.fromkeys(CHANNELS, np.zeros(len(angle)))  # what is not set below rests
    end_of_crank = _on_link(crank, 0.5 * machine.crank[2])
    for name, point in (("crank_b", end_of_crank), ("rod_b", end_b), ("rod_c", end_c)):
        table[f"{name}_transverse"], table[f"{name}_axial"] = _felt(point)
    table |= {
        "crank_angle": angle, "crank_speed": speed, "drive_torque": machine.kp * faster + machine.ki * lead,
        "slider_position": slider.place[:, 0], "slider_velocity": slider.rate[:, 0],
        "slider_horizontal": slider.acceleration[:, 0],
    }  # fmt: skip

    states = np.zeros((len(angle), SIZE))
    coordinates, rates = states[:, : len(Z)], states[:, len(Z) : -1]
    coordinates[:, Z.CRANK], rates[:, Z.CRANK], states[:, -1] = angle, speed, lead
    for part, end, bearing in ((coordinates, end_c.place, slider.place), (rates, end_c.rate, slider.rate)):
        part[:, Z.GAP_C_X], part[:, Z.GAP_C_Y] = end[:, 0] - bearing[:, 0], end[:, 1]
    if len(rod) > 1:
        coordinates[:, Z.MODE], rates[:, Z.MODE] = _mode(rod)
    touching = np.hypot(coordinates[:, Z.GAP_C_X], coordinates[:, Z.GAP_C_Y]) > machine.clearances()[1]
    memory = np.where(touching, np.maximum(contact[:, 2], APPROACH_FLOOR), 0.0)
    return ExudynRun(np.stack([table[name] for name in CHANNELS], axis=1), states, memory)


def _on_link(motion: Motion, arm: float) -> _Point:
    """A point of a rigid link, ``arm`` [m] beyond its centre of mass."""
    angle, spin = motion.place[:, 2], motion.rate[:, 2:]
    along = arm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return _Point(
        motion.place[:, :2] + along,
        motion.rate[:, :2] + spin * across,
        motion.acceleration[:, :2] + motion.acceleration[:, 2:] * across - spin**2 * along,
        angle,
    )


def _on_beam(motion: Motion) -> _Point:
    """The place of a beam's node."""
    slope = motion.place[:, 2:]
    place, rate, acceleration = (column[:, :2] for column in motion)
    return _Point(place, rate, acceleration, np.arctan2(slope[:, 1], slope[:, 0]))


def _felt(point: _Point) -> tuple[FloatArray, FloatArray]:
    """What a sensor there feels [m/s²]: transverse, axial."""
    (x, y), cosine, sine = point.acceleration.T, np.cos(point.angle), np.sin(point.angle)
    return y * cosine - x * sine, x * cosine + y * sine


def _mode(nodes: Sequence[Motion]) -> tuple[FloatArray, FloatArray]:
    """Share of the first sine in the deflection from the line between the ends [m], and its rate."""
    places = np.array([node.place[:, :2] - nodes[0].place[:, :2] for node in nodes])
    rates = np.array([node.rate[:, :2] - nodes[0].rate[:, :2] for node in nodes])
    chord, turning = places[-1], rates[-1]
    length = np.hypot(*chord.T)
    pieces = len(nodes) - 1
    shape = 2.0 / pieces * np.sin(pi * np.arange(len(nodes)) / pieces)
    return (
        shape @ (_cross(chord, places) / length),
        shape @ ((_cross(turning, places) + _cross(chord, rates)) / length),
    )


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Of vectors in the plane, along the last axis."""
    product: FloatArray = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return product
