"""A force of free form: a table over one argument, as a curve and as a hypothesis.

Reference: de Boor 1978, A Practical Guide to Splines (tables).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from clearance.diagnosis.hypotheses.hypothesis import Hypothesis
from clearance.diagnosis.shooting.model import Unknown
from clearance.mechanism.applied_force import TabulatedForce, shares
from clearance.mechanism.film import ECCENTRICITY_LIMIT
from clearance.mechanism.slider_crank import SliderCrank

_TAILS = 0.005  # of the argument's values to each side that the curve does not reach
_FRICTION = 0.3  # of a contact's force: what may act beside it
_PRESSED = 100.0  # N, the second knot of a table over the force of a contact
_LINE = 2  # knots over a contact's force, far beyond which impacts are: nothing holds the bends of more
KNOTS = 12
"""Of a curve that nobody has refined."""
DAMPING = "damping"
"""Direction of what resists a journal's motion in its bearing: a force along no direction of its own."""
CLOSEST = float(-np.log(1.0 - ECCENTRICITY_LIMIT**2))
"""Of a journal to its bearing, up to which what fills the gap is asked for."""
FREE_FORM = "free_form"
"""Name of the hypothesis that is no named effect."""

ARGUMENTS = ("crank_angle", "rod_angle", "slider_position", "slider_velocity", "contact_force", "time")


def arguments_of(body: str) -> tuple[str, ...]:
    """What a force on a body may be a function of; how the rod is turned is the place of the rod alone."""
    return tuple(one for one in ARGUMENTS if one != "rod_angle" or body == "rod")


@dataclass(frozen=True)
class Curve:
    """A force of free form that explains the unknown forces.

    Attributes:
        body: where it acts.
        direction: in which.
        argument: of ``ARGUMENTS``, or closeness of a journal to its bearing.
        knots: (knots,) values of the argument.
        forces: (knots,) [N or N m]; over closeness dampings [N s/m].
        deviations: (knots,) standard deviations.
        gain: as in ``Regression``.
        price: of its parameters.
        interpolation: between the knots, linear or cubic.
        period: after which a force over time repeats [s]; ``None``: it does not.
        returns: as of ``TabulatedForce``.
    """

    body: str
    direction: str
    argument: str
    knots: np.ndarray
    forces: np.ndarray
    deviations: np.ndarray
    gain: float
    price: float
    interpolation: str = "linear"
    period: float | None = None
    returns: float | None = None

    @property
    def repeats(self) -> bool:
        """Whether it covers one turn of the crank, or one period."""
        return self.argument == "crank_angle" or self.period is not None

    def shares(self, values: np.ndarray) -> np.ndarray:
        """(values, knots) of each knot's force at values of the argument."""
        spacing, place = self.knots[1] - self.knots[0], values - self.knots[0]
        if self.returns is not None:
            place = place % (self.period or 2.0 * np.pi)
            place = np.minimum(place, self.returns - place)
        covers, straight = self.repeats and self.returns is None, self.argument == "contact_force"
        return shares(place / spacing, len(self.knots), covers, self.interpolation, straight)


def contact_force_of(joint: str) -> str:
    """The simulator's name of the normal force in joint B or C."""
    return f"force_{joint.lower()}"


def curve_over(values: np.ndarray, body: str, direction: str, argument: str, count: int = KNOTS) -> Curve:
    """A curve of size one, with knots over (segments,) values of its argument, or ``count`` over a turn."""
    if argument == "crank_angle":
        knots = 2.0 * np.pi * np.arange(count) / count
    else:
        low, high = np.quantile(values, [_TAILS, 1.0 - _TAILS])
        knots = np.linspace(low, max(high, low + 1e-9), _LINE if argument == "contact_force" else KNOTS)
    return Curve(body, direction, argument, knots, np.ones_like(knots), np.zeros_like(knots), 0.0, 0.0)


def resisting(joint: str, size: float) -> Curve:
    """What fills the gap of joint B or C and resists the journal's motion, the more the closer it comes.

    Begun as if its damping [N s/m], ``size`` in the middle, grew as one over the gap's thickness.
    """
    knots = np.linspace(0.0, CLOSEST, KNOTS)
    none = np.zeros(KNOTS)
    return Curve(f"joint_{joint.lower()}", DAMPING, "closeness", knots, size * np.exp(knots), none, 0.0, 0.0)


def rubbing(joint: str, coefficient: float) -> Curve:
    """What hinders the surfaces of joint B or C from sliding, by how hard they press.

    Begun as friction with a coefficient; it goes on straight where they press harder.
    """
    knots = np.array([0.0, _PRESSED])
    body = f"joint_{joint.lower()}"
    return Curve(
        body, "tangential", "contact_force", knots, coefficient * knots, np.zeros(2), 0.0, 0.0
    )  # fmt: skip


def along(curve: Curve, values: np.ndarray) -> np.ndarray:
    """(segments,) force of a curve at values of its argument [N or N m]."""
    return curve.shares(values) @ curve.forces


def refined(curve: Curve, interpolation: str) -> Curve:
    """The same curve with a knot between each two, a line or a spline from one to the next."""
    count, spacing = len(curve.knots), curve.knots[1] - curve.knots[0]
    knots = curve.knots[0] + 0.5 * spacing * np.arange(2 * count if curve.repeats else 2 * count - 1)
    forces = along(curve, knots)
    return replace(
        curve, knots=knots, forces=forces, deviations=np.zeros(len(knots)), interpolation=interpolation
    )


def lasting(curve: Curve, period: float) -> Curve:
    """The same curve over time in another period [s]."""
    assert curve.period is not None
    return replace(curve, knots=curve.knots * (period / curve.period), period=period)


def halved(curve: Curve) -> Curve:
    """A curve over the same range with half as many knots, and a spline from one to the next."""
    count = len(curve.knots) // 2
    end = curve.knots[0] + len(curve.knots) * (curve.knots[1] - curve.knots[0])
    knots = np.linspace(curve.knots[0], end if curve.repeats else curve.knots[-1], count, not curve.repeats)
    forces = along(curve, knots)
    return replace(curve, knots=knots, forces=forces, deviations=np.zeros(count), interpolation="cubic")


def curve_of(law: TabulatedForce) -> Curve:
    """The table of a machine as a curve."""
    count = len(law.values)
    spacing = (law.period or 2.0 * np.pi) / count if law.spacing is None else law.spacing
    knots = law.start + spacing * np.arange(count)
    argument = "contact_force" if law.straight else law.argument
    return Curve(
        law.body, law.direction, argument, knots, np.array(law.values), np.zeros(count), 0.0, 0.0,
        law.interpolation, law.period, law.returns,
    )  # fmt: skip


def unnamed(hypotheses: Sequence[Hypothesis]) -> Hypothesis | None:
    """The force of free form among hypotheses, if there is one."""
    return next((h for h in hypotheses if h.name == FREE_FORM), None)


def free_form(curve: Curve, joint: str) -> Hypothesis:
    """A curve as a hypothesis whose parameters are its forces at the knots."""
    own = {"contact_force": contact_force_of(joint), "closeness": f"closeness_{joint.lower()}"}
    argument = own.get(curve.argument, curve.argument)
    spacing = None if curve.repeats else float(curve.knots[1] - curve.knots[0])
    typical = float(max(np.abs(curve.forces).max(), 1e-3))
    if curve.argument == "contact_force" and curve.direction not in ("torque", "moment"):
        typical = max(typical, _FRICTION * float(curve.knots[-1]))  # beside impacts a line begins too flat

    def apply(machine: SliderCrank, values: np.ndarray) -> SliderCrank:
        return replace(machine, force=_law(curve, argument, spacing, values))

    resists = curve.direction == DAMPING  # over its whole range, from little to much; and never pushes on
    sizes = np.maximum(curve.forces, 1e-6) if resists else np.full(len(curve.knots), typical)
    unknowns = tuple(
        Unknown(
            f"force_at_{knot:.4g}", 1e-4 * size, 0.0 if resists else -1e5, 1e5, reach=0.3 * size, log=resists
        )
        for knot, size in zip(curve.knots, sizes, strict=True)
    )
    return Hypothesis(
        FREE_FORM, "physics", curve.body, curve.direction, unknowns, np.zeros(len(unknowns)),
        curve.forces.copy(), apply,
    )  # fmt: skip


def known_force(force: Hypothesis, values: np.ndarray) -> Hypothesis:
    """A force of free form of which nothing is fitted: a path is sought better by one that stays."""
    none = np.zeros(0)
    return replace(
        force, unknowns=(), off=none, start=none, apply=lambda machine, _: force.apply(machine, values)
    )


def _law(curve: Curve, argument: str, spacing: float | None, forces: np.ndarray) -> TabulatedForce:
    return TabulatedForce(
        curve.body, curve.direction, argument, float(curve.knots[0]), spacing, tuple(map(float, forces)),
        curve.interpolation, curve.period,
    )  # fmt: skip
