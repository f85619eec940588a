"""The Lightning side of training: loss, optimiser and learning curves."""

import logging
import time
from pathlib import Path
from typing import Any

import lightning
import pandas as pd
import torch
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.utilities.types import OptimizerLRScheduler

from pipeline.atomic import atomic_file
from pipeline.errors import ConfigError
from pipeline.learning.batches import Batch
from pipeline.learning.networks import Compnetx

log = logging.getLogger(__name__)
_LOG_SECONDS = 15.0  # at least this far apart are two lines of a training


class CompnetxModule(lightning.LightningModule):
    """Trains encoders and generator end to end on the mean-square loss (compnetx.txt, equation 7).

    Both losses are taken with dropout on, because the network plans with it: they hold the spread of the samples as
    well as their error. They are squared normalised distances, summed over the joints, averaged over the pairs.

    Args:
        network: to train.
        voxels: grids of all scenes (S, L, W, H).
        learning_rate: of Adagrad.
        warmup: steps over which the learning rate rises linearly.
    """

    def __init__(self, network: Compnetx, voxels: torch.Tensor, learning_rate: float, warmup: int = 0) -> None:
        super().__init__()
        self.network = network
        self.learning_rate, self.warmup = learning_rate, warmup
        self.voxels: torch.Tensor
        self.register_buffer("voxels", voxels, persistent=False)
        self.train_loss = float("nan")  # of the last finished epoch
        self.steps_per_second: float | None = None
        self._losses: list[torch.Tensor] = []  # of the running epoch, times the pairs of their batch
        self._pairs = 0
        self._begin = (0.0, 0)
        self._gathered: tuple[torch.Tensor, torch.Tensor] | None = None  # scenes of the last batch, their grids

    def on_train_start(self) -> None:
        """Note where this process begins."""
        self._begin = (time.perf_counter(), self.trainer.global_step)

    def on_train_epoch_start(self) -> None:
        """Begin a new sum; `self.log` at every step is slower."""
        self._losses, self._pairs = [], 0

    def training_step(self, batch: Batch, index: int) -> torch.Tensor:
        """Return the loss of a batch."""
        loss = self._loss(batch)
        self._losses.append(loss.detach() * len(batch.row))
        self._pairs += len(batch.row)
        return loss

    def validation_step(self, batch: Batch, index: int) -> None:
        """Gather the validation loss."""
        self.log("val_loss", self._loss(batch), on_step=False, on_epoch=True, batch_size=len(batch.row))

    def on_train_epoch_end(self) -> None:
        """Measure the pace of this process so far, validation included."""
        begin, step = self._begin
        self.steps_per_second = (self.trainer.global_step - step) / (time.perf_counter() - begin)

    def on_train_batch_end(self, outputs: Any, batch: Batch, batch_idx: int) -> None:
        """Close the epoch's sum after its last step, before the curves are written."""
        if self.trainer.is_last_batch:
            self.train_loss = float(torch.stack(self._losses).sum()) / self._pairs

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Return Adagrad and its warm-up; its fused form, which takes a third of the time, exists for CPUs."""
        fused = True if self.device.type == "cpu" else None
        optimizer = torch.optim.Adagrad(self.network.parameters(), lr=self.learning_rate, fused=fused)
        if not self.warmup:
            return optimizer
        rise = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: min(1.0, (step + 1) / self.warmup))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": rise, "interval": "step"}}

    def _loss(self, batch: Batch) -> torch.Tensor:
        codes = self.network.encode(self._grids(batch.scenes))  # (U, code)
        found = self.network(codes.index_select(0, batch.row), batch.current, batch.target, batch.masks)  # (B, n)
        return (found - batch.following).square().sum(dim=1).mean()

    def _grids(self, scenes: torch.Tensor) -> torch.Tensor:
        """Gather the grids of scenes (U,); most batches hold the scenes of the one before, and copying takes 2 ms."""
        if self._gathered is None or not torch.equal(self._gathered[0], scenes):
            self._gathered = scenes, self.voxels[scenes]
        return self._gathered[1]


class Lines(Callback):
    """Now and then a line in a log, for where no bar is seen."""

    def __init__(self) -> None:
        self.begin = self.last = time.monotonic()

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Say where training stands, unless it was said a moment ago."""
        done, now = trainer.current_epoch + 1, time.monotonic()
        if now - self.last > _LOG_SECONDS or done == trainer.max_epochs:
            self.last = now
            loss = float(trainer.callback_metrics["val_loss"])
            log.info(
                "train: epoch %d of %s, validation loss %.4f after %.0f s",
                done,
                trainer.max_epochs,
                loss,
                now - self.begin,
            )


class Curves(Callback):
    """Keeps the losses of all epochs, also in the checkpoints, and writes them to a CSV file after each."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, Any]] = []

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Add a row and rewrite the file.

        Raises:
            ConfigError: a loss is not finite.
        """
        assert isinstance(pl_module, CompnetxModule)
        row = {
            "epoch": trainer.current_epoch,
            "train_loss": pl_module.train_loss,
            "val_loss": float(trainer.callback_metrics["val_loss"]),
        }
        if not row["train_loss"] + row["val_loss"] < float("inf"):
            raise ConfigError(f"training diverged: {row}; lower train.learning_rate (now {pl_module.learning_rate})")
        self.rows.append(row)
        with atomic_file(self.path) as temporary:
            self.frame().to_csv(temporary, index=False)

    def frame(self) -> pd.DataFrame:
        """Return one row per epoch: epoch, train_loss, val_loss."""
        return pd.DataFrame(self.rows, columns=["epoch", "train_loss", "val_loss"])

    def state_dict(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {"rows": list(self.rows)}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Continue the rows of a checkpoint."""
        self.rows = list(state_dict["rows"])
