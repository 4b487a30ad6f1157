"""A frame that sensors on the crank feel moving: one that gives way, or one that something shakes."""

from copy import copy
from dataclasses import replace

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained, refine
from clearance.diagnosis.hypotheses.free_form import Curve, free_form, known_force
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, Setting
from clearance.diagnosis.kinematics.agreement import profile
from clearance.diagnosis.kinematics.pushing import find_pushing
from clearance.diagnosis.kinematics.shaking import FOUND, KNOTS, find_shaking, measure_frame, shakes
from clearance.diagnosis.kinematics.swaying import find_frame, sways
from clearance.diagnosis.searching.balance import settle_in, suggest_forces
from clearance.diagnosis.searching.everywhere import fit_from
from clearance.diagnosis.searching.explanation import Explanation, Suspected
from clearance.diagnosis.searching.geometry import FRAME, Shown, suggest_dimensions
from clearance.diagnosis.searching.rattling import begin_guide
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.work import Balanced
from clearance.errors import InputError

_NAMED = 2  # forces that are tried beside a frame
_OFF = {"frequency": 0.01, "damping_ratio": 0.1, "mass": 0.02}  # of a frame's numbers, as measured
_DAMPING = 4e-3  # of its damping ratio, however small that is
_TOLD = 0.5  # of the variance of what shakes the frame, that a rhythm explains at least


def begin_frame(search: Search, explanation: Explanation) -> None:
    """Fit a frame that gives way as the one does which the crank's sensors feel, at A or at its end.

    Where it does not explain, with the play of a slider that strikes rails on it, with a force that the
    balance of work against the frame names, and with a dimension with which the motion against the frame
    agrees better.
    """
    nominal, known = explanation.nominal, search.setting.machine
    hypothesis = next((g[0] for g in search.groups.values() if g[0].name == FRAME), None)
    if hypothesis is None or not hypothesis.structural(known) or explained(nominal):
        return
    turning, p = _turning(search), known.parameters()
    pairs = list(zip(search.recordings, turning, strict=True))
    measured, at_a = None, all(shakes(one, *turns) for one, turns in pairs)
    if at_a:
        measured = measure_frame(search.recordings, turning, known)
    elif all(sways(one, *turns, p) for one, turns in pairs):
        measured = find_frame(search.recordings, turning, known)
    if measured is None:
        return
    shown = "{:.4g} Hz, a damping ratio of {:.2g} and {:.4g} kg".format(*measured)
    search.report(f"  the frame shakes as one of {shown} would")
    own = dict(zip(FOUND, measured, strict=True))
    sizes = np.array([np.clip(own[u.name], u.low, u.high) for u in hypothesis.unknowns])
    try:
        against = profile(
            search.recordings, search.alignments,
            lambda c: hypothesis.apply(search.setting.with_clearance(c), sizes), search.workers,
        )  # fmt: skip
    except np.linalg.LinAlgError:
        return
    fit_from(search, explanation, nominal, [hypothesis], sizes, against.best, anew=False)
    if explained(explanation.best) or search.late():
        return
    if at_a:  # what the crank's end tells of a frame supposes that the slider stays on its line
        begin_guide(search, explanation, Shown((hypothesis,), sizes, _doubts(hypothesis, sizes), against))
    if explained(explanation.best) or explanation.rails is not None or search.late():
        return
    setting = search.setting.added([hypothesis], sizes)
    for force in _forces_on(search, setting, against.best):
        both, values = [hypothesis, *force.hypotheses], np.append(sizes, force.values)
        fit_from(search, explanation, nominal, both, values, force.clearance, anew=True)
        if explained(explanation.best) or search.late():
            return
    standing = copy(search)
    standing.setting, standing.profile = setting, against
    for one in suggest_dimensions(standing, {}):
        values = np.append(one.value, sizes)
        fit_from(search, explanation, nominal, [one.hypothesis, hypothesis], values, one.clearance, anew=True)
        if explained(explanation.best) or search.late():
            return


def _doubts(hypothesis: Hypothesis, sizes: np.ndarray) -> np.ndarray:
    """Standard deviations of a measured frame's numbers."""
    shares = np.array([_OFF[unknown.name] for unknown in hypothesis.unknowns])
    least = np.array(
        [_DAMPING if unknown.name == "damping_ratio" else 0.0 for unknown in hypothesis.unknowns]
    )
    return np.maximum(shares * sizes, least)


def _forces_on(search: Search, setting: Setting, clearance: float) -> list[Balanced]:
    """Named forces that give the torque which the motion of a machine needs, settled, the best first."""
    try:
        suggested = suggest_forces(search, setting, clearance, named=True)
        if suggested is None:
            return []
        return [settle_in(search, setting, force) for force in suggested.forces[:_NAMED]]
    except (InputError, np.linalg.LinAlgError):
        return []


def begin_shaking(search: Search, explanation: Explanation) -> None:
    """Fit a force over time that shakes a frame which is known to give way, where the balance shows one.

    Whatever the nominal machine leaves: from segment to segment a frame that is pushed looks free.
    """
    machine, turning = search.setting.machine, _turning(search)
    found = find_shaking(search.recordings, turning, machine)
    if found is None:
        found = find_pushing(search.recordings, turning, machine)
    if found is None or found.share < _TOLD:
        return
    period, none, most = found.rhythm.period, np.zeros(KNOTS), np.abs(found.forces).max()
    search.report(
        f"  a force of {most:.3g} N at most on the frame ({found.direction}) that repeats every "
        f"{period * 1e3:.5g} ms gives {found.share:.1%} of what shakes it"
    )
    explanation.shaken = found
    explanation.suspected = Suspected("frame", found.direction, explanation.nominal.misfit)
    curve = Curve(
        "frame", found.direction, "time", period * np.arange(KNOTS) / KNOTS, found.forces, none, 0.0, 0.0,
        found.interpolation, period,
    )  # fmt: skip
    with search.timed(found.rhythm):
        measured = known_force(free_form(curve, search.setting.joint), curve.forces)
        pushed = _with(search, explanation, measured, search.profile.best)
        if pushed is not None and not (explained(pushed) or search.late()):
            fewer = replace(curve, knots=curve.knots[::2], forces=curve.forces[::2], interpolation="cubic")
            fitted = free_form(fewer, search.setting.joint)
            pushed = _with(search, explanation, fitted, float(pushed.fit.values[0, 0])) or pushed
    if pushed is not None and explained(pushed) and explained(explanation.nominal):
        _on_the_path_of(pushed, search, explanation)
        explanation.shown = pushed


def _with(search: Search, explanation: Explanation, force: Hypothesis, clearance: float) -> Attempt | None:
    """Fit a force from its values and a clearance [m], on paths that follow it."""
    return fit_from(search, explanation, explanation.nominal, [force], force.start, clearance, anew=True)


def _on_the_path_of(pushed: Attempt, search: Search, explanation: Explanation) -> None:
    """Fit the nominal machine to the same stretches: a whole period is followed with a force that repeats."""
    model, values = search.setting.model(), pushed.fit.values[:, [0, -1]]
    nominal = search.finished.attempt(
        (), model, lambda: refine((), model, pushed.followers, values, pushed.scale, 8, search.workers),
        search.workers,
    )  # fmt: skip
    if nominal is not None:
        explanation.nominal = nominal
        search.report(f"nominal, on the path of {pushed.label}: misfit {nominal.misfit:.3g}")


def _turning(search: Search) -> list[tuple[float, float]]:
    return [(one.angle, one.speed) for one in search.alignments]
