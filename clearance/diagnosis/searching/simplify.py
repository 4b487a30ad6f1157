"""Of an explanation that was found: what it can do without, and whether more of the same explains more."""

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, explained
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis, same
from clearance.diagnosis.searching.explanation import Explanation, penalised
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import SURE


def prune(search: Search, explanation: Explanation) -> None:
    """Take effects away from the best attempt as long as it explains as much without them.

    The last one, too, where the nominal machine explains: on the path that was found with an effect it may
    do as well as with it, when what looked torn beside it was a path in another minimum. Nothing is
    asserted that is not clearly better than it.
    """
    fewest = 0 if explained(explanation.nominal) else 1
    while len(explanation.best.hypotheses) > fewest:
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
            if not best.hypotheses[left_out].structural(search.setting.with_clearance(3e-4)):
                scale = ANNEALING[2] if held else best.scale  # more would lead back to the path that it had
                search.refit(explanation, held, best.followers, values, scale)
            elif held:  # a path with other coordinates is no beginning
                search.keep(
                    explanation,
                    held,
                    lambda h=held, v=values: search.grown(h, v),  # type: ignore[misc]
                )
        if explanation.best is best:
            break
    bare = [attempt for attempt in explanation.attempts if not attempt.hypotheses]
    explanation.nominal = min([explanation.nominal, *bare], key=penalised)
    explanation.attempts = [attempt for attempt in explanation.attempts if attempt.hypotheses]
    if explained(explanation.nominal):
        for attempt in explanation.attempts:
            attempt.withdrawn |= penalised(attempt) + SURE > penalised(explanation.nominal)


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
