"""Explain by a force of free form what no named effect does: on which body, as a function of what.

Beside the nominal path the unknown forces suggest curves. Each is fitted for a few steps to one recording's
path; with those that leave clearly less, that recording is followed from its sure place on. A curve that is
right follows as a named effect would. What it is a function of, all recordings together tell; its table is
then fitted to them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, LOOSENESS, Attempt, explained
from clearance.diagnosis.following.growth import grow, surest_of
from clearance.diagnosis.hypotheses.free_form import (
    Curve,
    along,
    free_form,
    unnamed,
)
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.hypotheses.missing_force import (
    PLACES,
    arguments_along,
    as_function_of,
    effect_as_curves,
)
from clearance.diagnosis.searching.balance import suggest_names
from clearance.diagnosis.searching.beside import NEARLY, beside
from clearance.diagnosis.searching.elsewhere import rhythm_of, seek_anew
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.screening import shapes
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.tables import refine_table
from clearance.diagnosis.searching.widen import look
from clearance.diagnosis.shooting.fit import fit
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.settle import Settled, settle
from clearance.errors import InputError

_SMOOTH = 4  # scales of the noise at which paths are smoothed
_FIRST = 2  # arguments of each direction that are tried first
_STEPS = 6  # of a trial beside the base's path
_LESS = 0.8  # of what the base leaves at that scale: a curve that leaves more is not followed with
_FOLLOWED = 3  # of the curves tried at a time, with which a recording is followed
_FITTED = 2  # arguments whose tables are fitted to all recordings
_SAID = 0.2  # of a force's robust square that may be left where it is a function of another argument
_NAMED = 3  # named effects that are tried in the place of a table
_LIKE = 2  # of those that would turn the crank as a table does
_AS_GOOD = 1.1  # times the misfit of a named effect: a table that leaves no more may be too coarse alone
_NO_WORSE = 1.5  # likewise: one that leaves no more may be right on a path of its own
_PART = 0.3  # of the base's misfit: a direction that leaves less is not doubted any more


@dataclass(frozen=True)
class Suggestion:
    """A curve with which one recording was followed better than without.

    Attributes:
        curve: with the forces found.
        follower: of that recording, with its path.
        values: (unknowns,) of the model with its table.
        misfit: with it.
    """

    curve: Curve
    follower: Follower
    values: np.ndarray
    misfit: float


def suggest_curve(search: Search, base: Attempt) -> tuple[list[Curve], float]:
    """Curves that promise to explain the recordings, and what is left of one recording with the best.

    Args:
        search: with its traces and starts.
        base: beside whose path curves are looked for.

    Returns:
        Curves in one direction, as functions of what, likeliest first; misfit of the surest recording.
    """
    free = _smoothed(search, base)
    search.report(f"with unknown forces: misfit {free.misfit:.3g}")
    found = shapes(free, search.setting.joint, search.traces[0].path.force, search.workers)
    each: dict[tuple[str, str], list[Curve]] = {}
    for curve in found:
        each.setdefault((curve.body, curve.direction), []).append(curve)
    trials = _Trials(search, base)
    inside = [
        curve for curve in found if curve.body.startswith("joint") and curve.argument == "contact_force"
    ]
    first = [curve for curves in each.values() for curve in curves[:_FIRST] if curve not in inside]
    trials.add([*inside, *first])
    if trials.best is not None and trials.best.misfit > NEARLY:  # the place may be right, the argument not
        place = trials.best.curve.body, trials.best.curve.direction
        trials.add([curve for curve in each[place][_FIRST:] if curve not in inside])
    best = trials.best
    if best is None:
        return [], base.misfits[trials.surest]
    # one recording at one speed cannot tell a function of the angle from one of the velocity; all may
    model = search.setting.model([free_form(best.curve, search.setting.joint)])
    path = settle([best.follower], model, best.values[None], 0).passes[0]
    arguments = arguments_along(
        path, model.machine(best.values), search.setting.joint, best.follower.measured
    )
    force = along(best.curve, arguments[best.curve.argument])
    ranked = []
    for other in each[best.curve.body, best.curve.direction]:
        said, left = as_function_of(force, arguments[other.argument], other)
        followed = trials.followed.get((other.body, other.direction, other.argument))
        if followed is not None:
            said, left = followed.curve, 0.0
        if left < _SAID:
            try:
                level, forces = trials.beside_all(said)
            except (InputError, np.linalg.LinAlgError):
                continue
            search.report(f"  as a function of {other.argument}: {level * ANNEALING[3] ** 2:.3g}")
            far = followed is None or followed.misfit > NEARLY  # on torn paths others seem to leave less
            ranked.append((far, level, replace(other, forces=forces)))
    return [curve for *_, curve in sorted(ranked, key=lambda one: one[:2])], best.misfit


def fit_curve(search: Search, explanation: Explanation, curves: Sequence[Curve]) -> None:
    """Fit the tables of the first suggested curves to all recordings, until one explains them.

    None is made finer before all were tried: many knots over the angle say what few say over the place.
    """
    coarse: list[tuple[Attempt, Curve]] = []
    for curve in curves[:_FITTED]:
        if search.late():
            return
        hypothesis = free_form(curve, search.setting.joint)
        first = explanation.nominal.fit.values[0, 0]
        values = np.array([[first, *curve.forces, trace.speed] for trace in search.traces])
        found = search.keep(
            explanation, [hypothesis], lambda h=hypothesis, v=values: search.grown([h], v)  # type: ignore[misc]
        )  # fmt: skip
        if explained(explanation.best):
            return
        if found is not None:
            coarse.append((found, curve))
    for found, curve in sorted(coarse, key=lambda one: one[0].misfit):
        refine_table(search, explanation, curve, found)
        if explained(explanation.best):
            return


def reshape(search: Search, explanation: Explanation, best: Attempt) -> list[Attempt]:
    """Let a force of free form take the place of a named effect, where that explains more.

    Something else that acts much like it, on the same body, may be there in truth. The table begins as what
    the effect does, on its paths, which are nearly right.

    Returns:
        What came of the coarse tables that do not explain on these paths.
    """
    coarse = list[Attempt]()
    place = (best.hypotheses[0].body, best.hypotheses[0].direction)
    if best.scale > ANNEALING[3] or len(best.hypotheses) > 1 or place not in PLACES:
        return coarse
    nominal = search.setting.model()
    passes = []
    for follower, row in zip(best.followers, best.fit.values, strict=True):
        passes.append(follower.look(nominal.machine(row[[0, -1]]), [best.model.machine(row)]))
    machine, joint = best.model.machine(best.fit.values[0]), search.setting.joint
    for curve in effect_as_curves(passes, best.followers, machine, place, joint)[:_FITTED]:
        hypothesis = free_form(curve, joint)
        values = np.array([[row[0], *curve.forces, row[-1]] for row in best.fit.values])
        search.report(f"  in its place, a function of {curve.argument}")
        found = search.refit(explanation, [hypothesis], best.followers, values, ANNEALING[3], again=True)
        if found is not None and not explained(explanation.best) and found.misfit < _AS_GOOD * best.misfit:
            refine_table(search, explanation, curve, found)
        if explained(explanation.best) and unnamed(explanation.best.hypotheses) is not None:
            return []
        if found is not None:
            coarse.append(found)
    return coarse


def reshape_anew(search: Search, explanation: Explanation, base: Attempt, tables: Sequence[Attempt]) -> None:
    """Fit tables that took the place of an effect on paths of their own, where its paths are not near.

    These were followed with a force that is wrong: at some impacts they are torn, and there a table that is
    right leaves as much as the effect does.
    """
    if base.misfit < NEARLY:
        return
    for table in sorted(tables, key=lambda one: one.misfit):
        if explained(explanation.best) or search.late():
            return
        if table.misfit < _NO_WORSE * base.misfit:
            seek_anew(search, explanation, table.hypotheses, table.fit.values, table, again=False)


def name_curve(search: Search, explanation: Explanation) -> None:
    """Try named effects in the place of a table, on its paths, where they can be judged.

    Beside the nominal machine's own paths an effect that is right may promise little. However late it is, one
    that would turn the crank alike is tried: it takes a few seconds, and to be named is what was asked for.
    """
    best = explanation.best
    _name_torque(search, explanation, best)
    if (explained(explanation.best) and unnamed(explanation.best.hypotheses) is None) or search.late():
        return
    others, places = _beside_table(best)
    model, values = search.setting.model(others), best.fit.values[:, [*places, -1]]
    own = [follower.part(0, follower.segments) for follower in best.followers]
    without = fit(own, model, values, 0, 1.0, search.workers, scale=ANNEALING[2])
    base = Attempt(tuple(others), model, without, ANNEALING[2], without.level, own)
    prospects = look(search, explanation, base)
    for hint in [*prospects.promising, *prospects.unlikely][:_NAMED]:
        if search.late():
            return
        if len(others) + len(hint.hypotheses) > search.most:
            continue
        held, begun = beside(base, hint.hypotheses, hint.values)
        search.refit(explanation, held, own, begun, ANNEALING[2])


def _beside_table(best: Attempt) -> tuple[list[Hypothesis], list[int]]:
    """The hypotheses beside a table, and the places of the clearance and of their values."""
    table = unnamed(best.hypotheses)
    others, places, column = list[Hypothesis](), [0], 1
    for hypothesis in best.hypotheses:
        if hypothesis is not table:
            others.append(hypothesis)
            places.extend(range(column, column + len(hypothesis.unknowns)))
        column += len(hypothesis.unknowns)
    return others, places


def _name_torque(search: Search, explanation: Explanation, best: Attempt) -> None:
    """Try the effects that would turn the crank as a table on one of the links does, in its place."""
    table = unnamed(best.hypotheses)
    if table is None or (table.body, table.direction) not in PLACES or best.scale > ANNEALING[3]:
        return
    others, places = _beside_table(best)
    row = best.fit.values[0]
    machine = best.model.machine(row)
    if others:  # what the table does is told beside a machine that lacks the others, too
        machine = replace(search.setting.with_clearance(float(row[0])), force=machine.force)
    try:
        with search.timed(rhythm_of(best)):
            alike = suggest_names(search, machine, float(row[0]))
    except np.linalg.LinAlgError:
        return
    known = {hypothesis.name for hypothesis in others}
    new = [one for one in alike if known.isdisjoint(h.name for h in one.hypotheses)]
    for one in [one for one in new if len(others) + len(one.hypotheses) <= search.most][:_LIKE]:
        shown = ", ".join(f"{value:.3g}" for value in one.values)
        search.report(f"  the table does what {one.label} = {shown} would: {one.cost:.3g} are left")
        values = np.array([[*own[places], *one.values, own[-1]] for own in best.fit.values])
        search.refit(explanation, [*others, *one.hypotheses], best.followers, values, ANNEALING[2])
        if explained(explanation.best) and unnamed(explanation.best.hypotheses) is None:
            return


def _smoothed(search: Search, base: Attempt) -> Attempt:
    """The nominal machine on paths that unknown forces keep near the recordings, whatever acts there.

    Not begun from the nominal machine's own paths: where something acts that it lacks, these are torn.
    """
    model = search.setting.model()
    values = np.array([[base.fit.values[0, 0], trace.speed] for trace in search.traces])
    followers = [trace.follower(LOOSENESS) for trace in search.traces]
    for scale in ANNEALING[:_SMOOTH]:
        found = fit(followers, model, values, 8, 3e-2, search.workers, scale=scale)
        values[:, 1:] = found.values[:, 1:]
    return Attempt((), model, found, scale, found.level, followers)


class _Trials:
    """Curves with which the surest recording was followed better, ``followed``; of the best one its path."""

    def __init__(self, search: Search, base: Attempt) -> None:
        self.search, self.base = search, base
        self.surest = surest_of(search.starts)
        row = base.fit.values[self.surest]
        self.least = _LESS * self._beside(base.model, row).level
        self.best: Suggestion | None = None
        self.followed: dict[tuple[str, str, str], Suggestion] = {}

    def add(self, curves: Iterable[Curve]) -> None:
        """Try each curve beside the base's path, and follow with those that leave clearly less."""
        fitted = []
        for curve in curves:
            if curve.gain <= 0.0:
                continue
            held, rows = beside(self.base, [free_form(curve, self.search.setting.joint)], curve.forces)
            try:
                found = self._beside(self.search.setting.model(held), rows[self.surest])
            except (InputError, np.linalg.LinAlgError):
                continue
            if found.level < self.least:
                fitted.append((found.level, replace(curve, forces=found.values[0, 1:-1]), found.values[0]))
        fitted.sort(key=lambda one: one[0])
        for _, curve, row in fitted[:_FOLLOWED]:
            self._follow(curve, row)
            if self.best is not None and self.best.misfit < _PART * self.base.misfits[self.surest]:
                return

    def _beside(self, model: Model, row: np.ndarray) -> Settled:
        """A few steps beside the path of the base."""
        own = self.base.followers[self.surest]
        return settle(
            [own.part(0, own.segments)], model, row[None], _STEPS, 3e-2, 1, home=row[None],
            scale=ANNEALING[3],
        )  # fmt: skip

    def beside_all(self, curve: Curve) -> tuple[float, np.ndarray]:
        """What a curve leaves beside the base's paths of all recordings, and its forces then."""
        held, values = beside(self.base, [free_form(curve, self.search.setting.joint)], curve.forces)
        followers = [own.part(0, own.segments) for own in self.base.followers]
        found = settle(
            followers, self.search.setting.model(held), values, _STEPS, 3e-2, self.search.workers,
            home=values, scale=ANNEALING[3],
        )  # fmt: skip
        return found.level, found.values[0, 1:-1]

    def _follow(self, curve: Curve, row: np.ndarray) -> None:
        label = f"{curve.body} {curve.direction} by {curve.argument}"
        model = self.search.setting.model([free_form(curve, self.search.setting.joint)])
        start = self.search.starts[self.surest]
        try:
            found = self.search.finished.followed(label, lambda: grow(start, model, row))
        except (InputError, np.linalg.LinAlgError):
            return
        assert found is not None  # without a limit none is given up: a table comes right late
        self.search.report(f"  {label}: misfit {found[2]:.3g} on one recording")
        followed = Suggestion(replace(curve, forces=found[1][1:-1]), *found)
        if followed.misfit < self.base.misfits[self.surest]:
            self.followed[curve.body, curve.direction, curve.argument] = followed
            if self.best is None or followed.misfit < self.best.misfit:
                self.best = followed
