"""Whether recordings are of machines with different clearances, where no machine explains all of them."""

import numpy as np

from clearance.diagnosis.kinematics.agreement import Profile, profile
from clearance.diagnosis.searching.search import Search

_APART = 1.25  # times: clearances that are taken for different ones
_LESS = 0.5  # of the disagreement with another recording's clearance: so much less is left with its own


def contradictions(search: Search) -> list[str]:
    """In words, which recordings show different clearances by their motion, each of them clearly.

    Args:
        search: that found nothing to explain all of its recordings.
    """
    names = list(dict.fromkeys(one.name for one in search.recordings))
    if len(names) < 2:
        return []
    each = [
        profile([one], [known], search.setting.with_clearance, search.workers)
        for one, known in zip(search.recordings, search.alignments, strict=True)
    ]
    order = np.argsort([one.best for one in each])
    least, most = int(order[0]), int(order[-1])
    pair = [each[least], each[most]]
    clear = all(_left(one, one.best) < _LESS * _left(one, other.best) for one, other in (pair, pair[::-1]))
    if each[most].best < _APART * each[least].best or not clear:
        return []
    shown = " and ".join(f"{search.recordings[r].name} {each[r].best * 1e3:.3f} mm" for r in (least, most))
    return [
        f"The recordings contradict each other: by its motion alone each shows another clearance in joint "
        f"{search.setting.joint}, {shown}. Are they of one machine, and was nothing changed between them? If "
        "not, diagnose them apart."
    ]


def _left(one: Profile, clearance: float) -> float:
    """Of the motion's disagreement at a clearance [m]."""
    finite = np.isfinite(one.misfit)
    return float(np.interp(np.log(clearance), np.log(one.clearance[finite]), one.misfit[finite]))
