"""What names leave, as one force of free form: a torque on the crank or a force on the slider, as a table.

The numbers that were named stay as they are: over the crank's angle a table can imitate gravity or a motor,
and would only make these unsure. So it says what acts beside them, and no more.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import log
from typing import Any

import numpy as np

from clearance.diagnosis.hypotheses.effect import Effect, FreeParameter
from clearance.diagnosis.hypotheses.free_form import FREE_FORM
from clearance.diagnosis.motion.attempt import Attempt, Remainder
from clearance.diagnosis.motion.fit import fit
from clearance.diagnosis.motion.model import Model, term_of
from clearance.diagnosis.motion.prediction import predict
from clearance.diagnosis.motion.search import Search
from clearance.diagnosis.motion.track import Track
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.mechanism.applied_force import NoForce, TabulatedForce, shares
from clearance.mechanism.slider_crank import SliderCrank

_FORMS = (
    ("crank", "torque", "crank_angle"),
    ("crank", "torque", "crank_speed"),
    ("slider", "x", "slider_position"),
    ("slider", "x", "slider_velocity"),
)
"""Body, direction and argument of each force that is tried."""
_KNOTS = (6, 12)  # of a table, coarse or fine
_TYPICAL = 0.1  # of the slider's inertia force: a plausible size
_LARGEST = 3.0  # times that, of a knot about which the motion says nothing, as at the ends of a stroke
_UNITS = {"crank_angle": "rad", "crank_speed": "rad/s", "slider_position": "m", "slider_velocity": "m/s"}
_ALONG = 4  # points from knot to knot at which a spline is given
_LEAST = 10.0  # decrease of the penalised cost for which a table is worth its knots


@dataclass(frozen=True)
class _Form:
    """A table before its values are known: body, direction, argument, and its knots."""

    body: str
    direction: str
    argument: str
    knots: np.ndarray

    @property
    def repeats(self) -> bool:
        return self.argument == "crank_angle"

    def effect(self, size: float) -> Effect:
        """The table as an effect whose parameters are its forces at the knots, of a plausible size."""
        spacing = None if self.repeats else float(self.knots[1] - self.knots[0])
        law = {
            "_target_": f"{TabulatedForce.__module__}.{TabulatedForce.__qualname__}", "body": self.body,
            "direction": self.direction, "argument": self.argument, "start": float(self.knots[0]),
            "spacing": spacing, "values": [0.0] * len(self.knots), "interpolation": "cubic",
        }  # fmt: skip
        unit = "N m" if self.direction == "torque" else "N"
        free = tuple(
            FreeParameter(f"force_at_{knot:.4g}", f"force.values.{k}", unit, (-1e5, 1e5), 0.0, size)
            for k, knot in enumerate(self.knots)
        )
        return Effect(
            FREE_FORM, "physics", self.body, self.direction, "", "between its knots", "{parameters}", free,
            {"force": law},
        )  # fmt: skip


def remainder(search: Search, best: Attempt, named: bool) -> Remainder | None:
    """The table that leaves least beside an attempt, whose numbers stay; ``None`` where none is worth it.

    Where its names do not explain, a table may stand in their place, beside faults of instruments alone: all
    numbers are fitted with it then.

    Args:
        search: which is over.
        best: of its attempts.
        named: whether its names explain.
    """
    machine, instrument = best.fit.model.apply(best.fit.shared)
    if not isinstance(machine.force, NoForce):
        return None
    given, joint, tracks = best.fit.model, search.model.joint, search.tracks
    fixed = Model(
        machine, joint, with_zero=given.with_zero, zero_deviation=given.zero_deviation, instrument=instrument,
        known_clearance=given.clearance(best.fit.shared),
    )  # fmt: skip
    none = fit(fixed, tracks, np.zeros(0), best.fit.own, search.begin, search.workers)
    names = best.price - best.fit.cost  # what they are charged
    faults = [term for term in best.terms if term.effect.kind == "instrument"]
    begun = np.concatenate(
        [best.fit.shared[: len(given.fixed_unknowns)], *(best.parameters(fault)[0] for fault in faults)]
    )
    found: list[Remainder] = []
    reached = _reached(fixed, none.own, tracks)
    for form in _forms(reached):
        size = _size(machine, reached["crank_speed"], form)
        term = term_of(form.effect(size), machine, joint)
        if term is None or search.late():
            continue
        held = tuple(replace(unknown, prior=(0.0, _LARGEST * size)) for unknown in term.unknowns)
        term = replace(term, unknowns=held)
        shown = f"{form.direction} on the {form.body} by {form.argument} ({len(form.knots)} knots)"
        search.report(f"asking whether {shown} gives what is left")
        zeros = np.zeros(len(term.unknowns))
        own = fit(replace(fixed, terms=(term,)), tracks, zeros, none.own, search.begin, search.workers)
        price = own.cost + names + len(zeros) * log(own.samples)
        if named or best.terms:
            found.append(Remainder(Attempt((term,), own, price), beside=bool(best.terms)))
        if not named:
            alone = search.attempt((*faults, term), np.append(begun, zeros), none.own)
            found.append(Remainder(alone, beside=False))
    left = min(found, key=lambda one: one.attempt.price, default=None)
    return left if left is not None and left.attempt.price < none.cost + names - _LEAST else None


def described(left: Remainder) -> dict[str, Any]:
    """A table as the contract writes it, with its 95 % band; of a torque its mean is the drive's."""
    law, found = table_of(left), left.attempt.fit
    count = len(law.values)
    step = law.repeats_after / count if law.repeats else float(law.spacing or 0.0)
    steps = np.arange(count * _ALONG if law.repeats else (count - 1) * _ALONG + 1) / _ALONG
    own = shares(steps, count, law.repeats, law.interpolation)
    if law.direction == "torque":
        own = own - 1.0 / count
    forces = own @ np.array(law.values)
    last = slice(len(found.shared) - count, len(found.shared))
    band = 1.96 * np.sqrt(np.einsum("ki,ij,kj->k", own, found.covariance[last, last], own))
    return {
        "body": law.body, "direction": law.direction, "argument": law.argument,
        "unit": "N m" if law.direction == "torque" else "N", "argument_unit": _UNITS[law.argument],
        "period": None, "clocks": None,
        "table": [[law.start + step * k, float(force)] for k, force in zip(steps, forces, strict=True)],
        "low": (forces - band).tolist(), "high": (forces + band).tolist(),
    }  # fmt: skip


def table_of(left: Remainder) -> TabulatedForce:
    """The law of a table that was found."""
    force = left.attempt.fit.model.apply(left.attempt.fit.shared)[0].force
    assert isinstance(force, TabulatedForce)
    return force


def _reached(model: Model, own: np.ndarray, tracks: Sequence[Track]) -> dict[str, np.ndarray]:
    """What the machine runs through: speed of the crank, place and velocity of the slider."""
    names, found = ("crank_speed", "slider_position", "slider_velocity"), []
    for track, begin in zip(tracks, own, strict=True):
        guess = model.guess(np.zeros(0), begin)
        assert guess is not None
        bare = Track(track.name, np.zeros((len(track.values), len(names))), names, track.rate)
        found.append(predict(bare, [replace(guess, instrument=Instrument(), clearance=0.0)])[0])
    return dict(zip(names, np.concatenate(found).T, strict=True))


def _forms(reached: dict[str, np.ndarray]) -> list[_Form]:
    """All tables, with knots over what the machine runs through."""
    found = []
    for (body, direction, argument), count in product(_FORMS, _KNOTS):
        if argument == "crank_angle":
            knots = 2.0 * np.pi * np.arange(count) / count
        else:
            low, high = float(reached[argument].min()), float(reached[argument].max())
            knots = np.linspace(low, max(high, low + 1e-9), count)
        found.append(_Form(body, direction, argument, knots))
    return found


def _size(machine: SliderCrank, speeds: np.ndarray, form: _Form) -> float:
    """A plausible force [N] or torque [N m]: a share of what moves the slider at these speeds [rad/s]."""
    force = machine.slider.mass * machine.crank.length * float((speeds**2).mean())
    return _TYPICAL * force * (machine.crank.length if form.direction == "torque" else 1.0)
