"""What one recording suggests of a machine, fitted to all of them on paths that are sought anew."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.following.attempt import EXPLAINED, Attempt, explained, refine
from clearance.diagnosis.following.growth import Start, surest_of
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Hypothesis
from clearance.diagnosis.searching.beside import HALFWAY, beside
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.geometry import GEOMETRIC, LOOSE_GUIDE
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.work import DRIVE
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.side_by_side import side_by_side
from clearance.errors import InputError

_LOOKS = 3  # at all recordings
_LESS = 0.8  # of the misfit of the look before: what leaves more is not looked at again
_ASTRAY = 1.3  # times larger or smaller than another one: a clearance that means another path
_APART = 1.02  # likewise: one from which another path may be met


def fit_from(
    search: Search,
    explanation: Explanation,
    base: Attempt,
    hypotheses: Sequence[Hypothesis],
    values: np.ndarray,
    clearance: float,
    anew: bool,
    insist: int = 1,
) -> Attempt | None:
    """Fit hypotheses beside ``base`` from values and a clearance [m]; others as of ``fit_everywhere``."""
    surest = surest_of(search.starts)
    held, rows = beside(base, hypotheses, values)
    row = rows[surest]
    row[0] = clearance
    return search.keep(
        explanation, held, lambda: fit_everywhere(search, held, row, surest, base, anew, insist, clearance)
    )


def fit_everywhere(
    search: Search,
    held: Sequence[Hypothesis],
    row: np.ndarray,
    surest: int,
    base: Attempt,
    anew: bool = False,
    insist: int = 1,
    clearance: float | None = None,
) -> Attempt | None:
    """Fit to all recordings what the surest one suggests, again on the paths that this gives while it helps.

    What speed a drive is asked for, and its integral, follow from the torque by the drive's own gains: paths
    are sought anew with another drive; with ``anew`` they are from the first look on. What points at such
    values has been seen, so that each recording may be the one from which the others learn, ``insist`` times.
    A wrong size may lead the clearance astray: the next look begins again at ``clearance`` [m], with which
    the motion agrees beside such values, or at that of the nominal motion where no hypothesis misleads it.
    Where one recording is followed, or nearly, and another is not, all are looked at again with what the one
    tells alone.
    """
    model, drive = search.setting.model(held), held[-1].name == DRIVE
    misled = any(misleads(hypothesis) for hypothesis in held)
    seen = anew or misled
    best: Attempt | None = None
    for look in range(_LOOKS):

        def begin(r: int, row: np.ndarray = row, again: bool = anew or look > 0) -> Start:
            if again or (drive and r != surest):
                return search.sought(r, model, row)
            return start_with(search, held[-1], model, row, r)

        try:
            starts = side_by_side(begin, range(len(search.starts)), search.workers)
            values = np.repeat(row[None], len(starts), axis=0)
            for r, start in enumerate(starts):
                if anew or look or r != surest:
                    values[r, -1] = start.trace.speed
            found = search.grown(held, values, starts, base=base, insist=seen * insist)
        except (InputError, np.linalg.LinAlgError):
            if best is None:
                raise
            break  # what an earlier look has found stands
        if found is None or (best is not None and not found.misfit < best.misfit):
            break
        little = best is not None and found.misfit > _LESS * best.misfit
        best, row = found, found.fit.values[surest].copy()
        teachers = _teachers(best, base)
        if teachers and look < _LOOKS - 1:
            row = _told(search, best, teachers)
            continue
        known = row[0] if misled else search.profile.best
        known = known if clearance is None else clearance
        row[0] = known if astray(row[0], known) else row[0]
        if explained(best) or little or best.misfit > HALFWAY * base.misfit:
            break
    return best


def _teachers(found: Attempt, base: Attempt) -> list[int]:
    """Recordings that are followed, or nearly, where others are lost; none that ``base`` explained teach."""
    limits = [max(EXPLAINED, HALFWAY * misfit) for misfit in base.misfits]
    near = [r for r, misfit in enumerate(found.misfits) if misfit < limits[r]]
    new = any(base.misfits[r] >= EXPLAINED for r in near)
    return near if new and len(near) < len(limits) else []


def _told(search: Search, found: Attempt, teachers: Sequence[int]) -> np.ndarray:
    """(unknowns,) what some of the recordings tell alone."""
    followers, rows = [found.followers[r] for r in teachers], found.fit.values[teachers]
    alone = refine(found.hypotheses, found.model, followers, rows, found.scale, 8, search.workers)
    row: np.ndarray = alone.fit.values[0].copy()
    return row


def start_with(search: Search, hypothesis: Hypothesis, model: Model, row: np.ndarray, r: int) -> Start:
    """Where a recording can be followed from: anew where a hypothesis makes it another path."""
    structural = hypothesis.structural(search.setting.with_clearance(SOME_CLEARANCE))
    if not (structural or misleads(hypothesis) or astray(row[0], search.clearance)):
        return search.starts[r]
    return search.sought(r, model, row)


def misleads(hypothesis: Hypothesis) -> bool:
    """Whether the motion itself is taken for another one without it: it moves links or alters a sensor."""
    return hypothesis.name in (*GEOMETRIC, LOOSE_GUIDE) or hypothesis.fault is not None


def between(shown: float, fitted: float) -> float | None:
    """A clearance [m] between that of the motion and the nominal one; ``None`` where they hardly differ.

    What is missing leads one of them up and the other down: from 0.633 and from 0.669 mm a ripple was not
    followed, from their mean it was at once. Where they mean two paths it is the motion's.
    """
    apart = max(shown, fitted) / min(shown, fitted)
    if apart < _APART:
        return None
    return shown if astray(shown, fitted) else float(np.sqrt(shown * fitted))


def astray(clearance: float, other: float) -> bool:
    """Whether two clearances mean two paths."""
    return abs(np.log(clearance / other)) > np.log(_ASTRAY)
