"""A trained CoMPNetX: sizes, the kinds of tasks it knows, and weights."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import torch

from pipeline.errors import ArtifactError, ConfigError
from pipeline.learning.codec import Codec
from pipeline.learning.compnetx.networks import Compnetx, Layers, NetworkParameters
from pipeline.learning.store import load_weights, save_weights, with_weights
from pipeline.learning.task_kinds import TaskKind, task_input

KIND = "compnetx"


@dataclass(frozen=True)
class Model:
    """A network with what is needed to use it.

    Attributes:
        parameters: its sizes.
        kinds: of the tasks it has learned from.
        network: its weights.
    """

    parameters: NetworkParameters
    kinds: tuple[TaskKind, ...]
    network: Compnetx

    def __post_init__(self) -> None:
        wanted = sized(self.parameters, self.kinds, self.parameters.grid)
        if wanted != self.parameters:
            raise ConfigError(
                f"the network is for {self.parameters.width} numbers of a configuration and "
                f"{self.parameters.task_input} of a task; the tasks have {wanted.width} and {wanted.task_input}"
            )


def sized(layers: Layers, kinds: Sequence[TaskKind], grid: int) -> NetworkParameters:
    """Return all sizes of a network: those of its layers, and what follows from tasks and voxel grids."""
    chosen = {field.name: getattr(layers, field.name) for field in fields(Layers)}
    width = max(kind.codec.size for kind in kinds)
    return NetworkParameters(width=width, grid=grid, task_input=task_input(kinds), **chosen)


def untrained(layers: Layers, kinds: Sequence[TaskKind], grid: int, seed: int) -> Model:
    """Return a model with the first weights that a training of this seed begins with."""
    parameters = sized(layers, kinds, grid)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return Model(parameters, tuple(kinds), Compnetx(parameters).eval())


def save_model(model: Model, path: Path) -> None:
    """Write a model whole; equal models give equal bytes."""
    described = {"network": asdict(model.parameters), "kinds": [asdict(kind) for kind in model.kinds]}
    save_weights(KIND, described, model.network.state_dict(), path)


def load_model(path: Path) -> Model:
    """Read a model onto the CPU.

    Raises:
        ArtifactError: the file is missing, truncated, foreign, of another version or kind, or its weights do not fit or
            are not finite.
    """
    content = load_weights(path, KIND)
    try:
        parameters = _read(NetworkParameters, content["network"])
        kinds = tuple(_read(TaskKind, {**kind, "codec": _read(Codec, kind["codec"])}) for kind in content["kinds"])
        return Model(parameters, kinds, with_weights(lambda: Compnetx(parameters), content["weights"]))
    except (KeyError, TypeError, ValueError, RuntimeError, ConfigError) as error:
        raise ArtifactError(f"{path} holds a model that does not fit this code: {error}") from error


def _read(kind: type, content: dict[str, Any]) -> Any:
    """Build a dataclass from all of its fields, none missing, none unknown."""
    known: Sequence[str] = [f.name for f in fields(kind)]
    if set(content) != set(known):
        raise KeyError(f"{kind.__name__} has the fields {sorted(known)}, the file {sorted(content)}")
    return kind(**content)
