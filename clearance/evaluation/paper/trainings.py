"""Which trainings a table consists of, which of them are finished, and how they differ from the paper's.

A finished training is found by its folder, or by its row in the record of all that were ever reported:
folders with weights may stay on the machine that trained them, the record goes with the project.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import hydra
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf

from clearance.configuration import CONFIGURATION
from clearance.errors import InputError
from clearance.evaluation.paper.perturbation import PERTURBED
from clearance.models.run_folder import CONFIG, HARDWARE, METRICS
from clearance.whole_files import read_json, read_yaml

_SWEPT = ("model", "sensors", "joint", "chain.decimation")  # what the rows of the paper's tables differ in
_INCIDENTAL = (
    "name", "folder", "experiment", "chosen_model", "overrides", "labels", "resume", "seed", "seeds",
    "split_seed", *HARDWARE,
)  # fmt: skip
"""Keys in which trainings of one study may differ."""
_REFERENCE = re.compile(r"\$\{([\w.]+)\}")


class Setting(NamedTuple):
    """What one row of a table is about."""

    model: str
    sensors: str = "rod"
    joint: str = "C"
    decimation: int = 10

    @property
    def overrides(self) -> list[str]:
        """Of ``clearance.train``."""
        return [f"{key}={value}" for key, value in zip(_SWEPT, self, strict=True)]


class Training(NamedTuple):
    """A setting, how the recordings were divided, and the initial weights."""

    setting: Setting
    split_seed: int
    seed: int


@dataclass(frozen=True)
class Finished:
    """A training whose last file is there, or whose row is in the record.

    Attributes:
        training: which one.
        metrics: what it left: errors, times, environment, seeds.
        reduced: settings that are not the paper's: key to value and the paper's value.
        data_seed: of the simulated recordings.
        test_to_training: recordings of the one for each of the other.
        date: of its last file.
        perturbed: errors by perturbation of Table 7, where they were measured.
        path: its folder; ``None``: another machine has it.
        config: it was made from; empty without a folder.
    """

    training: Training
    metrics: Mapping[str, Any]
    reduced: Mapping[str, tuple[str, str]]
    data_seed: int
    test_to_training: float
    date: str
    perturbed: Mapping[str, Mapping[str, float]] | None = None
    path: Path | None = None
    config: Mapping[str, Any] = field(default_factory=dict)

    @staticmethod
    def of(path: Path) -> "Finished":
        """The training in a folder.

        Raises:
            InputError: there is none, or what was measured of it since is damaged.
        """
        config, own = read_yaml(path / CONFIG, "runs") or {}, path / PERTURBED
        try:
            training, data_seed, split = _identify(config), config["data_seed"], config["data"]["split"]
            test_to_training = (1.0 - split["train"] - split["validation"]) / split["train"]
        except (KeyError, TypeError, AttributeError):
            raise InputError(f"{path}: no training of clearance.train; set runs to another folder") from None
        try:
            perturbed = read_json(own, "runs")["perturbations"] if own.exists() else None
        except (KeyError, TypeError):
            raise InputError(
                f"{own}: no errors by perturbation; remove it, and set perturbed to measure them"
            ) from None
        return Finished(
            training, read_json(path / METRICS, "runs"), _reduced(config, training.setting), data_seed,
            test_to_training,
            datetime.fromtimestamp((path / METRICS).stat().st_mtime, UTC).strftime("%Y-%m-%d"),
            perturbed, path, config,
        )  # fmt: skip

    @staticmethod
    def of_row(row: Mapping[str, Any]) -> "Finished":
        """The training of a row of the record."""
        setting = Setting(row["model"], row["sensors"], row["joint"], row["decimation"])
        training = Training(setting, row["split_seed"], row["seed"])
        metrics = {**row, "data": {"recordings": row["recordings"]}}
        reduced = {key: (own, paper) for key, (own, paper) in row["reduced"].items()}
        return Finished(
            training,
            metrics,
            reduced,
            row["data_seed"],
            row["test_to_training"],
            row["date"],
            row["perturbed"],
        )

    @property
    def row(self) -> dict[str, Any]:
        """For the record."""
        keys = ("validation", "test", "training_seconds", "evaluation_seconds", "parameters", "environment")
        setting, split_seed, seed = self.training
        return {
            **setting._asdict(), "split_seed": split_seed, "seed": seed, "date": self.date,
            "recordings": self.metrics["data"]["recordings"], "data_seed": self.data_seed,
            "test_to_training": self.test_to_training, "reduced": dict(self.reduced),
            **{key: self.metrics[key] for key in keys}, "perturbed": self.perturbed,
        }  # fmt: skip


@cache
def trainings_of(experiment: str) -> tuple[Training, ...]:
    """What ``clearance.train -m experiment=...`` trains, in that order: ``conf/experiment`` says it once."""
    cfg = _composed(f"experiment={experiment}")
    if not cfg.hydra.sweeper.params:
        raise InputError(
            f"experiment={experiment} sweeps nothing, so that it is no table of trainings; set experiments"
        )
    params: Any = OmegaConf.to_container(cfg.hydra.sweeper.params)
    swept = {str(key): str(value).split(",") for key, value in params.items()}
    plain = {**cfg.hydra.runtime.choices, "chain.decimation": cfg.chain.decimation}
    axes = [swept.pop(key, [str(plain[key])]) for key in _SWEPT]
    seeds = [swept.pop(key, [str(cfg[key])]) for key in ("split_seed", "seed")]
    if swept:
        raise InputError(f"experiment={experiment} sweeps {', '.join(swept)}, which no table tells apart")
    return tuple(
        Training(Setting(model, sensors, joint, int(decimation)), int(split), int(seed))
        for model, sensors, joint, decimation, split, seed in product(*axes, *seeds)
    )


def finished_trainings(folder: Path) -> list[Finished]:
    """All finished trainings below ``folder``.

    Raises:
        InputError: two of them are the same training, twice or at different scales.
    """
    found: dict[Training, Finished] = {}
    for path in sorted(folder.rglob(METRICS)):
        one = Finished.of(path.parent)
        if one.training in found:
            raise InputError(
                f"runs = {folder}: {found[one.training].path} and {one.path} are the same training, twice or "
                "at different scales; set runs to a folder with one of them"
            )
        found[one.training] = one
    return list(found.values())


def recorded_trainings(record: Path) -> list[Finished]:
    """All trainings of a record, which need not be there.

    Raises:
        InputError: it is none, or of an older version.
    """
    if not record.exists():
        return []
    try:
        return [Finished.of_row(row) for row in read_json(record, "pictures")]
    except (KeyError, TypeError, ValueError):
        raise InputError(
            f"pictures = {record.parent}: {record.name} there is no record of trainings, or one of an older "
            "version; move it away or set pictures to another folder"
        ) from None


def known_trainings(folder: Path, record: Path) -> list[Finished]:
    """All trainings below ``folder``, and those of the record that are not there.

    Raises:
        InputError: folder or record hold different scales.
    """
    found = {one.training: one for one in recorded_trainings(record)}
    for one in finished_trainings(folder):
        known = found.get(one.training)
        if known and one.perturbed is None and one.metrics["test"] == known.metrics["test"]:
            one = replace(one, perturbed=known.perturbed)  # measured where the same weights were before
        found[one.training] = one
    scales: dict[str, Finished] = {}
    for one in found.values():
        first = scales.setdefault(one.training.setting.model, one)
        if dict(first.reduced) != dict(one.reduced):
            where = " and ".join(str(run.path or record) for run in (first, one))
            raise InputError(
                f"trainings of {one.training.setting.model} at different scales: {where}; set pictures and "
                "report to others, or runs to a folder with one scale"
            )
    return list(found.values())


@cache
def reduction(setting: Setting, *overrides: str) -> dict[str, tuple[str, str]]:
    """What would not be the paper's of a training with these overrides: key to value and the paper's."""
    return _reduced(_resolved("experiment=paper", *setting.overrides, *overrides), setting)


def reductions(found: Sequence[Finished]) -> dict[tuple[str, str, str], set[str]]:
    """Settings in which any of these trainings is not the paper's.

    Returns:
        Key, value and the paper's value, to the models of which this is true.
    """
    different: dict[tuple[str, str, str], set[str]] = {}
    for one in found:
        for key, (own, paper) in one.reduced.items():
            different.setdefault((key, own, paper), set()).add(one.training.setting.model)
    return different


def _identify(config: Mapping[str, Any]) -> Training:
    setting = Setting(
        config.get("chosen_model") or config["name"].split(" on ")[0],  # an older one has its name alone
        config["sensors"]["name"],
        config["joint"]["name"],
        config["chain"]["decimation"],
    )
    return Training(setting, config["split_seed"], config["seed"])


@cache
def _papers(setting: Setting) -> dict[str, Any]:
    return _compared(_resolved("experiment=paper", *setting.overrides))


def _resolved(*overrides: str) -> Any:
    # Name and folder would ask Hydra about this job.
    cfg = _composed(*overrides, "name=paper", "folder=paper")
    kept = OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key != "hydra"])
    return OmegaConf.to_container(kept, resolve=True)


def _reduced(config: Mapping[str, Any], setting: Setting) -> dict[str, tuple[str, str]]:
    paper, own = _papers(setting), _compared(config)
    return {
        key: (_short(key, own.get(key)), _short(key, paper.get(key)))
        for key in sorted({*paper, *own})
        if paper.get(key) != own.get(key)
    }


def _compared(config: Mapping[str, Any]) -> dict[str, Any]:
    """Every key that may tell two trainings apart, once."""
    flat = dict(_flattened(config, ""))
    return {
        key: value for key, value in flat.items()
        if not _below(key, _INCIDENTAL) and not _repeats(key, flat)
    }  # fmt: skip


def _repeats(key: str, flat: Mapping[str, Any]) -> bool:
    """Whether a key only says what another one does."""
    return any(
        _below(key, [place]) and flat[key] == flat.get(source + key.removeprefix(place))
        for place, source in _references().items()
    )


@cache
def _references() -> dict[str, str]:
    """Keys that follow others unless they are set themselves, to those."""
    raw = OmegaConf.to_container(_composed("experiment=paper"), resolve=False)
    found = {key: _REFERENCE.fullmatch(str(value)) for key, value in _flattened(raw, "")}
    return {key: match[1] for key, match in found.items() if match}


def _flattened(node: Any, path: str) -> list[tuple[str, Any]]:
    if isinstance(node, Mapping):
        return [
            leaf
            for key, value in node.items()
            for leaf in _flattened(value, f"{path}.{key}" if path else key)
        ]
    return [(path, node)]


def _below(key: str, parents: Sequence[str]) -> bool:
    return any(key == parent or key.startswith(f"{parent}.") for parent in parents)


def _short(key: str, value: Any) -> str:
    if value is None:
        return "none"
    if key.endswith("_target_"):  # of a class its name; any other text may be a path
        return str(value).rpartition(".")[2]
    return f"{value:g}" if isinstance(value, float) else str(value)


def _composed(*overrides: str) -> DictConfig:
    if GlobalHydra.instance().is_initialized():  # inside a command
        return hydra.compose("train", list(overrides), return_hydra_config=True)
    with hydra.initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return hydra.compose("train", list(overrides), return_hydra_config=True)
