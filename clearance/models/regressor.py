"""The Lightning side of a network: loss, optimiser, schedule and metrics; networks know nothing of it."""

from collections.abc import Callable, Iterable

import lightning as L
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor, nn
from torch.optim import Optimizer
from torchmetrics import MetricCollection

from clearance.models.schedule import Schedule
from clearance.windows.scaling import MinMaxScaler
from clearance.windows.window_set import Batch


class Regressor(L.LightningModule):
    """Trains a finished ``net`` on scaled targets and reports metrics in metres.

    Args:
        net: (batch, time, channel) -> (batch, targets).
        loss: Of scaled outputs and targets.
        optimizer: Makes an optimiser from parameters.
        schedule: Changes its rate after every batch.
        metrics: Computed on validation windows, under ``val/``.
        scaler: Of the targets, to turn outputs into metres.
    """

    def __init__(
        self,
        net: nn.Module,
        loss: nn.Module,
        optimizer: Callable[[Iterable[nn.Parameter]], Optimizer],
        schedule: Schedule,
        metrics: MetricCollection,
        scaler: MinMaxScaler,
    ) -> None:
        super().__init__()
        self.net, self.loss = net, loss
        self._optimizer, self._schedule, self._scaler = optimizer, schedule, scaler
        self.metrics = metrics.clone(prefix="val/")
        for metric in self.metrics.values():
            metric.sync_on_compute = False  # every device sees all validation windows

    def training_step(self, batch: Batch, index: int) -> Tensor:
        """Loss of a batch."""
        signals, target = batch
        loss = self.loss(self.net(signals).float(), target)
        self.log("train/loss", loss, on_step=False, on_epoch=True, sync_dist=True, batch_size=len(target))
        return loss

    def validation_step(self, batch: Batch, index: int) -> None:
        """Loss of a batch, and its errors in metres."""
        signals, target = batch
        output = self.net(signals).float()
        self.log("val/loss", self.loss(output, target), sync_dist=True, batch_size=len(target))
        self.metrics.update(self._scaler.metres(output), self._scaler.metres(target))

    def on_validation_epoch_end(self) -> None:
        """Metrics over all validation windows: medians and percentiles are not means over batches."""
        self.log_dict(self.metrics.compute(), prog_bar=True, sync_dist=True)
        self.metrics.reset()

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """Optimiser, and a schedule for all batches to come."""
        optimizer = self._optimizer(self.net.parameters())
        scheduler = self._schedule.build(optimizer, int(self.trainer.estimated_stepping_batches))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}
