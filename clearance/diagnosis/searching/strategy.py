"""What is looked for in which order: an explanation first, then whether it is the right one."""

from collections.abc import Callable

from clearance.diagnosis.following.attempt import ROOM, explained
from clearance.diagnosis.hypotheses.free_form import unnamed
from clearance.diagnosis.searching.argument import choose_argument
from clearance.diagnosis.searching.confirm import confirm
from clearance.diagnosis.searching.course import search_all
from clearance.diagnosis.searching.edges import place_edges
from clearance.diagnosis.searching.elsewhere import begin_elsewhere, begin_inside, begin_sure
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.parts import unfinished
from clearance.diagnosis.searching.scrutiny import compare_kinds, contest, hear, scrutinise
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.shaken import begin_shaking
from clearance.diagnosis.searching.significance import cushioned, incomplete, unsettled
from clearance.diagnosis.searching.simplify import enlarge, prune, retry_nominal
from clearance.diagnosis.searching.small_force import begin_small_force
from clearance.diagnosis.searching.tables import sharpen
from clearance.diagnosis.searching.turned import fit_twins

_BODIES = ("crank", "rod", "slider")  # on which effects that no linear look can judge may do the same


def find_explanation(search: Search, explanation: Explanation, keep: Callable[[Explanation], None]) -> None:
    """Find what explains the recordings, with as few effects as it takes.

    A frame that its sensors feel shaking comes first, then the steps of a ``Course``, or what acts inside a
    joint whose gap a nominal machine that explains has closed. Where something is
    left, a load's edges are looked for along the stroke, and a table is put to the test against names. Named
    effects that explain are followed anew. What explains is looked beside for what is small; where effects
    leave more than right ones do, for what a look beside a nominal machine that explains was sure of, for
    what acts inside the joint, and for what a linear look cannot judge, which is then asked beside the
    nominal machine, too.
    Where nothing takes away what is too much for a machine with nothing missing, effects that a linear look
    is sure of, then small forces of free form, then effects that it cannot judge, are tried on paths of their
    own. What was put together is followed anew, and other kinds of the sensors' faults in it are fitted, too.
    A named force must stand against one of free form in its place, and again where it is left alone by
    pruning what is not needed. A nominal machine that explains is fitted on the path of what explains more,
    and at last one that was lost. Of what a force without a name is a function is asked last, and whether a
    sensor that shows too little may be turned.

    Args:
        search: after its nominal stage.
        explanation: with the nominal attempt; added to.
        keep: called after each step with what was found so far.
    """
    begin_shaking(search, explanation)
    if not explained(explanation.best):
        search_all(search, explanation, keep)
    elif cushioned(explanation, explanation.nominal):
        begin_inside(search, explanation, explanation.nominal)
    if explanation.best.misfit > ROOM and not search.late():
        place_edges(search, explanation)
        if explained(explanation.best):
            enlarge(search, explanation)
        sharpen(search, explanation)
    confirm(search, explanation)
    confirmed = explanation.best
    scrutinise(search, explanation)
    unsure = incomplete(explanation.best) and unsettled(explanation)
    if unsure and not search.late():
        begin_sure(search, explanation)
    base = unfinished(explanation, search.most)
    part = incomplete(explanation.best) and explained(base) and not unsettled(explanation)
    if part and not search.late():
        begin_inside(search, explanation, base, anew=True)
    if incomplete(explanation.best) and len(explanation.best.hypotheses) < search.most and not search.late():
        begin_elsewhere(search, explanation, explanation.best)
    if incomplete(explanation.best) and not search.late():  # it may be none of these
        begin_elsewhere(search, explanation, explanation.nominal)
    retry_nominal(search, explanation)
    if unsettled(explanation) and not search.late():
        if not unsure:
            begin_sure(search, explanation)
        begin_small_force(search, explanation)
        table = unnamed(explanation.best.hypotheses)
        if unsettled(explanation) or (table is not None and table.body in _BODIES):
            begin_elsewhere(search, explanation, explanation.nominal)
        if explanation.best.hypotheses:
            scrutinise(search, explanation)
    if explanation.best is not confirmed or incomplete(explanation.best):
        confirm(search, explanation, at_last=True)
    compare_kinds(search, explanation)
    hear(explanation)
    contest(search, explanation)
    stood = explanation.best
    prune(search, explanation)
    if explanation.best is not stood:  # alone it explains on the path that another effect put right
        contest(search, explanation)
    retry_nominal(search, explanation, at_last=True)
    choose_argument(search, explanation)
    fit_twins(search, explanation)
