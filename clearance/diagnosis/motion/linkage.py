"""The linkage alone: where the slider stands at each measured angle of the crank, whatever the forces are.

What an encoder and a position sensor say of one another needs no law of force and no run of the simulator, so
that the encoder's zero, the senses in which both count, and a sensor's offset, size and delay are found
wherever they are, and before anything else.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from math import log

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from clearance.diagnosis.motion.model import Term
from clearance.diagnosis.motion.track import Track
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank

_FIRST, _SECOND, _TORQUE = "crank_angle", "slider_position", "drive_torque"
_LABELS = (
    f"sensor_bias({_SECOND})",
    f"sensor_gain({_SECOND})",
    f"sensor_delay({_SECOND})",
    "slider_offset(offset)",
)
_ZEROS = 72  # of an encoder, from which the best begins
_SAMPLES = 2000  # of a recording that are looked at
_TURNED = 0.5  # of what is left in the declared senses, root mean square: less in others, and these hold
_DOUBT = 3.0  # times the deviation of independent samples, which these are not
_RIDGE = 1e-12
_SUREST = 1e-4  # rad, of an encoder's zero: without noise a deviation is none
_MATERIAL = 0.9  # of what is left without a term: with one that is worth it no more than that is


@dataclass(frozen=True)
class Linkage:
    """What angle and position say of one another.

    Attributes:
        terms: that are missing by it, with what is known of their numbers as priors.
        values: of each, on the scale of the fit.
        zeros: of the encoder [rad], by recording.
        deviation: of these [rad].
        turned: channels whose sense is the other one.
    """

    terms: tuple[Term, ...] = ()
    values: tuple[np.ndarray, ...] = ()
    zeros: Mapping[str, float] = field(default_factory=dict)
    deviation: float = 10.0
    turned: tuple[str, ...] = ()

    def zero(self, name: str) -> float:
        """Of the encoder in a recording [rad]; of one that was not looked at, that of the first."""
        return self.zeros.get(name, next(iter(self.zeros.values()), 0.0))

    def oriented(self, track: Track) -> Track:
        """A recording with channels in the senses of the model."""
        sign = np.array([-1.0 if channel in self.turned else 1.0 for channel in track.channels])
        return replace(track, values=track.values * sign)


def link(tracks: Sequence[Track], machine: SliderCrank, terms: Mapping[str, Term], joint: str) -> Linkage:
    """Compare the slider's position with that of the linkage at the measured angle.

    Args:
        tracks: recordings; without both channels in each nothing is said.
        machine: nominal, joints ideal.
        terms: that may be missing, by label.
        joint: B or C.
    """
    if not all({_FIRST, _SECOND} <= set(track.channels) for track in tracks):
        return Linkage()
    pairs = [_Pair.of(track) for track in tracks]
    senses = {
        senses: [pair.zero(machine, *senses) for pair in pairs] for senses in product((1.0, -1.0), repeat=2)
    }
    left = {one: sum(rest for _, rest in found) for one, found in senses.items()}
    best = min(left, key=lambda one: left[one])
    if not left[best] < _TURNED**2 * left[1.0, 1.0]:
        best = (1.0, 1.0)
    pairs = [pair.turned(*best) for pair in pairs]
    zeros = np.array([zero for zero, _ in senses[best]])
    turned = [
        channel
        for sign, channels in zip(
            best, (("crank_angle", "crank_speed"), ("slider_position", "slider_velocity")), strict=True
        )
        for channel in channels
        if sign < 0.0
    ]
    if best[0] < 0.0 and all(map(_drives, tracks)):  # a torque that drives as it was recorded goes on to
        turned.append(_TORQUE)
    known = [terms[label] for label in _LABELS if label in terms]
    some, (own, *values), (wide, *deviations) = _chosen(pairs, machine, joint, known, zeros)
    named = {track.name: float(zero) for track, zero in zip(tracks, own, strict=True)}
    sure = [_sure(*one) for one in zip(some, values, deviations, strict=True)]
    return Linkage(tuple(sure), tuple(values), named, max(float(wide.max()), _SUREST), tuple(turned))


def _drives(track: Track) -> bool:
    """Whether the recorded torque turns the crank the way that it was recorded to turn."""
    if _TORQUE not in track.channels:
        return False
    angle, torque = (track.values[:, track.channels.index(channel)] for channel in (_FIRST, _TORQUE))
    return bool(torque.mean() * (angle[-1] - angle[0]) > 0.0)


def _sure(term: Term, values: np.ndarray, deviations: np.ndarray) -> Term:
    """A term that stays where the linkage has it, as far as that is sure, but no surer than its step."""
    known = [
        replace(u, prior=(float(v), max(float(d), u.step)))
        for u, v, d in zip(term.unknowns, values, deviations, strict=True)
    ]
    return replace(term, unknowns=tuple(known))


@dataclass(frozen=True)
class _Pair:
    """Angle [rad] over time [s] and position [m] of one recording."""

    time: np.ndarray
    angle: CubicSpline
    position: np.ndarray

    @staticmethod
    def of(track: Track) -> "_Pair":
        part, every = track.judged, max(1, len(track.values) // _SAMPLES)
        time = np.arange(len(track.values)) / track.rate
        angle, position = (track.values[:, track.channels.index(c)] for c in (_FIRST, _SECOND))
        return _Pair(time[part][::every], CubicSpline(time, angle), position[part][::every])

    def turned(self, angle: float, position: float) -> "_Pair":
        spline = CubicSpline(self.angle.x, angle * self.angle(self.angle.x))
        return _Pair(self.time, spline, position * self.position)

    def zero(self, machine: SliderCrank, turning: float, moving: float) -> tuple[float, float]:
        """The encoder's zero [rad] with which an offset and a size above 0 explain most, and the rest."""
        angle, position = turning * self.angle(self.time), moving * (self.position - self.position.mean())
        found = []
        for zero in np.linspace(-np.pi, np.pi, _ZEROS, endpoint=False):
            stands = slider(machine, angle - zero)
            stands = stands - stands.mean()
            size = max(float(stands @ position) / float(stands @ stands), 0.0)
            found.append((float(((position - size * stands) ** 2).sum()), float(zero)))
        rest, zero = min(found)
        return zero, rest


def slider(machine: SliderCrank, angle: np.ndarray) -> np.ndarray:
    """Where the slider of ideal joints stands [m] at angles of the crank [rad]; NaN where it cannot."""
    across = machine.guide_offset - machine.crank.length * np.sin(angle)
    with np.errstate(invalid="ignore"):
        return np.asarray(machine.crank.length * np.cos(angle) + np.sqrt(machine.rod.length**2 - across**2))


def _chosen(
    pairs: Sequence[_Pair], machine: SliderCrank, joint: str, known: Sequence[Term], zeros: np.ndarray
) -> tuple[list[Term], list[np.ndarray], list[np.ndarray]]:
    """The terms that pay for their numbers (Schwarz 1978), but for those without which little more is left.

    Returns:
        They; the encoder's zeros followed by the values of each; standard deviations of all these.
    """
    sets = [some for count in range(len(known) + 1) for some in combinations(range(len(known)), count)]
    found = {some: _fitted(pairs, machine, joint, [known[i] for i in some], zeros) for some in sets}
    samples = sum(len(pair.time) for pair in pairs)
    best = min(sets, key=lambda some: samples * log(max(found[some][0], 1e-300)) + len(some) * log(samples))
    for fewer in sets:  # few terms come first
        if set(fewer) < set(best) and found[best][0] > _MATERIAL * found[fewer][0]:
            best = fewer
            break
    terms, (_, values, deviations) = [known[i] for i in best], found[best]
    ends = np.cumsum([len(zeros), *(len(term.unknowns) for term in terms)])[:-1]
    return terms, np.split(values, ends), np.split(deviations, ends)


def _fitted(
    pairs: Sequence[_Pair], machine: SliderCrank, joint: str, some: Sequence[Term], zeros: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Sum of squares that some terms leave [m²], the zeros and values that leave it, and their deviations."""
    start, low, high = list(zeros), [-np.inf] * len(zeros), [np.inf] * len(zeros)
    for term in some:
        for unknown, off in zip(term.unknowns, term.off, strict=True):
            start.append(float(off))
            low.append(unknown.inner(unknown.low))
            high.append(unknown.inner(unknown.high))
    samples = sum(len(pair.time) for pair in pairs)
    place = len(zeros)
    for term in some:
        if term.name == "sensor_bias":  # which the position's mean tells
            start[place] = float(
                np.mean(
                    [
                        p.position.mean() - slider(machine, p.angle(p.time) - z).mean()
                        for p, z in zip(pairs, zeros, strict=True)
                    ]
                )
            )
        place += len(term.unknowns)

    def rest(values: np.ndarray) -> np.ndarray:
        changed, at = machine, len(pairs)
        said = {"bias": 0.0, "gain": 1.0, "delay": 0.0}
        for term in some:
            named = term.values(values[at : at + len(term.unknowns)])
            try:
                changed = term.effect.machine(changed, joint, named)
            except InputError:  # which cannot turn
                return np.ones(samples)
            said |= {name: value for name, value in named.items() if term.effect.kind == "instrument"}
            at += len(term.unknowns)
        found = [
            pair.position
            - (said["gain"] * slider(changed, pair.angle(pair.time - said["delay"]) - zero) + said["bias"])
            for pair, zero in zip(pairs, values, strict=False)
        ]
        return np.nan_to_num(np.concatenate(found), nan=1.0)

    begun = np.clip(start, np.array(low) + 1e-12, np.array(high) - 1e-12)
    done = least_squares(rest, begun, bounds=(low, high), x_scale="jac", method="trf", max_nfev=50)
    information = done.jac.T @ done.jac
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    # what two numbers share alone is left wide
    inverse = np.linalg.inv(information / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)))
    variance = 2.0 * done.cost / max(samples - len(scale), 1)
    return float(2.0 * done.cost), done.x, _DOUBT * np.sqrt(variance * np.diag(inverse)) / scale
