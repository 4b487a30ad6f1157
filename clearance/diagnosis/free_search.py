"""Explain by a force of free form what no named effect does: on which body, as a function of what.

Beside the nominal path the unknown forces suggest curves. Each is tried by following one recording with it:
first the likeliest curve of each body and direction, then, where that follows best, other arguments. A curve
that is right follows as a named effect would; its table is then fitted to all recordings.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from clearance.diagnosis.fit import fit, settle
from clearance.diagnosis.growth import grow
from clearance.diagnosis.missing_force import Curve, free_form
from clearance.diagnosis.screening import shapes
from clearance.diagnosis.search import ANNEALING, LOOSENESS, Attempt
from clearance.errors import InputError

if TYPE_CHECKING:
    from clearance.diagnosis.explain import Explanation, Search

_SMOOTH = 4  # scales of the noise at which paths are smoothed
_FIRST = 2  # arguments of each direction that are tried first
_STEPS = 6  # of a trial beside the base's path
_FOLLOWED = 5  # of the curves tried at a time, with which a recording is followed


def shape_freely(search: "Search", explanation: "Explanation", base: Attempt) -> None:
    """Let a force of free form explain what no named effect does.

    Args:
        search: with its traces and starts.
        explanation: added to.
        base: beside whose path the curves are looked for.
    """
    free = _smoothed(search, base)
    search.report(f"with unknown forces: misfit {free.misfit:.3g}")
    found = shapes(free, search.setting.joint, search.traces[0].path.force, search.workers)
    each: dict[tuple[str, str], list[Curve]] = {}
    for curve in found:
        each.setdefault((curve.body, curve.direction), []).append(curve)
    trials = _Trials(search, base)
    trials.add([curve for curves in each.values() for curve in curves[:_FIRST]])
    if trials.best is None:
        return
    trials.add(each[trials.best.body, trials.best.direction])
    curve = trials.best
    hypothesis = free_form(curve, search.setting.joint)
    values = np.array([[*trials.values[:-1], trace.speed] for trace in search.traces])
    search.keep(explanation, [hypothesis], lambda: search.grown([hypothesis], values))


def _smoothed(search: "Search", base: Attempt) -> Attempt:
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
    """Curves with which the surest recording was followed; the best one is kept."""

    def __init__(self, search: "Search", base: Attempt) -> None:
        self.search, self.base = search, base
        self.surest = int(np.argmin([start.doubt for start in search.starts]))
        self.misfit = base.misfit
        self.best: Curve | None = None
        self.values = np.zeros(0)
        self.tried: list[tuple[str, str, str]] = []

    def add(self, curves: Iterable[Curve]) -> None:
        """Try each curve beside the base's path, and follow with the best of them."""
        fitted = []
        for curve in curves:
            key = (curve.body, curve.direction, curve.argument)
            if key not in self.tried and curve.gain > 0.0:
                self.tried.append(key)
                fitted.append(self._beside(curve))
        for _, curve, row in sorted(fitted, key=lambda one: one[0])[:_FOLLOWED]:
            label = f"{curve.body} {curve.direction} by {curve.argument}"
            model = self.search.setting.model([free_form(curve, self.search.setting.joint)])
            try:
                found = grow(self.search.starts[self.surest], model, row)
            except (InputError, np.linalg.LinAlgError):
                continue
            assert found is not None  # without a limit none is given up: a table comes right late
            self.search.report(f"  {label}: misfit {found[2]:.3g} on one recording")
            if found[2] < self.misfit:
                self.misfit, self.values = found[2], found[1]
                self.best = replace(curve, forces=found[1][1:-1])

    def _beside(self, curve: Curve) -> tuple[float, Curve, np.ndarray]:
        """Misfit, curve and values after a few steps beside the path of the base."""
        model = self.search.setting.model([free_form(curve, self.search.setting.joint)])
        own = self.base.followers[self.surest]
        row = self.base.fit.values[self.surest]
        values = np.concatenate([row[:1], curve.forces, row[-1:]])[None]
        try:
            found = settle(
                [own.part(0, own.segments)], model, values, _STEPS, 3e-2, 1, home=values, scale=ANNEALING[3]
            )
        except (InputError, np.linalg.LinAlgError):
            return np.inf, curve, values[0]
        values = found.values
        return found.level, replace(curve, forces=values[0, 1:-1]), values[0]
