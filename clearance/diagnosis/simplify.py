"""Of an explanation that was found: what it can do without, and whether more of the same explains more."""

import numpy as np

from clearance.diagnosis.explain import Explanation, Search
from clearance.diagnosis.hypothesis import Hypothesis, same
from clearance.diagnosis.search import ANNEALING, explained, refine


def prune(search: Search, explanation: Explanation) -> None:
    """Take effects away from the best attempt as long as it explains as much without them."""
    while len(explanation.best.hypotheses) > 1:
        best = explanation.best
        shorter = []
        for left_out in range(len(best.hypotheses)):
            held = [h for i, h in enumerate(best.hypotheses) if i != left_out]
            model = search.setting.model(held)
            keep = [0]
            place = 1
            for i, hypothesis in enumerate(best.hypotheses):
                count = len(hypothesis.unknowns)
                keep += [] if i == left_out else range(place, place + count)
                place += count
            values = best.fit.values[:, [*keep, place]]
            if best.hypotheses[left_out].structural(search.setting.with_clearance(3e-4)):
                # a path with other coordinates is no beginning
                anew = search.grown(held, values)
                shorter += [] if anew is None else [anew]
                continue
            shorter.append(refine(held, model, best.followers, values, ANNEALING[2], 8, search.workers))
        explanation.attempts += shorter
        for one in shorter:
            search.report(f"{one.label}: misfit {one.misfit:.3g}")
        if explanation.best is best:
            break


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
            middle = np.stack(
                [
                    own.get(u.name, np.full(len(old), _ready(larger, i)))
                    for i, u in enumerate(larger.unknowns)
                ],
                axis=1,
            )  # fmt: skip
            values = np.concatenate(
                [best.fit.values[:, :offset], middle, best.fit.values[:, offset + old.shape[1] :]], axis=1
            )
            one = refine(
                held, search.setting.model(held), best.followers, values, best.scale, 8, search.workers
            )
            explanation.attempts.append(one)
            search.report(f"{one.label}: misfit {one.misfit:.3g}")
            if explained(best):
                continue
            # the smaller one may owe its misfit to a worse path: give it the larger one's
            again = refine(
                best.hypotheses, best.model, one.followers, best.fit.values, ANNEALING[3], 8, search.workers
            )
            explanation.attempts.append(again)
            search.report(f"  without the added: {again.misfit:.3g}")
            if explained(again):
                return


def _ready(hypothesis: Hypothesis, i: int) -> float:
    """Where a further parameter begins: off, or its plausible value where that is infinite or a shape."""
    if hypothesis.shapes[i] or not np.isfinite(hypothesis.off[i]):
        return float(hypothesis.start[i])
    return float(hypothesis.off[i])
