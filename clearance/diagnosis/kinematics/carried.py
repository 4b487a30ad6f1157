"""How a slider moves across its guide, seen from the rod that carries it through a loose joint C.

No sensor on the slider feels its height, and the rod's end moves against it. While the joint carries load the
journal lies on the bearing where the force points, though, and the rod's own accelerations tell that force.
So the rod's end is aside by the clearance times the force's direction, and what it feels less the bend of
that is what the slider does. Where the slider touches no rail the same force moves it, whatever happened
before: with the right clearance both ways agree.

Reference: inverse dynamics of a rigid rod; medians against the strikes at the rails, Huber 1981, sec. 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from clearance.diagnosis.kinematics.lift import Across
from clearance.mechanism.parameters import Parameter
from clearance.simulation.layout import Signal

NEEDED = (Signal.ROD_B_TRANSVERSE, Signal.ROD_C_TRANSVERSE, Signal.ROD_C_AXIAL)
"""Channels without which nothing is told."""
_WIDTHS = (1.0, 1.5, 2.5, 4.0)  # samples: standard deviations of the smoothing that are compared
_PLAINLY = 1.07  # times what the best width leaves: a narrower one, which blurs less, may leave that
_LOADED = 0.25  # of the typical force: below, the journal may be anywhere
_APART = 0.02  # of a smoothed sample that may come from there
_LEAST = 0.1  # of the samples with a load: fewer tell nothing
_CLEARANCES = np.geomspace(1e-5, 1.3e-3, 120)  # m, that are compared


@dataclass(frozen=True)
class Carried:
    """The rod's end and what it does to the slider.

    Attributes:
        acceleration: (samples,) of the rod's end across the guide, as felt [m/s^2].
        force: (samples, 2) of the rod on the slider [N].
        doubt: standard deviation of the acceleration's noise [m/s^2].
        mass: of the slider [kg].
        gravity: (samples,) across the guide [m/s^2].
        period: of the samples [s].
    """

    acceleration: np.ndarray
    force: np.ndarray
    doubt: float
    mass: float
    gravity: np.ndarray
    period: float

    @staticmethod
    def of(
        p: np.ndarray,
        signals: Sequence[int],
        values: np.ndarray,
        sigma: np.ndarray,
        rod_angle: np.ndarray,
        along: np.ndarray,
        gravity: np.ndarray,
        period: float,
    ) -> "Carried":
        """From the rod's sensors, and the slider's along its guide if there is one.

        Args:
            p: (PARAMETERS,) of the machine.
            signals: of the channels, ``NEEDED`` among them.
            values: (samples, channels) felt [m/s^2].
            sigma: (channels,) standard deviation of their noise [m/s^2].
            rod_angle: (samples,) [rad].
            along: (samples,) force on the slider along its guide, beside the joint's [N].
            gravity: (samples,) across the guide [m/s^2].
            period: of the samples [s].
        """
        sine, cosine = np.sin(rod_angle), np.cos(rod_angle)
        at = list(signals).index
        near, far, axial = (values[:, at(signal)] for signal in NEEDED)
        place, end = p[Parameter.SENSOR_ROD_B], p[Parameter.SENSOR_ROD_C]
        to_center, length = p[Parameter.ROD_TO_B], p[Parameter.ROD_TO_B] + p[Parameter.ROD_TO_C]
        turn = (far - near) / (end - place)
        center = near + (to_center - place) * turn
        across = turn / p[Parameter.ROD_INVERSE_INERTIA] + p[Parameter.ROD_MASS] * to_center * center
        across /= length  # on the rod at C, in its own axes
        slides = Signal.SLIDER_HORIZONTAL in signals
        sliding = values[:, at(Signal.SLIDER_HORIZONTAL)] if slides else cosine * axial - sine * far
        mass = float(p[Parameter.SLIDER_MASS])
        x = along - mass * sliding
        y = (x + across * sine) / cosine * sine + across * cosine
        doubt = np.hypot(sigma[at(Signal.ROD_C_TRANSVERSE)], sigma[at(Signal.ROD_C_AXIAL)] * sine.std())
        force = np.stack([-x, -y], axis=1)
        return Carried(cosine * far + sine * axial, force, float(doubt), mass, gravity, period)

    def across(self, clearance: float) -> Across:
        """What is seen of the slider with a clearance of the joint [m].

        What smooths least is taken of that with which slider and force agree about as well as with any.
        """
        tried = [_Smoothed.of(self, width) for width in _WIDTHS]
        left = np.array([one.left(np.array([clearance]))[0] for one in tried])
        one = tried[int(np.argmax(left < _PLAINLY * left.min()))]
        bend = clearance * one.bend
        aside = clearance * np.stack([one.direction, one.turning, one.bend])
        aside[2] = self.acceleration - np.where(one.told, one.end - bend, one.pushed / self.mass)
        push = np.where(one.told, self.mass * (one.end - bend) - one.pushed, 0.0)
        return Across(self.acceleration + self.gravity, push, self.doubt, aside, one.told)


@dataclass(frozen=True)
class _Smoothed:
    """Both ways to tell the slider's acceleration, smoothed alike.

    Attributes:
        end: (samples,) acceleration of the rod's end [m/s^2].
        pushed: (samples,) force of the rod on the slider, across the guide [N].
        free: (samples,) acceleration that this gives the slider [m/s^2].
        direction: (samples,) share of the force that acts across the guide.
        turning: (samples,) its rate [1/s].
        bend: (samples,) the rate of that [1/s^2].
        told: (samples,) whether the joint carries load.
    """

    end: np.ndarray
    pushed: np.ndarray
    free: np.ndarray
    direction: np.ndarray
    turning: np.ndarray
    bend: np.ndarray
    told: np.ndarray

    @staticmethod
    def of(carried: Carried, width: float) -> "_Smoothed":
        size = np.hypot(*carried.force.T)
        direction = carried.force[:, 1] / np.maximum(size, 1e-9)
        light = gaussian_filter1d((size < _LOADED * np.median(size)).astype(float), width)
        pushed = gaussian_filter1d(carried.force[:, 1], width)
        return _Smoothed(
            gaussian_filter1d(carried.acceleration, width), pushed, pushed / carried.mass, direction,
            gaussian_filter1d(direction, width, order=1) / carried.period,
            gaussian_filter1d(direction, width, order=2) / carried.period**2, light < _APART,
        )  # fmt: skip

    def left(self, clearances: np.ndarray) -> np.ndarray:
        """(clearances,) typical disagreement over that without a clearance, infinite if little is told."""
        apart, bend = (self.end - self.free)[self.told], self.bend[self.told]
        typical = np.median(np.abs(apart)) if self.told.mean() > _LEAST else 0.0
        if typical == 0.0:
            return np.full(len(clearances), np.inf)
        return np.array([np.median(np.abs(apart - one * bend)) for one in clearances]) / typical


def tell_clearance(motions: Sequence[Carried]) -> tuple[float, float]:
    """The clearance of joint C [m] with which slider and force agree best; the disagreement that is left.

    The latter is over that without a clearance.

    Args:
        motions: of one machine.
    """
    costs = np.array([
        np.mean([_Smoothed.of(one, width).left(_CLEARANCES) for one in motions], axis=0) for width in _WIDTHS
    ])  # fmt: skip
    least = costs.min(axis=1)
    best = costs[int(np.argmax(least < _PLAINLY * least.min()))]
    return float(_CLEARANCES[int(np.argmin(best))]), float(best.min())
