"""From demonstrations and voxels to a trained CoMPNetX."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.constraints import Constraint
from pipeline.errors import ArtifactError, require
from pipeline.learning.compnetx.batches import Batches, TrainingData
from pipeline.learning.compnetx.learner import CompnetxLearner
from pipeline.learning.compnetx.model import Model, sized
from pipeline.learning.compnetx.networks import Compnetx, Layers, NetworkParameters
from pipeline.learning.compnetx.pairs import Pairs, demonstration_pairs, split_by_scene, together
from pipeline.learning.engine import Job, Trained, TrainParameters, train
from pipeline.learning.store import with_weights
from pipeline.learning.task_kinds import TaskKind, kind_of, task_kinds, task_vector
from pipeline.spec.scene import Scene, Split
from pipeline.tasks import Setup, set_up

_VALIDATION_BATCH = 4096  # pairs per step without gradients; larger ones gain nothing


@dataclass(frozen=True, kw_only=True)
class CompnetxRecipe:
    """What is trained on what.

    Attributes:
        layers: sizes of the network; the others follow from tasks and voxel grids.
        centre: see `Codec`.
        spacing, reverse: see `demonstration_pairs`.
    """

    layers: Layers
    centre: bool
    spacing: float
    reverse: bool

    def __post_init__(self) -> None:
        require("model.spacing", self.spacing, above=0)


def train_compnetx(
    recipe: CompnetxRecipe,
    parameters: TrainParameters,
    scenes: Mapping[str, Scene],
    voxels: Mapping[str, np.ndarray],
    paths: pd.DataFrame,
    scratch: Path,
) -> tuple[Model, Trained]:
    """Train on demonstrations in scenes; work in progress is kept in `scratch`, see `train`.

    Args:
        recipe: what is trained on what.
        parameters: how.
        scenes: by name.
        voxels: grids (L, W, H) of bool by scene.
        paths: demonstrations, see `demonstrate`.
        scratch: see `train`.

    Raises:
        ArtifactError: no demonstration of a validation scene was solved, or scenes, voxels and paths do not belong
            together.
        ConfigError: data that no network can be trained on.
    """
    paths = paths[paths["solved"]]
    held_out = sorted(set(paths[paths["split"] == Split.VALIDATION.value]["scene"]))
    if not held_out:
        raise ArtifactError("no validation scene has a solved demonstration: nothing to choose a checkpoint by")
    names = [name for name, scene in scenes.items() if scene.split is not Split.TEST]
    _check(names, voxels, paths)
    setups = [set_up(scenes[name].statement) for name in names]
    kinds = task_kinds([(setup.robot, setup.constraint) for setup in setups], recipe.centre)
    grids = np.stack([voxels[name] for name in names]).astype(bool)
    network = sized(recipe.layers, kinds, grids.shape[1])
    rows = [kind_of(kinds, setup.robot, setup.constraint) for setup in setups]
    pairs = _encoded_pairs(recipe, network, kinds, names, setups, rows, paths)
    data = TrainingData(
        grids,
        np.stack([task_vector(kinds, row, setup.constraint.said) for row, setup in zip(rows, setups, strict=True)]),
        np.stack([np.arange(network.width) < kinds[row].codec.size for row in rows]),
        *split_by_scene(pairs, names, held_out),
    )
    return train_network(parameters, network, kinds, data, scratch)


def _check(names: Sequence[str], voxels: Mapping[str, np.ndarray], paths: pd.DataFrame) -> None:
    """Refuse scenes without voxels, grids of several shapes, and paths of scenes that are not there."""
    missing = sorted(set(names) - set(voxels))
    if missing:
        raise ArtifactError(f"there are no voxels of the scenes {missing[:5]} ({len(missing)} in all)")
    shapes = sorted({voxels[name].shape for name in names})
    if len(shapes) > 1:
        raise ArtifactError(f"voxels of scenes have several shapes: {shapes[:5]}")
    unknown = sorted(set(paths["scene"]) - set(names))
    if unknown:
        raise ArtifactError(f"demonstrations are of scenes that are not there: {unknown[:5]} ({len(unknown)} in all)")


def train_network(
    parameters: TrainParameters,
    network: NetworkParameters,
    kinds: Sequence[TaskKind],
    data: TrainingData,
    scratch: Path,
) -> tuple[Model, Trained]:
    """Train a network of given sizes on given pairs. Raises as `train` does, and `TrainingData.check`."""
    data.check(network)
    steps = -(-len(data.train) // parameters.batch_size)
    rise, seed = round(parameters.warmup * steps), parameters.seed
    job = Job(
        lambda: CompnetxLearner(Compnetx(network), data, parameters.learning_rate, rise),
        lambda epoch: Batches(data.train, network, parameters.batch_size, seed, epoch),
        Batches(data.validation, network, _VALIDATION_BATCH, seed, None),
        [network, data],
        Path(__file__),
    )
    trained = train(parameters, job, scratch)
    model = Model(network, tuple(kinds), with_weights(lambda: Compnetx(network), trained.weights))
    counted = {
        "train_pairs": len(data.train),
        "validation_pairs": len(data.validation),
        "train_scenes": len(np.unique(data.train.scene)),
        "validation_scenes": len(np.unique(data.validation.scene)),
    }
    return model, replace(trained, metrics={**trained.metrics, **counted})


def _encoded_pairs(
    recipe: CompnetxRecipe,
    network: NetworkParameters,
    kinds: Sequence[TaskKind],
    names: Sequence[str],
    setups: Sequence[Setup],
    rows: Sequence[int],
    paths: pd.DataFrame,
) -> Pairs:
    """Return the pairs of all demonstrations; scenes that share a constraint are projected together."""
    groups: dict[tuple[int, int], list[str]] = {}
    for name, setup, kind in zip(names, setups, rows, strict=True):
        groups.setdefault((kind, id(setup.constraint)), []).append(name)
    found = []
    for (kind, _), scenes in groups.items():
        constraint = setups[names.index(scenes[0])].constraint
        own = paths[paths["scene"].isin(scenes)]
        if len(own):
            project = partial(_projected, constraint)
            pairs = demonstration_pairs(own, names, recipe.spacing, project, recipe.reverse)
            found.append(pairs.encoded(kinds[kind].codec, network.width))
    return together(found)


def _projected(constraint: Constraint, Q: np.ndarray) -> np.ndarray:
    return constraint.project_batch(Q)[0]
