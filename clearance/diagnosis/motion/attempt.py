"""Terms that were fitted, what they came to, and all that was tried."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import log

import numpy as np

from clearance.diagnosis.motion.fit import OWN, Fit
from clearance.diagnosis.motion.model import Term
from clearance.diagnosis.motion.rest import Explained

_DOUBT = 6.0  # standard deviations off zero below which a parameter is tried without
_LEAST_SIZE = 0.3  # of a plausible one: where sizes that vanish begin again


@dataclass
class Attempt:
    """A set of terms, fitted.

    Attributes:
        terms: in the order they were taken in.
        fit: result.
        price: cost with a price for each parameter, that of Schwarz 1978.
    """

    terms: tuple[Term, ...]
    fit: Fit
    price: float

    @property
    def label(self) -> str:
        """All terms."""
        return " + ".join(term.label for term in self.terms) or "nominal"

    @property
    def misfit(self) -> float:
        """Cost a sample."""
        return self.fit.cost / self.fit.samples

    def parameters(self, term: Term) -> tuple[np.ndarray, np.ndarray]:
        """Values and standard deviations of a term, on the scale of the fit."""
        place = len(self.fit.model.fixed_unknowns)
        for other in self.terms:
            if other is term:
                part = slice(place, place + len(term.unknowns))
                return self.fit.shared[part], self.fit.deviations[part]
            place += len(other.unknowns)
        raise ValueError(f"{term.label} is no term of {self.label}")

    def at_bound(self, term: Term) -> bool:
        """Whether a parameter of a term lies at a bound that is not where the term vanishes."""
        values, _ = self.parameters(term)
        for unknown, value, off in zip(term.unknowns, values, term.off, strict=True):
            for bound in (unknown.low, unknown.high):
                near = abs(value - unknown.inner(bound)) < 1e-9 and abs(value - off) > 1e-9
                if near and not unknown.whole:  # a count was chosen, not fitted
                    return True
        return False

    def doubtful(self, term: Term, doubt: float = _DOUBT) -> set[str]:
        """Parameters of a term that may as well be off, and those that have no meaning without them.

        Args:
            term: of this attempt.
            doubt: standard deviations off zero below which a parameter may be.
        """
        values, deviations = self.parameters(term)
        found = {
            term.unknowns[i].name
            for i in term.sizes
            if np.isfinite(term.off[i]) and abs(values[i] - term.off[i]) < doubt * deviations[i]
        }
        if found:
            found |= {unknown.name for unknown in term.unknowns if unknown.shape}
        return found

    def sureness(self, term: Term) -> float:
        """By how many standard deviations a term's best-known size lies off zero."""
        values, deviations = self.parameters(term)
        found = 0.0
        for i in term.sizes:
            if np.isfinite(term.off[i]):
                found = max(found, abs(values[i] - term.off[i]) / max(deviations[i], 1e-300))
            else:  # off is infinitely far on a logarithmic scale: known to a factor of three or not at all
                found = max(found, log(3.0) / max(deviations[i], 1e-300))
        return float(found)


@dataclass(frozen=True)
class Remainder:
    """What names leave, or all that is missing, as a force of free form.

    Attributes:
        attempt: of which it is the last term.
        beside: whether names stand beside it, whose numbers stay as they were.
    """

    attempt: Attempt
    beside: bool


@dataclass
class Findings:
    """All that was tried.

    Attributes:
        nominal: nothing missing.
        best: the cheapest attempt that is sure of all its terms.
        attempts: the others.
        screened: label to linearised gain of terms that were only screened.
        zero: whether the encoder's zero is surely off.
        zeros: name of the recording to that zero [rad] and its standard deviation.
        instead: attempts with another fault in its place.
        enough: whether the best attempt leaves only noise.
        left: a force of free form, if held-out recordings are explained better with it.
    """

    nominal: Attempt
    best: Attempt
    attempts: list[Attempt] = field(default_factory=list)
    screened: dict[str, float] = field(default_factory=dict)
    zero: bool = False
    zeros: dict[str, tuple[float, float]] = field(default_factory=dict)
    instead: list[Attempt] = field(default_factory=list)
    enough: Explained | None = None
    left: Remainder | None = None


def zeros_of(fit: Fit, names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """The encoder's zero [rad] in each recording, and its standard deviation.

    An incremental encoder has another one whenever it is switched on. Over stretches of one recording it is
    their weighted mean.

    Args:
        fit: of an attempt.
        names: of the recording to which each of its stretches belongs.
    """
    places = [len(fit.shared) + r * OWN + 4 for r in range(len(fit.own))]
    weight = 1.0 / np.maximum(np.diag(fit.covariance)[places], 1e-300)
    found = {}
    for name in dict.fromkeys(names):
        own = [r for r, other in enumerate(names) if other == name]
        total = weight[own].sum()
        found[name] = float((weight[own] * fit.own[own, 4]).sum() / total), float(total**-0.5)
    return found


def inside(attempt: Attempt) -> np.ndarray:
    """Shared values of an attempt, sizes that vanish put back to a third of a plausible one."""
    values = attempt.fit.shared.copy()
    place = len(attempt.fit.model.fixed_unknowns)
    for term in attempt.terms:
        for i in term.sizes:
            if abs(values[place + i] - term.off[i]) < 1e-9:
                values[place + i] = term.off[i] + _LEAST_SIZE * (term.starts[0][i] - term.off[i])
        place += len(term.unknowns)
    return values
