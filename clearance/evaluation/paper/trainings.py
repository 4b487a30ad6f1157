"""Which trainings a table consists of, which of them are finished, and how they differ from the paper's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import hydra
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig, OmegaConf

from clearance.configuration import CONFIGURATION
from clearance.errors import InputError
from clearance.models.run_folder import CONFIG, METRICS
from clearance.whole_files import read_json, read_yaml

_SWEPT = ("model", "sensors", "joint", "chain.decimation")  # what the rows of the paper's tables differ in
# What tells one scale from another; the rest of a configuration follows from it or is told by the row.
_SCALE = ("runs", "start_time", "campaign.duration", "windows", "trainer", "model")
_NOT_SCALE = ("model.training", "model.metrics", "trainer.threads", "trainer.progress", "trainer.accelerator")


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
    """A training whose last file is there."""

    training: Training
    path: Path
    config: Mapping[str, Any]
    metrics: Mapping[str, Any]


@cache
def trainings_of(experiment: str) -> tuple[Training, ...]:
    """What ``clearance.train -m experiment=...`` trains, in that order: ``conf/experiment`` says it once."""
    cfg = _composed(f"experiment={experiment}")
    params = OmegaConf.to_container(cfg.hydra.sweeper.params)
    assert isinstance(params, dict)
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
        InputError: two of them are the same training at different scales.
    """
    found: dict[Training, Finished] = {}
    for path in sorted(folder.rglob(METRICS)):
        config = read_yaml(path.parent / CONFIG) or {}
        one = Finished(_identify(config, path.parent), path.parent, config, read_json(path))
        if one.training in found:
            raise InputError(
                f"runs = {folder}: {found[one.training].path} and {one.path} are the same training at "
                "different scales; set runs to a folder with one scale"
            )
        found[one.training] = one
    return list(found.values())


def reductions(found: Sequence[Finished]) -> dict[tuple[str, str, str], set[str]]:
    """Settings in which any of these trainings is not the paper's.

    Returns:
        Key, value and the paper's value, to the models of which this is true.
    """
    different: dict[tuple[str, str, str], set[str]] = {}
    for one in found:
        paper, own = _paper_scale(one.training.setting), _scale(one.config)
        for key in sorted({*paper, *own}):
            if paper.get(key) != own.get(key):
                values = (key, _short(own.get(key)), _short(paper.get(key)))
                different.setdefault(values, set()).add(one.training.setting.model)
    return different


def _identify(config: Mapping[str, Any], folder: Path) -> Training:
    try:
        setting = Setting(
            config["name"].split(" on ")[0],
            config["sensors"]["name"],
            config["joint"]["name"],
            config["chain"]["decimation"],
        )
        return Training(setting, config["split_seed"], config["seed"])
    except (KeyError, TypeError, AttributeError):
        raise InputError(f"{folder}: no training of clearance.train; set runs to another folder") from None


@cache
def _paper_scale(setting: Setting) -> dict[str, Any]:
    # Name and folder would ask Hydra about this job.
    cfg = _composed("experiment=paper", *setting.overrides, "name=paper", "folder=paper")
    config: Any = OmegaConf.to_container(
        OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key != "hydra"]), resolve=True
    )
    return _scale(config)


def _scale(config: Mapping[str, Any]) -> dict[str, Any]:
    flat = dict(_flattened(config, ""))
    return {
        key: value for key, value in flat.items()
        if _below(key, _SCALE) and not _below(key, _NOT_SCALE)
    }  # fmt: skip


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


def _short(value: Any) -> str:
    if value is None:
        return "none"
    return (
        value.rpartition(".")[2]
        if isinstance(value, str)
        else f"{value:g}"
        if isinstance(value, float)
        else str(value)
    )


def _composed(*overrides: str) -> DictConfig:
    if GlobalHydra.instance().is_initialized():  # inside a command
        return hydra.compose("train", list(overrides), return_hydra_config=True)
    with hydra.initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        return hydra.compose("train", list(overrides), return_hydra_config=True)
