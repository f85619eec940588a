"""Training of any model, resumable and repeatable.

What is random in an epoch follows from (seed, epoch), so that a killed run, continued after its last finished epoch,
ends with the weights of an unbroken one.
"""

import logging
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lightning
import pandas as pd
import torch
from lightning.pytorch.callbacks import Callback, ModelCheckpoint, RichProgressBar
from lightning.pytorch.trainer.states import TrainerStatus
from lightning.pytorch.utilities.exceptions import SIGTERMException

from pipeline.atomic import exclusive
from pipeline.errors import require
from pipeline.keys import code_digest, digest
from pipeline.learning.checkpoints import WholeFiles, last_checkpoint, weights_of_epoch
from pipeline.learning.learner import Curves, Learner, Lines

log = logging.getLogger(__name__)
_TERMINATED = 143  # the exit status of what SIGTERM ended: 128 + 15


@dataclass(frozen=True)
class TrainParameters:
    """How to train.

    Attributes:
        epochs: passes over the training examples (CoMPNetX: 400 in the authors' code).
        batch_size: examples per step (CoMPNetX: 256 in the authors' code; every step encodes its scenes anew, which at
            256 pairs from 40 scenes is half of its time).
        learning_rate: of the optimiser (CoMPNetX: 0.01, compnetx.txt, appendix C).
        warmup: epochs over which the learning rate rises to it from next to nothing. Adagrad's first steps are as long
            as its learning rate for every weight, however small the gradient: without a warm-up they throw the first
            weights away. Not in the paper.
        seed: of the first weights, the order of the examples and what else is drawn.
        threads: of torch; part of what determines the last bits of the weights. No more than there are idle cores:
            where two threads share a core with another process, a step takes twenty times as long (measured: 1.05 s
            instead of 0.06 s), unless OMP_WAIT_POLICY=PASSIVE stands in the environment before torch is imported.
        accelerator: of Lightning; "cpu" repeats to the bit.
    """

    epochs: int = 400
    batch_size: int = 256
    learning_rate: float = 0.01
    warmup: float = 0.0
    seed: int = 0
    threads: int = 1
    accelerator: str = "cpu"

    def __post_init__(self) -> None:
        for name, bound in (("epochs", 1), ("batch_size", 1), ("seed", 0), ("threads", 1)):
            require(f"training.{name}", getattr(self, name), at_least=bound)
        require("training.learning_rate", self.learning_rate, above=0)
        require("training.warmup", self.warmup, at_least=0)


@dataclass(frozen=True)
class Job:
    """What is learned, by whom, from what.

    Attributes:
        learner: makes the one that learns; the first weights follow from torch's seed, which is set before.
        batches: makes those of the training examples; it is given what tells the running epoch when a pass begins.
        held_out: batches to choose the best epoch by, the same at every pass.
        inputs: all that these depend on, as plain data and arrays: a run never goes on with another one's weights.
        code: file whose code, with all it imports, is part of that.
    """

    learner: Callable[[], Learner]
    batches: Callable[[Callable[[], int]], Iterable[Any]]
    held_out: Iterable[Any]
    inputs: Any
    code: Path


@dataclass(frozen=True)
class Trained:
    """What came of a training run.

    Attributes:
        weights: of the epoch with the lowest validation loss, by name.
        curves: one row per epoch, see `Curves`.
        metrics: scalars that repeat: epochs, best_epoch, all columns of the curves there, and the number of weights.
        steps_per_second: wall clock of this process, validation included; None when there was nothing left to do.
    """

    weights: Mapping[str, torch.Tensor]
    curves: pd.DataFrame
    metrics: dict[str, float | int]
    steps_per_second: float | None


def train(parameters: TrainParameters, job: Job, scratch: Path) -> Trained:
    """Train to the last epoch, continuing a killed run of equal inputs from where it stands in `scratch`.

    Args:
        parameters: how to train.
        job: what is learned.
        scratch: kept between calls; holds `best.ckpt`, `last.ckpt` and `curves.csv` of each run, in a folder named by
            the hash of parameters, the job's inputs, the code and the packages, so that a run never continues another.

    Raises:
        ConfigError: a training that diverged.
        ArtifactError: the run's folder was moved or edited in between.
        SystemExit: SIGTERM ended it; what is finished stays in the folder.
        KeyboardInterrupt: likewise.
    """
    folder = Path(scratch).resolve() / digest(parameters, job.inputs, code_digest(Path(__file__), job.code))
    with exclusive(folder), _settings(parameters.threads):
        torch.manual_seed(parameters.seed)  # of the first weights; the rest of the run asks torch for no chance
        learner, curves = job.learner(), Curves(folder / "curves.csv")
        trainer = _trainer(parameters, folder, curves)
        batches = job.batches(lambda: trainer.current_epoch)
        try:
            trainer.fit(learner, batches, job.held_out, ckpt_path=last_checkpoint(folder), weights_only=True)
        except SIGTERMException:  # Lightning would end with status 0, as if all were done
            # Not through the log: that of the stages goes to stdout.
            done = f"train: ended by SIGTERM after {len(curves.rows)} of {parameters.epochs} epochs"
            print(f"{done}; repeating the command continues there", file=sys.stderr)
            raise SystemExit(_TERMINATED) from None
        except SystemExit:  # what Lightning makes of Ctrl-C, which it ignores from then on
            if trainer.state.status is not TrainerStatus.INTERRUPTED:
                raise
            signal.signal(signal.SIGINT, signal.default_int_handler)
            raise KeyboardInterrupt from None
    frame = curves.frame()
    best = frame.iloc[int(frame["val_loss"].argmin())]
    weights = weights_of_epoch(folder, int(best["epoch"]))
    metrics: dict[str, float | int] = {
        "epochs": len(frame),
        "best_epoch": int(best["epoch"]),
        **{str(name): float(value) for name, value in best.items() if name != "epoch"},
        "weights": sum(weight.numel() for weight in learner.network.parameters()),
    }
    return Trained(weights, frame, metrics, learner.steps_per_second)


def _trainer(parameters: TrainParameters, folder: Path, curves: Curves) -> lightning.Trainer:
    on_terminal = sys.stdout.isatty()
    # Two checkpoint callbacks, because `save_last` skips the epochs that are not the best so far. Best comes first:
    # the state of the search for it is then part of last.ckpt.
    callbacks: list[Callback] = [
        curves,
        ModelCheckpoint(
            folder,
            filename="best",
            monitor="val_loss",
            save_weights_only=True,
            save_on_train_epoch_end=True,
            enable_version_counter=False,
        ),
        ModelCheckpoint(folder, filename="last", save_on_train_epoch_end=True, enable_version_counter=False),
    ]
    callbacks.append(RichProgressBar(refresh_rate=20) if on_terminal else Lines())
    return lightning.Trainer(
        max_epochs=parameters.epochs,
        accelerator=parameters.accelerator,
        devices=1,
        logger=False,
        callbacks=callbacks,
        plugins=[WholeFiles()],
        default_root_dir=folder,
        num_sanity_val_steps=0,
        enable_progress_bar=on_terminal,
        enable_model_summary=False,
        deterministic=True,
        inference_mode=False,  # learners keep tensors between steps, which torch would not let training use
    )


@contextmanager
def _settings(threads: int) -> Iterator[None]:
    """Set the global state of torch and Lightning's log for a run, and leave it as it was found."""
    before = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    log = logging.getLogger("lightning.pytorch")
    level = log.level
    torch.set_num_threads(threads)
    log.setLevel(logging.WARNING)  # below that it lists the accelerators it has not found and advertises
    try:
        with torch.random.fork_rng(devices=[]), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*LeafSpec.*")  # Lightning 2.6.6 calls torch 2.13 the old way
            warnings.filterwarnings("ignore", message="Checkpoint directory .* not empty")  # that is how a run goes on
            yield
    finally:
        log.setLevel(level)
        torch.set_num_threads(before[0])
        torch.use_deterministic_algorithms(before[1])
