"""A force over time that goes between two levels and repeats: five numbers instead of a table of knots."""

from dataclasses import replace

import numpy as np

from clearance.diagnosis.hypotheses.free_form import FREE_FORM, Curve
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.shooting.model import Unknown
from clearance.mechanism.applied_force import TabulatedForce
from clearance.mechanism.parameters import TABLE_KNOTS
from clearance.mechanism.slider_crank import SliderCrank

_WIDE = 3  # knots at a level: the slopes of a shorter one reach into each other
_LEVEL, _SLOPES = 0.15, 0.35  # of a jump, by which a knot is off its level; share of knots that may be
_FLANK = 0.5 - 0.5 * np.cos(np.pi * np.arange(9) / 8)  # of a jump: nothing is switched without a bend
_LASTING = (1e-3, 0.1)  # of a period, that a jump takes
_STEP, _REACH = 1e-4, 0.3  # of the difference of the levels, or of the time between two knots


def levels_of(curve: Curve) -> np.ndarray | None:
    """What a curve that repeats shows of a high and a low level, and of when the force rises and falls.

    Between knots that are far apart a jump is a slope with the same impulse, which tells where it is.

    Returns:
        (5,) two forces [N or N m], two places in the period and how much of it a jump takes, which between
        knots nobody knows [turns, 0 to 1]; ``None`` where the knots are at no two levels, or there are more
        jumps.
    """
    count, spacing = len(curve.knots), float(curve.knots[1] - curve.knots[0])
    # jumps and slopes outlast a median; a knot of which little is known, and may lie anywhere, does not
    forces = np.median([np.roll(curve.forces, k) for k in (-1, 0, 1)], axis=0)
    above = forces > 0.5 * (forces.min() + forces.max())
    crossed = np.flatnonzero(above != np.roll(above, -1))
    if not curve.repeats or len(crossed) != 2 or min(above.sum(), count - above.sum()) < _WIDE:
        return None
    low, high = float(np.median(forces[~above])), float(np.median(forces[above]))
    level = np.where(above, high, low)
    if np.mean(np.abs(forces - level) > _LEVEL * (high - low)) > _SLOPES:
        return None
    forces = np.where(np.abs(curve.forces - forces) < 0.5 * (high - low), curve.forces, forces)
    edges = []
    for i in crossed:
        around = forces[np.arange(i - 1, i + 3) % count]
        impulse, after = around.sum() - 0.5 * (around[0] + around[-1]), level[(i + 1) % count]
        edges.append(i - 1 + (3.0 * after - impulse) / (after - level[i]))
    places = (np.array(edges) + float(curve.knots[0]) / spacing) / count
    rises = int(np.argmax(level[(crossed + 1) % count]))
    return np.array([high, low, *(places[[rises, 1 - rises]] % 1.0), 1.0 / TABLE_KNOTS])


def two_levels(curve: Curve, values: np.ndarray) -> Hypothesis:
    """A force with the body, direction and period of a curve that jumps between two levels, as a hypothesis.

    Args:
        curve: over time, that repeats.
        values: (5,) to begin with, as of ``levels_of``.
    """
    size = float(abs(values[0] - values[1]))

    def apply(machine: SliderCrank, values: np.ndarray) -> SliderCrank:
        return replace(machine, force=_jumping(curve, values))

    levels = [
        Unknown(name, _STEP * size, -1e5, 1e5, reach=_REACH * size) for name in ("high_level", "low_level")
    ]
    places = [
        Unknown(name, _STEP / TABLE_KNOTS, -0.5, 1.5, reach=_REACH / TABLE_KNOTS)
        for name in ("rises", "falls")
    ]
    lasts = Unknown("lasts", _STEP / TABLE_KNOTS, *_LASTING, reach=_REACH / TABLE_KNOTS)
    return Hypothesis(
        FREE_FORM, "physics", curve.body, curve.direction, (*levels, *places, lasts), np.zeros(5),
        values.copy(), apply,
    )  # fmt: skip


def _jumping(curve: Curve, values: np.ndarray) -> TabulatedForce:
    high, low, rises, falls, lasts = map(float, values)
    assert curve.period is not None
    period = float(curve.period)
    jump = lasts * period
    high_for = float(np.clip((falls - rises) % 1.0 * period, jump, period - jump))
    forces = tuple(map(float, low + (high - low) * _FLANK))
    return TabulatedForce(
        curve.body, curve.direction, curve.argument, rises * period - 0.5 * jump, jump / (len(_FLANK) - 1),
        forces, "linear", period, high_for + jump,
    )  # fmt: skip
