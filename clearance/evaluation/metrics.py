"""The paper's measures of error, equations (24)-(27), as torchmetrics.

Errors are normalised by the range of the clearance, 1 mm in the paper, so that numbers from different test
sets compare: the range of the labels of one small test set is a matter of luck.
"""

import torch
from torch import Tensor
from torchmetrics import Metric, MetricCollection

from clearance.mechanism.parameters import require


class NormalizedMeanAbsoluteError(Metric):
    """Equation (24): mean absolute error in percent of ``label_range`` [m]."""

    total: Tensor
    count: Tensor

    def __init__(self, label_range: float = 1e-3) -> None:
        super().__init__()
        require(self, 0.0, 1.0, strict=True, label_range=label_range)
        self.label_range = label_range
        self.add_state("total", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("count", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")

    def update(self, estimate: Tensor, truth: Tensor) -> None:
        """Add (windows,) estimates and true values [m]."""
        self.total += (estimate - truth).abs().double().sum()
        self.count += truth.numel()

    def compute(self) -> Tensor:
        """Percent."""
        return 100 * self.total / self.count / self.label_range


class NormalizedRootMeanSquareError(NormalizedMeanAbsoluteError):
    """Equation (25): root mean square error in percent of ``label_range`` [m]."""

    def update(self, estimate: Tensor, truth: Tensor) -> None:
        """Add (windows,) estimates and true values [m]."""
        self.total += (estimate - truth).double().square().sum()
        self.count += truth.numel()

    def compute(self) -> Tensor:
        """Percent."""
        return 100 * (self.total / self.count).sqrt() / self.label_range


class AbsoluteErrorQuantile(Metric):
    """Equations (26) and (27): the median and any other quantile of the absolute error [m]."""

    errors: list[Tensor]

    def __init__(self, quantile: float) -> None:
        super().__init__()
        self.quantile = quantile
        self.add_state("errors", [], dist_reduce_fx="cat")

    def update(self, estimate: Tensor, truth: Tensor) -> None:
        """Add (windows,) estimates and true values [m]."""
        self.errors.append((estimate - truth).abs().double().flatten())

    def compute(self) -> Tensor:
        """Metres."""
        errors = torch.cat(self.errors) if isinstance(self.errors, list) else self.errors
        # Sorting by hand: torch.quantile refuses more than 16 million values.
        ordered = errors.sort().values
        place = self.quantile * (len(ordered) - 1)
        low, high = ordered[int(place)], ordered[min(int(place) + 1, len(ordered) - 1)]
        return low + (place - int(place)) * (high - low)


def paper_metrics(label_range: float = 1e-3) -> MetricCollection:
    """The paper's four: NMAE and NRMSE in percent, median and 95th percentile absolute error in metres."""
    return MetricCollection(
        {
            "nmae": NormalizedMeanAbsoluteError(label_range),
            "nrmse": NormalizedRootMeanSquareError(label_range),
            "median_ae": AbsoluteErrorQuantile(0.5),
            "p95_ae": AbsoluteErrorQuantile(0.95),
        },
        compute_groups=False,
    )
