"""A force without a name as the contract writes it: its table, and how sure it is."""

from typing import Any

import numpy as np

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.hypotheses.free_form import DAMPING, along, curve_of, unnamed
from clearance.diagnosis.hypotheses.hypothesis import Setting
from clearance.diagnosis.kinematics.shaking import Shaking
from clearance.diagnosis.shooting.covariance import deviations
from clearance.mechanism.applied_force import TabulatedForce

_UNITS = {
    "crank_angle": "rad",
    "rod_angle": "rad",
    "slider_position": "m",
    "slider_velocity": "m/s",
    "time": "s",
    "closeness": "-",
}
_ALONG = 4  # points from knot to knot at which a spline is given
_UNHELD = 10.0  # times the largest force of a table: what is less sure than that is not known at all
_FINE = 2000  # places in a period that tell the mean of what is on and off


def direction_of(direction: str) -> str:
    """Direction in the contract's words: what fills a gap holds the journal off the bearing."""
    return "normal" if direction == DAMPING else direction


def argument_of(law: TabulatedForce) -> str:
    """What a table is a function of, as the contract has it: of whose contact, its joint says."""
    if law.straight:
        return "contact_force"
    return "closeness" if law.argument.startswith("closeness") else law.argument


def _points(law: TabulatedForce) -> np.ndarray:
    """(points,) arguments of a table: whoever reads it joins its points by lines."""
    count = len(law.values)
    finer = _ALONG if law.interpolation == "cubic" else 1
    there = np.arange((count - 1) * finer + 1) / finer
    if law.returns is not None and law.spacing is not None:
        # beside each corner, too: there only the level is unsure, and not when it is left
        flank = law.spacing * there[-1]
        there = np.append(law.spacing * there, 2.0 * flank)
        off = np.array([law.returns + flank, law.repeats_after - flank, law.repeats_after])
        places = np.concatenate([there, law.returns - there[::-1], off])
        return law.start + np.unique(np.clip(places, 0.0, law.repeats_after))
    if law.repeats:
        return law.start + law.repeats_after / count * np.arange(count * finer) / finer
    return law.start + float(law.spacing or 0.0) * there


def _mean(law: TabulatedForce) -> np.ndarray:
    """(values,) share of each value of a table in its mean."""
    if law.returns is None:
        return np.full(len(law.values), 1.0 / len(law.values))
    places = law.start + law.repeats_after * np.arange(_FINE) / _FINE
    found: np.ndarray = curve_of(law).shares(places).mean(axis=0)
    return found


def free_form_of(attempt: Attempt, setting: Setting, shaken: Shaking | None = None) -> dict[str, Any] | None:
    """The table of an attempt's force of free form as the contract writes it, with its 95 % band.

    Where the recordings do not come nothing holds the table: there is no band, and its values say nothing.
    Of a torque only what varies is given: a constant one cannot be told from what the drive is asked for. Of
    a force over time ``clocks`` says what its clock shows where each recording begins [s].

    Args:
        attempt: to write down.
        setting: the nominal machine.
        shaken: whose deviation is that of a force which was measured, so that nothing of it was fitted.
    """
    hypothesis = unnamed(attempt.hypotheses)
    if hypothesis is None:
        return None
    place = 1 + sum(len(h.unknowns) for h in attempt.hypotheses[: attempt.hypotheses.index(hypothesis)])
    values = attempt.fit.values[0, place : place + len(hypothesis.unknowns)]
    law = hypothesis.apply(setting.machine, values).force
    assert isinstance(law, TabulatedForce)
    arguments = _points(law)
    own = curve_of(law).shares(arguments)
    if hypothesis.direction == "torque":
        own = own - _mean(law)
    if hypothesis.unknowns:
        combined = np.zeros((len(own), attempt.model.shared))
        for i, unknown in enumerate(hypothesis.unknowns):
            moved = values + unknown.reach * (np.arange(len(values)) == i)
            other = hypothesis.apply(setting.machine, moved).force
            assert isinstance(other, TabulatedForce)
            change = along(curve_of(other), arguments) - along(curve_of(law), arguments)
            if hypothesis.direction == "torque":
                change -= _mean(other) @ other.values - _mean(law) @ law.values
            combined[:, place + i] = change / unknown.reach
        band, least = 1.96 * deviations(attempt.fit, combined), hypothesis.unknowns[0].low
    else:
        band, least = np.full(len(own), 1.96 * (np.inf if shaken is None else shaken.deviation)), -np.inf
    forces = own @ np.array(law.values)
    held = band < _UNHELD * np.abs(forces).max()
    low = np.where(held, np.maximum(forces - band, least), np.nan)
    high = np.where(held, forces + band, np.nan)
    return {
        "body": law.body, "direction": direction_of(law.direction), "argument": argument_of(law),
        "unit": {"torque": "N m", "moment": "N m", DAMPING: "N s/m"}.get(law.direction, "N"),
        "argument_unit": _UNITS.get(argument_of(law), "N"), "period": law.period,
        "clocks": [f.measured.clock for f in attempt.followers] if law.argument == "time" else None,
        "table": [[float(one), float(force)] for one, force in zip(arguments, forces, strict=True)],
        "low": [None if np.isnan(one) else float(one) for one in low],
        "high": [None if np.isnan(one) else float(one) for one in high],
    }  # fmt: skip
