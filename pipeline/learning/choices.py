"""Samplers by name, learned ones among them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import ConfigError
from pipeline.learning.compnetx import CompnetxNetwork, CompnetxParameters, CompnetxSampler, Model
from pipeline.perception import read_voxels
from pipeline.samplers.base import Sampler
from pipeline.samplers.uniform import UniformParameters, UniformSampler
from pipeline.schema import Choice


@dataclass(frozen=True)
class Learned:
    """What learned samplers need: the network and the voxel grids of the scenes."""

    network: CompnetxNetwork
    voxels: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, model: Model, voxels: Path) -> "Learned":
        """Return a model's network with the grids of a file. Raises as `read_voxels` does."""
        return cls(CompnetxNetwork(model), read_voxels(voxels))


@dataclass(frozen=True)
class _Kind:
    """A kind of sampler.

    Attributes:
        parameters: its dataclass.
        make: makes one of parameters and what was learned.
        learned: whether it needs that.
    """

    parameters: type
    make: Callable[[Any, Any], Sampler]
    learned: bool = False


_KINDS = {
    "uniform": _Kind(UniformParameters, lambda p, _: UniformSampler(p.batch, p.block, p.around, p.directions)),
    "compnetx": _Kind(
        CompnetxParameters, lambda p, learned: CompnetxSampler(learned.network, learned.voxels, p), learned=True
    ),
}
_PARAMETERS: dict[str, Any] = {name: kind.parameters for name, kind in _KINDS.items()}


def check_sampler(choice: Choice) -> None:
    """Refuse a choice that `make_sampler` would, before there is a network.

    Raises:
        ConfigError: an unknown kind, or parameters that do not fit it.
    """
    choice.make(_PARAMETERS, "sampler")


def make_sampler(choice: Choice, learned: Learned | None = None) -> Sampler:
    """Return the sampler of a choice.

    Raises:
        ConfigError: an unknown kind, parameters that do not fit it, or a learned sampler without a network.
    """
    parameters = choice.make(_PARAMETERS, "sampler")
    kind = _KINDS[choice.kind]
    if kind.learned and learned is None:
        raise ConfigError(f"sampler {choice.kind!r} needs a trained network: run the train stage")
    return kind.make(parameters, learned)
