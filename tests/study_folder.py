"""Folders of finished trainings made without training, as far as tables read them."""

import json
from copy import deepcopy
from functools import cache

import yaml
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from clearance.configuration import CONFIGURATION
from clearance.evaluation.paper.trainings import Setting, Training


@cache
def configuration(setting: Setting, *overrides: str):
    name = f"name='{setting.model} on {setting.sensors}, joint {setting.joint}'"
    with initialize_config_dir(str(CONFIGURATION), version_base="1.3"):
        cfg = compose("train", ["experiment=paper", *setting.overrides, name, "folder=x", *overrides])
    return OmegaConf.to_container(cfg, resolve=True)


def finish(folder, training: Training, nmae: float, *overrides: str) -> None:
    """Leave the configuration and metrics of a training whose errors follow from ``nmae`` [%]."""
    seeds = {"split_seed": training.split_seed, "seed": training.seed}
    chosen = {"experiment": "paper", "chosen_model": training.setting.model}  # as train.open_run does
    config = chosen | deepcopy(configuration(training.setting, *overrides)) | seeds
    config["data"]["seed"], config["data"]["split"]["seed"] = training.seed, training.split_seed
    place = folder / ",".join(map(str, (*training.setting, *seeds.values())))
    place.mkdir(parents=True)
    (place / "config.yaml").write_text(yaml.safe_dump(config))
    errors = {"nmae": nmae, "nrmse": 2 * nmae, "median_ae": nmae * 1e-5 / 2, "p95_ae": nmae * 3e-5}
    metrics = {
        "validation": errors, "test": errors, "training_seconds": 60.0, "evaluation_seconds": 0.5,
        "parameters": 7, **seeds, "data": {"recordings": config["runs"]},
        "environment": {"processor": "P", "threads": 2, "gpu": None, "packages": {"torch": "2"}},
    }  # fmt: skip
    (place / "metrics.json").write_text(json.dumps(metrics))
