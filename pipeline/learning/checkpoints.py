"""Checkpoints of a training: written whole, and read back only where all of them are there."""

import io
import logging
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch.plugins.io import TorchCheckpointIO

from pipeline.atomic import atomic_file
from pipeline.errors import ArtifactError
from pipeline.learning.store import read_tensors

log = logging.getLogger(__name__)
_NETWORK = "network."  # before the names of a learner's weights


class WholeFiles(TorchCheckpointIO):
    """Checkpoints that are there whole or not at all: Lightning's own way copies them from a temporary folder."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any | None = None) -> None:
        """Write a checkpoint."""
        stream = io.BytesIO()  # to a full disk torch itself would write with an error that does not say so
        torch.save(checkpoint, stream)
        with atomic_file(Path(path)) as temporary:
            temporary.write_bytes(stream.getbuffer())


def last_checkpoint(folder: Path) -> Path | None:
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


def weights_of_epoch(folder: Path, epoch: int) -> dict[str, torch.Tensor]:
    """Read the network's weights of the best epoch; Lightning forgets which was best when the folder has moved.

    Raises:
        ArtifactError: best.ckpt is of another epoch.
    """
    path = folder / "best.ckpt"
    stored = read_tensors(path)
    if stored["epoch"] != epoch:
        raise ArtifactError(f"{path} is of epoch {stored['epoch']}, the best was {epoch}: delete its folder")
    named = stored["state_dict"].items()
    return {name.removeprefix(_NETWORK): weights for name, weights in named if name.startswith(_NETWORK)}
