"""The clearance that a diagnosis gives, and what the number rests on."""

from clearance.diagnosis.following.attempt import explained
from clearance.diagnosis.judging.verdict import MOTION, Estimate, basis_of, cushioned, estimates
from clearance.diagnosis.searching.explanation import Explanation

FIT, NEAREST = "fit", "nearest models"
"""What an estimate rests on: a model that explains, with a 95 % interval; the spread of those that come
near, which is none; or ``MOTION``, whatever the forces, or ``ONE`` recording that was followed."""
_AGREED = 0.2  # of the clearance that the motion shows: what it may err by
_NEAR = 2.0  # times the best misfit: models that say as much of the clearance, where none explains


def clearance_of(explanation: Explanation) -> tuple[Estimate, str]:
    """The clearance [m] with an interval, and what both rest on.

    Where nothing explains the recordings, the interval spans those of all models that are up to twice as far
    off as the nearest one: what is missing may have moved each of them. A slider that leaves its line moves
    them further than that; then it is the clearance at which the motion agrees between the rails, within what
    it may err by. So it is where a gap was closed that the motion shows to be wide.
    """
    best = explanation.best
    own = estimates(best)[0]
    if explained(best):
        return own, FIT
    if best is explanation.shown:
        return own, basis_of(explanation)
    if cushioned(explanation):
        assert explanation.agreed is not None
        shown = explanation.agreed[1]
        return Estimate(shown, (1.0 - _AGREED) * shown, (1.0 + _AGREED) * shown), MOTION
    near = [explanation.nominal, *explanation.attempts]
    each = [estimates(a)[0] for a in near if a.misfit <= _NEAR * best.misfit]
    low, high = min([own.low, *(e.low for e in each)]), max([own.high, *(e.high for e in each)])
    return Estimate(own.value, low, high), NEAREST
