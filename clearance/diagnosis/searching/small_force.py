"""A force without a name that is too small to throw the nominal machine off its path.

Where the nominal machine follows and yet something is missing, the unknown forces that one linear step would
add along its path are regressed on curves, as ``free_search`` does where it does not follow. What is small
looks alike in many places: each is fitted before it is believed.
"""

import numpy as np

from clearance.diagnosis.following.attempt import LOOSENESS
from clearance.diagnosis.hypotheses.free_form import Curve, free_form
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.screening import ONSET, shapes
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import unsettled

_PLACES = 3  # bodies and directions in which curves are fitted, one each
_MORE = 2  # other arguments of the one that says most


def begin_small_force(search: Search, explanation: Explanation) -> None:
    """Fit forces of free form beside a nominal machine that follows, until nothing is left that is too much.

    First what a contact does along itself by how hard it presses, which a linear look does not show among
    impacts; then the likeliest curve in each place; then others where the best one is.

    Args:
        search: after its nominal stage.
        explanation: added to.
    """
    nominal, joint = explanation.nominal, search.setting.joint
    force, step = search.traces[0].path.force, [trace.forces(LOOSENESS) for trace in search.traces]
    found = shapes(nominal, joint, force, search.workers, step)
    pressed = [c for c in found if c.body.startswith("joint") and c.argument == "contact_force"]
    each: dict[tuple[str, str], list[Curve]] = {}
    for curve in found:
        if curve.gain > curve.price:
            each.setdefault((curve.body, curve.direction), []).append(curve)

    def tried(curves: list[Curve]) -> bool:
        for curve in curves:
            if search.late() or not unsettled(explanation):
                return True
            search.report(f"  a small force: {curve.body} {curve.direction} by {curve.argument}")
            begun = ONSET * curve.forces
            values = np.array([[row[0], *begun, row[-1]] for row in nominal.fit.values])
            held = [free_form(curve, joint)]
            search.refit(explanation, held, nominal.followers, values, nominal.scale, 20, again=True)
        return not unsettled(explanation)

    if tried(pressed) or tried([curves[0] for curves in list(each.values())[:_PLACES]]):
        return
    best = explanation.best
    if best.hypotheses:
        place = best.hypotheses[0].body, best.hypotheses[0].direction
        tried(each.get(place, [])[1 : 1 + _MORE])
