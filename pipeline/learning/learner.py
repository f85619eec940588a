"""What learns, and the learning curves: the part of training that Lightning calls."""

import logging
import time
from abc import abstractmethod
from pathlib import Path
from typing import Any

import lightning
import pandas as pd
import torch
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import nn

from pipeline.atomic import atomic_file
from pipeline.errors import ConfigError

log = logging.getLogger(__name__)
_LOG_SECONDS = 15.0  # at least this far apart are two lines of a training


class Learner(lightning.LightningModule):
    """A network that learns from batches of some kind.

    A subclass says what is minimised (`terms`), how many examples a batch has (`size`) and by which optimisers
    (`configure_optimizers`). One that takes its steps itself, as adversaries do, sets `automatic_optimization` to False
    and writes `training_step`, in which it calls `note`.

    Args:
        network: to train; its weights are what comes of it.
        learning_rate: of its optimisers, for the message where training diverges.
    """

    def __init__(self, network: nn.Module, learning_rate: float) -> None:
        super().__init__()
        self.network: Any = network  # torch's modules have whatever methods they have
        self.learning_rate = learning_rate
        self.trained: dict[str, float] = {}  # terms over the last finished epoch, by name
        self.steps_per_second: float | None = None
        self._terms: dict[str, list[torch.Tensor]] = {}  # of the running epoch, times the examples of their batch
        self._examples = 0
        self._begin = (0.0, 0)

    @abstractmethod
    def terms(self, batch: Any) -> dict[str, torch.Tensor]:
        """Return what is measured of a batch, as means over its examples; "loss" is minimised, and chosen by."""

    @abstractmethod
    def size(self, batch: Any) -> int:
        """Return how many examples a batch has."""

    def note(self, terms: dict[str, torch.Tensor], size: int) -> None:
        """Add terms of a batch of `size` examples to those of the epoch; `self.log` at every step is slower."""
        for name, value in terms.items():
            self._terms.setdefault(name, []).append(value.detach() * size)
        self._examples += size

    def on_train_start(self) -> None:
        """Note where this process begins."""
        self._begin = (time.perf_counter(), self.trainer.global_step)

    def on_train_epoch_start(self) -> None:
        """Begin new sums."""
        self._terms, self._examples = {}, 0

    def training_step(self, batch: Any, index: int) -> torch.Tensor:
        """Return the loss of a batch."""
        terms = self.terms(batch)
        self.note(terms, self.size(batch))
        return terms["loss"]

    def validation_step(self, batch: Any, index: int) -> None:
        """Gather the terms of validation."""
        for name, value in self.terms(batch).items():
            self.log(f"val_{name}", value, on_step=False, on_epoch=True, batch_size=self.size(batch))

    def on_train_epoch_end(self) -> None:
        """Measure the pace of this process so far, validation included."""
        begin, step = self._begin
        self.steps_per_second = (self.trainer.global_step - step) / (time.perf_counter() - begin)

    def on_train_batch_end(self, outputs: Any, batch: Any, batch_idx: int) -> None:
        """Close the epoch's sums after its last step, before the curves are written."""
        if self.trainer.is_last_batch:
            self.trained = {
                name: float(torch.stack(values).sum()) / self._examples for name, values in self._terms.items()
            }


def warmed_up(optimizer: torch.optim.Optimizer, steps: int) -> OptimizerLRScheduler:
    """Return an optimiser whose learning rate rises linearly over some steps; 0 for none."""
    if not steps:
        return optimizer
    rise = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: min(1.0, (step + 1) / steps))
    return {"optimizer": optimizer, "lr_scheduler": {"scheduler": rise, "interval": "step"}}


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
    """Keeps the terms of all epochs, also in the checkpoints, and writes them to a CSV file after each.

    Columns are epoch, then train_<term> and val_<term> for every term of the learner.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, Any]] = []

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Add a row and rewrite the file.

        Raises:
            ConfigError: a term is not finite.
        """
        assert isinstance(pl_module, Learner)
        row: dict[str, Any] = {"epoch": trainer.current_epoch}
        row |= {f"train_{name}": value for name, value in pl_module.trained.items()}
        row |= {name: float(value) for name, value in trainer.callback_metrics.items() if name.startswith("val_")}
        if not all(abs(value) < float("inf") for value in row.values()):
            raise ConfigError(f"training diverged: {row}; lower training.learning_rate (now {pl_module.learning_rate})")
        self.rows.append(row)
        with atomic_file(self.path) as temporary:
            self.frame().to_csv(temporary, index=False)

    def frame(self) -> pd.DataFrame:
        """Return one row per epoch."""
        return pd.DataFrame(self.rows)

    def state_dict(self) -> dict[str, Any]:
        """Return what a checkpoint keeps."""
        return {"rows": list(self.rows)}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Continue the rows of a checkpoint."""
        self.rows = list(state_dict["rows"])
