"""A plant's state in coordinates that mean the same in any plant: crank, journals' gaps, frame, shoe, mode.

Two machines are in *the same state* where these are the same; a coordinate that a machine does not have (a
gap of an ideal joint, a frame that stands fast) is 0 there. Changing the offset of the guide or the rod's
centre of mass then moves bodies, but presses no journal into its bearing.
"""

from enum import IntEnum, auto
from math import asin, cos, sin

import numpy as np

from clearance.trial.plant import FloatArray, Instant, Plant
from clearance.trial.plant.kernels import COORDINATES, STATE, P, Q


class Z(IntEnum):
    """Coordinates; the rate of each is ``len(Z)`` further on, the drive's integral comes last. SI units."""

    CRANK = 0
    GAP_B_X = auto()  # journal centre minus bearing centre
    GAP_B_Y = auto()
    GAP_C_X = auto()
    GAP_C_Y = auto()
    FRAME_X = auto()
    FRAME_Y = auto()
    HEIGHT = auto()  # of the shoe over the guide line
    TILT = auto()
    MODE = auto()


SIZE = 2 * len(Z) + 1
_PAIRS = (
    (Z.CRANK, Q.CRANK),
    (Z.FRAME_X, Q.FRAME_X),
    (Z.FRAME_Y, Q.FRAME_Y),
    (Z.TILT, Q.SLIDER),
    (Z.MODE, Q.MODE),
)


def free(plant: Plant) -> list[int]:
    """The coordinates that a plant has."""
    p = plant.parameters()
    found = [Z.CRANK]
    for has, coordinates in (
        (p[P.LOOSE_B], (Z.GAP_B_X, Z.GAP_B_Y)),
        (p[P.LOOSE_C], (Z.GAP_C_X, Z.GAP_C_Y)),
        (p[P.FRAME_MASS], (Z.FRAME_X, Z.FRAME_Y)),
        (p[P.LOOSE_GUIDE], (Z.HEIGHT, Z.TILT)),
        (p[P.MODE_SHARE], (Z.MODE,)),
    ):
        found += coordinates if has != 0.0 else ()
    return [int(z) for z in found]


def chart(plant: Plant, state: FloatArray) -> FloatArray:
    """(SIZE,) coordinates of a plant's state (STATE,)."""
    p, z, n = plant.parameters(), np.zeros(SIZE), len(Z)
    for ours, theirs in _PAIRS:
        z[ours], z[n + ours] = state[theirs], state[COORDINATES + theirs]
    crank_tip = _tip(state, Q.CRANK_X, Q.CRANK, p[P.CRANK_TO_B])
    rod_b = _tip(state, Q.ROD_X, Q.ROD, p[P.ROD_TO_B])
    rod_c = _tip(state, Q.ROD_X, Q.ROD, p[P.ROD_TO_C])
    slider = _tip(state, Q.SLIDER_X, Q.SLIDER, 0.0)
    for ours, gap in ((Z.GAP_B_X, crank_tip - rod_b), (Z.GAP_C_X, rod_c - slider)):
        z[ours : ours + 2], z[n + ours : n + ours + 2] = gap
    z[Z.HEIGHT] = slider[0, 1] - state[Q.FRAME_Y] - p[P.OFFSET]
    z[n + Z.HEIGHT] = slider[1, 1] - state[COORDINATES + Q.FRAME_Y]
    z[-1] = state[STATE - 1]
    return z


def instant_of(plant: Plant, time: float, z: FloatArray, memory: FloatArray) -> Instant:
    """The plant's instant at coordinates (SIZE,); those that it does not have count as 0.

    Raises:
        FloatingPointError: if the plant's rod is too short for them.
    """
    p, n = plant.parameters(), len(Z)
    known = np.zeros(SIZE)
    for coordinate in free(plant):
        known[coordinate], known[n + coordinate] = z[coordinate], z[n + coordinate]
    state = np.zeros(STATE)
    for ours, theirs in _PAIRS:
        state[theirs], state[COORDINATES + theirs] = known[ours], known[n + ours]

    def pair(first: int) -> FloatArray:
        return np.array([known[first : first + 2], known[n + first : n + first + 2]])

    frame, gap_b, gap_c = pair(Z.FRAME_X), pair(Z.GAP_B_X), pair(Z.GAP_C_X)
    crank = _arm(known[Z.CRANK], known[n + Z.CRANK])
    rod_b = frame + (p[P.CRANK_TO_B] - p[P.CRANK_TO_A]) * crank - gap_b
    height = np.array([known[Z.HEIGHT] + p[P.OFFSET], known[n + Z.HEIGHT]]) + frame[:, 1]
    rise = height + gap_c[:, 1] - rod_b[:, 1]
    length = p[P.ROD_TO_C] - p[P.ROD_TO_B]
    if not abs(rise[0]) < length:
        raise FloatingPointError(f"a rod of {length:g} m cannot rise by {rise[0]:g} m")
    angle = asin(rise[0] / length)
    rod = _arm(angle, rise[1] / (length * cos(angle)))
    rod_c = rod_b + length * rod
    places = (
        (Q.CRANK_X, frame - p[P.CRANK_TO_A] * crank),
        (Q.ROD_X, rod_b - p[P.ROD_TO_B] * rod),
        (Q.SLIDER_X, np.stack([rod_c[:, 0] - gap_c[:, 0], height], axis=1)),
    )
    for first, place in places:
        state[first : first + 2], state[COORDINATES + first : COORDINATES + first + 2] = place
    state[Q.ROD], state[COORDINATES + Q.ROD] = angle, rise[1] / (length * cos(angle))
    state[STATE - 1] = z[-1]
    loose = np.array([p[P.LOOSE_B], p[P.LOOSE_C]])
    return Instant(time, state, memory * loose)


def _arm(angle: float, rate: float) -> FloatArray:
    """(2, 2) a unit arm at an angle [rad] and its velocity at a rate [rad/s]."""
    c, s = cos(angle), sin(angle)
    return np.array([[c, s], [-s * rate, c * rate]])


def _tip(state: FloatArray, first: int, angle: int, length: float) -> FloatArray:
    """(2, 2) place and velocity of a point along a body from its centre of mass."""
    centre = np.array([state[first : first + 2], state[COORDINATES + first : COORDINATES + first + 2]])
    tip: FloatArray = centre + length * _arm(state[angle], state[COORDINATES + angle])
    return tip
