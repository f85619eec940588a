"""Training of CoMPNetX: mean-square error, Adagrad (compnetx.txt, equation 7 and appendix C), resumable and repeatable.

What is random in an epoch follows from (seed, epoch), so that a killed run, continued after its last finished epoch,
ends with the weights of an unbroken one.
"""

import io
import logging
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import lightning
import numpy as np
import pandas as pd
import torch
from lightning.pytorch.callbacks import Callback, ModelCheckpoint, RichProgressBar
from lightning.pytorch.plugins.io import TorchCheckpointIO
from lightning.pytorch.trainer.states import TrainerStatus
from lightning.pytorch.utilities.exceptions import SIGTERMException

from pipeline.atomic import atomic_file, exclusive
from pipeline.errors import ArtifactError, require
from pipeline.keys import code_digest, digest
from pipeline.learning.batches import Batches, TrainingData
from pipeline.learning.model import Model, Normalisation, network_from, read_tensors
from pipeline.learning.module import CompnetxModule, Curves, Lines
from pipeline.learning.networks import Compnetx, NetworkParameters
from pipeline.learning.pairs import Pairs

log = logging.getLogger(__name__)
_TERMINATED = 143  # the exit status of what SIGTERM ended: 128 + 15
_VALIDATION_BATCH = 4096  # pairs per step without gradients; larger ones gain nothing


@dataclass(frozen=True)
class TrainParameters:
    """How to train.

    Attributes:
        epochs: passes over the training pairs (400 in the authors' code).
        batch_size: pairs per step (256 in the authors' code). Every step encodes its scenes anew, which at 256
            pairs from 40 scenes is half of its time.
        learning_rate: of Adagrad (0.01: compnetx.txt, appendix C).
        warmup: epochs over which the learning rate rises to it from next to nothing. Adagrad's first steps are as long
            as its learning rate for every weight, however small the gradient: without a warm-up they throw the first
            weights away. Not in the paper.
        seed: of the first weights, the order of the pairs and the dropout masks.
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
            require(f"train.{name}", getattr(self, name), at_least=bound)
        require("train.learning_rate", self.learning_rate, above=0)
        require("train.warmup", self.warmup, at_least=0)


@dataclass(frozen=True)
class Trained:
    """What came of a training run.

    Attributes:
        model: the weights of the epoch with the lowest validation loss.
        curves: one row per epoch: epoch, train_loss, val_loss (see `CompnetxModule`).
        metrics: scalars that repeat: epochs, best_epoch and its train_loss and val_loss, the number of weights, pairs
            and scenes.
        steps_per_second: wall clock of this process, validation included; None when there was nothing left to do.
    """

    model: Model
    curves: pd.DataFrame
    metrics: dict[str, float | int]
    steps_per_second: float | None


def train(
    parameters: TrainParameters,
    network: NetworkParameters,
    normalisation: Normalisation,
    data: TrainingData,
    scratch: Path,
) -> Trained:
    """Train to the last epoch, continuing a killed run of equal inputs from where it stands in `scratch`.

    Args:
        parameters: how to train.
        network: its sizes.
        normalisation: of configurations.
        data: pairs and voxel grids.
        scratch: kept between calls; holds `best.ckpt`, `last.ckpt` and `curves.csv` of each run, in a folder named by
            the hash of all other arguments, this code and the packages, so that a run never continues another one.

    Raises:
        ConfigError: data that does not fit the network, or a training that diverged.
        ArtifactError: the run's folder was moved or edited in between.
        SystemExit: SIGTERM ended it; what is finished stays in the folder.
        KeyboardInterrupt: likewise.
    """
    data.check(network, normalisation)
    folder = Path(scratch).resolve() / _key(parameters, network, normalisation, data)
    with exclusive(folder), _settings(parameters.threads):
        torch.manual_seed(parameters.seed)  # of the first weights; the rest of the run asks torch for no chance
        voxels, steps = torch.from_numpy(data.voxels).float(), -(-len(data.train) // parameters.batch_size)
        rise = round(parameters.warmup * steps)
        module = CompnetxModule(Compnetx(network), voxels, parameters.learning_rate, rise)
        curves = Curves(folder / "curves.csv")
        trainer = _trainer(parameters, folder, curves)
        shared = network, normalisation
        batches = Batches(data.train, *shared, parameters.batch_size, parameters.seed, lambda: trainer.current_epoch)
        held_out = Batches(data.validation, *shared, _VALIDATION_BATCH, parameters.seed, None)
        try:
            trainer.fit(module, batches, held_out, ckpt_path=_checkpoint(folder), weights_only=True)
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
    model = Model(network, normalisation, _best(folder / "best.ckpt", network, int(best["epoch"])))
    metrics: dict[str, float | int] = {
        "epochs": len(frame),
        "best_epoch": int(best["epoch"]),
        "train_loss": float(best["train_loss"]),
        "val_loss": float(best["val_loss"]),
        "weights": sum(weight.numel() for weight in model.network.parameters()),
        "train_pairs": len(data.train),
        "validation_pairs": len(data.validation),
        "train_scenes": len(np.unique(data.train.scene)),
        "validation_scenes": len(np.unique(data.validation.scene)),
    }
    return Trained(model, frame, metrics, module.steps_per_second)


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
        plugins=[_WholeFiles()],
        default_root_dir=folder,
        num_sanity_val_steps=0,
        enable_progress_bar=on_terminal,
        enable_model_summary=False,
        deterministic=True,
        inference_mode=False,  # the module keeps tensors between steps, which torch would not let training use
    )


class _WholeFiles(TorchCheckpointIO):
    """Checkpoints that are there whole or not at all: Lightning's own way copies them from a temporary folder."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any | None = None) -> None:
        """Write a checkpoint."""
        stream = io.BytesIO()  # to a full disk torch itself would write with an error that does not say so
        torch.save(checkpoint, stream)
        with atomic_file(Path(path)) as temporary:
            temporary.write_bytes(stream.getbuffer())


def _checkpoint(folder: Path) -> Path | None:
    """Return the checkpoint to go on from; None to begin, also where a file of the run is missing or unreadable."""
    last, best, curves = files = [folder / name for name in ("last.ckpt", "best.ckpt", "curves.csv")]
    if not last.is_file():
        return None
    path = last
    try:
        for path, part in ((last, "optimizer_states"), (best, "state_dict")):
            read_tensors(path)[part]
        path = curves
        path.stat()
    except (ArtifactError, LookupError, TypeError, OSError):  # LookupError, TypeError: of torch's, but no checkpoint
        log.warning("%s cannot be read: training begins again", path)
        for file in files:  # last.ckpt first: without it a run begins, whatever else is left
            file.unlink(missing_ok=True)
        return None
    return last


def _best(path: Path, parameters: NetworkParameters, epoch: int) -> Compnetx:
    """Read the weights of the best epoch; Lightning forgets which was best when the folder has moved."""
    stored = read_tensors(path)
    if stored["epoch"] != epoch:
        raise ArtifactError(f"{path} is of epoch {stored['epoch']}, the best was {epoch}: delete its folder")
    return network_from(parameters, {name.removeprefix("network."): w for name, w in stored["state_dict"].items()})


def _key(
    parameters: TrainParameters, network: NetworkParameters, normalisation: Normalisation, data: TrainingData
) -> str:
    arrays = [data.voxels]
    for pairs in (data.train, data.validation):
        arrays += [getattr(pairs, field.name) for field in fields(Pairs)]
    return digest(parameters, network, normalisation, arrays, code_digest(Path(__file__)))


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
