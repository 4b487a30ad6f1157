"""What was tried and what came of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from clearance.diagnosis.following.attempt import Attempt, explained
from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.kinematics.shaking import Shaking
from clearance.diagnosis.searching.screening import Hint

_WORKED, _PHASE = 0.05, 0.1  # standard deviation of what that balance says: a share; of an angle [rad]
_SHUT = 0.5  # of the clearance that the motion shows


@dataclass(frozen=True)
class Rails:
    """A slider that is loose in its guide, where not all recordings could be followed.

    Attributes:
        clearance: of the joint beside it [m].
        gap: of free travel on each side [m].
        deviations: standard deviations of both [m], and of ``sizes``.
        beside: effects that the motion shows with it, or the balance of work between the rails.
        sizes: of their parameters.
        followed: whether one recording was, and tells both; else the motion alone.
    """

    clearance: float
    gap: float
    deviations: np.ndarray
    beside: tuple[Hypothesis, ...] = ()
    sizes: np.ndarray = field(default_factory=lambda: np.zeros(0))
    followed: bool = False

    def with_forces(self, hypotheses: Sequence[Hypothesis], sizes: np.ndarray, clearance: float) -> "Rails":
        """The same with forces that the balance of work leaves no doubt of, and the clearance [m] with them.

        Of fifteen that a trial's machines had, it met fourteen within 2.8 % and one within 6.9 %, three
        phases within 0.02 rad.
        """
        turns = np.array([u.turns for h in hypotheses for u in h.unknowns], dtype=bool)
        doubts = np.where(turns, _PHASE, _WORKED * np.abs(sizes))
        return replace(
            self, clearance=clearance, deviations=np.append(self.deviations, doubts),
            beside=(*self.beside, *hypotheses), sizes=np.append(self.sizes, sizes),
        )  # fmt: skip


@dataclass(frozen=True)
class Suspected:
    """A force without a name that explains more of one recording than others would.

    Attributes:
        body: on which it acts.
        direction: in which.
        misfit: with it, of that recording.
    """

    body: str
    direction: str
    misfit: float


@dataclass(frozen=True)
class Worked:
    """The force that by the balance of work gives most of the torque which a machine lacks.

    Attributes:
        body: on which it acts.
        direction: in which.
        share: of the imbalance that it leaves.
    """

    body: str
    direction: str
    share: float


@dataclass
class Explanation:
    """What was tried and what came of it.

    Attributes:
        nominal: the machine as it is, refitted.
        attempts: hypotheses that were fitted, in the order in which they were tried.
        hints: of the screening beside the nominal machine.
        suspected: a force without a name that explains more than others, if one does.
        worked: the force that the balance of work points at, whether or not a machine is followed with it.
        shaken: the force without a name that the balance of forces on a known frame shows, if it does.
        rails: between which the slider moves, if it does and not all recordings are followed so.
        rattles: of the motion's disagreement that rails leave, followed or not; infinite where it shows none.
        misplaced: likewise another dimension, the best one.
        shown: the machine between these rails, where none that was followed explains the recordings; or the
            one with ``shaken``, where the nominal one explains them as well.
        agreed: joint, and the clearance in it at which the motion agrees best [m], whatever the forces.
        balanced: whether the drive and the known loads give the torque that the motion needs.
        unpushed: whether no force on the links would give what they do not.
        pushes: single effects that would, with the (unknowns,) sizes of each.
        simulated: rising falls that hypotheses promised beside simulations of the nominal machine, if asked.
    """

    nominal: Attempt
    attempts: list[Attempt] = field(default_factory=list)
    hints: list[Hint] = field(default_factory=list)
    suspected: Suspected | None = None
    worked: Worked | None = None
    shaken: Shaking | None = None
    rails: Rails | None = None
    rattles: float = float("inf")
    misplaced: float = float("inf")
    shown: Attempt | None = None
    agreed: tuple[str, float] | None = None
    balanced: bool = False
    unpushed: bool = False
    pushes: list[tuple[Hypothesis, np.ndarray]] = field(default_factory=list)
    simulated: np.ndarray | None = None

    @property
    def standing(self) -> list[Attempt]:
        """The nominal machine and what was followed beside it and may be asserted."""
        return [self.nominal, *(attempt for attempt in self.attempts if not attempt.withdrawn)]

    def shut(self, attempt: Attempt) -> bool:
        """Whether it closed a gap that the motion shows to be wide: something cushions the strikes."""
        return self.agreed is not None and bool(attempt.fit.values[0, 0] < _SHUT * self.agreed[1])

    def parts(self, attempt: Attempt) -> list[Attempt]:
        """What explains with some of an attempt's hypotheses alone: of each some, the best."""
        own = [h.label for h in attempt.hypotheses]
        found: dict[str, Attempt] = {}
        for one in self.standing[1:]:
            fewer = len(one.hypotheses) < len(own) and {h.label for h in one.hypotheses} <= set(own)
            if fewer and explained(one) and one.misfit <= found.get(one.label, one).misfit:
                found[one.label] = one
        return list(found.values())

    @property
    def samples(self) -> int:
        """Of the stretches on which the nominal machine was followed."""
        return sum(one.samples for one in self.nominal.fit.passes)

    def price(self, attempt: Attempt) -> float:
        """Robust sum of squares at the smallest scale reached, and a price for each parameter (Schwarz 1978).

        Over as many samples as the nominal machine was followed on: a force over time is followed for a
        period, another place in a short recording has less behind it. That accelerometers bend costs what
        their tolerances say.
        """
        price = self.samples * attempt.misfit + attempt.fit.bent
        return price + attempt.model.shared * np.log(self.samples) * max(attempt.misfit, 1.0)

    @property
    def best(self) -> Attempt:
        """The attempt of the smallest price, of those that may be asserted.

        Where it does not explain the recordings, what the motion alone shows comes before it; a force on the
        frame does where the nominal machine explains them: from segment to segment it is not felt.
        """
        followed = min(self.standing, key=self.price)
        unfelt = self.shaken is not None and followed is self.nominal
        return self.shown if self.shown is not None and (unfelt or not explained(followed)) else followed
