"""The steps of the search for an explanation, each a method, and their order."""

from collections.abc import Callable, Sequence
from functools import cached_property

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.following.growth import surest_of
from clearance.diagnosis.hypotheses.free_form import Curve, unnamed
from clearance.diagnosis.kinematics.shaking import LIFTED
from clearance.diagnosis.searching.beside import FAR, NEARLY, SHARED
from clearance.diagnosis.searching.building import build_on
from clearance.diagnosis.searching.elsewhere import (
    begin_again,
    begin_displaced_paths,
    begin_elsewhere,
    begin_inside,
    begin_plausible,
    rhythm_of,
)
from clearance.diagnosis.searching.explanation import Explanation, Suspected
from clearance.diagnosis.searching.free_search import (
    fit_curve,
    name_curve,
    reshape,
    suggest_curve,
)
from clearance.diagnosis.searching.from_motion import (
    begin_clock,
    begin_dimensions,
    begin_displaced,
    begin_wear,
)
from clearance.diagnosis.searching.from_work import begin_balanced, begin_misheard, begin_pairs
from clearance.diagnosis.searching.geometry import (
    CLOCK,
    GEOMETRIC,
    LOOSE_GUIDE,
    Dimension,
    Shown,
    suggest_channels,
    suggest_dimensions,
)
from clearance.diagnosis.searching.nominal import find_nominal
from clearance.diagnosis.searching.parts import PART, enough, in_part, named, unfinished
from clearance.diagnosis.searching.patient import begin_patiently
from clearance.diagnosis.searching.rattling import begin_guide
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.shaken import begin_frame
from clearance.diagnosis.searching.wear import WORN
from clearance.diagnosis.searching.widen import deafen, glaring, look, settled, widen
from clearance.diagnosis.searching.work import Balanced

_HALF = 0.5  # of what is missing: a named force that leaves less may stand for one without a name
_FAULTS = 2  # channels without which a fit is tried because the motion contradicts them
_MANY, _ACCUSED = 7, 0.4  # channels of which one can be spared; left of the motion's disagreement without it
_RAILED = 0.35  # of the motion's disagreement: rails that leave less come before any force
_PAIRS = 3  # pairs that are fitted
_CLEAR = 3  # pairs that a look is clear about
_FAINT = 0.1  # of what is missing: where a near path promises less, two of three lacked what no look judges


def search_all(search: Search, explanation: Explanation, keep: Callable[[Explanation], None]) -> None:
    """Try one step after another until the recordings are explained; arguments as of ``find_explanation``."""
    course = Course(search, explanation)
    for step in STEPS:
        if not course.over():
            step(course)
            keep(explanation)
    best = explanation.best
    if unnamed(best.hypotheses) is not None and (explained(best) or not search.late()):
        name_curve(search, explanation)


class Course:
    """One search from the nominal machine on: each step is a method, which adds to the explanation.

    Attributes:
        prospects: what a linear look beside the nominal path promises.
        built_on: attempts beside which others were looked for.
        waiting: forces of free form that another step has suggested and not fitted.
        pushed: forces that the balance of work suggests.
        deafened: channels without which a fit was tried.
        displaced: the dimension that was tried first.
        railed: whether the motion left no doubt of rails.
        curved, explored: whether forces of free form, and effects that no linear look can judge, were tried.
    """

    def __init__(self, search: Search, explanation: Explanation) -> None:
        self.search, self.explanation = search, explanation
        self.nominal = explanation.nominal
        self.prospects = look(search, explanation, self.nominal)
        self.built_on: list[Attempt] = []
        self.waiting: list[Curve] = []
        self.pushed: list[Balanced] = []
        self.deafened: list[str] = []
        self.displaced: Dimension | None = None
        self.curved = self.explored = self.railed = False

    def over(self) -> bool:
        """Whether the recordings are explained well enough, or time is over."""
        return enough(self.explanation) or self.search.late()

    def frame(self) -> None:
        """A frame that gives way."""
        begin_frame(self.search, self.explanation)

    def obvious(self) -> None:
        """What promises most of what is missing beside the nominal path."""
        if self.prospects.obvious:
            self._widen(self.prospects.obvious)
            self.deafened.extend(
                c for h in self.prospects.obvious if (c := h.hypotheses[0].channel) is not None
            )

    def cushion(self) -> None:
        """What acts inside a joint whose gap was closed, as a film does."""
        if self.explanation.shut(self.nominal):  # a sensor that says little of impacts does much of that, too
            begin_inside(self.search, self.explanation, self.nominal)

    def clock(self) -> None:
        """A recorder's clock by which the motion agrees better."""
        if self.nominal.misfit > FAR:
            begin_clock(self.search, self.explanation)

    def sensor(self) -> None:
        """A sensor that alone contradicts the nominal machine, or the motion."""
        channel = glaring(self.nominal)
        spared = len(self.search.recordings[0].channels) >= _MANY
        if channel is None and self.nominal.misfit > FAR and spared:
            channel = next((c for c, left in self._suspicious.items() if left < _ACCUSED), None)
        if channel is not None:
            self.deafened.append(channel)
            deafen(self.search, self.explanation, self.nominal, channel)

    def dimension(self) -> None:
        """A dimension without which the motion hardly agrees, or a sensor's fault beside a force."""
        if not self.nominal.misfit > FAR:
            return
        first = next(iter(self._dimensions), None)
        fault = first is not None and first.hypothesis.channel is not None and first.share < _ACCUSED
        if first is not None and fault and self.search.most > 1:
            begin_misheard(self.search, self.explanation, first)
        if not self.over():
            self.displaced = begin_displaced(self.search, self.explanation, self._dimensions)

    def rails(self) -> None:
        """A guide that is loose beyond doubt by the motion, or by it with a clock that it accuses.

        Where the slider's own sensor tells of rails, with another dimension, too: no other play moves it so.
        """
        if not self.nominal.misfit > FAR:
            return
        self.railed = begin_guide(self.search, self.explanation, most=_RAILED)
        lifted = all(LIFTED in recording.channels for recording in self.search.recordings)
        for one in self._dimensions:
            asked = one.hypothesis.name == CLOCK or (lifted and one.hypothesis.fault is None)
            if asked and not (self.railed or self.over()):
                shown = Shown.alone(self.search, one)
                self.railed = begin_guide(self.search, self.explanation, shown, most=_RAILED)

    def balance(self) -> None:
        """Where the path is far, what gives the torque that the motion needs."""
        if self.nominal.misfit >= NEARLY:
            self.pushed.extend(begin_balanced(self.search, self.explanation))
            best = self.explanation.best
            # a table that leaves little, or has another period by now, is more than what led its path
            table = unnamed(best.hypotheses) is not None
            told = table and (best.misfit < PART * self.nominal.misfit or rhythm_of(best) is not None)
            if told and not self.over():
                begin_again(self.search, self.explanation)

    def lead(self) -> None:
        """Beside a name that the work led to, of which no table says more: it may be one of two."""
        self.build_on(PART if unnamed(self.explanation.best.hypotheses) is not None else SHARED)

    def plain(self) -> None:
        """Single effects that promise much of what is missing; beside a near path two that do together."""
        self._widen(self.prospects.plain)
        if self.search.most > 1 and self.nominal.misfit < NEARLY:
            for pair in self.prospects.clear[:_CLEAR]:
                if not self._settled():
                    self.search.follow(self.explanation, self.nominal, pair)

    def motion(self) -> None:
        """A guide that is loose, and dimensions that the motion alone points at."""
        if self.explanation.rails is None:  # on a frame that gives way they were looked for before
            part = unfinished(self.explanation, self.search.most)
            drives = part in self.built_on and _forces(part)
            if drives:
                sizes = part.fit.values[0, 1 : part.model.shared]
                begin_guide(self.search, self.explanation, None, part.hypotheses, sizes)
            elif not self.railed:
                begin_guide(self.search, self.explanation)
        if not self._settled():
            begin_dimensions(self.search, self.explanation, self._dimensions, self.displaced)

    def curve_near(self) -> None:
        """Forces of free form beside a near path, where a look has judged names and tells bodies apart."""
        near = self.nominal.misfit < NEARLY
        if near and not in_part(self.explanation, named(self.explanation), self.nominal, PART):
            self.curve()

    def joint(self) -> None:
        """What acts inside the joint, from plausible sizes, and sensors that the motion points at."""
        if self._settled():
            return
        if not self.explanation.shut(self.nominal):
            begin_inside(self.search, self.explanation, self.nominal)
        for channel in self._accused:
            if channel not in self.deafened and not self._settled():
                deafen(self.search, self.explanation, self.nominal, channel)

    def unjudged(self) -> None:
        """Beside a near path where a look promises next to nothing, what no linear look can judge."""
        if self.nominal.misfit < NEARLY and self.prospects.share < _FAINT and not self._settled():
            self.elsewhere()

    def together(self) -> None:
        """Pairs that give the torque which the motion needs."""
        if self.search.most > 1 and self.nominal.misfit > FAR and not (self.built_on or self._settled()):
            begin_pairs(self.search, self.explanation, self.pushed)

    def balance_near(self) -> None:
        """The same as ``balance`` where names are cheaper by a look, and tables finer here than there."""
        if self.nominal.misfit < NEARLY and not self._settled():
            self.pushed.extend(begin_balanced(self.search, self.explanation))

    def inside(self) -> None:
        """Where no force gives the torque, a worn bearing, and effects that no linear look can judge."""
        unpushed = self.explanation.unpushed
        if unpushed or any(hint.hypotheses[0].name == WORN for hint in self.prospects.promising):
            begin_wear(self.search, self.explanation, self.nominal)
        if unpushed and self.nominal.misfit > FAR and not self._settled():
            self.elsewhere()

    def likely(self) -> None:
        """Effects and faults that promise a good part."""
        self._widen(self.prospects.likely)

    def reshaped(self) -> None:
        """In the place of a name that explains half, a force of free form."""
        best = self.explanation.best
        half = best.misfit - 1.0 < _HALF * (self.nominal.misfit - 1.0)
        if half and unnamed(best.hypotheses) is None and best not in self.built_on and not self._settled():
            reshape(self.search, self.explanation, best)

    def plausible(self) -> None:
        """Effects from plausible sizes."""
        if not (self.built_on or self._settled()):
            begin_plausible(self.search, self.explanation, self.nominal)

    def unlikely(self) -> None:
        """Effects that promised little: beside a path that is far from right none promises much."""
        self._widen([h for h in self.prospects.unlikely if h.hypotheses[0].fault is None])

    def curve(self) -> None:
        """Forces of free form on the slider, or with which most of one recording is explained."""
        if self.curved or self._settled():
            return
        self.curved = True
        found, misfit = suggest_curve(self.search, self.nominal)
        if not found:
            return
        self.explanation.suspected = Suspected(found[0].body, found[0].direction, misfit)
        near = max(NEARLY, PART * self.nominal.misfits[surest_of(self.search.starts)])
        if misfit < near or found[0].body == "slider":
            fit_curve(self.search, self.explanation, found)
        else:
            self.waiting.extend(found)

    def elsewhere(self) -> None:
        """Effects that no linear look can judge, unless they were looked for beside a part."""
        if not (self.built_on or self.explored):
            self.explored = True
            begin_elsewhere(self.search, self.explanation, self.nominal)

    def displaced_paths(self) -> None:
        """The same, and what acts inside the joint, from other clearances than the nominal one."""
        if not self._settled():
            begin_displaced_paths(self.search, self.explanation)

    def share(self) -> None:
        """Beside what explains a share only."""
        self.build_on(SHARED)

    def unlikely_faults(self) -> None:
        """Faults that promised little."""
        self._widen([h for h in self.prospects.unlikely if h.hypotheses[0].fault is not None])

    def pair(self) -> None:
        """Pairs of which neither shows without the other."""
        for hint in self.prospects.pairs[:_PAIRS]:
            if not self._settled():
                self.search.follow(self.explanation, self.nominal, hint)

    def patience(self) -> None:
        """One effect after another with patience, where no machine is followed nearly."""
        explanation = self.explanation
        lost = self.nominal.misfit > FAR and explanation.best.misfit > NEARLY
        if lost and explanation.rails is None and not self._settled():
            begin_patiently(self.search, explanation, self._dimensions)

    def other_curve(self) -> None:
        """Forces of free form that waited."""
        if not self._settled():
            fit_curve(self.search, self.explanation, self.waiting)

    def again(self) -> None:
        """The best so far on paths of its own."""
        if self.explanation.best is not self.nominal:
            begin_again(self.search, self.explanation)

    def lost(self) -> None:
        """The nominal machine once more, with patience, where nothing is followed nearly."""
        if self.explanation.best.misfit > FAR and self.explanation.rails is None:
            find_nominal(self.search, self.explanation)

    def build_on(self, part: float = PART) -> None:
        """Beside what explains a good part, the next one, and so on."""
        build_on(self.search, self.explanation, self.nominal, self.built_on, part)

    def _widen(self, hints: Sequence[Hint]) -> None:
        widen(self.search, self.explanation, self.nominal, hints)

    def _settled(self) -> bool:
        return settled(self.search, self.explanation, self.nominal)

    @cached_property
    def _suspicious(self) -> dict[str, float]:
        return suggest_channels(self.search)

    @property
    def _accused(self) -> dict[str, float]:
        return dict(list(self._suspicious.items())[:_FAULTS])

    @cached_property
    def _dimensions(self) -> list[Dimension]:
        """Dimensions and faults at which the motion points; what the best dimension leaves is noted."""
        found = suggest_dimensions(self.search, self._accused)
        shares = [one.share for one in found if one.hypothesis.name in GEOMETRIC]
        self.explanation.misplaced = min(shares, default=float("inf"))
        return found


STEPS: tuple[Callable[[Course], None], ...] = (
    Course.frame, Course.build_on, Course.obvious, Course.build_on, Course.cushion, Course.clock,
    Course.sensor, Course.build_on, Course.dimension, Course.build_on, Course.rails, Course.balance,
    Course.lead, Course.plain, Course.motion, Course.curve_near, Course.joint, Course.unjudged,
    Course.build_on, Course.together, Course.build_on, Course.balance_near, Course.inside, Course.likely,
    Course.build_on,
    Course.reshaped, Course.plausible, Course.build_on, Course.unlikely, Course.build_on, Course.curve,
    Course.elsewhere, Course.build_on, Course.share, Course.unlikely_faults, Course.build_on,
    Course.patience, Course.build_on, Course.pair, Course.build_on,
    Course.displaced_paths, Course.build_on, Course.other_curve, Course.again, Course.build_on, Course.lost,
)  # fmt: skip
"""What is likely and cheap first, what is rare and dear last; what explains a part is built on at once."""


def _forces(attempt: Attempt) -> bool:
    """Whether it says what drives alone: not where anything is, nor what a sensor makes of it."""
    places = (LOOSE_GUIDE, *GEOMETRIC)
    return all(one.fault is None and one.name not in places for one in attempt.hypotheses)
