"""Train one model from several seeds at once: what separate trainings would give, for little more than one.

Everything that a seed decides stays its own: weights to start from, order of the windows, clipping of the
gradient, the best epoch and when to stop. What is shared is the data, the optimiser's tensors and the device.
"""

import logging
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Checkpoint
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor, nn, optim
from torchmetrics import MetricCollection

from clearance.errors import InputError
from clearance.models.estimator import Estimator
from clearance.models.neural import NeuralEstimator, Training, run_lightning
from clearance.models.run_folder import RunFolder
from clearance.models.stack import NetworkStack, Replayed, stacked
from clearance.windows.datamodule import WindowData
from clearance.windows.side_by_side import SideBySideBatch, SideBySideWindows
from clearance.windows.window_set import Batch

log = logging.getLogger(__name__)
# These treat every weight by itself, but for the number of steps, which is everyone's.
_BY_ELEMENT = (
    optim.Adam, optim.AdamW, optim.NAdam, optim.RAdam, optim.Adamax, optim.Adagrad, optim.Adadelta,
    optim.RMSprop, optim.SGD,
)  # fmt: skip


class StackedRegressor(L.LightningModule):
    """Trains a stack of networks on scaled targets and reports each one's metrics to its own events.

    Args:
        stack: A network for each of ``runs``.
        plan: Loss, optimiser, schedule and stopping of every one.
        metrics: Computed on validation windows, under ``val/``.
        clip: Largest norm of a network's gradient, or None.
        data: Set up; gives recordings and scaler.
        runs: Where each training's events are written.
    """

    def __init__(
        self,
        stack: NetworkStack,
        plan: Training,
        metrics: MetricCollection,
        clip: float | None,
        data: WindowData,
        runs: Sequence[RunFolder],
    ) -> None:
        super().__init__()
        self.stack, self.loss, self.metrics = stack, plan.loss, metrics.clone(prefix="val/")
        self.best = nn.ParameterList(
            nn.Parameter(weight.detach().clone(), requires_grad=False) for weight in stack.weights
        )
        self._plan, self._clip, self._data, self._runs = plan, clip, data, runs
        self._compute = Replayed(stack)
        self._rows = list(range(len(runs)))  # which run each network of the stack belongs to
        self._running = [True] * len(runs)
        self._scores = [math.inf] * len(runs)  # lowest so far of what ``plan.monitor`` names
        self._waited = [0] * len(runs)  # epochs without a lower one
        self.seconds = [0.0] * len(runs)  # of the time of each epoch, an equal share

    def on_train_start(self) -> None:
        """Begin to count time; after a resumption there may be nothing left to do."""
        self._mark = time.perf_counter()
        if not any(self._running):
            self.trainer.should_stop = True

    def on_train_epoch_start(self) -> None:
        """Drop the networks that have stopped, and take the epoch's recordings to the device."""
        staying = [place for place, row in enumerate(self._rows) if self._running[row]]
        if len(staying) < len(self._rows):
            self.stack.keep(staying, self._optimizer)
            self._rows = [self._rows[place] for place in staying]
            self._compute = Replayed(self.stack)
        self._signals = torch.from_numpy(self._data.recordings.signals).to(self.device)
        self._index = torch.tensor(self._rows, device=self.device)
        self._offsets = torch.arange(self._data.windows.length, device=self.device)
        self._total, self._count = torch.zeros(len(self._rows), device=self.device), 0
        name, rate = type(self._optimizer).__name__, self._optimizer.param_groups[0]["lr"]
        for row in self._rows:
            self._write(row, {f"lr-{name}": rate}, self.global_step)

    def training_step(self, batch: SideBySideBatch, index: int) -> Tensor:
        """Sum of the networks' losses: the gradient of each is that of its own."""
        starts, target = batch.starts[self._index], batch.target[self._index]
        output = self._compute(self._signals[starts.unsqueeze(-1) + self._offsets]).float()
        losses = torch.vmap(self.loss)(output, target)
        self._total += losses.detach() * target.shape[1]
        self._count += target.shape[1]
        return losses.sum()

    def configure_gradient_clipping(
        self,
        optimizer: optim.Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clip the norm of each network's gradient, as ``torch.nn.utils.clip_grad_norm_`` does of one."""
        if self._clip is None:
            return
        gradients = [weight.grad for weight in self.stack.weights if weight.grad is not None]
        norms = torch.stack([gradient.flatten(1).norm(dim=1) for gradient in gradients]).norm(dim=0)
        factor = (self._clip / (norms + 1e-6)).clamp(max=1.0)
        for gradient in gradients:
            gradient.mul_(factor.view(-1, *(1,) * (gradient.dim() - 1)))

    def on_train_epoch_end(self) -> None:
        """Report the training losses of the epoch."""
        for row, loss in zip(self._rows, self._total / self._count, strict=True):
            self._write_epoch(row, {"train/loss": float(loss)})

    def on_validation_epoch_start(self) -> None:
        """Forget the last epoch's outputs."""
        self._validated: list[tuple[Tensor, Tensor, Tensor]] = []

    def validation_step(self, batch: Batch, index: int) -> None:
        """Outputs and losses of all networks for the same windows."""
        signals, target = (part.expand(len(self._rows), *part.shape) for part in batch)
        output = self.stack(signals).float()
        self._validated.append((output, target, torch.vmap(self.loss)(output, target) * target.shape[1]))

    def on_validation_epoch_end(self) -> None:
        """Metrics of every network; keep the weights that are better, stop those that wait too long."""
        outputs, targets, losses = zip(*self._validated, strict=True)
        output, target = torch.cat(outputs, dim=1), torch.cat(targets, dim=1)
        loss = torch.stack(losses).sum(0) / target.shape[1]
        self._share_time()
        all_found, metres = [], self._data.scalers.target.metres
        for place, row in enumerate(self._rows):
            self.metrics.reset()
            self.metrics.update(metres(output[place]), metres(target[place]))
            found = {"val/loss": float(loss[place])}
            found |= {name: float(value) for name, value in self.metrics.compute().items()}
            self._write_epoch(row, found)
            self._judge(place, row, found[self._plan.monitor])
            all_found.append(found)
        means = {name: sum(found[name] for found in all_found) / len(all_found) for name in all_found[0]}
        self.log_dict(means, prog_bar=True)  # for the progress; each one's are in its events
        if not any(self._running):
            self.trainer.should_stop = True

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """One optimiser for all networks, and a schedule for all batches to come."""
        self._optimizer = self._plan.optimizer(self.stack.parameters())
        scheduler = self._plan.schedule.build(self._optimizer, int(self.trainer.estimated_stepping_batches))
        return {"optimizer": self._optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Add how far each network is; the events so far are on disk first, since none is written again."""
        for row in self._rows:
            if not self._runs[row].finished:
                self._runs[row].logger.experiment.flush()
        checkpoint["together"] = {
            "rows": self._rows,
            "running": self._running,
            "scores": self._scores,
            "waited": self._waited,
            "seconds": self.seconds,
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Become as many networks as there were."""
        for name, value in checkpoint["together"].items():
            setattr(self, name if name == "seconds" else f"_{name}", value)
        self.stack.resize(len(self._rows))

    def _judge(self, place: int, row: int, score: float) -> None:
        """As Lightning's ModelCheckpoint and EarlyStopping do for one network."""
        if score < self._scores[row] or self.current_epoch == 0:
            for best, weight in zip(self.best, self.stack.weights, strict=True):
                best[row] = weight[place]
        better = score < self._scores[row]
        self._scores[row] = score if better else self._scores[row]
        self._waited[row] = 0 if better else self._waited[row] + 1
        self._running[row] = math.isfinite(score) and self._waited[row] < self._plan.patience

    def _share_time(self) -> None:
        now = time.perf_counter()
        for row in self._rows:
            self.seconds[row] += (now - self._mark) / len(self._rows)
        self._mark = now

    def _write_epoch(self, row: int, metrics: dict[str, float]) -> None:
        # As Lightning does for one: by the epoch's last step.
        self._write(row, {**metrics, "epoch": self.current_epoch}, self.global_step - 1)

    def _write(self, row: int, metrics: dict[str, float], step: int) -> None:
        if not self._runs[row].finished:  # by an earlier training, which is left as it is
            self._runs[row].logger.log_metrics(metrics, step)


class SparingCheckpoint(Checkpoint):
    """Keeps a checkpoint of the newest epoch; where writing takes long, of one not long ago.

    Ten of the paper's TDNN with their optimiser are 4 GB: a GPU may train as fast as a disk takes them.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._next = path, -math.inf

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Save, unless that was done a short while ago and this is not the end."""
        begin = time.perf_counter()
        if begin > self._next or trainer.should_stop or trainer.current_epoch + 1 == trainer.max_epochs:
            trainer.save_checkpoint(self._path)
            spent = time.perf_counter() - begin
            self._next = begin + (20 * spent if spent > 1.0 else 0.0)  # at most a twentieth of the time


def fit_together(
    estimators: Sequence[NeuralEstimator], data: WindowData, runs: Sequence[RunFolder], shared: RunFolder
) -> list[float]:
    """Train every estimator with the seed of its run, or go on from the last checkpoint in ``shared``.

    Args:
        estimators: Of one configuration, ``shareable``.
        data: Set up.
        runs: One an estimator.
        shared: Where the checkpoints of all are kept.

    Returns:
        Seconds of training, divided among those that were trained at each time.
    """
    first = estimators[0]
    for estimator, run in zip(estimators, runs, strict=True):
        estimator.initialize(data, run.seed)
    stack = stacked([estimator.net for estimator in estimators])
    module = StackedRegressor(stack, first.training, first.metrics, first.gradient_clip, data, runs)
    windows = SideBySideWindows(data, [run.seed for run in runs])
    with _uninitialized_memory():
        # Validation without inference mode: what it stores of the weights is trained on after a resumption.
        newest = SparingCheckpoint(shared.checkpoints / "last.ckpt")
        run_lightning(
            module, windows, first.training, shared.checkpoints, [newest], logger=False, inference_mode=False
        )
    for estimator, state in zip(estimators, stack.states(module.cpu().best), strict=True):
        estimator.net.load_state_dict(state)
        estimator.net.eval()
    return module.seconds


def shareable(estimators: Sequence[Estimator]) -> list[NeuralEstimator]:
    """The estimators, if trainings together would give them the weights of separate ones.

    Raises:
        InputError: a model, an optimiser or a precision that cannot be shared.
    """
    networks = [estimator for estimator in estimators if isinstance(estimator, NeuralEstimator)]
    if len(networks) < len(estimators):
        kind = type(estimators[0]).__name__
        raise InputError(
            f"seeds: networks are trained together, and {kind} is none; set seed, or another model"
        )
    plan = networks[0].training
    optimizer = type(plan.optimizer([nn.Parameter(torch.zeros(1))]))
    if optimizer not in _BY_ELEMENT:
        names = ", ".join(allowed.__name__ for allowed in _BY_ELEMENT)
        raise InputError(
            f"trainer.optimizer={optimizer.__name__}: must be one of {names} for trainings together; set "
            "trainer.optimizer, or seed instead of seeds"
        )
    if (plan.devices or 1) > 1:
        raise InputError(
            f"trainer.devices={plan.devices}: trainings together take one; set trainer.devices, or seed "
            "instead of seeds"
        )
    if str(plan.precision) not in ("32-true", "32"):
        raise InputError(
            f"trainer.precision={plan.precision}: must be 32-true or 32 for trainings together; set "
            "trainer.precision, or seed instead of seeds"
        )
    return networks


@contextmanager
def _uninitialized_memory() -> Iterator[None]:
    """Deterministic algorithms fill new memory with NaN, to show what reads it: a launch more a tensor."""
    settings: Any = torch.utils.deterministic
    before, settings.fill_uninitialized_memory = settings.fill_uninitialized_memory, False
    try:
        yield
    finally:
        settings.fill_uninitialized_memory = before
