"""What the motion alone says of the mechanism's dimensions and of its sensors, before any force is believed.

The path that the accelerations show (``kinematics.reconstruction``) must fit the links, the guide, the gaps
of the joints and every channel. Where a dimension or a sensor is wrong it does not, whatever moves the
machine; a force that is missing leaves the agreement as it is. On the plant's machines a guide line that lies
elsewhere or play in the other joint, once put right, lowers the disagreement to a seventh or to three
quarters; where it is small from the start, play takes up a little of what friction does. Without a sensor at
fault a third is left, without another one two thirds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.kinematics.agreement import (
    CLEARANCES,
    COMPARED,
    Alignment,
    Profile,
    agreement,
    loose,
    profile,
)
from clearance.diagnosis.kinematics.carried import Carried, tell_clearance
from clearance.diagnosis.kinematics.lift import gaps, measure_gap
from clearance.diagnosis.kinematics.reconstruction import Reconstruction, reconstruct
from clearance.diagnosis.kinematics.shaking import LIFTED
from clearance.diagnosis.searching.explanation import Rails
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.measured import SAMPLES, Measured
from clearance.errors import InputError
from clearance.mechanism.parameters import Parameter
from clearance.mechanism.slider_crank import SliderCrank

SECOND = "second_clearance"
GEOMETRIC = ("slider_offset", SECOND)
"""Effects that change where the links can be."""
LOOSE_GUIDE, FRAME, CLOCK = "guide_clearance", "flexible_base", "timebase"

_MULTIPLES = np.outer([-1.0, 1.0], [0.3, 0.7, 1.5, 3.0, 7.0, 15.0, 40.0]).ravel()  # of a plausible size
_WITHIN = 2.5  # times larger or smaller than the best one of these
_CLEARLY = 0.9  # of the disagreement without it
_MUCH = 0.25  # by which it falls at least: below, a second gap takes up what a friction does (0.2 seen)
_SMALL = 4  # of the clearances that are compared: at smaller ones motions differ little
_MISLED = 0.5  # of the disagreement: less is left without a channel whose sensor is at fault
RAILED = 0.6
"""Likewise, between the right rails."""
_CARRIED = 0.66  # likewise, of slider and force through a loose joint: the right clearance leaves less
_ALIKE = 1.7  # times the smallest gap that a recording shows there, the largest one
_SHOWN = 5.0  # times the noise: what a slider that leaves its line shows
_SYSTEMATIC = 0.1  # of a clearance or a gap: a shoe that tilts lies elsewhere than one that does not
_CLOSER = 8  # sizes that are compared around the best one
_TURNS = 3  # while it helps; beside a wrong clock the motion shows a clearance five times too large


@dataclass(frozen=True)
class Dimension:
    """A dimension, or the size of a sensor's fault, with which the motion agrees better.

    Attributes:
        hypothesis: that it differs.
        value: at which the motion agrees best.
        clearance: beside it [m].
        share: of the disagreement that is left.
    """

    hypothesis: Hypothesis
    value: float
    clearance: float
    share: float


@dataclass(frozen=True)
class Shown:
    """Effects that the motion alone shows, beside which others are looked for.

    Attributes:
        hypotheses: these effects.
        sizes: of their parameters.
        deviations: standard deviations of these.
        profile: how well the motion agrees with each clearance beside them.
    """

    hypotheses: tuple[Hypothesis, ...]
    sizes: np.ndarray
    deviations: np.ndarray
    profile: Profile

    @staticmethod
    def nothing(search: Search) -> "Shown":
        """The nominal machine."""
        return Shown((), np.zeros(0), np.zeros(0), search.profile)

    @staticmethod
    def alone(search: Search, one: "Dimension") -> "Shown":
        """One dimension, or a fault that is undone."""
        size = np.array([one.value])
        shown = Shown((one.hypothesis,), size, _SYSTEMATIC * np.abs(size), search.profile)
        setting = search.setting.added(shown.hypotheses, size)
        recordings, workers = shown.undone(search), search.workers
        beside = profile(recordings, search.alignments, setting.with_clearance, workers)
        return replace(shown, profile=beside)

    def undone(self, search: Search) -> list[Measured]:
        """The recordings without the faults that are among these effects."""
        if all(hypothesis.fault is None for hypothesis in self.hypotheses):
            return search.recordings
        model = search.setting.model(self.hypotheses)
        instrument = model.instrument(np.concatenate([[np.nan], self.sizes, [np.nan]]))
        return [one.undone(instrument) for one in search.recordings]


def suggest_channels(search: Search) -> dict[str, float]:
    """Channels without which the motion agrees much better, the most suspicious one first: what is left.

    At whichever clearance: a gain of 0.85 led that of the motion from 0.121 to 0.504 mm, at which the other
    channels disagree, too.
    """
    clearances = [search.profile.best, *CLEARANCES[_SMALL::2]]
    machines = [search.setting.with_clearance(one) for one in clearances]
    recordings, channels = search.recordings, search.recordings[0].channels

    def disagree(heard: list[Measured]) -> float:
        return float(agreement(heard, search.alignments, machines, COMPARED // 2, search.workers).min())

    whole = disagree(recordings)
    shares = {c: disagree([one.without(c) for one in recordings]) / whole for c in channels}
    found = {c: shares[c] for c in sorted(channels, key=lambda c: shares[c]) if shares[c] < _MISLED}
    for channel, share in found.items():
        search.report(f"  without {channel} {share:.0%} of the motion's disagreement are left")
    return found


def suggest_dimensions(search: Search, channels: Mapping[str, float]) -> list[Dimension]:
    """Dimensions and faults with which the motion agrees clearly better, the best one first.

    Args:
        search: after its nominal stage.
        channels: whose sensors may be at fault, with what is left of the disagreement without each; unless
            a dimension leaves less.
    """
    found: list[Dimension] = []
    single = [group[0] for group in search.groups.values() if len(group[0].unknowns) == 1]
    single.sort(key=lambda one: one.fault is not None)
    for hypothesis in single:
        possible = hypothesis.name in (*GEOMETRIC, CLOCK)
        if hypothesis.channel is not None and hypothesis.channel in channels:
            left = channels[hypothesis.channel]
            possible = all(left < one.share for one in found if one.hypothesis.fault is None)
        best = _dimension(search, hypothesis) if possible else None
        if best is not None:
            _tell(search, best)
            found.append(best)
    return sorted(found, key=lambda one: one.share)


def suggest_clock(search: Search) -> Dimension | None:
    """A recorder's clock that runs fast or slow, where the motion agrees much better by another one.

    Nothing else alters every channel alike, so that no force is to be looked for before that.
    """
    hypothesis = next((group[0] for group in search.groups.values() if group[0].name == CLOCK), None)
    best = None if hypothesis is None else _dimension(search, hypothesis)
    if best is None or best.share > _MISLED:
        return None
    _tell(search, best)
    return best


def suggest_guide(search: Search, shown: Shown, most: float = RAILED) -> Dimension | None:
    """Play of the slider in its guide, where its height along the motion shows rails and the motion agrees.

    Args:
        search: with its recordings.
        shown: what else the motion shows.
        most: of the motion's disagreement that rails may leave; not asked through a loose joint C.

    The widest gap of all recordings; where C is ideal and the rod's end shows them the narrowest, since that
    came out 4 to 23 % too wide on seven machines of the plant by 1 % noise.

    Raises:
        LinAlgError: a linkage that does not turn.
    """
    hypothesis = next((g[0] for g in search.groups.values() if g[0].name == LOOSE_GUIDE), None)
    alignments, workers = search.alignments, search.workers
    if hypothesis is None:
        return None
    recordings = shown.undone(search)
    setting = search.setting.added(shown.hypotheses, shown.sizes)
    nominal = setting.with_clearance(shown.profile.best)
    paths = [_compared(one, known, nominal) for one, known in zip(recordings, alignments, strict=True)]
    stiffness = float(hypothesis.apply(nominal, hypothesis.start).parameters()[Parameter.GUIDE_STIFFNESS])
    period = 1.0 / recordings[0].chain.rate
    through = [path.carried for path in paths if path.carried is not None]
    if through:
        return _through_joint(search, hypothesis, through, stiffness)
    seen = [path.across for path in paths if path.across is not None]
    if not seen or any(one.slider.std() < _SHOWN * one.doubt for one in seen):
        return None
    told = gaps(seen, stiffness, period)
    if not told:
        return None
    gap = max(told) if LIFTED in recordings[0].channels else min(told)
    size = np.array([gap])
    beside = profile(
        recordings, alignments, lambda c: hypothesis.apply(setting.with_clearance(c), size), workers
    )
    share = float(beside.misfit.min() / shown.profile.misfit.min())
    if share > most:
        return None
    search.report(
        f"  the slider strikes rails that leave it {gap * 1e6:.3g} um on each side, with a clearance of "
        f"{beside.best * 1e3:.3f} mm: {share:.0%} of the motion's disagreement are left"
    )
    return Dimension(hypothesis, gap, beside.best, share)


def _through_joint(
    search: Search, hypothesis: Hypothesis, through: Sequence[Carried], stiffness: float
) -> Dimension | None:
    """Play in the guide, seen through a loose joint C; what is left is that of slider and force.

    Of nine machines of the plant seven showed rails: the clearance off by 0 to 5 % on four with a sensor
    along the guide, by 8 to 28 % on three by the rod's four or 5 % noise, the gap by 1 to 10 %, once by half.
    """
    clearance, share = tell_clearance(through)
    if share > _CARRIED:
        return None
    told = gaps([one.across(clearance) for one in through], stiffness, through[0].period)
    if not told or max(told) > _ALIKE * min(told):
        return None
    search.report(
        f"  through the loose joint the slider strikes rails that leave it {max(told) * 1e6:.3g} um on each "
        f"side, with a clearance of {clearance * 1e3:.3f} mm: {share:.0%} of what disagrees are left"
    )
    return Dimension(hypothesis, max(told), clearance, share)


def measure_rails(search: Search, guide: Dimension, shown: Shown) -> Rails:
    """How wide the play is that a slider's motion shows, on the path between such rails.

    Args:
        search: after its nominal stage.
        guide: of ``suggest_guide``.
        shown: likewise.
    """
    setting = search.setting.added(shown.hypotheses, shown.sizes)
    machine = guide.hypothesis.apply(setting.with_clearance(guide.clearance), np.array([guide.value]))
    gaps, weights = [], []
    for one, known in zip(shown.undone(search), search.alignments, strict=True):
        path = _compared(one, known, machine)
        assert path.across is not None  # the guide was suggested by it
        gap, sd = measure_gap(path.across, guide.value, 1.0 / one.chain.rate)
        gaps.append(gap)
        weights.append(sd**-2)
    gap = float(np.average(gaps, weights=weights))
    doubts = [sum(weights) ** -0.5, _SYSTEMATIC * gap, gap - guide.value]  # two ways to tell it may differ
    own = [_SYSTEMATIC * guide.clearance, float(np.linalg.norm(doubts))]
    return Rails(guide.clearance, gap, np.append(own, shown.deviations), shown.hypotheses, shown.sizes)


def _tell(search: Search, one: Dimension) -> None:
    search.report(
        f"  the motion agrees with {one.hypothesis.label} = {one.value:.3g} and a clearance of "
        f"{one.clearance * 1e3:.3f} mm: {one.share:.0%} of the disagreement are left"
    )


def _compared(one: Measured, known: Alignment, machine: SliderCrank) -> Reconstruction:
    return reconstruct(
        one, machine.parameters(), loose(machine), known.speed, known.angle, COMPARED * SAMPLES
    )  # fmt: skip


def _dimension(search: Search, hypothesis: Hypothesis) -> Dimension | None:
    (off,), (unknown,) = hypothesis.off, hypothesis.unknowns
    off = off if np.isfinite(off) else 0.0
    sizes = off + _MULTIPLES * (hypothesis.start[0] - off)
    sizes = sizes[(sizes >= unknown.low) & (sizes <= unknown.high)]

    def machine(clearance: float, size: float) -> SliderCrank:
        nominal = search.setting.with_clearance(clearance)
        return nominal if hypothesis.fault else hypothesis.apply(nominal, np.array([size]))

    def heard(size: float) -> list[Measured]:
        if hypothesis.fault is None:
            return search.recordings
        instrument = hypothesis.fault(Instrument(), np.array([size]))
        return [one.undone(instrument) for one in search.recordings]

    def disagree(clearance: float, size: float) -> float:
        try:
            machines = [machine(clearance, size)]
            return float(agreement(heard(size), search.alignments, machines, COMPARED, search.workers)[0])
        except InputError:
            return float("inf")

    def clearance_with(size: float) -> float:
        return profile(heard(size), search.alignments, lambda c: machine(c, size), search.workers).best

    nominal = [search.setting.with_clearance(search.profile.best)]
    without = float(agreement(search.recordings, search.alignments, nominal, COMPARED, search.workers)[0])
    tried = [disagree(search.profile.best, size) for size in sizes]
    if not tried or not min(tried) < min(_CLEARLY * without, without - _MUCH):
        return None
    size = float(sizes[int(np.argmin(tried))])
    best: Dimension | None = None
    for _ in range(_TURNS):  # the clearance that goes with the size, the size that goes with it, and again
        beside = clearance_with(size)
        low, high = sorted((off + (size - off) / _WITHIN, off + (size - off) * _WITHIN))
        closer = minimize_scalar(
            lambda one, c=beside: disagree(c, float(one)), method="bounded",
            bounds=(max(low, unknown.low), min(high, unknown.high)), options={"maxiter": _CLOSER},
        )  # fmt: skip
        if not closer.fun < (_CLEARLY * without if best is None else _CLEARLY * best.share * without):
            break  # at another clearance it is no better
        size = float(closer.x)
        best = Dimension(hypothesis, size, beside, float(closer.fun / without))
    return best
