"""Samplers by name. Apart from the package's front door, so that classical planning does not load torch."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipeline.errors import ConfigError
from pipeline.learning import CompnetxNetwork
from pipeline.samplers.base import Sampler
from pipeline.samplers.compnetx import CompnetxParameters, CompnetxSampler
from pipeline.samplers.uniform import UniformParameters, UniformSampler
from pipeline.schema import Choice

_PARAMETERS: dict[str, Any] = {"uniform": UniformParameters, "compnetx": CompnetxParameters}


@dataclass(frozen=True)
class Learned:
    """What learned samplers need: the network and the voxel grids of the scenes."""

    network: CompnetxNetwork
    voxels: Mapping[str, np.ndarray]


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
    if choice.kind == "uniform":
        return UniformSampler(parameters.batch, parameters.block, parameters.around, parameters.directions)
    if learned is None:
        raise ConfigError(f"sampler {choice.kind!r} needs a trained network: run the train stage")
    return CompnetxSampler(learned.network, learned.voxels, **asdict(parameters))
