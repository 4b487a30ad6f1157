"""Of an explanation that was found: what it can do without, and whether more of the same explains more."""

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, Attempt, explained, refine, tightened
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Hypothesis, same
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.nominal import follow_nominal
from clearance.diagnosis.searching.screening import screen
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import SURE
from clearance.diagnosis.shooting.covariance import deviations
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.settle import settle
from clearance.errors import InputError

_BACK = (0.8, 0.6, 0.4, 0.2, 0.0)  # of what was found: sizes on the way to off
_SURELY = 1.96  # standard deviations from off: what is nearer may as well be off
_STEPS = 6  # in which clearance and path follow each


def prune(search: Search, explanation: Explanation) -> None:
    """Take effects away from the best attempt as long as it explains as much without them.

    However late it is: beside a second effect, though it was too many, the first one's path was put right.
    Variants of the effects with fewer parameters are tried too: one that does nothing blurs the others.
    """
    while len(explanation.best.hypotheses) > 1:
        best = explanation.best
        for left_out in range(len(best.hypotheses)):
            held = [h for i, h in enumerate(best.hypotheses) if i != left_out]
            keep = [0]
            place = 1
            for i, hypothesis in enumerate(best.hypotheses):
                count = len(hypothesis.unknowns)
                keep += [] if i == left_out else range(place, place + count)
                place += count
            values = best.fit.values[:, [*keep, place]]
            if best.hypotheses[left_out].structural(search.setting.with_clearance(SOME_CLEARANCE)):
                if search.late():
                    continue
                # a path with other coordinates is no beginning
                search.keep(
                    explanation,
                    held,
                    lambda h=held, v=values: search.grown(h, v),  # type: ignore[misc]
                )
            else:
                search.refit(explanation, held, best.followers, values, ANNEALING[2], again=True)
        if explanation.best is best:
            break
    _reduce(search, explanation)


def _reduce(search: Search, explanation: Explanation) -> None:
    """Try variants of the best attempt's effects without parameters that may as well be off, on its path."""
    best, offset = explanation.best, 1
    if search.late() or not explained(best):
        return
    for index, hypothesis in enumerate(best.hypotheses):
        names = [u.name for u in hypothesis.unknowns]
        place = slice(offset, offset + len(names))
        offset = place.stop
        for group in search.groups.values():
            smaller = group[0]
            own = [u.name for u in smaller.unknowns]
            if not same(smaller, hypothesis) or not set(own) < set(names):
                continue
            apart = np.abs(best.fit.values[0, place] - hypothesis.off)
            needed = (apart > _SURELY * deviations(best.fit)[place]) & ~hypothesis.shapes
            if not {name for name, one in zip(names, needed, strict=True) if one} <= set(own):
                continue
            held = [*best.hypotheses[:index], smaller, *best.hypotheses[index + 1 :]]
            kept = [place.start + names.index(name) for name in own]
            columns = [*range(place.start), *kept, *range(place.stop, best.fit.values.shape[1])]
            search.refit(
                explanation, held, best.followers, best.fit.values[:, columns], best.scale, again=True
            )


def retry_nominal(search: Search, explanation: Explanation, at_last: bool = False) -> None:
    """Fit a nominal machine that explains once more on the path of what explains more.

    What looked torn beside it may have been a path in another minimum, which an effect was the way out of.
    Its sizes are led back to "off" step by step while clearance and path follow. So is a nominal machine that
    was lost, where what explains may as well be off, or where no linear look is sure of anything: it was only
    another way onto the path. At last any lost one is asked, and counts if it explains: beside it whatever
    found the path is asserted. Where that has other coordinates it is no beginning, but its clearance is: a
    frame of a ton and a half explained what the nominal machine does, 0.13 mm from where it was lost.

    Args:
        search: after its nominal stage.
        explanation: whose nominal machine is replaced by one that leaves less.
        at_last: whether every lost one is asked: it takes a while.
    """
    best, nominal = explanation.best, explanation.nominal
    if not best.hypotheses or search.late():
        return
    machine = search.setting.with_clearance(SOME_CLEARANCE)
    torn = explained(best) and max((hint.gain for hint in explanation.hints), default=SURE) < SURE
    other = any(hypothesis.structural(machine) for hypothesis in best.hypotheses)
    lost = at_last and explained(best) and not explained(nominal)
    near = not other and (explained(nominal) or torn or _idle(best))
    if not (lost or near):
        return

    def make() -> Attempt | None:
        if other:
            return follow_nominal(search, model, float(best.fit.values[0, 0]))
        followers, values = _led_back(best, search.workers)
        return refine((), model, followers, values, best.scale, 8, search.workers)

    model = search.setting.model()
    try:
        found = search.finished.attempt((), model, make, search.workers)
    except (InputError, np.linalg.LinAlgError):
        return
    if found is None or not found.misfit < nominal.misfit or not (near or explained(found)):
        return
    explanation.nominal = found
    explanation.hints = screen(found, search.others(found), search.workers).singles
    search.report(f"nominal, on the path of {best.label}: misfit {found.misfit:.3g}")


def _idle(best: Attempt) -> bool:
    """Whether an attempt explains and every size of its effects may as well be off."""
    off = np.concatenate([hypothesis.off for hypothesis in best.hypotheses])
    sizes = ~np.concatenate([hypothesis.shapes for hypothesis in best.hypotheses])
    shared = best.model.shared
    apart = np.abs(best.fit.values[0, 1:shared] - off)
    near = apart <= _SURELY * deviations(best.fit)[1:shared]
    return bool(explained(best) and near[sizes].all())


def _led_back(best: Attempt, workers: int) -> tuple[list[Follower], np.ndarray]:
    """Followers on the path of an attempt whose effects are off, and (recordings, 2) clearance and speed."""
    model, values, followers = best.model, best.fit.values.copy(), tightened(best.followers)
    off = np.concatenate([hypothesis.off for hypothesis in best.hypotheses])
    shapes = np.concatenate([hypothesis.shapes for hypothesis in best.hypotheses])
    sizes, free = 1 + np.flatnonzero(~shapes), [0, values.shape[1] - 1]
    there, home = best.fit.values[:, sizes], off[~shapes]
    for share in _BACK if np.isfinite(home).all() else ():
        values[:, sizes] = home + share * (there - home)
        found = settle(followers, model.only(free, values[0]), values[:, free], _STEPS, 1e-4, workers)
        values[:, free] = found.values
    return followers, values[:, free]


def enlarge(search: Search, explanation: Explanation) -> None:
    """Try the variants of the best attempt's effects that have more parameters."""
    best = explanation.best
    for index, hypothesis in enumerate(best.hypotheses):
        for group in search.groups.values():
            larger = group[0]
            names = {u.name for u in hypothesis.unknowns}
            if not same(larger, hypothesis) or not names < {u.name for u in larger.unknowns}:
                continue
            held = [*best.hypotheses[:index], larger, *best.hypotheses[index + 1 :]]
            offset = 1 + sum(len(h.unknowns) for h in best.hypotheses[:index])
            old = best.fit.values[:, offset : offset + len(hypothesis.unknowns)]
            own = {u.name: old[:, i] for i, u in enumerate(hypothesis.unknowns)}
            # a parameter that does nothing at "off" shows no slope there; the work of all motion may show it
            pushed = next((v for h, v in explanation.pushes if h.label == larger.label), None)
            middle = np.stack(
                [
                    own.get(u.name, np.full(len(old), _ready(larger, i) if pushed is None else pushed[i]))
                    for i, u in enumerate(larger.unknowns)
                ],
                axis=1,
            )  # fmt: skip
            values = np.concatenate(
                [best.fit.values[:, :offset], middle, best.fit.values[:, offset + old.shape[1] :]], axis=1
            )
            one = search.refit(explanation, held, best.followers, values, best.scale)
            if one is None or explained(best):
                continue
            # the smaller one may owe its misfit to a worse path: give it the larger one's
            again = search.refit(explanation, best.hypotheses, one.followers, best.fit.values, ANNEALING[3])
            if again is not None and explained(again):
                return


def _ready(hypothesis: Hypothesis, i: int) -> float:
    """Where a further parameter begins: off, or its plausible value where that is infinite or a shape."""
    if hypothesis.shapes[i] or not np.isfinite(hypothesis.off[i]):
        return float(hypothesis.start[i])
    return float(hypothesis.off[i])
