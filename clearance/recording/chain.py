"""The measurement chain: what turns the machine's accelerations into a recording.

Simulation, training, prediction and diagnosis share one declaration of it, because a recording compared with
a prediction that went through another filter looks like missing physics.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import isclose
from typing import Any

import numpy as np

from clearance.errors import InputError
from clearance.mechanism.parameters import require
from clearance.recording.recording import RATE_LIMITS, SAME_RATE
from clearance.simulation.decimation import Decimation

CHAIN_LIMITS: Mapping[str, tuple[float, float, str]] = {
    "base_rate": (RATE_LIMITS[0], 1e7, "Hz"),
    "decimation": (1, 200, ""),
    "filter_order": (2, 12, ""),
    "ripple_db": (1e-6, 3.0, "dB"),
    "cutoff": (0.05, 0.95, "of the Nyquist frequency after decimation"),
}
"""Least and largest value of each key of a chain, simulated or declared, and its unit."""
WHOLE = ("decimation", "filter_order")


@dataclass(frozen=True)
class MeasurementChain:
    """Zero-phase Chebyshev type I low-pass of unit gain at zero frequency, then every n-th sample.

    The paper's chain (Section 4.2) with the gain set right: an even-order Chebyshev filter applied in both
    directions has a gain of 0.98855 at zero frequency, here divided out.

    Attributes:
        base_rate: sampling rate before the filter [Hz].
        decimation: n; 1 leaves the signal unfiltered.
        filter_order: of one direction, even.
        ripple_db: passband ripple of one direction [dB].
        cutoff: as a fraction of the Nyquist frequency after decimation.
    """

    base_rate: float = 1e5
    decimation: int = 10
    filter_order: int = 8
    ripple_db: float = 0.05
    cutoff: float = 0.8

    def __post_init__(self) -> None:
        for name, (low, high, _) in CHAIN_LIMITS.items():
            require(self, low, high, whole=name in WHOLE, **{name: getattr(self, name)})
        if self.filter_order % 2:
            raise InputError(
                f"chain.filter_order = {self.filter_order} is odd: an even number is needed; "
                "change chain.filter_order"
            )

    @property
    def rate(self) -> float:
        """Sampling rate of a recording [Hz]."""
        return self.base_rate / self.decimation

    def filter(self) -> Decimation:
        """Coefficients for filtering in the same pass as the simulation."""
        if self.decimation == 1:
            return Decimation.none()
        return Decimation.chebyshev(self.decimation, self.filter_order, self.ripple_db, self.cutoff)

    def apply(self, values: np.ndarray) -> np.ndarray:
        """Filter and decimate signals that were sampled at the base rate by something else.

        Args:
            values: (samples, channels).

        Returns:
            (ceil(samples / decimation), channels).
        """
        return self.smooth(values)[:: self.decimation]

    def smooth(self, values: np.ndarray) -> np.ndarray:
        """Filter (samples, channels) at the base rate, without decimation."""
        from scipy import signal  # takes a second to import, which simulations need not wait for

        if self.decimation == 1:
            return values.copy()
        sections = signal.cheby1(
            self.filter_order, self.ripple_db, self.cutoff / self.decimation, output="sos"
        )
        gain = np.prod(sections[:, :3].sum(axis=1) / sections[:, 3:].sum(axis=1))
        return np.asarray(signal.sosfiltfilt(sections, values, axis=0, padtype="constant")) / gain**2


def declared_chain(chain: object, rate: float | None = None) -> dict[str, Any]:
    """What a recording declares under ``chain``, completed from the defaults of ``MeasurementChain``.

    Args:
        chain: mapping, or ``None``.
        rate: of the recording [Hz], at which the chain ends: every n-th sample of the usual base rate, if
            that gives it; else n times as many. ``None``: that of the defaults.
    """
    if chain is None:
        chain = {}
    if not isinstance(chain, Mapping):
        raise InputError(f"chain: {str(chain)[:60]!r} is not a mapping; give `name: value` pairs")
    usual = asdict(MeasurementChain())
    if rate is not None:
        base = chain.get("base_rate", usual["base_rate"])
        factor = chain.get("decimation", max(1, round(base / rate)))
        fits = abs(base / factor / rate - 1.0) <= SAME_RATE
        usual |= {"decimation": factor, "base_rate": base if fits else rate * factor}
    return {key: chain.get(key, value) for key, value in usual.items()}


def chain_differences(declared: object, trained: Mapping[str, Any], rate: float | None = None) -> str:
    """In which keys the chain of a recording is not that of a model's training, in words; or nothing.

    Args:
        declared: what the recording declares under ``chain``; ``None``: nothing, which is the usual chain
            where the model was trained with that.
        trained: of the model's training, complete.
        rate: of the recording [Hz].
    """
    recorded = declared_chain(declared, rate)
    other = {key: value for key, value in trained.items() if not _equal(recorded[key], value)}
    if other and not declared:
        known = ", ".join(f"chain.{key} = {value}" for key, value in other.items())
        return (
            f"its chain is not declared, the model was trained with {known}; give chain: in the YAML beside "
            "it"
        )
    return "; ".join(
        f"recorded with chain.{key} = {recorded[key]}, the model was trained with {value}"
        for key, value in other.items()
    )


def _equal(one: Any, other: Any) -> bool:
    numbers = isinstance(one, int | float) and isinstance(other, int | float)
    return isclose(one, other, rel_tol=1e-9) if numbers else one == other
