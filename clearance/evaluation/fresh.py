"""A gauge on recordings that did not exist when it was trained: does its interval hold what it promises?"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from clearance.errors import InputError
from clearance.models.gauge import Gauge
from clearance.recording.dataset import LABELS
from clearance.recording.synthesis import Campaign
from clearance.whole_files import read_json

FRESH = "fresh.json"
_OTHER_SEED = 1_000_000  # added to the training's: none of its runs, streamed or stored, comes again


@dataclass(frozen=True)
class FreshEvaluation:
    """Estimates of one joint from freshly simulated recordings, (recordings,) each, lengths in metres."""

    joint: str
    truth: list[float]
    estimate: list[float]
    low: list[float]
    high: list[float]
    trusted: list[bool]

    def summary(self) -> dict[str, Any]:
        """Coverage with its exact binomial 95 % interval, share trusted, error, median width."""
        truth, estimate = np.array(self.truth), np.array(self.estimate)
        low, high = np.array(self.low), np.array(self.high)
        covered = (low <= truth) & (truth <= high)
        exact = stats.binomtest(int(covered.sum()), len(truth)).proportion_ci(0.95, method="exact")
        return {
            "joint": self.joint,
            "recordings": len(truth),
            "coverage": float(covered.mean()),
            "coverage_low": float(exact.low),
            "coverage_high": float(exact.high),
            "trusted": float(np.mean(self.trusted)),
            "mean_absolute_error_m": float(np.abs(estimate - truth).mean()),
            "median_width_m": float(np.median(high - low)),
        }

    def to_json(self) -> dict[str, Any]:
        """Plain numbers with their summary first."""
        return {"summary": self.summary(), **asdict(self)}


def read_fresh(run: Path) -> list[dict[str, Any]]:
    """What was measured for a training, one a joint; nothing where it was not, or by an older version."""
    known = read_json(run / FRESH, "runs") if (run / FRESH).exists() else []
    return known if isinstance(known, list) else []


def evaluate_fresh(gauge: Gauge, campaign: Campaign, recordings: int) -> list[FreshEvaluation]:
    """Simulate recordings like those of the training and estimate them one by one.

    Args:
        gauge: trained and calibrated.
        campaign: that made the training data; another seed makes new runs of it.
        recordings: how many.

    Returns:
        One a joint whose clearance is estimated.

    Raises:
        InputError: every run became non-finite.
    """
    signals, labels = replace(campaign, seed=campaign.seed + _OTHER_SEED).fresh(recordings, 0, gauge.channels)
    if not signals:
        raise InputError(
            f"fresh={recordings}: every fresh run became non-finite; set fresh=0, or train with another "
            "integrator.step or machine"
        )
    chain = asdict(campaign.chain)
    found = [gauge.estimate(one.astype(float), campaign.chain.rate, chain) for one in signals]
    return [
        FreshEvaluation(
            joint,
            labels[:, LABELS.index(target)].tolist(),
            [one.clearance_m for one in own],
            [one.low_m for one in own],
            [one.high_m for one in own],
            [one.trusted for one in own],
        )
        for joint, target, own in zip(gauge.joints, gauge.targets, zip(*found, strict=True), strict=True)
    ]
