"""The folder of one training: what is in it, written so that a kill leaves no half file."""

import os
import platform
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import torch
import yaml
from lightning.pytorch.loggers import TensorBoardLogger
from torch.utils.tensorboard.summary import hparams

from clearance.errors import InputError
from clearance.provenance import revision
from clearance.whole_files import read_json, read_yaml, write_atomically, write_json

CONFIG, METRICS = "config.yaml", "metrics.json"
_BEGUN = "begun.json"  # on which recordings, and by which job of Slurm
HARDWARE = (
    "trainer.threads", "trainer.progress", "trainer.accelerator", "trainer.devices", "model.jobs",
    "model.device", "campaign.device", "data.memory_gib", "data.source.folder",
)  # fmt: skip
"""Keys of what computes a training, and of where its data lie: they decide its last digits at most."""
_COMPUTING = frozenset(key.rpartition(".")[2] for key in HARDWARE)  # copied to where they are used
_ASKED = ("experiment", "chosen_model", "overrides", "folder", "resume")
"""How a training was asked for: does not change it."""
_OUTDATED = (
    METRICS, _BEGUN, "model.safetensors", "model.ubj", "scalers.json", "calibration.json", "fresh.json",
    "perturbed.json", "events.out.tfevents.*",
)  # fmt: skip
"""Of another training: what it left, and what was measured of its weights since."""


@dataclass
class RunFolder:
    """A folder, its TensorBoard events and the seed of what is trained in it.

    Attributes:
        path: the folder.
        seed: of the training.
        config: of the training.
        anew: what is there is of another training, or is not wanted: ``begin`` removes it.
        logger: of TensorBoard's events.
    """

    path: Path
    seed: int
    config: dict[str, Any]
    anew: bool
    logger: TensorBoardLogger

    @classmethod
    def open(cls, path: Path, config: dict[str, Any], seed: int, resume: bool = True) -> "RunFolder":
        """Open the folder of ``config``: the same training goes on where it stopped, unless it shall not.

        Raises:
            InputError: if another training, or somebody, has left something there that would be lost.
        """
        found = read_yaml(path / CONFIG, "hydra.run.dir")
        known = set(found or {}) & set(config)  # of a training's configuration, not of somebody's
        if not known and any((path / name).exists() for name in (CONFIG, "checkpoints")):
            raise InputError(f"{path} holds files that no training left; choose another hydra.run.dir")
        other = _differing(_task(found or {}), _task(config))
        if resume and other and ((path / METRICS).exists() or (path / "checkpoints").exists()):
            raise InputError(
                f"{path} holds a training with other settings ({', '.join(other)}): choose another "
                "hydra.run.dir, or resume=false to replace it"
            )
        anew = bool(other) or not (resume or _begun_by_this_job(path))
        logger = TensorBoardLogger(path, name="", version="", default_hp_metric=False)
        return cls(path, seed, config, anew, logger)

    def begin(self, recordings: str) -> None:
        """Make the folder that of this training, on recordings with this fingerprint.

        Raises:
            InputError: a training that would go on, or is finished, had others.
        """
        begun = {} if self.anew else _begun(self.path)
        if begun and begun["recordings"] != recordings:
            raise InputError(f"{self.path}: its recordings have changed; resume=false trains again")
        self.path.mkdir(parents=True, exist_ok=True)
        if self.anew:
            self.drop_checkpoints()
            for outdated in [one for pattern in _OUTDATED for one in self.path.glob(pattern)]:
                outdated.unlink()
        if not self.finished:  # what is stays as it was asked for
            text = yaml.safe_dump(self.config, sort_keys=False)
            write_atomically(self.path / CONFIG, lambda file: file.write_text(text, encoding="utf-8"))
        if not begun:
            write_json(self.path / _BEGUN, {"recordings": recordings, "job": os.environ.get("SLURM_JOB_ID")})
        self.anew = False

    @property
    def checkpoints(self) -> Path:
        """Where a training keeps what it needs to go on."""
        return self.path / "checkpoints"

    @property
    def finished(self) -> bool:
        """Whether the last file of the training is there."""
        return not self.anew and (self.path / METRICS).exists()

    def compare(self, scores: dict[str, float]) -> None:
        """Give TensorBoard's HParams what it compares this training with others by.

        Lightning would add a list of columns, which TensorBoard takes from one training; without it, it
        puts those of all together, and first those in which they differ.
        """
        self.logger.log_metrics(scores)
        known = {key: value for key, value in self.config.items() if key not in ("data", *_ASKED)}
        _, start, end = hparams(_flat(known), {})  # data repeats what the other keys say
        writer = self.logger.experiment._get_file_writer()
        writer.add_summary(start)
        writer.add_summary(end)

    def finish(self, metrics: dict[str, Any]) -> None:
        """Write the metrics, the last file, and drop what only a resumption needs."""
        write_json(self.path / METRICS, metrics)
        self.drop_checkpoints()
        self.logger.finalize("success")

    def drop_checkpoints(self) -> None:
        """Remove what only a resumption needs."""
        shutil.rmtree(self.checkpoints, ignore_errors=True)


def _begun(path: Path) -> dict[str, Any]:
    """What the beginning of the training in a folder left; empty where it is older than this file."""
    found: dict[str, Any] = read_json(path / _BEGUN, "resume=false") if (path / _BEGUN).exists() else {}
    return found


def _begun_by_this_job(path: Path) -> bool:
    """Whether a job that Slurm has queued again, after a lost node or at a limit of time, began it."""
    again = int(os.environ.get("SLURM_RESTART_COUNT", "0")) > 0
    return again and _begun(path).get("job") == os.environ.get("SLURM_JOB_ID")


def _flat(config: dict[str, Any], before: str = "") -> dict[str, Any]:
    """{"model/net/hidden_size": 128}: numbers as they are, everything else as text."""
    flat: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{before}{key}/")
        else:
            flat[f"{before}{key}"] = value if isinstance(value, int | float | str) else str(value)
    return flat


def _task(config: dict[str, Any]) -> dict[str, Any]:
    """A configuration without what does not decide its training; what is null as if it were not there."""
    return _named({key: value for key, value in config.items() if key not in _ASKED})


def _named(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _named(one) for key, one in value.items() if one is not None and key not in _COMPUTING}
    return [_named(one) for one in value] if isinstance(value, list) else value


def _differing(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    return sorted(key for key in {*one, *other} if one.get(key) != other.get(key))


def environment(threads: int | None = None, gpu: bool = True) -> dict[str, Any]:
    """Hardware, versions and commit that a duration or a last digit depends on.

    Args:
        threads: that computed; ``None``: as many as torch takes now.
        gpu: whether a GPU computed, where there is one.
    """
    packages = ("clearance", "torch", "lightning", "numpy", "scikit-learn")
    return {
        "processor": _processor(),
        "threads": threads or torch.get_num_threads(),
        "gpu": torch.cuda.get_device_name() if gpu and torch.cuda.is_available() else None,
        "python": platform.python_version(),
        "revision": revision(),
        "packages": {name: metadata.version(name) for name in packages},
    }


def hardware(environment: Mapping[str, Any]) -> str:
    """What computed, of an ``environment``: the GPU, or the processor and its threads."""
    if environment["gpu"]:
        return str(environment["gpu"])
    threads = environment["threads"]
    return f"{environment['processor']}, {threads} thread{'s' if threads != 1 else ''}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()
