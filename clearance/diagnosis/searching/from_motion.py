"""Effects at which the motion alone points: dimensions, a clock, lobes of a bearing."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, same
from clearance.diagnosis.searching.balance import settle_in, suggest_forces
from clearance.diagnosis.searching.beside import HALFWAY, NEARLY_ALL
from clearance.diagnosis.searching.elsewhere import rhythm_of
from clearance.diagnosis.searching.everywhere import fit_from
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import Dimension, suggest_clock
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.wear import suggest_wear
from clearance.diagnosis.searching.work import Balanced
from clearance.errors import InputError

_DISPLACED = 0.3  # of the disagreement: a dimension with which less is left is looked at before any force
_LARGER = (1.0, 1.2, 1.45, 1.75)  # times the lobes that the motion shows
_LESS_CLEARANCE = (1.0, 0.94, 0.88)  # than the motion shows beside a dimension


def begin_displaced(
    search: Search, explanation: Explanation, dimensions: Sequence[Dimension]
) -> Dimension | None:
    """Fit a dimension without which the motion hardly agrees, first with what the work then lacks.

    Beside a wrong one the motion shows a clearance that is far off, and the balance of work other forces.

    Args:
        search: after its nominal stage.
        explanation: added to.
        dimensions: of ``suggest_dimensions``.

    Returns:
        The one that was tried, if one was.
    """
    one = next((one for one in dimensions if one.hypothesis.fault is None), None)
    if one is None or one.share > _DISPLACED:
        return None
    nominal, size = explanation.nominal, np.array([one.value])
    force = _beside_dimension(search, one)
    if force is not None:
        sizes = np.append(size, force.values)
        held = [one.hypothesis, *force.hypotheses]
        found = fit_from(search, explanation, nominal, held, sizes, force.clearance, anew=True)
        nearly = found is not None and found.misfit < NEARLY_ALL * nominal.misfit
        if explained(explanation.best) or nearly or search.late():
            return one
    _fit_dimension(search, explanation, one)
    return one


def _beside_dimension(search: Search, one: Dimension) -> Balanced | None:
    """What the balance of work lacks in a machine with another dimension, if it can be settled with it.

    No more effects than ``search.most`` together with the dimension.
    """
    setting = search.setting.added([one.hypothesis], np.array([one.value]))
    try:
        suggested = suggest_forces(search, setting, one.clearance, named=True)
        forces = [] if suggested is None else suggested.forces
        force = next((force for force in forces if len(force.hypotheses) < search.most), None)
        return None if force is None else settle_in(search, setting, force)
    except (InputError, np.linalg.LinAlgError):
        return None


def _fit_dimension(search: Search, explanation: Explanation, one: Dimension) -> None:
    """Fit a dimension alone, with less clearance where it is not followed with what the motion shows.

    By the rod's sensors and 5 % noise that was 14 % too much (a guide line 6.4 mm off).
    """
    nominal = explanation.nominal
    for less in _LESS_CLEARANCE if one.hypothesis.fault is None else _LESS_CLEARANCE[:1]:
        size, clearance = np.array([one.value]), less * one.clearance
        found = fit_from(search, explanation, nominal, [one.hypothesis], size, clearance, anew=False)
        if (found is not None and found.misfit < HALFWAY * nominal.misfit) or search.late():
            return


def begin_clock(search: Search, explanation: Explanation) -> None:
    """Fit a recorder's clock that the motion surely accuses, on paths sought anew by the right one."""
    one = suggest_clock(search)
    if one is not None:
        size = np.array([one.value])
        fit_from(search, explanation, explanation.nominal, [one.hypothesis], size, one.clearance, anew=True)


def begin_dimensions(
    search: Search,
    explanation: Explanation,
    dimensions: Sequence[Dimension],
    tried: Dimension | None,
) -> None:
    """Fit dimensions and faults with which the motion alone agrees better, on paths that are sought anew.

    Beside a dimension that does not explain all, with the best of what was found before, or with a force that
    the balance of work then names.

    Args:
        search: after its nominal stage.
        explanation: added to.
        dimensions: of ``suggest_dimensions``.
        tried: one of them, of ``begin_displaced``: it is fitted beside what was found since, and no more.
    """
    nominal, part = explanation.nominal, explanation.best
    for one in dimensions:
        size = np.array([one.value])
        if one is not tried:
            _fit_dimension(search, explanation, one)
        if explained(explanation.best) or search.late():
            return
        if one.hypothesis.fault is not None:
            continue
        new = part.hypotheses and all(not same(one.hypothesis, held) for held in part.hypotheses)
        if new and part.misfit < HALFWAY * nominal.misfit and len(part.hypotheses) < search.most:
            more, clearance, rhythm = part.hypotheses, one.clearance, rhythm_of(part)
            values = part.fit.values[0, 1 : part.model.shared]
        else:
            force = None if one is tried else _beside_dimension(search, one)
            if force is None:
                continue
            more, values, clearance = force.hypotheses, force.values, force.clearance
            rhythm = force.rhythm
        sizes = np.append(size, values)
        with search.timed(rhythm):
            fit_from(search, explanation, nominal, [one.hypothesis, *more], sizes, clearance, anew=True)
        if explained(explanation.best) or search.late():
            return


def begin_wear(
    search: Search,
    explanation: Explanation,
    base: Attempt,
    forces: Sequence[Hypothesis] = (),
    sizes: np.ndarray | None = None,
    most: float = np.inf,
) -> None:
    """Fit a worn bearing beside ``base``, from the lobes that the motion shows, on paths sought anew.

    How much better the motion agrees says little: beside a missing force lobes do, too (a tenth was seen).
    By 5 % noise it shows them too small (49 um of 83, at a phase 0.3 off), and the gap with them.

    Args:
        search: after its nominal stage.
        explanation: added to.
        base: what explains a part.
        forces: that are fitted beside it, too.
        sizes: (unknowns,) of these.
        most: of the motion's disagreement that lobes may leave.
    """
    sizes = np.zeros(0) if sizes is None else sizes
    known = np.append(base.fit.values[0, 1 : base.model.shared], sizes)
    try:
        one = suggest_wear(search, [*base.hypotheses, *forces], known)
    except (InputError, np.linalg.LinAlgError):
        return
    if one is None or one.share > most:
        return
    shown = ", ".join(f"{value:.3g}" for value in one.values)
    search.report(
        f"  the motion agrees best with {one.hypothesis.label} = {shown} and a clearance of "
        f"{one.clearance * 1e3:.3f} mm: {one.share:.0%} of the disagreement are left"
    )
    amplitude, order, phase = one.values
    for larger in _LARGER:
        size = np.append(sizes, [larger * amplitude, order, phase])
        gap = one.clearance + (larger - 1.0) * amplitude  # what is seen of it is beside the lobes
        fit_from(search, explanation, base, [*forces, one.hypothesis], size, gap, anew=True)
        if explained(explanation.best) or search.late():
            return
