"""A trained model: sizes, normalisation and weights in one open file that is read without running code from it."""

import io
import pickle
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pipeline.atomic import atomic_file
from pipeline.errors import ArtifactError, ConfigError
from pipeline.files import VERSION, require_file
from pipeline.learning.networks import Compnetx, NetworkParameters

SCHEMA = "compnetx-model"


@dataclass(frozen=True)
class Normalisation:
    """Maps configurations to the network's numbers and back, by the robot's limits and never by data.

    Dividing by the range alone, as the authors' code does, is the default: it leaves symmetric limits, such as the
    sphere's, within +-0.5 as centring would. For a joint whose limits lie on one side of zero, centring keeps its
    numbers small.

    Attributes:
        lower, upper: limits of the robot (n,) [rad or m].
        centre: whether to subtract the middle of the limits first.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    centre: bool = False

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            object.__setattr__(self, name, tuple(float(value) for value in getattr(self, name)))
        if len(self.lower) != len(self.upper) or not all(
            -np.inf < low < high < np.inf for low, high in zip(self.lower, self.upper, strict=True)
        ):
            raise ConfigError(f"limits {self.lower} to {self.upper} do not normalise: finite, lower below upper")

    @property
    def scale(self) -> np.ndarray:
        """What configurations are divided by (n,)."""
        return np.subtract(self.upper, self.lower)

    @property
    def offset(self) -> np.ndarray:
        """What is subtracted before (n,); zeros without centring."""
        return np.add(self.upper, self.lower) / 2 if self.centre else np.zeros(len(self.lower))

    def normalise(self, Q: np.ndarray) -> np.ndarray:
        """Return (Q - offset) / scale for rows of Q (N, n)."""
        return (Q - self.offset) / self.scale

    def denormalise(self, X: np.ndarray) -> np.ndarray:
        """Return X * scale + offset for rows of X (N, n)."""
        return X * self.scale + self.offset


@dataclass(frozen=True)
class Model:
    """A network with what is needed to use it.

    Attributes:
        parameters: its sizes.
        normalisation: of configurations, in and out.
        network: its weights.
    """

    parameters: NetworkParameters
    normalisation: Normalisation
    network: Compnetx

    def __post_init__(self) -> None:
        if len(self.normalisation.lower) != self.parameters.dimension:
            raise ConfigError(
                f"normalisation is for {len(self.normalisation.lower)} joints, the network for "
                f"{self.parameters.dimension}"
            )


def network_from(parameters: NetworkParameters, weights: Mapping[str, torch.Tensor]) -> Compnetx:
    """Return a network of given weights, in eval mode; torch's stream of chance is left alone.

    Raises:
        RuntimeError: names or shapes do not fit.
    """
    with torch.device("meta"):  # draws no weights that would be thrown away
        network = Compnetx(parameters)
    network.load_state_dict(weights, assign=True)
    return network.eval()


def save_model(model: Model, path: Path) -> None:
    """Write a model whole; equal models give equal bytes."""
    content = {
        "schema": SCHEMA,
        "version": VERSION,
        "network": asdict(model.parameters),
        "normalisation": asdict(model.normalisation),
        "weights": {name: value.detach().cpu().contiguous() for name, value in model.network.state_dict().items()},
    }
    stream = io.BytesIO()  # torch writes the name of a file into the file
    torch.save(content, stream)
    with atomic_file(path) as temporary:
        temporary.write_bytes(stream.getvalue())


def load_model(path: Path) -> Model:
    """Read a model onto the CPU.

    Raises:
        ArtifactError: the file is missing, truncated, foreign, of another version, or its weights do not fit or are not
            finite.
    """
    content = read_tensors(path)
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else None
        raise ArtifactError(f"{path} holds schema {found or 'none'!r}, expected {SCHEMA!r}")
    if content.get("version") != VERSION:
        raise ArtifactError(f"{path} has version {content.get('version')!r} of {SCHEMA!r}, this code reads {VERSION}")
    try:
        parameters = _read(NetworkParameters, content["network"])
        normalisation = _read(Normalisation, content["normalisation"])
        model = Model(parameters, normalisation, network_from(parameters, content["weights"]))
    except (KeyError, TypeError, RuntimeError, ConfigError) as error:
        raise ArtifactError(f"{path} holds a model that does not fit this code: {error}") from error
    for name, weights in content["weights"].items():
        if not torch.isfinite(weights).all():
            raise ArtifactError(f"{path}: weights {name!r} are not all finite; train again")
    return model


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


def _read(kind: type, content: dict[str, Any]) -> Any:
    """Build a dataclass from all of its fields, none missing, none unknown."""
    known: Sequence[str] = [f.name for f in fields(kind)]
    if set(content) != set(known):
        raise KeyError(f"{kind.__name__} has the fields {sorted(known)}, the file {sorted(content)}")
    return kind(**content)
