"""Networks as estimators: training with early stopping, resumption, and weights as plain arrays."""

import logging
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
import torch
from lightning.pytorch.callbacks import (
    EarlyStopping,
    LearningRateMonitor,
    ModelCheckpoint,
    Timer,
    TQDMProgressBar,
)
from lightning.pytorch.plugins.io import TorchCheckpointIO
from lightning.pytorch.utilities.exceptions import MisconfigurationException
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn
from torch.optim import Optimizer
from torchmetrics import MetricCollection

from clearance.errors import InputError
from clearance.mechanism.parameters import require
from clearance.models.processor import efficient_processor, used_threads
from clearance.models.regressor import Regressor
from clearance.models.run_folder import RunFolder
from clearance.models.schedule import Schedule
from clearance.whole_files import write_atomically
from clearance.windows.datamodule import WindowData
from clearance.windows.window_set import WindowSet

log = logging.getLogger(__name__)
_PRECISIONS = ("32-true", "32", "bf16-mixed", "bf16", "16-mixed", "16")
_SHAPE = ("channels", "length", "outputs")  # of a network, as its arguments and in its file
_PREDICTED_AT_ONCE = 512  # windows: bounds the memory of activations


@dataclass
class Training:
    """How any network is trained; an option of ``trainer``."""

    loss: nn.Module
    optimizer: Callable[[Iterable[nn.Parameter]], Optimizer]
    schedule: Schedule
    epochs: int = 200
    patience: int = 20  # epochs without a better validation loss
    monitor: str = "val/loss"  # chooses the epoch whose weights are kept
    precision: str = "32-true"  # of Lightning: bf16-mixed computes products in 16 bits; weights keep 32
    accelerator: str = "auto"
    devices: int | None = None  # GPUs, or processes without one, that share each batch; null: one
    threads: int | None = None  # of the processor; null takes all that this process may use, 8 at most
    progress: bool = True

    def __post_init__(self) -> None:
        require(self, 1, 1e6, whole=True, epochs=self.epochs, patience=self.patience)
        for name in ("devices", "threads"):
            if getattr(self, name) is not None:
                require(self, 1, 1024, whole=True, **{name: getattr(self, name)})
        if not isinstance(self.progress, bool):
            raise InputError(
                f"trainer.progress = {self.progress!r} is neither true nor false; change trainer.progress"
            )
        for name in ("loss", "schedule"):
            if getattr(self, name) is None:
                raise InputError(f"trainer.{name} = null: a training needs one; change trainer.{name}")
        rate = getattr(self.optimizer, "keywords", {}).get("lr", 0.0)
        if isinstance(rate, bool) or not isinstance(rate, int | float):
            raise InputError(f"lr = {rate!r} is not a number; change trainer.optimizer.lr")
        try:
            self.optimizer([nn.Parameter(torch.zeros(1))])
        except (TypeError, ValueError) as error:
            raise InputError(f"trainer.optimizer: {error}; change trainer.optimizer") from error


class Patience(EarlyStopping):
    """Early stopping that has stopped for good: a training that is resumed later is not trained on."""

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Stop before the first epoch where the last one before a kill was one too many."""
        trainer.should_stop = trainer.should_stop or self.wait_count >= self.patience


class Checkpoints(ModelCheckpoint):
    """Checkpoints that may be moved with their folder; Lightning's then forgets which was the best."""

    @property
    def state_key(self) -> str:
        """That of Lightning's own: trainings that were begun with these go on."""
        return super().state_key.replace(type(self).__qualname__, ModelCheckpoint.__qualname__, 1)

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take over what was known, with every path in the folder of today."""

        def here(path: str) -> str:
            return str(Path(str(self.dirpath)) / Path(path).name) if path else path

        paths = {name: here(path) for name, path in state_dict.items() if name.endswith("_model_path")}
        best = {here(path): score for path, score in state_dict["best_k_models"].items()}
        super().load_state_dict({**state_dict, **paths, "dirpath": self.dirpath, "best_k_models": best})


class NeuralEstimator:
    """A network, how it is trained, and afterwards its best weights.

    Args:
        net: Makes the network from the numbers of channels, of time steps and of outputs.
        training: Loss, optimiser, schedule and stopping.
        metrics: In metres, reported on the validation windows every epoch.
        gradient_clip: Largest norm of the gradient, or None.
    """

    def __init__(
        self,
        net: Callable[..., nn.Module],
        training: Training,
        metrics: MetricCollection,
        gradient_clip: float | None = None,
    ) -> None:
        self._make, self.training, self.metrics, self.gradient_clip = net, training, metrics, gradient_clip
        self._shape = (0, 0, 0)  # channels, time steps, outputs
        self._begun: dict[str, torch.Tensor] = {}  # weights of another training
        if gradient_clip is not None:
            require(self, 0.0, strict=True, gradient_clip=gradient_clip)
        monitored = ["val/loss", *(f"val/{name}" for name in metrics)]
        if training.monitor not in monitored:
            raise InputError(
                f"trainer.monitor={training.monitor}: must be one of {', '.join(monitored)}; "
                "set trainer.monitor"
            )
        self.net: nn.Module

    @property
    def parameters(self) -> int:
        """Number of weights."""
        return sum(p.numel() for p in self.net.parameters())

    @property
    def processors(self) -> tuple[int | None, bool]:
        """Threads, and whether a GPU is taken where there is one."""
        return used_threads(self.training.threads), self.training.accelerator != "cpu"

    def check(self, data: WindowData) -> None:
        """Build the network and let it read a window of zeros: what fails shows before there are data."""
        plan = self.training
        if str(plan.precision) not in _PRECISIONS:
            raise InputError(
                f"trainer.precision={plan.precision}: must be one of {', '.join(_PRECISIONS)}; set "
                "trainer.precision"
            )
        self._build_for(data)
        try:
            with torch.inference_mode():
                self.net(torch.zeros(1, data.windows.length, len(data.channels)))
        except RuntimeError as error:
            raise InputError(f"model.net: {error}; change model.net, or windows.length") from error

    def check_devices(self) -> None:
        """Make Lightning's trainer, which looks for them."""
        with warnings.catch_warnings():
            _quiet()
            off = ("logger", "enable_checkpointing", "enable_progress_bar", "enable_model_summary")
            _trainer(**_devices(self.training), **dict.fromkeys(off, False))

    def fit(self, data: WindowData, run: RunFolder) -> float:
        """Train until the validation loss stops falling, or go on from the last checkpoint of ``run``."""
        plan = self.training
        self.initialize(data, run.seed)
        module = Regressor(
            self.net, plan.loss, plan.optimizer, plan.schedule, self.metrics, data.scalers.target
        )  # fmt: skip
        best = Checkpoints(run.checkpoints, "best", monitor=plan.monitor, enable_version_counter=False)
        timer = Timer(verbose=False)
        callbacks = [
            Patience(plan.monitor, patience=plan.patience),
            timer,
            best,
            Checkpoints(run.checkpoints, "last", enable_version_counter=False),
            LearningRateMonitor("epoch"),
            OfDevice(plan.threads),
        ]
        run_lightning(
            module, data, plan, run.checkpoints, callbacks,
            logger=run.logger, gradient_clip_val=self.gradient_clip,
        )  # fmt: skip
        # What the callbacks know is in the checkpoint; of spawned processes' it is nowhere else.
        last, chosen = (
            torch.load(run.checkpoints / f"{name}.ckpt", map_location="cpu", weights_only=True)
            for name in ("last", "best")
        )
        told = last["callbacks"]
        module.load_state_dict(chosen["state_dict"])
        log.info("best epoch: %s = %.6g", plan.monitor, told[best.state_key]["best_model_score"])
        self.net = module.net.cpu().eval()
        return float(told[timer.state_key]["time_elapsed"]["train"])

    def initialize(self, data: WindowData, seed: int) -> None:
        """Build the network with its first weights: by chance from ``seed``, or those of ``begin``."""
        L.seed_everything(seed, verbose=False)
        self._build_for(data)
        if self._begun:
            self._take(self._begun, "begin")

    def predict(self, windows: WindowSet) -> np.ndarray:
        """Outputs in single precision, on the GPU where there is one and ``trainer.accelerator`` takes it."""
        gpu = self.training.accelerator != "cpu" and torch.cuda.is_available()
        device = torch.device("cuda" if gpu else "cpu")
        net = self.net.to(device).eval()
        outputs = []
        with efficient_processor(self.training.threads), torch.inference_mode():
            for index in torch.arange(len(windows)).split(_PREDICTED_AT_ONCE):
                outputs.append(net(windows[index].signals.to(device)).float().cpu())
        self.net.cpu()
        return torch.cat(outputs).double().numpy() if outputs else np.empty((0, self._shape[2]))

    def save(self, folder: Path) -> None:
        """Write the weights to ``model.safetensors``."""
        state = {name: value.contiguous() for name, value in self.net.state_dict().items()}
        shape = dict(zip(_SHAPE, map(str, self._shape), strict=True))
        write_atomically(folder / "model.safetensors", lambda file: save_file(state, file, metadata=shape))

    def load(self, folder: Path) -> None:
        """Build the network and take the weights from ``model.safetensors``."""
        path = folder / "model.safetensors"
        try:
            with safe_open(path, framework="pt") as file:
                shape = file.metadata()
                state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
            self._build(*(int(shape[name]) for name in _SHAPE))
        except (OSError, SafetensorError, TypeError, KeyError, ValueError) as error:
            raise InputError(
                f"{path}: not the weights of a network ({error}); set checkpoint or begin"
            ) from error
        self._take(state, str(path))
        self.net.eval()

    def begin(self, folder: Path) -> None:
        """Train from the weights that ``save`` left in the folder of another training, not from chance.

        They must fit what ``check`` was called with, where it was.
        """
        wanted = self._shape
        self.load(folder)
        self._begun = {name: value.clone() for name, value in self.net.state_dict().items()}
        if any(wanted):
            self._build(*wanted)
            self._take(self._begun, "begin")

    def _take(self, weights: dict[str, torch.Tensor], source: str) -> None:
        try:
            self.net.load_state_dict(weights)
        except RuntimeError as error:
            raise InputError(
                f"{source}: not the weights of this model on these sensors and windows ({error}); set "
                "checkpoint or begin to a training of the same"
            ) from error

    def _build_for(self, data: WindowData) -> None:
        self._build(len(data.channels), data.windows.length, len(data.targets))

    def _build(self, channels: int, length: int, outputs: int) -> None:
        self._shape = (channels, length, outputs)
        try:
            self.net = self._make(**dict(zip(_SHAPE, self._shape, strict=True)))
        except InputError:
            raise
        except (TypeError, ValueError, RuntimeError) as error:
            raise InputError(f"model.net: {error}; change model.net") from error


class AtomicCheckpoints(TorchCheckpointIO):
    """Checkpoints that are there whole or not at all; Lightning's pass through /tmp, maybe another disk."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any = None) -> None:
        """Write beside the final place, then rename."""
        content = BytesIO()
        torch.save(checkpoint, content)
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(Path(path), lambda file: file.write_bytes(content.getbuffer()))


def run_lightning(
    module: L.LightningModule,
    data: L.LightningDataModule,
    plan: Training,
    checkpoints: Path,
    callbacks: Sequence[L.Callback],
    **settings: Any,
) -> None:
    """Train ``module`` as ``plan`` says, or go on from ``last.ckpt`` that one of ``callbacks`` keeps."""
    torch.backends.cudnn.deterministic, torch.backends.cudnn.benchmark = True, False
    progress = TQDMProgressBar(refresh_rate=10) if plan.progress else EpochLines()
    last = checkpoints / "last.ckpt"
    if last.exists():
        log.info("going on from %s", last)
    with efficient_processor(plan.threads), warnings.catch_warnings():
        _quiet()
        trainer = _trainer(
            **_devices(plan),
            use_distributed_sampler=False,  # BatchOrder shares the windows out
            max_epochs=plan.epochs,
            callbacks=[*callbacks, progress],
            plugins=[AtomicCheckpoints()],
            enable_progress_bar=plan.progress,
            enable_model_summary=False,
            num_sanity_val_steps=0,
            reload_dataloaders_every_n_epochs=1,
            deterministic=True,
            log_every_n_steps=1,
            **settings,
        )
        with suppress(SystemExit):  # Lightning's answer to Ctrl-C
            trainer.fit(module, datamodule=data, ckpt_path=last if last.exists() else None, weights_only=True)
    if trainer.interrupted:
        raise KeyboardInterrupt


def _devices(plan: Training) -> dict[str, Any]:
    """What computes, for Lightning."""
    return {
        "accelerator": plan.accelerator,
        "devices": plan.devices or 1,
        # Spawned processes: this one goes on alone with what they have written.
        "strategy": "ddp_spawn" if (plan.devices or 1) > 1 else "auto",
        "precision": plan.precision,
    }


def _trainer(**settings: Any) -> L.Trainer:
    try:
        return L.Trainer(**settings)
    except (TypeError, ValueError, MisconfigurationException) as error:
        raise InputError(f"{error}; change trainer.accelerator, devices or precision") from error


class OfDevice(L.Callback):
    """Gives a process that was started for one of several devices what this one has: processor and log."""

    def __init__(self, threads: int | None) -> None:
        self._threads = threads

    def setup(self, trainer: L.Trainer, pl_module: L.LightningModule, stage: str) -> None:
        """Set them until the process ends."""
        if trainer.world_size > 1:
            self._settings = ExitStack()
            self._settings.enter_context(efficient_processor(self._threads))
            _quiet()
            logging.basicConfig(
                level=logging.INFO, stream=sys.stdout,
                format="[%(asctime)s][%(name)s][%(levelname)s] - %(message)s",
            )  # fmt: skip


class EpochLines(L.Callback):
    """A line an epoch in the log: the progress of a training that nobody watches."""

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Remember when, and at which epoch, this process began."""
        self._begin, self._first = time.perf_counter(), trainer.current_epoch

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Say how good the epoch's weights are, and how long the rest takes at this pace."""
        if not trainer.is_global_zero:
            return
        done, epochs = trainer.current_epoch + 1, trainer.max_epochs or 0
        pace = (time.perf_counter() - self._begin) / (done - self._first)
        log.info(
            "epoch %d of %d: validation NMAE %.2f %%, at most %.0f s left",
            done, epochs, trainer.callback_metrics["val/nmae"], pace * (epochs - done),
        )  # fmt: skip


def _quiet() -> None:
    """Silence advice that does not apply: data are in memory, and a folder that is resumed is not empty."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    for message in (
        ".*does not have many workers.*",
        ".*exists and is not empty.*",
        ".*treespec.*LeafSpec.*",
        ".*`srun` command is available.*",
        ".*GPU available but not used.*",
    ):
        warnings.filterwarnings("ignore", message=message)
