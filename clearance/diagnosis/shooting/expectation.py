"""What is expected of a model's unknowns before the recordings are looked at."""

import numpy as np

from clearance.diagnosis.shooting.model import Model
from clearance.diagnosis.shooting.normal_equations import flatten

_FARTHEST = 3.0  # times what the linearisation bears: standard deviation of an unknown from its home
_REACH = 0.05  # of a parameter's value that the linearisation bears, where nothing else is said


class Expectation:
    """Where each unknown is expected, and how far from there it may be, as a sum of squares.

    An unknown that says so itself (``within``) is expected where it says. Of the others nothing is expected
    unless they are given a home: then they stay within a few times what their linearisation bears, so that
    what a short stretch does not show cannot run away.

    Args:
        model: whose unknowns.
        values: (recordings, unknowns) to begin with.
        home: (recordings, unknowns) values near which the unknowns are expected.

    Attributes:
        weight: (P,) of all parameters: inverse variances.
    """

    def __init__(self, model: Model, values: np.ndarray, home: np.ndarray | None) -> None:
        self.model = model
        within = flatten(np.tile([u.within for u in model.unknowns], (len(values), 1)), model)
        far = np.zeros(len(within)) if home is None else stiffness(model, home) / _FARTHEST**2
        self.weight = np.where(np.isfinite(within), within**-2.0, far)
        known = np.array([np.isfinite(u.within) for u in model.unknowns], dtype=bool)
        expected = np.array([u.expected for u in model.unknowns])
        self.home = np.where(known, expected, values if home is None else home)
        self.turning = np.array([u.turns for u in model.unknowns], dtype=bool)

    def distance(self, values: np.ndarray) -> np.ndarray:
        """(P,) from home; of shared unknowns that of the first recording."""
        apart = values - self.home
        return flatten(np.where(self.turning, wrapped(apart), apart), self.model)

    def cost(self, values: np.ndarray) -> float:
        """Sum of squares of the unknowns' distances, each in units of what is expected."""
        return float((self.weight * self.distance(values) ** 2).sum())


def expected(model: Model, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is known of a model's shared unknowns before they are fitted: information and score (shared,).

    Both for a change by one step of each, as ``Pass.gram`` has them.
    """
    shared = model.unknowns[: model.shared]
    steps = np.array([model.step(values[0], i) for i in range(len(shared))])
    weight = np.array([one.within for one in shared]) ** -2.0
    away = np.array([one.expected for one in shared]) - values[0, : len(shared)]
    return weight * steps**2, weight * away * steps


def stiffness(model: Model, values: np.ndarray) -> np.ndarray:
    """(P,) inverse squares of the changes that the parameters surely bear."""
    shared = model.shared
    reach = np.array(
        [u.reach or _REACH * max(abs(v), u.step) for u, v in zip(model.unknowns, values[0], strict=True)]
    )
    own = np.tile(reach[shared:], len(values))
    return 1.0 / np.concatenate([reach[:shared], own]) ** 2


def wrapped(angles: np.ndarray) -> np.ndarray:
    """Angles [rad] between -π and π."""
    turned: np.ndarray = np.mod(angles + np.pi, 2.0 * np.pi) - np.pi
    return turned
