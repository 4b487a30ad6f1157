"""The nominal machine, refitted first: nobody gets credit for a nuisance parameter.

The motion alone suggests a clearance. A glance, some steps along the surest recording, says how right it is;
where it moves it, the paths of all recordings are sought anew. Then all are followed and fitted.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from clearance.diagnosis.following.attempt import ANNEALING, FOLLOWED, Attempt, explained, refine
from clearance.diagnosis.following.growth import Followed, Start, grow, surest_of
from clearance.diagnosis.hypotheses.clipping import clipped_sensors
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.screening import screen
from clearance.diagnosis.searching.search import PATIENCE, Search
from clearance.diagnosis.sensing.measured import Measured
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model
from clearance.errors import InputError

_GLANCES, _GLANCE = 3, 40  # glances at the clearance, and segments of each
_FACTORS = (1.0, 0.95, 1.05)  # on it, tried one after another
_PATIENTLY = (1.0, 0.975, 1.025, 0.95, 1.05, 0.925, 1.075, 0.9, 1.1, 0.875, 1.125)  # likewise, at last
_SURER = 0.7  # of the doubt about accelerometers before: less asks for new paths
_SAME, _UNSURE = 0.02, 10.0  # change that asks for new paths; misfit from which on looks tell little


def refit_nominal(search: Search) -> Explanation:
    """Refit the nominal machine to all recordings, whose paths the search has traced.

    What accelerometers may do within their tolerances leads the clearance of the motion astray. Where a
    fit that is far off has moved it, paths are sought anew from there, once.
    """
    explanation = _refitted(search)
    clearance = float(explanation.nominal.fit.values[0, 0])
    astray = explanation.nominal.misfit > _UNSURE and abs(np.log(clearance / search.clearance)) > _SAME
    if search.recordings[0].raw is None or not astray or search.late():
        return explanation
    before, recordings = (search.clearance, search.traces, search.starts), search.recordings
    search.retrace_all(clearance)
    other = _refitted(search)
    if other.nominal.misfit < explanation.nominal.misfit:
        return other
    search.clearance, search.traces, search.starts = before
    search.hear(recordings)
    return explanation


def find_nominal(search: Search, explanation: Explanation) -> None:
    """Look for the nominal machine with patience, near the motion's clearance and further from it.

    By few sensors the motion may show another clearance than there is, and a path that strikes hard is lost
    at once with the right one, too. One that is followed then counts if it explains all recordings. Not
    where accelerometers are to be calibrated: these lead the motion astray by themselves (``refit_nominal``).

    Args:
        search: after its nominal stage.
        explanation: whose nominal machine is replaced by one that explains.
    """
    if search.recordings[0].raw is not None:
        return
    model = search.setting.model()
    search.report("the nominal machine is looked for with patience")
    make = partial(follow_nominal, search, model, search.clearance, _PATIENTLY)
    found = search.finished.attempt((), model, make, search.workers)
    if found is None:
        return
    clearance = float(found.fit.values[0, 0])
    search.retrace_all(clearance)
    search.starts = search.finished.starts(
        search.traces, lambda: search.begin(search.traces, model, found.fit.values, PATIENCE)
    )
    explanation.nominal = found
    explanation.hints = screen(found, search.others(found), search.workers).singles
    search.report(f"nominal: misfit {found.misfit:.3g}, clearance {clearance * 1e3:.4f} mm")


def follow_nominal(
    search: Search, model: Model, clearance: float, factors: Sequence[float] = (1.0,)
) -> Attempt | None:
    """The nominal machine on paths of its own, at the first of ``factors`` on a clearance [m] that explains.

    Where one recording is not followed with it from its start no other is tried.
    """
    surest = surest_of(search.starts)
    for factor in factors:
        if search.late():
            return None
        row = np.array([factor * clearance, search.traces[surest].speed])
        try:
            found = grow(search.sought(surest, model, row, PATIENCE), model, row, most=_GLANCE)
            if found is None or not found[2] < FOLLOWED:
                continue
            values = np.array([[found[1][0], trace.speed] for trace in search.traces])
            starts = [search.sought(r, model, row, PATIENCE) for r, row in enumerate(values)]
            attempt = search.grown((), values, starts)
        except (InputError, np.linalg.LinAlgError):  # no motion is near with such a clearance
            continue
        if attempt is not None and explained(attempt):
            return attempt
    return None


def _refitted(search: Search) -> Explanation:
    """The nominal machine, from the clearance that glances end at.

    Sensors that stop at a limit show it: with these limits it is followed first.
    """
    clipped = clipped_sensors(search.recordings, search.groups.values())
    limits = [float(one.start[0]) for one in clipped]
    known = np.array([search.clearance, *limits, search.traces[0].speed])
    model = search.setting.model(clipped).only([0, len(known) - 1], known)
    values = _find_starts(search, model)
    found = search.finished.attempt((), model, lambda: search.grown((), values, model=model), search.workers)
    assert found is not None
    explanation = Explanation(found, agreed=(search.setting.joint, search.profile.best))
    if clipped:
        scale, (clearances, speeds) = max(found.scale, ANNEALING[3]), found.fit.values.T
        plain, paths, begun = search.setting.model(), found.followers, found.fit.values
        nominal = search.finished.attempt(
            (), plain, lambda: refine((), plain, paths, begun, scale, 8, search.workers), search.workers
        )
        assert nominal is not None
        explanation.nominal = nominal
        limited = np.column_stack([clearances, np.tile(limits, (len(speeds), 1)), speeds])
        search.refit(explanation, clipped, found.followers, limited, scale)
    shown = f"clearance {found.fit.values[0, 0] * 1e3:.4f} mm"
    search.report(f"nominal: misfit {explanation.nominal.misfit:.3g}, {shown}")
    return explanation


def _find_starts(search: Search, model: Model) -> np.ndarray:
    """Where recordings are followed from, looked for anew where a glance moves the clearance.

    Returns:
        (recordings, 2) clearance and speed to begin with.
    """
    kept, clearance = list[Start](), search.clearance
    for glance in range(_GLANCES + 1):
        values = np.array([[search.clearance, trace.speed] for trace in search.traces])
        search.starts = search.finished.starts(
            search.traces,
            lambda values=values, kept=kept: search.begin(  # type: ignore[misc]
                search.traces, model, values, 0, kept, 1
            ),
        )
        heard = search.recordings[0].raw is not None
        followed = max(start.doubt for start in search.starts) < FOLLOWED
        if glance == _GLANCES or (glance and followed and not heard):  # fits find what is left of the error
            break
        seen = search.finished.followed(
            "glance",
            lambda values=values: _glanced(search, model, values),  # type: ignore[misc]
        )
        clearance = search.clearance if seen is None else float(seen[1][0])
        surer = seen is not None and _heard(search, seen[0].measured)
        if abs(np.log(clearance / search.clearance)) < _SAME and not surer:
            break
        search.retrace_all(clearance)
        kept = _kept(search, seen[0]) if seen is not None and surer else []
    values[:, 0] = clearance
    for patience in (0, PATIENCE):
        # a machine with which one is followed is right, or nearly: others that are lost are worth patience
        if (patience > 0) == (min(start.doubt for start in search.starts) < FOLLOWED):
            search.starts = search.finished.starts(
                search.traces, partial(search.begin, search.traces, model, values, patience, search.starts)
            )
    return values


def _glanced(search: Search, model: Model, values: np.ndarray) -> Followed | None:
    """Some steps through the surest recording, whose clearance counts; nothing if these tell little."""
    surest = surest_of(search.starts)
    best, misfit = None, _UNSURE
    for factor in _FACTORS:
        row = values[surest] * [factor, 1.0]
        try:
            found = grow(search.starts[surest], model, row, most=_GLANCE)
        except InputError:  # lobes that close the bore
            continue
        if found is not None and found[2] < misfit:
            best, misfit = found, found[2]
        if misfit < FOLLOWED:
            break
    return best


def _heard(search: Search, measured: Measured) -> bool:
    """Go on with what accelerometers were found to do; whether they are known much better than before."""
    before = max(one.widened for one in search.recordings)
    if measured.covariance is None or not measured.widened < _SURER * before:
        return False
    search.hear([one.calibrated(measured.sensors, measured.covariance) for one in search.recordings])
    return True


def _kept(search: Search, seen: Follower) -> list[Start]:
    """The starts, of which the surest has just been followed from, its sensors calibrated."""
    surest = surest_of(search.starts)
    kept = []
    for r, (start, trace) in enumerate(zip(search.starts, search.traces, strict=True)):
        follower = start.follower.part(0, start.follower.segments)
        follower.measured = follower.measured.calibrated(seen.measured.sensors, seen.measured.covariance)
        if r == surest:
            first = seen.measured.first - follower.measured.first
            follower.path.nodes[first : first + seen.segments] = seen.path.nodes
        kept.append(Start(trace, follower, start.island, 0.0 if r == surest else np.inf))
    return kept
