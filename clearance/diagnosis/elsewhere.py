"""Effects that no look beside a nominal path can judge: they add coordinates, or change much at once."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.explain import Explanation, Search, beside
from clearance.diagnosis.finished import Followed
from clearance.diagnosis.fit import Model
from clearance.diagnosis.geometry import GEOMETRIC, suggest_dimensions
from clearance.diagnosis.growth import Start, grow
from clearance.diagnosis.hypothesis import Hypothesis
from clearance.diagnosis.search import EXPLAINED, LOOSENESS, POOR, Attempt, explained
from clearance.errors import InputError

_FITTED = 2  # of them that are fitted to all recordings
_PART = 0.5  # of the base's misfit: one that leaves more of one recording is not
_TRIALS = 3  # plausible shapes of an effect that are tried
_ELSEWHERE = ("soft_drive", "second_clearance", "rod_flexibility", "flexible_base", "guide_clearance")
"""Effects that no linear look beside a nominal path can judge, cheap and frequent ones first."""


def begin_elsewhere(search: Search, explanation: Explanation, base: Attempt) -> None:
    """Fit effects that add coordinates or change much at once, from plausible sizes, beside ``base``.

    No linear look at a path without them can judge them. They are tried on one recording; the best are
    fitted to all.
    """
    surest = int(np.argmin([start.doubt for start in search.starts]))
    tried: list[tuple[float, list[Hypothesis], np.ndarray]] = []

    def everywhere(held: list[Hypothesis], row: np.ndarray) -> bool:
        search.keep(explanation, held, lambda: _everywhere(search, held, row, surest))
        return explained(explanation.best)

    for group in _judged_elsewhere(search.others(base)):
        for hypothesis in group[:_TRIALS]:
            if search.late():
                return
            held, values = beside(base, [hypothesis], hypothesis.start)
            model, row = search.setting.model(held), values[surest]

            def one(
                h: Hypothesis = hypothesis, model: Model = model, row: np.ndarray = row
            ) -> Followed | None:
                return grow(_begun(search, h, model, row, surest), model, row, max(base.misfit, POOR))

            try:
                found = search.finished.followed(f"{base.label} + {hypothesis.label}, one recording", one)
            except (InputError, np.linalg.LinAlgError):
                continue
            if found is None:
                continue
            misfit = found[2]
            search.report(f"  {hypothesis.label}: misfit {misfit:.3g} on one recording")
            if misfit < EXPLAINED:  # of the others, too? one recording at one speed shows little of a motor
                if everywhere(held, found[1]):
                    return
                break
            tried.append((misfit, held, found[1]))
    tried.sort(key=lambda one: one[0])
    for misfit, held, row in tried[:_FITTED]:
        if misfit > _PART * base.misfit or search.late() or everywhere(held, row):
            return


def begin_dimensions(search: Search, explanation: Explanation, channels: Sequence[str]) -> None:
    """Fit dimensions and faults with which the motion alone agrees better, on paths that are sought anew.

    Args:
        search: after its nominal stage.
        explanation: added to.
        channels: whose sensors may be at fault.
    """
    surest = int(np.argmin([start.doubt for start in search.starts]))
    for one in suggest_dimensions(search, channels):
        held, values = beside(explanation.nominal, [one.hypothesis], np.array([one.value]))
        row = values[surest]
        row[0] = one.clearance
        search.keep(
            explanation, held,
            lambda held=held, row=row: _everywhere(search, held, row, surest),  # type: ignore[misc]
        )  # fmt: skip
        if explained(explanation.best):
            return


def _begun(search: Search, hypothesis: Hypothesis, model: Model, row: np.ndarray, r: int) -> Start:
    """Where a recording can be followed from: anew where a hypothesis adds coordinates or moves the links."""
    structural = hypothesis.structural(search.setting.with_clearance(3e-4))
    if not structural and hypothesis.name not in GEOMETRIC and hypothesis.fault is None:
        return search.starts[r]
    trace = search.retrace(r, model.machine(row), model.instrument(row))
    return Start.of(trace, model.held(row), LOOSENESS)


def _everywhere(search: Search, held: Sequence[Hypothesis], row: np.ndarray, surest: int) -> Attempt | None:
    """Fit to all recordings what the surest one suggests.

    What speed a drive is asked for, and its integral, follow from the torque by the drive's own gains: the
    others' paths are sought anew with another drive.
    """
    model = search.setting.model(held)
    starts, values = list(search.starts), np.repeat(row[None], len(search.starts), axis=0)
    for r, trace in enumerate(search.traces):
        if r != surest:
            values[r, -1] = trace.speed
        if held[-1].name == "soft_drive" and r != surest:
            starts[r] = Start.of(search.retrace(r, model.machine(row)), model.held(row), LOOSENESS)
            values[r, -1] = starts[r].trace.speed
        else:
            starts[r] = _begun(search, held[-1], model, values[r], r)
    return search.grown(held, values, starts)


def _single(hypothesis: Hypothesis) -> bool:
    """Whether it has one size beside shapes: the simplest variant of its effect; a drive has two gains."""
    return int((~hypothesis.shapes).sum()) == 1 or hypothesis.name == "soft_drive"


def _judged_elsewhere(groups: Sequence[Sequence[Hypothesis]]) -> list[Sequence[Hypothesis]]:
    """The simplest variants of the effects in ``_ELSEWHERE``, in that order."""
    single = [g for g in groups if g[0].name in _ELSEWHERE and _single(g[0])]
    fewest: dict[str, int] = {}
    for group in single:
        count = len(group[0].unknowns)
        fewest[group[0].name] = min(count, fewest.get(group[0].name, count))
    chosen = [g for g in single if len(g[0].unknowns) == fewest[g[0].name]]
    return sorted(chosen, key=lambda g: _ELSEWHERE.index(g[0].name))
