"""In which order explanations are tried: what is likely and cheap first, what is rare and dear last."""

from collections.abc import Callable
from functools import cache
from itertools import takewhile

from clearance.diagnosis.following.attempt import ROOM, Attempt, explained
from clearance.diagnosis.hypotheses.free_form import Curve, unnamed
from clearance.diagnosis.searching.beside import FAR, NEARLY, SHARED
from clearance.diagnosis.searching.confirm import confirm
from clearance.diagnosis.searching.edges import place_edges
from clearance.diagnosis.searching.elsewhere import (
    begin_again,
    begin_elsewhere,
    begin_inside,
    begin_plausible,
    begin_sure,
    rhythm_of,
)
from clearance.diagnosis.searching.explanation import Explanation, Suspected
from clearance.diagnosis.searching.free_search import (
    fit_curve,
    name_curve,
    reshape,
    reshape_anew,
    suggest_curve,
)
from clearance.diagnosis.searching.from_motion import (
    begin_balanced,
    begin_beside,
    begin_clock,
    begin_dimensions,
    begin_displaced,
    begin_pairs,
    begin_wear,
)
from clearance.diagnosis.searching.geometry import (
    GEOMETRIC,
    LOOSE_GUIDE,
    Dimension,
    suggest_channels,
    suggest_dimensions,
)
from clearance.diagnosis.searching.parts import PART, in_part, named, set_aside, unfinished
from clearance.diagnosis.searching.rattling import begin_guide
from clearance.diagnosis.searching.scrutiny import contest, hear, scrutinise
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.shaken import begin_frame, begin_shaking
from clearance.diagnosis.searching.significance import incomplete, unsettled
from clearance.diagnosis.searching.simplify import enlarge, prune, retry_nominal
from clearance.diagnosis.searching.small_force import begin_small_force
from clearance.diagnosis.searching.tables import sharpen
from clearance.diagnosis.searching.wear import WORN
from clearance.diagnosis.searching.widen import deafen, glaring, look, settled, widen
from clearance.diagnosis.searching.work import Balanced

_HALF = 0.5  # of what is missing: a named force that leaves less may stand for one without a name
_FAULTS = 2  # channels without which a fit is tried because the motion contradicts them
_MANY, _ACCUSED = 7, 0.4  # channels of which one can be spared; left of the motion's disagreement without it
_PAIRS = 3  # pairs that are fitted
_BODIES = ("crank", "rod", "slider")  # on which effects that no linear look can judge may do the same


def find_explanation(
    search: Search, explanation: Explanation, most: int, keep: Callable[[Explanation], None]
) -> None:
    """Find what explains the recordings, with as few effects as it takes.

    A frame that its sensors feel shaking comes first, then what promises most of what is missing beside the
    nominal path, a recorder's clock by which the motion agrees much better, and a sensor that alone
    contradicts the nominal machine, or the motion, and a dimension without which the motion hardly agrees.
    Where the path is not near, effects follow that give the torque which the motion needs. Then single
    effects that promise much of what is missing; dimensions that the motion alone points at; where the path
    is near, a force of free form; what acts inside the joint, from plausible sizes, and faulty sensors that
    the motion points at; where the path is near, what gives the torque that the motion needs; where no force
    gives it, a worn bearing, and where the path is far, effects that no linear look can judge; effects and
    faults that promise a good part; in the place of one that explains half, a force of free form. Beside one
    that explains a good part, the next one, and both on paths of their own. Where the path is far, effects
    from plausible sizes; then effects that promised little, since beside a path that is far from right none
    promises much; forces of free form on the slider, or with which most of one recording is explained;
    effects that no linear look can judge; faults that promised little; pairs of which neither shows without
    the other; other tables; the best so far on paths of its own. A table is put to the test against names.
    Where something is left, a load's edges are looked for along the stroke. Named effects that explain are
    followed anew. What explains is looked beside for what is small; where effects leave more than right ones
    do, for others that a linear look cannot judge; where nothing takes away what is too much for a machine
    with nothing missing, effects that a linear look is sure of, then small forces of free form, then effects
    that it cannot judge, are tried on paths of their own. What was put together is followed anew. A named
    force must stand against one of free form in its place. What is not needed is pruned. A nominal machine
    that explains is fitted on the path of what explains more.

    Args:
        search: after its nominal stage.
        explanation: with the nominal attempt; added to.
        most: effects that may be missing together.
        keep: called after each step with what was found so far.
    """
    begin_shaking(search, explanation)
    if not explained(explanation.best):
        _search_all(search, explanation, most, keep)
    if explanation.best.misfit > ROOM and not search.late():
        place_edges(search, explanation)
        if explained(explanation.best):
            enlarge(search, explanation)
        sharpen(search, explanation)
    confirm(search, explanation)
    confirmed = explanation.best
    scrutinise(search, explanation, most)
    if incomplete(explanation.best) and len(explanation.best.hypotheses) < most and not search.late():
        begin_elsewhere(search, explanation, explanation.best)
    retry_nominal(search, explanation)
    if unsettled(explanation) and not search.late():
        begin_sure(search, explanation)
        begin_small_force(search, explanation)
        table = unnamed(explanation.best.hypotheses)
        if unsettled(explanation) or (table is not None and table.body in _BODIES):
            begin_elsewhere(search, explanation, explanation.nominal)
        if explanation.best.hypotheses:
            scrutinise(search, explanation, most)
    if explanation.best is not confirmed or incomplete(explanation.best):
        confirm(search, explanation, at_last=True)
    hear(explanation)
    contest(search, explanation)
    prune(search, explanation)
    retry_nominal(search, explanation)


def _search_all(
    search: Search, explanation: Explanation, most: int, keep: Callable[[Explanation], None]
) -> None:
    nominal = explanation.nominal
    prospects = look(search, explanation, nominal)
    built_on: list[Attempt] = []
    explored = curved = False
    waiting: list[Curve] = []
    pushed: list[Balanced] = []
    suspicious = cache(lambda: suggest_channels(search))
    deafened: list[str] = []
    displaced: Dimension | None = None

    def accused() -> dict[str, float]:
        return dict(list(suspicious().items())[:_FAULTS])

    dimensions = cache(lambda: suggest_dimensions(search, accused()))

    def frame() -> None:
        begin_frame(search, explanation)

    def cushion() -> None:
        if explanation.shut(nominal):  # a sensor that says little of impacts does much of what a film does
            begin_inside(search, explanation, nominal)

    def sensor() -> None:
        channel = glaring(nominal)
        if channel is None and nominal.misfit > FAR and len(search.recordings[0].channels) >= _MANY:
            channel = next((c for c, left in suspicious().items() if left < _ACCUSED), None)
        if channel is not None:
            deafened.append(channel)
            deafen(search, explanation, nominal, channel)

    def clock() -> None:
        if nominal.misfit > FAR:
            begin_clock(search, explanation)

    def dimension() -> None:
        nonlocal displaced
        if nominal.misfit > FAR:
            displaced = begin_displaced(search, explanation, dimensions(), most)

    def balance() -> None:
        if nominal.misfit >= NEARLY:
            pushed.extend(begin_balanced(search, explanation, most))
            best = explanation.best
            # a table that leaves little, or has another period by now, is more than what led its path
            table = unnamed(best.hypotheses) is not None
            told = table and (best.misfit < PART * nominal.misfit or rhythm_of(best) is not None)
            if told and not (_enough(explanation) or search.late()):
                begin_again(search, explanation)

    def balance_near() -> None:  # there a linear look at names is cheaper, and tables finer here than there
        if nominal.misfit < NEARLY and not settled(search, explanation, nominal):
            pushed.extend(begin_balanced(search, explanation, most))

    def obvious() -> None:
        if prospects.obvious:
            widen(search, explanation, nominal, prospects.obvious)
            deafened.extend(c for h in prospects.obvious if (c := h.hypotheses[0].channel) is not None)

    def plain() -> None:
        widen(search, explanation, nominal, prospects.plain)

    def motion() -> None:
        if explanation.rails is None:  # on a frame that gives way they were looked for before
            part = unfinished(explanation, most)
            drives = part in built_on and part.hypotheses[0].name not in GEOMETRIC and _sound(part)
            begin_guide(search, explanation, None, part if drives else None)
        if settled(search, explanation, nominal):
            return
        begin_dimensions(search, explanation, dimensions(), displaced, most)

    def joint() -> None:
        if settled(search, explanation, nominal):
            return
        if not explanation.shut(nominal):
            begin_inside(search, explanation, nominal)
        for channel in accused():
            if channel not in deafened and not settled(search, explanation, nominal):
                deafen(search, explanation, nominal, channel)

    def likely() -> None:
        widen(search, explanation, nominal, prospects.likely)

    def together() -> None:
        if most > 1 and nominal.misfit > FAR and not (built_on or settled(search, explanation, nominal)):
            begin_pairs(search, explanation, pushed)

    def reshaped() -> None:
        best = explanation.best
        nearer = best.misfit - 1.0 < _HALF * (nominal.misfit - 1.0) and unnamed(best.hypotheses) is None
        if nearer and best not in built_on and not settled(search, explanation, nominal):
            reshape(search, explanation, best)

    def plausible() -> None:
        if not (built_on or settled(search, explanation, nominal)):
            begin_plausible(search, explanation, nominal)

    def unlikely() -> None:
        widen(search, explanation, nominal, [h for h in prospects.unlikely if h.hypotheses[0].fault is None])

    def unlikely_faults() -> None:
        faults = [h for h in prospects.unlikely if h.hypotheses[0].fault is not None]
        widen(search, explanation, nominal, faults)

    def build_beside(part: float) -> None:
        before, base = nominal, unfinished(explanation, most)
        while (
            base not in built_on and in_part(explanation, base, before, part) and len(base.hypotheses) < most
        ):
            built_on.append(base)
            if base is explanation.best:
                enlarge(search, explanation)
                if explanation.best is not base and not (_enough(explanation) or search.late()):
                    begin_again(search, explanation)  # the smaller variant may have torn the paths
            if _enough(explanation) or search.late():
                return
            base = unfinished(explanation, most)
            beside, tables = look(search, explanation, base), list[Attempt]()
            if base is explanation.best and not beside.obvious:  # else something is there beside the name
                tables = reshape(search, explanation, base)
                if _enough(explanation) or search.late():
                    return
                if base is not unfinished(explanation, most):
                    base = unfinished(explanation, most)
                    beside = look(search, explanation, base)
            begin_beside(search, explanation, base)
            if settled(search, explanation, base):
                return
            hopeful = beside.promising
            first = list(takewhile(lambda hint: hint.hypotheses[0].name != WORN, hopeful))
            widen(search, explanation, base, first)  # lobes take up much of what promises more than they do
            if len(first) < len(hopeful) and not settled(search, explanation, base):
                begin_wear(search, explanation, base)
                widen(search, explanation, base, hopeful[len(first) :])
            further = explanation.best is not base and unnamed(explanation.best.hypotheses) is None
            if further and not settled(search, explanation, base):
                begin_again(search, explanation)
            if beside.obvious and base is explanation.best and not settled(search, explanation, base):
                tables = reshape(search, explanation, base)
            if not settled(search, explanation, base):
                reshape_anew(search, explanation, base, tables)
            if base.misfit > FAR and not settled(search, explanation, base):
                begin_inside(search, explanation, base)
            if not settled(search, explanation, base):
                begin_elsewhere(search, explanation, base)
            before, base = base, unfinished(explanation, most)

    def build_on(part: float = PART) -> None:
        with set_aside(explanation, most):
            build_beside(part)

    def share() -> None:
        build_on(SHARED)

    def lead() -> None:  # a name that the work led to, of which no table says more, may be one of two
        build_on(PART if unnamed(explanation.best.hypotheses) is not None else SHARED)

    def curve() -> None:
        nonlocal curved
        if curved or settled(search, explanation, nominal):
            return
        curved = True
        found, misfit = suggest_curve(search, nominal)
        if found:
            explanation.suspected = Suspected(found[0].body, found[0].direction, misfit)
        if misfit < max(NEARLY, PART * nominal.misfit) or (found and found[0].body == "slider"):
            fit_curve(search, explanation, found)
        else:
            waiting.extend(found)

    def curve_near() -> None:  # there a linear look has judged names, and one recording tells bodies apart
        if nominal.misfit < NEARLY and not in_part(explanation, named(explanation), nominal, PART):
            curve()

    def elsewhere() -> None:
        nonlocal explored  # beside the nominal machine, or beside a part, which falls away where it is none
        if not (built_on or explored):
            explored = True
            begin_elsewhere(search, explanation, nominal)

    def inside() -> None:
        if explanation.unpushed or any(hint.hypotheses[0].name == WORN for hint in prospects.promising):
            begin_wear(search, explanation, nominal)
        if explanation.unpushed and nominal.misfit > FAR and not settled(search, explanation, nominal):
            elsewhere()

    def pair() -> None:
        for hint in prospects.pairs[:_PAIRS]:
            if not settled(search, explanation, nominal):
                search.follow(explanation, nominal, hint)

    def other_curve() -> None:
        if not settled(search, explanation, nominal):
            fit_curve(search, explanation, waiting)

    def again() -> None:
        if explanation.best is not nominal:
            begin_again(search, explanation)

    steps = (
        frame, build_on, obvious, build_on, cushion, clock, sensor, build_on, dimension, build_on, balance,
        lead, plain, motion, curve_near, joint, build_on, together, build_on, balance_near, inside, likely,
        build_on, reshaped, plausible, build_on, unlikely, build_on, curve, elsewhere, build_on, share,
        unlikely_faults, build_on, pair, build_on, other_curve, again, build_on,
    )  # fmt: skip
    for step in steps:
        if not (_enough(explanation) or search.late()):
            step()
            keep(explanation)
    best = explanation.best
    if unnamed(best.hypotheses) is not None and (explained(best) or not search.late()):
        name_curve(search, explanation)


def _enough(explanation: Explanation) -> bool:
    """Whether the recordings are explained, or a table leaves so little that its shape alone is missing.

    It is not that where a finer table leaves no less. Without the play that its motion shows no machine is
    followed.
    """
    best = explanation.best
    table = unnamed(best.hypotheses) is not None and not _refined(explanation, best)
    if explanation.rails is not None and not any(_loose(a) for a in explanation.attempts):
        return True
    return explained(best) or (table and best.misfit < min(PART * explanation.nominal.misfit, NEARLY))


def _refined(explanation: Explanation, best: Attempt) -> bool:
    """Whether a table with more knots was fitted in the place of the best one."""
    label, knots = best.label, best.model.shared
    return any(a.label == label and a.model.shared > knots for a in explanation.attempts)


def _sound(attempt: Attempt) -> bool:
    return all(hypothesis.fault is None for hypothesis in attempt.hypotheses)


def _loose(attempt: Attempt) -> bool:
    return any(hypothesis.name == LOOSE_GUIDE for hypothesis in attempt.hypotheses)
