"""What would put impacts together that a model leaves torn.

What changes impacts alone, as a restitution does, shows there alone. No linear look sees across an impact
that is torn: its errors are so large that they hardly count. So the stretches around such impacts are fitted
anew with each effect, everything else held; they are short, and this is quick.
"""

import numpy as np

from clearance.diagnosis.following.attempt import APART, NEAR, Attempt, explained, whole
from clearance.diagnosis.following.horizon import islands, mend
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.searching.beside import beside
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import SURE
from clearance.diagnosis.shooting.follow import EDGE
from clearance.diagnosis.shooting.settle import settle
from clearance.diagnosis.side_by_side import side_by_side
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank

_STRETCHES = 4  # that are put together anew: those that cost most
_STEPS = 8  # in which a stretch is fitted
_BEGUN = (0.3, 1.0)  # of an effect's plausible size, to begin with
_HOPEFUL = 0.1  # of the best one's gain: less is no hint


def rejoin_impacts(search: Search, base: Attempt) -> list[Hint]:
    """Effects of one size that put torn impacts together, beside an attempt that follows otherwise.

    Not asked: effects that add coordinates or vanish at infinity, and faults of sensors.

    Args:
        search: with its hypotheses.
        base: nothing where it does not explain, or follows everywhere.

    Returns:
        Those whose gain, the fall of the robust cost of the recording that has most of it, is beyond chance;
        the best first.
    """
    if not explained(base) or whole(base):
        return []
    ripped = [np.where(one.each > APART, one.local, 0.0) for one in base.fit.passes]
    for one in ripped:
        one[:EDGE] = one[-EDGE:] = 0.0
    r = int(np.argmax([one.sum() for one in ripped]))
    torn, machine = islands(ripped[r] > 0.0, NEAR), base.model.machine(base.fit.values[r])
    stretches = sorted(torn, key=lambda ends: -ripped[r][slice(*ends)].sum())[:_STRETCHES]
    without, _ = _refitted(search, base, r, stretches, [], np.zeros(0))

    def asked(hypothesis: Hypothesis) -> list[Hint]:
        sizes, hints = ~hypothesis.shapes, list[Hint]()
        off, start = hypothesis.off[sizes], hypothesis.start[sizes]
        for share in _BEGUN:
            begun = hypothesis.start.copy()
            begun[sizes] = off + share * (start - off)
            try:
                cost, best = _refitted(search, base, r, stretches, [hypothesis], begun)
            except (InputError, np.linalg.LinAlgError):
                continue
            hints.append(Hint((hypothesis,), best, without - cost))
        return hints

    chosen = [group[0] for group in search.others(base) if _plain(group[0], machine)]
    found: list[Hint] = []
    for first in range(0, len(chosen), search.workers):
        if search.late():
            break
        for hints in side_by_side(asked, chosen[first : first + search.workers], search.workers):
            found += hints
    found.sort(key=lambda hint: -hint.gain)
    each: dict[str, Hint] = {}
    for hint in found:
        if hint.gain > max(SURE, _HOPEFUL * found[0].gain):
            each.setdefault(hint.label, hint)
    return list(each.values())


def _plain(hypothesis: Hypothesis, machine: SliderCrank) -> bool:
    """Whether it is an effect of one size that begins at nothing and adds no coordinates."""
    off = hypothesis.off[~hypothesis.shapes]
    plain = hypothesis.fault is None and len(off) == 1 and bool(np.isfinite(off).all())
    return plain and not hypothesis.structural(machine)


def _refitted(
    search: Search,
    base: Attempt,
    r: int,
    stretches: list[tuple[int, int]],
    hypotheses: list[Hypothesis],
    values: np.ndarray,
) -> tuple[float, np.ndarray]:
    """Cost of some stretches of recording ``r`` with hypotheses beside an attempt, and their values."""
    held, rows = beside(base, hypotheses, values)
    model, row = search.setting.model(held), rows[r]
    follower = base.followers[r].part(0, base.followers[r].segments)
    follower.signals[:] = base.followers[r].signals  # the filter reaches beyond a stretch
    parts = []
    for first, last in stretches:
        mend(follower, model.held(row), first, last)
        parts.append(follower.part(first, last))
    added = list(range(base.model.shared, base.model.shared + len(values)))
    begun = np.repeat(row[None, added], len(parts), axis=0)
    found = settle(parts, model.only(added, row), begun, _STEPS, 1e-2, 1)
    return found.cost, found.values[0]
