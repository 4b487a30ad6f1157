"""Beside what was found so far: which hypotheses promise to explain more, and what comes of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from clearance.diagnosis.following.attempt import (
    ANNEALING,
    EXPLAINED,
    FOLLOWED,
    POOR,
    Attempt,
    explained,
    refine,
)
from clearance.diagnosis.following.growth import Start
from clearance.diagnosis.following.trace import Trace
from clearance.diagnosis.kinematics.agreement import profile
from clearance.diagnosis.searching.beside import HALFWAY, NEARLY, beside
from clearance.diagnosis.searching.explanation import Explanation
from clearance.diagnosis.searching.misheard import kinds, misheard
from clearance.diagnosis.searching.screening import Hint, screen
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.shooting.follow import EDGE
from clearance.errors import InputError

_FITTED = 4  # hypotheses of one screening that are fitted
_HOPEFUL = 0.1  # of the best one's gain: less is not fitted
_LITTLE = 1e-3  # misfit above a perfect model's: less is nothing to take shares of
_LIKELY = 0.04  # of what is missing: effects that were right promised 5 to 90 %, others 0 to 6 %
_OBVIOUS = 0.55  # of it: in four trials what promised that much was right, 20 of 20, however far the path
_PLAIN = 0.3  # of it: such effects come early
_DEAF = 2  # channels without which a fit is tried
_RIVAL = 1.2  # times the misfit of the likeliest fault: on paths that are not final others may be right
_CLEARLY = 1.3  # times what the best single one promises: two that promise more show together
_FAR_BETTER = 0.05  # of the nominal misfit: such an effect is right, or nearly
_LEFT = 0.5  # of what is missing beside a near path: more is left where no sensor is at fault
_CLIPPED, _LOUD, _QUIET = 9.0, 3.0, 1.5  # squares of residuals; means of a channel that glares, of others


@dataclass(frozen=True)
class Prospects:
    """What one look at all hypotheses suggests, most promising ones first.

    Attributes:
        obvious: the single hypothesis that promises most of what is missing, if one does.
        plain: others that promise much of it.
        likely: others that promise a good part of it.
        unlikely: others, which promise much less than that.
        pairs: of hypotheses.
        clear: those of them that promise much of it, and clearly more than either alone.
        share: of what is missing: what the best single one promises.
    """

    obvious: list[Hint]
    plain: list[Hint]
    likely: list[Hint]
    unlikely: list[Hint]
    pairs: list[Hint]
    clear: list[Hint] = field(default_factory=list)
    share: float = 1.0

    @property
    def promising(self) -> list[Hint]:
        """Single hypotheses that promise at least a good part of what is missing, the best first."""
        return [*self.obvious, *self.plain, *self.likely]


def look(search: Search, explanation: Explanation, base: Attempt) -> Prospects:
    """What points where the misfit points beside ``base``."""
    search.report(f"looking at all hypotheses beside {base.label}")
    found = screen(base, search.others(base), search.workers)
    explanation.hints = explanation.hints or found.singles
    singles = sorted([*found.singles, *misheard(search, base)], key=lambda hint: -hint.gain)
    missing = max(base.misfit - 1.0, _LITTLE) * sum(p.samples for p in base.fit.passes)
    for hint in singles[:5]:
        search.report(f"  {hint.label}: promises {hint.gain / missing:.1%} of what is missing")
    best = singles[0].gain if singles else 0.0
    hopeful = [_pushed(hint, explanation) for hint in singles if hint.gain > _HOPEFUL * best]
    obvious = [hint for hint in hopeful[:1] if hint.gain > _OBVIOUS * missing]
    plain = [hint for hint in hopeful[len(obvious) :] if hint.gain > _PLAIN * missing]
    promising = sum(hint.gain > _LIKELY * missing for hint in hopeful)
    likely = hopeful[len(obvious) + len(plain) : promising]
    clear = [pair for pair in found.pairs if pair.gain > max(_PLAIN * missing, _CLEARLY * best)]
    return Prospects(obvious, plain, likely, hopeful[promising:], found.pairs, clear, best / missing)


def _pushed(hint: Hint, explanation: Explanation) -> Hint:
    """A hint with the sizes that the balance of work gave: no slope tells where a load begins and ends."""
    for hypothesis, values in explanation.pushes:
        if hypothesis.label == hint.label:
            return replace(hint, hypotheses=(hypothesis,), values=values)
    return hint


def widen(search: Search, explanation: Explanation, base: Attempt, hints: Sequence[Hint]) -> None:
    """Fit what some hints suggest beside ``base``, until something explains the recordings.

    First effects, most promising ones first; then deaf channels, whose sensors may be at fault.
    """
    for hint in hints[:_FITTED]:
        if not settled(search, explanation, base):
            search.follow(explanation, base, hint)
    if not settled(search, explanation, base):
        search.follow_best(explanation, base, hints[:_FITTED])
    loud = [hint.hypotheses[0].channel for hint in hints]
    for channel in list(dict.fromkeys(c for c in loud if c is not None))[:_DEAF]:
        if not settled(search, explanation, base):
            deafen(search, explanation, base, channel)


def settled(search: Search, explanation: Explanation, base: Attempt) -> bool:
    """Whether nothing else is tried beside ``base``: nearly all that it leaves is explained, or time over."""
    best = explanation.best
    further = len(best.hypotheses) > len(base.hypotheses)
    nearly = best.misfit < min(_FAR_BETTER * explanation.nominal.misfit, NEARLY)
    much = best.misfit - 1.0 < _LEFT * (base.misfit - 1.0)
    return explained(best) or (further and nearly and much) or search.late()


def glaring(base: Attempt) -> str | None:
    """The channel that alone contradicts an attempt, while the noise explains all others; else ``None``."""
    if base.scale > 1.0:  # paths that are smoothed contradict every channel
        return None
    squares = [np.minimum(one.residual[EDGE:-EDGE] ** 2, _CLIPPED) for one in base.fit.passes]
    square = np.mean([one.mean(axis=(0, 1)) for one in squares], axis=0)
    loudest = int(np.argmax(square))
    if square[loudest] < _LOUD or (np.delete(square, loudest) > _QUIET).any():
        return None
    return base.followers[0].measured.channels[loudest]


def deafen(search: Search, explanation: Explanation, base: Attempt, channel: str) -> None:
    """Fit without a channel: where that explains everything, its sensor is at fault; how, is fitted."""
    try:
        found = _deaf(search, explanation, base, channel)
    except (InputError, np.linalg.LinAlgError):
        return
    if found is None:
        return
    search.report(f"without {channel}: misfit {found.misfit:.3g}")
    if not found.misfit < max(EXPLAINED, HALFWAY * base.misfit):
        return
    hearing = [f.part(0, f.segments) for f in found.followers]
    for follower, trace in zip(hearing, search.traces, strict=True):
        first = follower.measured.first - trace.measured.first
        follower.measured = trace.measured.part(first, first + follower.segments)
    best = np.inf
    for hypothesis, added, misfit in kinds(search, found, hearing, channel):
        if explained(explanation.best) and misfit > _RIVAL * best:
            return
        best = min(best, misfit)
        held, values = beside(found, [hypothesis], added)
        search.refit(explanation, held, hearing, values, ANNEALING[2])


def _deaf(search: Search, explanation: Explanation, base: Attempt, channel: str) -> Attempt | None:
    """What is left of an attempt's misfit without a channel."""
    deaf, values = [start.without(channel) for start in search.starts], base.fit.values
    misled = base.misfit > FOLLOWED and glaring(base) != channel
    if base is explanation.nominal and misled:  # the path, by that channel, too
        deaf, values = unheard(search, channel)
    elif base.scale <= 1.0:  # the path is near: what the channel contradicts shows beside it
        followers = [f.part(0, f.segments) for f in base.followers]
        for follower in followers:
            follower.measured = follower.measured.without(channel)
        near = refine(base.hypotheses, base.model, followers, values, 1.0, 8, search.workers)
        if not near.misfit < 1.0 + _LEFT * (base.misfit - 1.0):
            return near
    return search.grown(base.hypotheses, values, deaf, max(base.misfit, POOR))


def unheard(search: Search, channel: str) -> tuple[list[Start], np.ndarray]:
    """Where recordings can be followed from without a channel; (recordings, 2) clearances and speeds."""
    recordings = [one.without(channel) for one in search.recordings]
    clearance = profile(recordings, search.alignments, search.setting.with_clearance, search.workers).best
    machine = search.setting.with_clearance(clearance)
    traces = [Trace.of(*one, machine) for one in zip(recordings, search.alignments, strict=True)]
    values = np.array([[clearance, trace.speed] for trace in traces])
    search.report(f"without {channel} the motion suggests a clearance of {clearance * 1e3:.3f} mm")
    return search.begin(traces, search.setting.model(), values), values
