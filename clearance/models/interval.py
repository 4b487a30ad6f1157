"""One clearance of a recording from its windows, with an interval that holds a stated share of the time.

Split conformal prediction with normalised scores, by recording: windows are not exchangeable, recordings are.
Of several of one machine the machine is the unit, and they share its weight. References: Lei et al. 2018, J.
Am. Stat. Assoc. 113(523), 1094-1111, Sections 2 and 5.2; Lee, Barber & Willett 2023, arXiv:2306.06342.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from clearance.errors import InputError


def robust_mean(values: np.ndarray) -> float:
    """Mean of the middle half of (windows,) values: a few odd windows do not move it."""
    ordered = np.sort(values)
    cut = len(ordered) // 4
    return float(ordered[cut : len(ordered) - cut].mean())


def spread(values: np.ndarray) -> float:
    """Robust standard deviation of (windows,) values, from the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))  # 1.4826: normal distribution


@dataclass(frozen=True)
class ConformalInterval:
    """Point estimate plus and minus ``quantile * (floor + spread of the windows)``.

    The quantile depends on how many windows a recording has: the estimate of a short one is less certain. It
    is tabulated for 1, 2, 4 ... windows, and a recording takes the entry at or below its own number.

    Attributes:
        coverage: Share of recordings whose interval holds the truth [-].
        floor: Median error of the validation recordings [m].
        windows: Numbers of windows in the table.
        quantiles: Of the normalised scores at each; None where too few recordings support the coverage.
        limit: Largest clearance that the model can be asked about [m].
    """

    coverage: float
    floor: float
    windows: tuple[int, ...]
    quantiles: tuple[float | None, ...]
    limit: float

    @classmethod
    def calibrate(
        cls,
        validation: Sequence[tuple[np.ndarray, float]],
        calibration: Sequence[tuple[np.ndarray, float]],
        coverage: float = 0.9,
        limit: float = 1e-3,
        machines: np.ndarray | None = None,
    ) -> "ConformalInterval":
        """Calibrate.

        Args:
            validation: Windows' estimates (windows,) [m] and true clearance [m] of recordings that set the
                floor; they must not be among those of ``calibration``.
            calibration: The same of recordings that neither training nor the choice of an epoch has seen.
            coverage: Wanted share [-].
            limit: Largest clearance [m].
            machines: (recordings,) whose each of ``calibration`` is; ``None``: each of another one.
        """
        if not 0 < coverage < 1:
            raise InputError(
                f"calibration.coverage={coverage}: must be between 0 and 1; set calibration.coverage"
            )
        errors = [abs(robust_mean(estimates) - truth) for estimates, truth in validation]
        if not np.isfinite(errors).all():
            raise InputError(
                "the model's estimates are no numbers: its training failed; lower trainer.optimizer.lr"
            )
        floor = max(float(np.median(errors)), 1e-6 * limit)  # an exact model still gets an interval
        most = min(len(estimates) for estimates, _ in calibration)
        table = [2**k for k in range(most.bit_length()) if 2**k < most] + [most]
        quantiles = [
            conformal_quantile(
                np.array([_score(_middle(e, n), truth, floor) for e, truth in calibration]),
                coverage,
                machines,
            )
            for n in table
        ]
        return cls(coverage, floor, tuple(table), tuple(quantiles), limit)

    def bounds(self, estimates: np.ndarray) -> tuple[float, float]:
        """Low and high end [m] for a recording whose windows gave ``estimates`` (windows,) [m]."""
        place = max(int(np.searchsorted(self.windows, len(estimates), side="right")) - 1, 0)
        quantile = self.quantiles[place]
        centre = robust_mean(estimates)
        if quantile is None:
            return 0.0, max(self.limit, centre)
        width = quantile * (self.floor + spread(estimates))
        # A clearance is never negative: cutting there costs no coverage.
        return max(centre - width, 0.0), max(centre + width, 0.0)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> "ConformalInterval":
        """Inverse of ``to_json``."""
        return cls(
            **{**content, "windows": tuple(content["windows"]), "quantiles": tuple(content["quantiles"])}
        )


def conformal_quantile(
    scores: np.ndarray, coverage: float, machines: np.ndarray | None = None
) -> float | None:
    """The smallest score up to which lies ``coverage`` of the weight; None where no finite one has so much.

    Of n machines each weighs 1 / (n + 1), which its scores share; what is left is the next machine's. With
    one score each it is the ceil((n + 1) coverage)-th smallest.

    Args:
        scores: (scores,).
        coverage: Wanted share [-].
        machines: (scores,) whose each is; ``None``: each of another one.
    """
    machines = np.arange(len(scores)) if machines is None else machines
    _, place, count = np.unique(machines, return_inverse=True, return_counts=True)
    order = np.argsort(scores, kind="stable")
    weight = np.cumsum(1.0 / count[place[order]]) / (len(count) + 1)
    rank = int(np.searchsorted(weight, coverage - 1e-9))  # 1e-9: round-off must not add a rank
    return float(scores[order[rank]]) if rank < len(scores) else None


def _score(estimates: np.ndarray, truth: float, floor: float) -> float:
    return abs(robust_mean(estimates) - truth) / (floor + spread(estimates))


def _middle(values: np.ndarray, count: int) -> np.ndarray:
    start = (len(values) - count) // 2
    return values[start : start + count]
