"""Fit hypotheses to recordings that are followed, from coarse to fine."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clearance.diagnosis.following.horizon import islands, mend
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.shooting.fit import Fit, fit
from clearance.diagnosis.shooting.follow import EDGE, TIGHT, Follower
from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.side_by_side import side_by_side
from clearance.simulation.integrator import Integrator

ANNEALING = (100.0, 31.6, 10.0, 3.16, 1.0)  # factors on the noise while a guess is far from a solution
FOLLOWED = 2.5  # robust cost a sample: above, a model does not follow at this scale of the noise
EXPLAINED = 1.35  # and up to which nothing is left to explain
_ONE = 2.0  # and of one recording, which so much is left of where another one leaves nothing
ROOM = 1.03  # and above which what explains may have more parameters
LOOSENESS = 0.15  # of the joint's typical force: unknown forces while a path is looked for
POOR = 3.0  # misfit up to which a model is not given up on the way, whatever others reach
COARSE = Integrator("runge_kutta_4", 1e-5, 1)  # while a path is looked for: half the work
FINE = Integrator("runge_kutta_4", 1e-5, 2)  # of what is asserted: errors far below the noise
_LOOKS = 3  # at most, to put torn impacts together
APART, _SOME = 3.0, 0.01  # cost a sample of a segment that is not followed; share of these that may be
NEAR = 5  # segments that are fitted with a torn one
_TORN, _MANY = 2.0, 0.3  # cost a sample; share of segments
_FEW = 0.1  # of them: where more are torn their paths are not looked for
_CHANCE = 2.0  # standard deviations of a segment's cost: more is torn beside a model that explains
_LOST = 2.0  # cost a sample of a segment that is then looked for
_WORTH = 5e-3  # share by which the cost falls where another look is worth the time
_FINELY = 0.01  # of the unknown forces' deviations: near a path larger ones reach into other contacts
_LARGE = 12  # unknowns from which on their last digits are not worth the time


@dataclass(eq=False)  # two that were found alike are two
class Attempt:
    """A model fitted to the stretches of all recordings.

    Attributes:
        hypotheses: beside the nominal machine.
        model: of them.
        fit: the last fit that followed.
        scale: of the noise at which it follows.
        level: robust cost a sample at that scale.
        followers: with the paths of the fit.
        withdrawn: whether it must not be asserted: one of its effects may as well be off, the nominal machine
            does as well, or it is a table in the place of a name, or of another table, that does.
        reach: (shared, 2) how far below and above its values the likelihood does not fall, once it was asked;
            of values that the motion alone shows, what these may err by.
        shares: (recordings,) of held-out ones, how much of what was to be followed was, for the rest the path
            was lost; empty: all.
    """

    hypotheses: tuple[Hypothesis, ...]
    model: Model
    fit: Fit
    scale: float
    level: float
    followers: list[Follower]
    withdrawn: bool = False
    reach: np.ndarray | None = None
    shares: tuple[float, ...] = ()

    @property
    def misfit(self) -> float:
        """Robust mean square of residuals in units of the noise: 1 for a perfect model."""
        return self.level * self.scale**2

    @property
    def misfits(self) -> list[float]:
        """The same for each recording."""
        return [level * self.scale**2 for level in self.fit.levels]

    @property
    def sensors(self) -> Instrument:
        """What the accelerometers were found to do within their tolerances."""
        return self.followers[0].measured.sensors

    @property
    def label(self) -> str:
        """The hypotheses' labels."""
        return " + ".join(h.label for h in self.hypotheses) or "nominal"

    @property
    def labels(self) -> frozenset[str]:
        """The same, in whichever order they were found."""
        return frozenset(h.label for h in self.hypotheses)


def refine(
    hypotheses: Sequence[Hypothesis],
    model: Model,
    followers: Sequence[Follower],
    values: np.ndarray,
    scale: float,
    iterations: int = 6,
    workers: int = 1,
    patient: bool = True,
) -> Attempt:
    """Fit at a scale of the noise, then at smaller ones as long as the model follows.

    The followers are not changed; the attempt has its own, free of unknown forces. ``patient``: whether a
    scale at which the model does not follow is tried twice.
    """
    own = tightened(followers)
    best: Attempt | None = None
    for s in [scale, *[a for a in ANNEALING if a < 0.9 * scale]]:
        before = [(f.path.copy(), f.measured) for f in own]
        for follower in own:
            follower.integrator = integrator_at(s)
        found = fit(own, model, values, iterations, 1e-2, workers, scale=s)
        level = found.level
        if patient and best is not None and level > EXPLAINED:
            # a good model often needs a second look, and impacts that were torn apart put together again
            for _ in range(_LOOKS):
                if not mend_torn(own, model, found, workers):
                    break
                again = fit(own, model, found.values, iterations, 1e-2, workers, scale=s)
                improved = again.level < 0.9 * level
                found, level = again, again.level
                if not improved or level < EXPLAINED:
                    break
        if best is not None and level > FOLLOWED:
            if level * s**2 < best.misfit:
                best = Attempt(tuple(hypotheses), model, found, s, level, own)
            else:
                for follower, (path, measured) in zip(own, before, strict=True):
                    follower.path, follower.measured = path, measured
                    follower.integrator = integrator_at(best.scale)
            break
        values = found.values
        best = Attempt(tuple(hypotheses), model, found, s, level, own)
    assert best is not None
    return best if best.scale > 1.0 else _polished(best, workers)


def integrator_at(scale: float) -> Integrator:
    """How segments are run at a scale of the noise."""
    return FINE if scale <= 1.0 else COARSE


def _polished(attempt: Attempt, workers: int) -> Attempt:
    """Where an attempt follows, its values are those of the minimum, not of a valley's slope.

    One impact that is put together wrongly holds all parameters: no step of theirs sets its path right, and
    every step tears it further apart. Beside a model that explains, it stands out.
    """
    for look in range(_LOOKS):
        torn, lost = _TORN, np.inf
        if explained(attempt):
            rows = attempt.fit.passes[0].residual[0].size
            torn, lost = attempt.level * (1.0 + _CHANCE * np.sqrt(2.0 / rows)), _LOST
        before, kept = attempt.fit, [(f.path.copy(), f.measured) for f in attempt.followers]
        mended = mend_torn(attempt.followers, attempt.model, before, workers, torn, lost)
        if mended or (look == 0 and explained(attempt)):
            _settle_down(attempt, workers)
        if not mended:
            break
        gained = before.cost - attempt.fit.cost
        if gained < 0.0:
            attempt.fit, attempt.level = before, before.level
            for follower, (path, measured) in zip(attempt.followers, kept, strict=True):
                follower.path, follower.measured = path, measured
        if gained < _WORTH * before.cost:
            break
    return attempt


def _settle_down(attempt: Attempt, workers: int) -> None:
    tolerance = 1e-5 if explained(attempt) and attempt.model.shared < _LARGE else 1e-4
    found = fit(attempt.followers, attempt.model, attempt.fit.values, 12, tolerance, workers)
    attempt.fit, attempt.level = found, found.level


def mend_torn(
    followers: Sequence[Follower],
    model: Model,
    found: Fit,
    workers: int,
    torn: float = _TORN,
    lost: float = np.inf,
) -> bool:
    """Fit each stretch that is not followed on its own, if these are few.

    Args:
        followers: with the paths of the fit; changed.
        model: that was fitted.
        found: the fit.
        workers: threads.
        torn: cost a sample of a segment that is not followed.
        lost: cost a sample of a segment from which on the path is looked for.

    Returns:
        Whether there was one.
    """
    apart = [one.local > torn * one.residual[0].size for one in found.passes]
    some = [r for r, mask in enumerate(apart) if 0.0 < mask.mean() < _MANY]

    def mended(r: int) -> None:
        sought = lost if apart[r].mean() < _FEW else np.inf
        for first, last in islands(apart[r], NEAR):
            mend(followers[r], model.held(found.values[r]), first, last, sought)

    side_by_side(mended, some, workers, [float(apart[r].sum()) for r in some])
    return bool(some)


def tightened(followers: Sequence[Follower]) -> list[Follower]:
    """Copies of followers in which no unknown force is left."""
    own = [f.part(0, f.segments) for f in followers]
    for follower in own:
        follower.input_sigma = TIGHT.copy()
        follower.path.inputs[:] = 0.0
    return own


def loosen(
    model: Model,
    values: np.ndarray,
    followers: Sequence[Follower],
    forces: Sequence[np.ndarray],
    scales: Sequence[float],
    workers: int = 1,
) -> Attempt:
    """A model on given paths with unknown forces beside it, which show what it lacks.

    Args:
        model: of the machine.
        values: (recordings, unknowns) to begin with.
        followers: with paths; not changed.
        forces: (inputs,) standard deviations of the forces for each recording [N m, N m, N].
        scales: of the noise, one after another as long as it follows.
        workers: threads.
    """
    own = [f.part(0, f.segments) for f in followers]
    for follower, sigma in zip(own, forces, strict=True):
        follower.input_sigma = sigma
        follower.nudge = _FINELY
        follower.path.inputs[:] = 0.0
    best: Attempt | None = None
    for scale in scales:
        found = fit(own, model, values, 10, 3e-2, workers, scale=scale)
        values = found.values
        best = Attempt((), model, found, scale, found.level, own)
        if found.level > 0.3:
            break
    assert best is not None
    return best


def explained(attempt: Attempt) -> bool:
    """Whether nothing is left to explain, in no recording: of many, one may be lost and the mean be small."""
    return attempt.scale <= 1.0 and attempt.level < EXPLAINED and max(attempt.misfits) < _ONE


def whole(attempt: Attempt) -> bool:
    """Whether it follows everywhere, impacts included."""
    if not explained(attempt):
        return False
    each = np.concatenate([
        one.each[EDGE:-EDGE]
        for one in attempt.fit.passes
    ])  # fmt: skip
    return bool((each > APART).mean() <= _SOME)
