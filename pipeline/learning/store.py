"""Trained weights with what describes them in one open file, which is read without running code from it."""

import io
import pickle
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from pipeline.atomic import atomic_file
from pipeline.errors import ArtifactError, shown
from pipeline.files import VERSION, require_file

SCHEMA = "model"


def save_weights(kind: str, described: Mapping[str, Any], weights: Mapping[str, torch.Tensor], path: Path) -> None:
    """Write weights whole; equal ones give equal bytes.

    Args:
        kind: of the model.
        described: what else it takes to use them, as plain data.
        weights: by name.
        path: of the file.
    """
    content = {
        "schema": SCHEMA,
        "version": VERSION,
        "kind": kind,
        **described,
        "weights": {name: value.detach().cpu().contiguous() for name, value in weights.items()},
    }
    stream = io.BytesIO()  # torch writes the name of a file into the file
    torch.save(content, stream)
    with atomic_file(path) as temporary:
        temporary.write_bytes(stream.getvalue())


def load_weights(path: Path, kind: str) -> dict[str, Any]:
    """Read what `save_weights` wrote, onto the CPU: what describes the weights, and under "weights" themselves.

    Raises:
        ArtifactError: the file is missing, truncated, foreign, of another version or kind, or weights are not finite.
    """
    content = read_tensors(path)
    found = content.get("schema") if isinstance(content, dict) else None
    if not isinstance(found, str) or found != SCHEMA:
        said = found if isinstance(found, str) else "none"
        raise ArtifactError(f"{path} holds schema {said!r}, expected {SCHEMA!r}")
    for name, expected in (("version", VERSION), ("kind", kind)):
        found = content.get(name)
        if type(found) is not type(expected) or found != expected:
            raise ArtifactError(f"{path} has {name} {shown(found)} of {SCHEMA!r}, this code reads {expected!r}")
    weights = content.get("weights")
    if not isinstance(weights, dict) or not all(isinstance(name, str) for name in weights):
        raise ArtifactError(f"{path} holds no weights")
    for name, value in weights.items():
        if not _plain(value):
            raise ArtifactError(f"{path}: weights {name!r} are no plain tensor of single precision; train again")
        if not torch.isfinite(value).all():
            raise ArtifactError(f"{path}: weights {name!r} are not all finite; train again")
    return content


def _plain(value: Any) -> bool:
    """Tell whether a value is a tensor whose numbers are all in the file: not one number that stands for many."""
    return (
        isinstance(value, torch.Tensor)
        and value.layout is torch.strided
        and value.dtype is torch.float32
        and not value.is_meta
        and value.is_contiguous()
    )


def with_weights(build: Any, weights: Mapping[str, torch.Tensor]) -> Any:
    """Return what `build()` makes, a torch module, with given weights, in eval mode; no chance is asked for others.

    Raises:
        RuntimeError: names or shapes do not fit.
    """
    with torch.device("meta"):  # draws no weights that would be thrown away
        network = build()
    network.load_state_dict(weights, assign=True)
    return network.eval()


def read_tensors(path: Path) -> Any:
    """Return what `torch.save` wrote of tensors, numbers, text and collections of these, on the CPU.

    Raises:
        ArtifactError: the file is missing, truncated or foreign, or holds anything else: that would take running code
            from the file, which is never done, whatever torch advises.
    """
    require_file(path)
    try:
        with warnings.catch_warnings(action="ignore"):  # torch's guesses at what a foreign file may be
            return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        reason = "it holds something else than tensors, numbers and text, or nothing that is read without running code"
        raise ArtifactError(f"{path} is not a readable model (truncated or foreign): {reason}") from error
    except Exception as error:  # torch and zipfile raise half a dozen kinds here; all mean the same to a reader
        raise ArtifactError(f"{path} is not a readable model (truncated or foreign): train again") from error
