"""Fit what accelerometers may do within their tolerances, together with everything else.

Each has a gain, an angle, a delay and an offset of its own, of which the data sheet says no more than a
limit. They are unknowns of a fit that every recording shares, expected to be off by half their tolerance.
What a fit knows of its parameters it then knows whatever they are.
"""

from collections.abc import Sequence

import numpy as np

from clearance.diagnosis.sensing.instrument import Instrument
from clearance.diagnosis.sensing.tolerances import HALF, Open, instrument_of, values_of
from clearance.diagnosis.shooting.follow import Follower
from clearance.diagnosis.shooting.model import Model, Unknown
from clearance.diagnosis.shooting.stretch import Pass
from clearance.mechanism.slider_crank import SliderCrank

_FURTHEST = 1.5  # tolerances: bound
_STEP = 1e-2  # of a tolerance, for derivatives


class Calibration:
    """A model with what its accelerometers may do, beside the same without.

    Args:
        model: without.
        what: the accelerometers may do.

    Attributes:
        plain: the model without.
        model: with these unknowns behind the shared ones.
    """

    def __init__(self, model: Model, what: Sequence[Open]) -> None:
        self.what, self._shared, self.plain = tuple(what), model.shared, model
        self._last: tuple[bytes, SliderCrank] | None = None
        unknowns = tuple(
            Unknown(
                f"{one.fault} of {one.channel}", _STEP * one.tolerance,
                one.neutral - _FURTHEST * one.tolerance, one.neutral + _FURTHEST * one.tolerance,
                reach=one.tolerance, expected=one.neutral, within=HALF * one.tolerance,
            )
            for one in self.what
        )  # fmt: skip
        sensing = model.sensing or (False,) * len(model.unknowns)
        first = self._shared
        self.model = Model(
            (*model.unknowns[:first], *unknowns, *model.unknowns[first:]),
            self._machine,
            lambda v: self.sensors(v).beside(model.instrument(self.without(v))),
            (*sensing[:first], *(True for _ in unknowns), *sensing[first:]),
        )  # fmt: skip

    def _machine(self, row: np.ndarray) -> SliderCrank:
        """The machine of a row; no sensor changes it, so that the last one often serves."""
        plain = self.without(row)
        key, last = plain.tobytes(), self._last
        if last is None or last[0] != key:
            self._last = last = key, self.plain.machine(plain)
        return last[1]

    def sensors(self, row: np.ndarray) -> Instrument:
        """What the accelerometers do, of a row of values."""
        return instrument_of(self.what, row[self._shared : self._shared + len(self.what)])

    def bent(self, row: np.ndarray) -> float:
        """Sum of squares of how far the accelerometers are off, each in what it is expected to be off by."""
        away = row[self._shared : self._shared + len(self.what)] - [one.neutral for one in self.what]
        return float(((away / [HALF * one.tolerance for one in self.what]) ** 2).sum())

    def beside(self, values: np.ndarray, sensors: Instrument) -> np.ndarray:
        """(recordings, unknowns) from values without; ``without`` goes back."""
        known = np.tile(values_of(self.what, sensors), (len(values), 1))
        return np.concatenate([values[:, : self._shared], known, values[:, self._shared :]], axis=1)

    def without(self, values: np.ndarray) -> np.ndarray:
        """(…, unknowns) of the model without, from values or rows of the whole."""
        last = self._shared + len(self.what)
        return np.concatenate([values[..., : self._shared], values[..., last:]], axis=-1)

    def known(self, information: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What is known of the model's parameters and of the accelerometers.

        Args:
            information: (P, P) of the whole.

        Returns:
            (P', P') information of the model's parameters, whatever the accelerometers do, (what, what)
            covariance of these, and (what, P') by how much they go back when a parameter moves on.
        """
        place = np.arange(len(information))
        own = (place >= self._shared) & (place < self._shared + len(self.what))
        expected = np.diag([(HALF * one.tolerance) ** -2.0 for one in self.what])
        if not np.isfinite(information).all():  # a segment that does not run tells nothing of them
            rest = information[np.ix_(~own, ~own)]
            return rest, np.linalg.inv(expected), np.zeros((len(self.what), len(rest)))
        theirs, between = information[np.ix_(own, own)] + expected, information[np.ix_(own, ~own)]
        rest = information[np.ix_(~own, ~own)]
        scale, other = np.diag(theirs) ** -0.5, np.maximum(np.diag(rest), np.finfo(float).tiny) ** -0.5
        unit, across = theirs * np.outer(scale, scale), between * np.outer(scale, other)
        told = np.linalg.solve(unit, across)
        own_rest = rest * np.outer(other, other)
        known = own_rest - across.T @ told
        spread = np.linalg.inv(unit) + told @ np.linalg.pinv(known, hermitian=True) @ told.T
        followed = told * np.outer(scale, 1.0 / other)
        return known / np.outer(other, other), spread * np.outer(scale, scale), followed

    def scores(self, passes: Sequence[Pass], values: np.ndarray, followed: np.ndarray) -> list[np.ndarray]:
        """Scores of the segments for the model's parameters while the accelerometers follow these.

        What a parameter shares with an accelerometer tells nothing of it: else intervals are as wide as if
        everything that the segments say were as uncertain as the little that is left.

        Args:
            passes: of the whole.
            values: (recordings, unknowns) likewise.
            followed: as of ``known``.

        Returns:
            (segments, unknowns of the plain model) of each recording, as of ``Pass.parts``.
        """
        first, last = self._shared, self._shared + len(self.what)
        count, found = len(self.model.unknowns), []
        for r, (one, row) in enumerate(zip(passes, values, strict=True)):
            steps = np.array([self.model.step(row, i) for i in range(count)])
            natural = one.parts / steps
            begun = first + r * (count - last)
            places = [*range(first), *range(begun, begun + count - last)]
            projected = self.without(natural) - natural[:, first:last] @ followed[:, places]
            found.append(projected * self.without(steps))
        return found


def calibration_of(followers: Sequence[Follower], model: Model) -> Calibration | None:
    """What is to be found of the accelerometers of recordings; ``None`` where nothing is left open.

    Nor where unknown forces are: they would take up what an accelerometer does.
    """
    measured = followers[0].measured
    what = measured.tolerances.open(measured.channels)
    return Calibration(model, what) if what and not any(one.forced for one in followers) else None
