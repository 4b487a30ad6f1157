"""Where the recordings' machine was and which joint is loose: what comes before any hypothesis."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from clearance.diagnosis.following.attempt import explained
from clearance.diagnosis.hypotheses.effect import Effect
from clearance.diagnosis.hypotheses.hypothesis import SOME_CLEARANCE, Setting, gather
from clearance.diagnosis.kinematics.agreement import Alignment, aligned
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.nominal import refit_nominal
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.sensing.measured import Measured
from clearance.diagnosis.side_by_side import side_by_side
from clearance.errors import InputError
from clearance.mechanism.slider_crank import SliderCrank

_UNLIKELY = 0.25  # share of the variance that the ideal mechanism must explain


def locate_joint(
    recordings: Sequence[Measured],
    settings: Sequence[Setting],
    effects: Sequence[Effect],
    speed_range: tuple[float, float],
    workers: int,
    report: Callable[[str], None],
    deadline: float = np.inf,
    finished: Path | None = None,
) -> tuple[Search, Explanation, dict[str, float]]:
    """Refit the nominal machine with clearance in each joint that it may be in; the best one is gone on with.

    The joint in which the motion alone agrees better is tried first; where it explains the recordings, the
    other is not tried.

    Args:
        recordings: to fit.
        settings: the nominal machine with each joint that may be loose.
        effects: to make hypotheses of.
        speed_range: [rad/s].
        workers: threads.
        report: called with progress.
        deadline: of the search [s of ``time.monotonic``].
        finished: folder in which fits are kept for another run.

    Returns:
        The search of the joint chosen, its nominal explanation, and the misfit with each joint tried.

    Raises:
        InputError: a recording that no machine of this kind could have made.
    """
    machine = settings[0].with_clearance(SOME_CLEARANCE)
    alignments = side_by_side(
        lambda one: align_plausibly(one, machine, speed_range), list(recordings), workers
    )
    for one, found in zip(recordings, alignments, strict=True):
        report(f"{one.name}: {found.speed * 30 / np.pi:.1f} rpm")
    searches = []
    for setting in settings:
        machine = setting.with_clearance(SOME_CLEARANCE)
        groups = gather(effects, machine, setting.joint, recordings[0].channels)
        search = Search(recordings, alignments, setting, groups, workers, report, deadline, finished)
        search.speed_range = speed_range
        try:
            search.trace()
        except np.linalg.LinAlgError:
            report(f"with clearance in joint {setting.joint} no path of the mechanism is near the recordings")
            continue
        searches.append(search)
    if not searches:
        raise InputError(
            f"{', '.join(one.name for one in recordings)}: channels contradict each other so much that no "
            "motion of this mechanism is near; is a unit or a scale wrong, or a sensor broken?"
        )
    tried: list[tuple[Search, Explanation]] = []
    for search in sorted(searches, key=lambda one: float(one.profile.misfit.min())):
        tried.append((search, refit_nominal(search)))
        if explained(tried[-1][1].best):
            break
    best = min(tried, key=lambda one: one[1].best.misfit)
    return *best, {search.setting.joint: found.best.misfit for search, found in tried}


def align_plausibly(measured: Measured, machine: SliderCrank, speed_range: tuple[float, float]) -> Alignment:
    """Speed and angle of a recording, as of ``aligned``.

    Raises:
        InputError: this mechanism explains next to nothing of it.
    """
    found = aligned(measured, machine, speed_range)
    if found.explained < _UNLIKELY:
        raise InputError(
            f"{measured.name}: this mechanism explains {max(found.explained, 0.0):.0%} of what it shows, at "
            f"its best speed ({found.speed * 30 / np.pi:.0f} rpm); is it another machine's, are channels "
            "swapped, does the crank turn from y to x instead of from x to y, or is its speed outside "
            "speed_range?"
        )
    return found
