"""Effects that no look beside a nominal path can judge: they add coordinates, or change much at once."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from clearance.diagnosis.balance import settle_in, suggest_forces
from clearance.diagnosis.explain import (
    FAR,
    HALFWAY,
    NEARLY,
    PATIENCE,
    Explanation,
    Rails,
    Search,
    beside,
    enough,
)
from clearance.diagnosis.finished import Followed
from clearance.diagnosis.fit import Model
from clearance.diagnosis.free_search import refine_table
from clearance.diagnosis.geometry import GEOMETRIC, LOOSE_GUIDE, suggest_dimensions, suggest_guide
from clearance.diagnosis.growth import Start, grow
from clearance.diagnosis.hypothesis import Hypothesis
from clearance.diagnosis.missing_force import KNOTS
from clearance.diagnosis.search import EXPLAINED, LOOSENESS, POOR, Attempt, explained
from clearance.errors import InputError

_FITTED = 2  # of them that are fitted to all recordings
_LEFT = 0.3  # of what a base that explains leaves: what is right leaves less
_LOOKS = 3  # at all recordings
_TRIALS = 3  # plausible shapes or sizes of an effect that are tried
_ASTRAY = 1.3  # times larger or smaller than another one: a clearance that means another path
_GAPS = (1.0, 0.95, 1.05, 1.1, 0.9)  # times that which the motion shows: rattling is followed within 3 %
_HOPELESS = 30.0  # misfit with a gap that is not worth another look
_ELSEWHERE = ("soft_drive", "second_clearance", "rod_flexibility", "flexible_base", LOOSE_GUIDE)
"""Effects that no linear look beside a nominal path can judge, cheap and frequent ones first."""
_OUTSIDE = ("crank", "rod", "slider")  # what acts there does work
_FILM, _DRIVE = "joint_lubrication", "soft_drive"
_EDGED = "process_load"  # at one place of many: a size alone says nothing


def begin_elsewhere(search: Search, explanation: Explanation, base: Attempt) -> None:
    """Fit effects that add coordinates or change much at once, from plausible sizes, beside ``base``.

    No linear look at a path without them can judge them. They are tried on one recording; the best are
    fitted to all.
    """
    tried = (_DRIVE,) if base is explanation.nominal and base.misfit > FAR else ()  # in ``begin_plausible``
    groups = [g for g in _judged_elsewhere(search.others(base)) if g[0].name not in tried]
    _try_out(search, explanation, base, groups, None)


def begin_plausible(search: Search, explanation: Explanation, base: Attempt) -> None:
    """Fit every effect of one size from a plausible one, where the path is far from right.

    A linear look beside such a path may promise nothing of an effect that, once there, follows the recording.
    Where the work is balanced only effects inside the joint are tried.
    """
    if base.misfit < FAR:
        return
    known = {attempt.label for attempt in explanation.attempts}
    groups = [
        [group[0]]
        for group in search.others(base)
        if _of_one_size(group[0])
        and group[0].fault is None
        and group[0].name not in (*_ELSEWHERE, *GEOMETRIC, _EDGED)
        and group[0].label not in known
        and not (explanation.balanced and group[0].body in _OUTSIDE)
    ]
    drives = [group for group in _judged_elsewhere(search.others(base)) if group[0].name == _DRIVE]
    _try_out(search, explanation, base, [*groups, *([] if explanation.balanced else drives)], None)


def begin_balanced(search: Search, explanation: Explanation) -> None:
    """Fit effects that give the torque which the motion needs, where the path is not near."""
    nominal = explanation.nominal
    if nominal.misfit < NEARLY:
        return
    try:
        suggested = suggest_forces(search, search.setting, search.profile.best)
    except np.linalg.LinAlgError:
        return
    if suggested is None:
        return
    explanation.balanced, explanation.unpushed = suggested.balanced, not suggested.forces
    surest = int(np.argmin([start.doubt for start in search.starts]))
    known: list[set[str]] = []  # one variant of each effect, one argument of a force without a name
    for one in suggested.forces:
        names = {h.name for h in one.hypotheses} if one.curve is None else {one.label}
        if names in known:
            continue
        known.append(names)
        try:
            settled = settle_in(search, search.setting, one)
        except (InputError, np.linalg.LinAlgError):
            continue
        shown = ", ".join(f"{value:.4g}" for value in settled.values)
        search.report(f"  {one.label} = {shown} goes with a clearance of {settled.clearance * 1e3:.3f} mm")
        held, values = beside(nominal, one.hypotheses, settled.values)
        row = values[surest]
        row[0] = settled.clearance
        found = search.keep(
            explanation, held,
            lambda held=held, row=row: _everywhere(search, held, row, surest, nominal, True),  # type: ignore[misc]
        )  # fmt: skip
        table = one.curve
        if found is not None and table is not None and len(table.knots) <= KNOTS and not explained(found):
            refine_table(search, explanation, table, found)
        if explained(explanation.best) or search.late() or len(known) == _FITTED:
            return


def begin_film(search: Search, explanation: Explanation) -> None:
    """Fit a film in the joint where the motion shows another clearance than the nominal machine finds.

    A machine whose journal is cushioned moves as if its gap were small, which the geometry contradicts.
    """
    nominal, shown = explanation.nominal, search.profile.best
    if _astray(nominal.fit.values[0, 0], shown):
        groups = [g for g in search.others(nominal) if g[0].name == _FILM]
        _try_out(search, explanation, nominal, groups, shown)


def _try_out(
    search: Search,
    explanation: Explanation,
    base: Attempt,
    groups: Sequence[Sequence[Hypothesis]],
    clearance: float | None,
) -> None:
    """Try hypotheses on one recording, fit the best to all; from a clearance [m], or that of ``base``."""
    surest = int(np.argmin([start.doubt for start in search.starts]))
    limit, good = max(base.misfits[surest], POOR), enough(base, surest)
    little = min(EXPLAINED, 1.0 + _LEFT * (base.misfits[surest] - 1.0)) if explained(base) else EXPLAINED
    tried: list[tuple[float, list[Hypothesis], np.ndarray]] = []

    def everywhere(held: list[Hypothesis], row: np.ndarray) -> bool:
        before = explanation.best
        search.keep(explanation, held, lambda: _everywhere(search, held, row, surest, base))
        return explained(explanation.best) and explanation.best is not before

    for group in groups:
        for hypothesis in group[:_TRIALS]:
            if search.late():
                return
            held, values = beside(base, [hypothesis], hypothesis.start)
            model, row = search.setting.model(held), values[surest]
            row[0] = row[0] if clearance is None else clearance

            def one(
                h: Hypothesis = hypothesis, model: Model = model, row: np.ndarray = row
            ) -> Followed | None:
                return grow(_begun(search, h, model, row, surest), model, row, limit)

            try:
                begun = f"{base.label} + {hypothesis.label} from {row}, one recording"
                found = search.finished.followed(begun, one)
            except (InputError, np.linalg.LinAlgError):
                continue
            if found is None:
                continue
            misfit = found[2]
            search.report(f"  {hypothesis.label}: misfit {misfit:.3g} on one recording")
            if misfit < little:  # of the others, too? one recording at one speed shows little of a motor
                if everywhere(held, found[1]):
                    return
                break
            tried.append((misfit, held, found[1]))
    best: dict[str, tuple[float, list[Hypothesis], np.ndarray]] = {}
    for trial in sorted(tried, key=lambda trial: trial[0]):
        best.setdefault(trial[1][-1].label, trial)
    for misfit, held, row in list(best.values())[:_FITTED]:
        if misfit > (little if explained(base) else good) or search.late() or everywhere(held, row):
            return


def begin_dimensions(search: Search, explanation: Explanation, channels: Sequence[str]) -> None:
    """Fit dimensions and faults with which the motion alone agrees better, on paths that are sought anew.

    Beside a dimension that does not explain all, with a force that the balance of work then names.

    Args:
        search: after its nominal stage.
        explanation: added to.
        channels: whose sensors may be at fault.
    """
    surest = int(np.argmin([start.doubt for start in search.starts]))
    for one in suggest_dimensions(search, channels):
        size = np.array([one.value])
        _begin_dimension(search, explanation, [one.hypothesis], size, one.clearance, surest)
        if explained(explanation.best) or search.late():
            return
        if one.hypothesis.fault is not None:
            continue
        setting = replace(search.setting, machine=one.hypothesis.apply(search.setting.machine, size))
        try:
            suggested = suggest_forces(search, setting, one.clearance)
            named = [force for force in suggested.forces if force.curve is None] if suggested else []
            force = settle_in(search, setting, named[0]) if named else None
        except (InputError, np.linalg.LinAlgError):
            continue
        if force is not None:
            both = [one.hypothesis, *force.hypotheses]
            sizes = np.append(size, force.values)
            _begin_dimension(search, explanation, both, sizes, force.clearance, surest)
        if explained(explanation.best):
            return


def _begin_dimension(
    search: Search,
    explanation: Explanation,
    hypotheses: Sequence[Hypothesis],
    sizes: np.ndarray,
    clearance: float,
    surest: int,
) -> None:
    """Fit a dimension, alone or with a force, from a clearance [m] on paths that are sought anew."""
    held, values = beside(explanation.nominal, hypotheses, sizes)
    row = values[surest]
    row[0] = clearance
    search.keep(
        explanation, held,
        lambda: _everywhere(search, held, row, surest, explanation.nominal, len(hypotheses) > 1),
    )  # fmt: skip


def begin_guide(search: Search, explanation: Explanation) -> None:
    """Fit play of the slider in its guide, from the gap that the motion shows.

    A shoe that rattles is lost at many strikes, so its path is looked for with patience. The clearance is
    fitted first: from 1.6 % off it was found on two machines, once the gap was nearly right.
    """
    try:
        one = suggest_guide(search)
    except np.linalg.LinAlgError:
        return
    if one is None:
        return
    nominal = explanation.nominal
    explanation.rails = Rails(one.value, one.clearance)
    held, values = beside(nominal, [one.hypothesis], np.array([one.value]))
    model = search.setting.model(held)
    values[:, 0] = one.clearance
    for factor in _GAPS:
        tried = values.copy()
        tried[:, 1] *= factor
        begun = [_anew(search, model, row, r) for r, row in enumerate(tried)]
        r = int(np.argmin([start.doubt for start in begun]))
        row, start = tried[r], begun[r]
        for _ in range(_LOOKS):
            if search.late():
                return
            row = np.append(row[:-1], start.trace.speed)
            try:
                found = grow(start, model, row, _HOPELESS, patient=True)
            except (InputError, np.linalg.LinAlgError):  # the gap has closed
                break
            if found is None:
                break
            row = found[1]
            search.report(f"  {one.hypothesis.label}: misfit {found[2]:.3g} on one recording")
            if found[2] < EXPLAINED:
                search.keep(
                    explanation, held,
                    lambda row=row, r=r: _everywhere(search, held, row, r, nominal),  # type: ignore[misc]
                )  # fmt: skip
                return
            start = _anew(search, model, row, r, PATIENCE)


def _begun(search: Search, hypothesis: Hypothesis, model: Model, row: np.ndarray, r: int) -> Start:
    """Where a recording can be followed from: anew where a hypothesis makes it another path."""
    structural = hypothesis.structural(search.setting.with_clearance(3e-4))
    if not (structural or _misleads(hypothesis) or _astray(row[0], search.clearance)):
        return search.starts[r]
    return _anew(search, model, row, r)


def _anew(search: Search, model: Model, row: np.ndarray, r: int, patience: int = 0) -> Start:
    """Where a recording can be followed from, at its own speed, with what another one may have told."""
    trace = search.retrace(r, model.machine(row), model.instrument(row))
    return Start.of(trace, model.held(np.append(row[:-1], trace.speed)), LOOSENESS, patience)


def _everywhere(
    search: Search,
    held: Sequence[Hypothesis],
    row: np.ndarray,
    surest: int,
    base: Attempt,
    anew: bool = False,
) -> Attempt | None:
    """Fit to all recordings what the surest one suggests, again on the paths that this gives while it helps.

    What speed a drive is asked for, and its integral, follow from the torque by the drive's own gains: paths
    are sought anew with another drive; with ``anew`` they are from the first look on.
    """
    model, drive = search.setting.model(held), held[-1].name == _DRIVE
    rattling = held[-1].name == LOOSE_GUIDE
    best: Attempt | None = None
    for look in range(_LOOKS):

        def begin(r: int, row: np.ndarray = row, again: bool = anew or look > 0) -> Start:
            if again or rattling or (drive and r != surest):
                return _anew(search, model, row, r, PATIENCE if rattling else 0)
            return _begun(search, held[-1], model, row, r)

        with ThreadPoolExecutor(search.workers) as pool:
            starts = list(pool.map(begin, range(len(search.starts))))
        values = np.repeat(row[None], len(starts), axis=0)
        for r, start in enumerate(starts):
            if anew or look or r != surest:
                values[r, -1] = start.trace.speed
        found = search.grown(held, values, starts, base=base, patient=rattling)
        if found is None or (best is not None and not found.misfit < best.misfit):
            break
        best, row = found, found.fit.values[surest].copy()
        # a wrong size may have led the clearance astray; the motion knows it, unless it is misled, too
        if not _misleads(held[-1]) and _astray(row[0], search.profile.best):
            row[0] = search.profile.best
        if explained(best) or best.misfit > HALFWAY * base.misfit:
            break
    return best


def _misleads(hypothesis: Hypothesis) -> bool:
    """Whether the motion itself is taken for another one without it: it moves links or alters a sensor."""
    return hypothesis.name in (*GEOMETRIC, LOOSE_GUIDE) or hypothesis.fault is not None


def _astray(clearance: float, other: float) -> bool:
    """Whether two clearances mean two paths."""
    return abs(np.log(clearance / other)) > np.log(_ASTRAY)


def _single(hypothesis: Hypothesis) -> bool:
    """Whether it has one size beside shapes: the simplest variant of its effect; a drive has two gains."""
    return _of_one_size(hypothesis) or hypothesis.name == _DRIVE


def _of_one_size(hypothesis: Hypothesis) -> bool:
    return int((~hypothesis.shapes).sum()) == 1


def _judged_elsewhere(groups: Sequence[Sequence[Hypothesis]]) -> list[Sequence[Hypothesis]]:
    """The simplest variants of the effects in ``_ELSEWHERE``, in that order; both kinds of drive."""
    single = [g for g in groups if g[0].name in _ELSEWHERE and _single(g[0])]
    fewest: dict[str, int] = {}
    for group in single:
        count = len(group[0].unknowns)
        fewest[group[0].name] = min(count, fewest.get(group[0].name, count))
    chosen = [g for g in single if g[0].name == _DRIVE or len(g[0].unknowns) == fewest[g[0].name]]
    return sorted(chosen, key=lambda g: _ELSEWHERE.index(g[0].name))
