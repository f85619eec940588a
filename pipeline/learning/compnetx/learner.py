"""How CoMPNetX learns: mean-square error, Adagrad (compnetx.txt, equation 7 and appendix C)."""

import torch
from lightning.pytorch.utilities.types import OptimizerLRScheduler

from pipeline.learning.compnetx.batches import Batch, TrainingData
from pipeline.learning.compnetx.networks import Compnetx
from pipeline.learning.learner import Learner, warmed_up


class CompnetxLearner(Learner):
    """Trains encoders and generator end to end on the mean-square loss (compnetx.txt, equation 7).

    Both losses are taken with dropout on, because the network plans with it: they hold the spread of the samples as
    well as their error. They are squared distances of numbers of the network (`Codec`), summed over those that a task
    has, averaged over the pairs.

    Args:
        network: to train.
        data: for its grids and tasks.
        learning_rate: of Adagrad.
        warmup: steps over which the learning rate rises linearly.
    """

    def __init__(self, network: Compnetx, data: TrainingData, learning_rate: float, warmup: int = 0) -> None:
        super().__init__(network, learning_rate)
        self.warmup = warmup
        self.voxels: torch.Tensor
        self.tasks: torch.Tensor
        self.used: torch.Tensor
        for name in ("voxels", "tasks", "used"):
            self.register_buffer(name, torch.from_numpy(getattr(data, name)).float(), persistent=False)
        self._padded = not data.used.all()
        self._gathered: tuple[torch.Tensor, torch.Tensor] | None = None  # scenes of the last batch, their grids

    def size(self, batch: Batch) -> int:
        """See `Learner`: pairs."""
        return len(batch.row)

    def terms(self, batch: Batch) -> dict[str, torch.Tensor]:
        """See `Learner`: the loss alone."""
        tasks = self.tasks[batch.scenes] if self.tasks.shape[1] else None
        codes = self.network.encode(self._grids(batch.scenes), tasks)  # (U, code)
        found = self.network(codes.index_select(0, batch.row), batch.current, batch.target, batch.masks)  # (B, w)
        off = (found - batch.following).square()
        if self._padded:
            off = off * self.used[batch.scenes].index_select(0, batch.row)
        return {"loss": off.sum(dim=1).mean()}

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Return Adagrad and its warm-up; its fused form, which takes a third of the time, exists for CPUs."""
        fused = True if self.device.type == "cpu" else None
        optimizer = torch.optim.Adagrad(self.network.parameters(), lr=self.learning_rate, fused=fused)
        return warmed_up(optimizer, self.warmup)

    def _grids(self, scenes: torch.Tensor) -> torch.Tensor:
        """Gather the grids of scenes (U,); most batches hold the scenes of the one before, and copying takes 2 ms."""
        if self._gathered is None or not torch.equal(self._gathered[0], scenes):
            self._gathered = scenes, self.voxels[scenes]
        return self._gathered[1]
