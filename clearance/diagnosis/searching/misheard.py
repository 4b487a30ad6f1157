"""What a sensor made of what it felt, beside a path that the other ones tell."""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.following.attempt import Attempt
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.searching.screening import Hint
from clearance.diagnosis.searching.search import Search
from clearance.diagnosis.searching.significance import SURE
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.suspicion import disagreement, steady, suspect
from clearance.diagnosis.shooting.follow import Follower

_SUSPECTED = 3  # faults of a channel that are fitted
_LOUD = 1.1  # sigma that a channel is off by, where no sensor's fault is to be looked for below
_LEFT = 0.3  # of it: a fault that is right leaves less
_BENT = 0.7  # of it: a resonance that is, of a channel which had a share in leading the path astray
_RESONANCE = "sensor_resonance"


def misheard(search: Search, base: Attempt) -> list[Hint]:
    """The fault that would explain the channel which contradicts ``base`` most, if it surely would.

    No linear look judges a resonance, since without one there is none to take a derivative by; nor a delay
    where impacts make the signal: one that comes two samples late leaves no slope at no delay.
    """
    if base.scale > 1.0:  # paths that are smoothed contradict every channel
        return []
    measured = base.followers[0].measured
    # in the units of ``kinds``, whose misfit it is compared with, and so in the same segments
    recorded, predicted, sigma = side_by_side(base, base.followers)
    residuals = (predicted - recorded) / sigma
    calm = [residuals[steady(residuals, [i])][..., i].ravel() for i in range(residuals.shape[2])]
    each = np.array([float(disagreement(one[:, None])[0]) for one in calm])
    each[measured.filtered :] = 0.0
    each[[measured.channels.index(h.channel) for h in base.hypotheses if h.channel]] = 0.0
    loudest = int(np.argmax(each))
    if each[loudest] < _LOUD:
        return []
    found = kinds(search, base, base.followers, measured.channels[loudest])
    hints = [
        Hint((hypothesis,), values, len(calm[loudest]) * float(each[loudest] ** 2 - misfit**2))
        for hypothesis, values, misfit in found[:1]
        # others take up what a bad impact leaves
        if misfit - 1.0 < (_BENT if hypothesis.name == _RESONANCE else _LEFT) * (each[loudest] - 1.0)
    ]
    return [hint for hint in hints if hint.gain > SURE]


def side_by_side(base: Attempt, hearing: Sequence[Follower]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What was recorded, what an attempt predicts by the recorder's clock, and the noise.

    Args:
        base: the attempt.
        hearing: followers on its paths, with what was recorded.

    Returns:
        Twice (segments of all recordings, samples, channels), and (channels,) mean standard deviations.
    """
    recorded = np.concatenate([one.measured.values for one in hearing])
    clocks = [Instrument(timebase=base.model.instrument(row).timebase) for row in base.fit.values]
    each = zip(hearing, base.fit.passes, clocks, strict=True)
    predicted = np.concatenate([own.measured.seen(one.predicted, clock) for own, one, clock in each])
    return recorded, predicted, np.mean([one.measured.sigma for one in hearing], axis=0)


def kinds(
    search: Search, base: Attempt, hearing: Sequence[Follower], channel: str
) -> list[tuple[Hypothesis, np.ndarray, float]]:
    """Faults that would turn a channel's signal on the paths of ``base`` into the recorded one, best first.

    None that is larger or smaller than any sensor's: a signal of nothing but noise is clipped by no limit.

    Args:
        search: with its hypotheses.
        base: that trusts the channel to be faultless.
        hearing: followers on its paths, with what was recorded.
        channel: the suspected one.

    Returns:
        Each fault, its (unknowns,) values and what remains [sigma].
    """
    measured = hearing[0].measured
    recorded, predicted, sigma = side_by_side(base, hearing)
    shape = (-1, len(measured.channels))
    calm = steady((predicted - recorded) / sigma, [measured.channels.index(channel)])
    suspicions = suspect(  # a limit may be reached at the highest of several speeds alone
        recorded.reshape(shape), predicted.reshape(shape), list(measured.channels), measured.chain.rate,
        sigma, channel, np.repeat(calm, recorded.shape[1]),
    )  # fmt: skip
    known = {(g[0].name, g[0].channel): g[0] for g in search.groups.values()}
    found = []
    for suspicion in suspicions[:_SUSPECTED]:
        hypothesis = known.get((suspicion.effect, channel))
        if hypothesis is not None:
            values = np.array([suspicion.parameters[u.name] for u in hypothesis.unknowns])
            if all(u.low <= value <= u.high for u, value in zip(hypothesis.unknowns, values, strict=True)):
                found.append((hypothesis, values, suspicion.misfit))
    return found
