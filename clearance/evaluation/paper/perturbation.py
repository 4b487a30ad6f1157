"""Finished trainings on other machines and sensors than the training's (paper, Section 4.6, Table 7)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torchmetrics import MetricCollection

from clearance.errors import InputError
from clearance.mechanism.contact import ContactLaw
from clearance.mechanism.description import with_values
from clearance.mechanism.parameters import require, require_list
from clearance.models.gauge import Gauge, estimate_windows
from clearance.models.run_folder import CONFIG
from clearance.models.trusted import instantiate_trusted
from clearance.provenance import fingerprint
from clearance.recording.synthesis import Campaign
from clearance.whole_files import read_yaml
from clearance.windows.sources import LabelledRecordings, SimulatedSource
from clearance.windows.splitting import RandomSplit
from clearance.windows.window_set import WindowSet

PERTURBED = "perturbed.json"
_OTHER_SEED = 2_000_000  # added to the training's: the same new clearances and speeds for every perturbation
_NOISE_STREAM = 3


@dataclass(frozen=True)
class TrainingData:
    """Where a finished training's recordings came from."""

    campaign: Campaign
    folder: Path  # of data sets
    start_time: float  # [s]
    channels: tuple[str, ...]
    targets: tuple[str, ...]
    split: RandomSplit
    memory: int  # bytes that recordings may take

    @classmethod
    def of(cls, run: Path) -> "TrainingData":
        """Read the configuration of a finished training.

        Raises:
            InputError: it was not trained on runs that it simulated.
        """
        config: dict[str, Any] = read_yaml(run / CONFIG, "runs") or {}
        try:
            data = config["data"]
            split = {key: data["split"][key] for key in ("seed", "train", "validation")}
            return cls(
                replace(instantiate_trusted(config["campaign"], str(run / CONFIG)), device="cpu"),
                Path(data["source"]["folder"]),
                float(data["source"]["start_time"]),
                tuple(data["channels"]),
                tuple(config["targets"]),
                RandomSplit(**split),
                int(data["memory_gib"] * 2**30),
            )
        except (KeyError, TypeError) as error:
            raise InputError(
                f"{run / CONFIG}: not trained on runs that it simulated (data=simulated); set perturbed=0, "
                "or runs to another folder"
            ) from error

    def load(self, campaign: Campaign | None = None) -> LabelledRecordings:
        """Recordings of a campaign, or of the training's; simulated where they are not stored."""
        source = SimulatedSource(campaign or self.campaign, str(self.folder), self.start_time)
        source.prepare()
        return source.load(self.channels, self.targets, self.memory)

    def test(self) -> LabelledRecordings:
        """The recordings that the training was tested with."""
        return subset(every := self.load(), self.split.divide(every.groups).test)


class Perturbation(Protocol):
    """Makes recordings that a training is tested with."""

    def recordings(self, data: TrainingData, count: int) -> LabelledRecordings:
        """``count`` new recordings, or the training's own test recordings, changed."""
        ...


@dataclass(frozen=True)
class NewRuns:
    """New runs of a machine whose contact is not the training's.

    Attributes:
        restitution: limits of its relative error, drawn anew for each run [-].
        stiffness: likewise of K.
        law: whose formula the contact follows; ``None``: the training's.
    """

    restitution: Sequence[float] = (0.0, 0.0)
    stiffness: Sequence[float] = (0.0, 0.0)
    law: ContactLaw | None = None

    def __post_init__(self) -> None:
        require_list(self, 2, -0.99, 10.0, restitution=self.restitution, stiffness=self.stiffness)

    def campaign(self, nominal: Campaign, count: int) -> Campaign:
        """The training's campaign with another contact in the joint whose clearance is drawn."""
        random: dict[str, Sequence[float]] = dict(nominal.random or {})
        machine = nominal.mechanism
        for joint, drawn in (("joint_b", nominal.joint.b), ("joint_c", nominal.joint.c)):
            if drawn is False:
                continue
            contact = getattr(machine, joint).contact
            errors = {"restitution": self.restitution, "stiffness_scale": self.stiffness}
            for name, (low, high) in errors.items():
                if (low, high) != (0.0, 0.0):
                    own = getattr(contact, name)
                    random[f"{joint}.contact.{name}"] = (own * (1 + low), own * (1 + high))
            if self.law is not None:
                machine = with_values(machine, {f"{joint}.contact": type(self.law)(**vars(contact))})
        seed = nominal.seed + _OTHER_SEED
        return replace(nominal, mechanism=machine, random=random, seed=seed, runs=count)

    def recordings(self, data: TrainingData, count: int) -> LabelledRecordings:
        """Simulate ``count`` runs."""
        return data.load(self.campaign(data.campaign, count))


@dataclass(frozen=True)
class NoisyTest:
    """The training's own test recordings with white Gaussian noise.

    Attributes:
        noise: its standard deviation over the signal's, per channel [-].
    """

    noise: float

    def __post_init__(self) -> None:
        require(self, 0.0, 10.0, noise=self.noise)

    def recordings(self, data: TrainingData, count: int) -> LabelledRecordings:
        """All test recordings; ``count`` is not used."""
        test = data.test()
        rng = np.random.default_rng([data.campaign.seed, _NOISE_STREAM])
        deviation = test.signals.std(axis=0, dtype=np.float64).astype(np.float32)
        test.signals += self.noise * deviation * rng.standard_normal(test.signals.shape, dtype=np.float32)
        return test


def subset(every: LabelledRecordings, indices: np.ndarray) -> LabelledRecordings:
    """Some recordings, copied."""
    return replace(
        every,
        signals=np.concatenate([every.recording(int(index)) for index in indices]),
        lengths=every.lengths[indices],
        target=every.target[indices],
        speed=every.speed[indices],
        groups=every.groups[indices],
    )


def estimate(gauge: Gauge, recordings: LabelledRecordings) -> tuple[np.ndarray, np.ndarray]:
    """Estimated and true clearances (windows, targets) [m] of all windows side by side."""
    windows = WindowSet.side_by_side(
        gauge.scalers.signals.transform(recordings.signals), recordings.lengths, gauge.familiarity.length,
        recordings.target.shape[1],
    )  # fmt: skip
    truth = recordings.target[windows.recording.numpy()]
    return estimate_windows(gauge.estimator, gauge.scalers, windows), truth


def evaluate_perturbed(
    gauge: Gauge,
    data: TrainingData,
    perturbations: Mapping[str, Perturbation],
    count: int,
    metrics: MetricCollection,
) -> dict[str, Any]:
    """Errors by perturbation, as plain numbers, and by which perturbations."""
    found: dict[str, dict[str, float]] = {}
    for name, perturbation in perturbations.items():
        fresh = metrics.clone()
        fresh.update(*map(torch.from_numpy, estimate(gauge, perturbation.recordings(data, count))))
        found[name] = {key: float(value) for key, value in fresh.compute().items()}
    return {"recordings": count, "asked": asked(perturbations, count), "perturbations": found}


def asked(perturbations: Mapping[str, Perturbation], count: int) -> str:
    """Changes with the perturbations and the number of new recordings of each."""
    return fingerprint([perturbations, count])
