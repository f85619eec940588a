"""From demonstrations and voxels to a trained network: what the train stage and the sweeps over it share."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import ArtifactError
from pipeline.files import read_arrays, read_table
from pipeline.learning.batches import TrainingData
from pipeline.learning.model import Normalisation
from pipeline.learning.networks import NetworkParameters
from pipeline.learning.pairs import demonstration_pairs, split_by_scene
from pipeline.learning.training import Trained, TrainParameters, train
from pipeline.profile import Profile
from pipeline.spec.environment import EnvironmentChoice
from pipeline.spec.scene import Split, read_scenes
from pipeline.tasks import set_up


@dataclass(frozen=True)
class ModelConfig:
    """Sizes of the network and how configurations are normalised."""

    network: NetworkParameters
    centre: bool


@dataclass(frozen=True)
class Recipe:
    """See `conf/train.yaml` and `conf/recipe/`."""

    profile: Profile
    environment: EnvironmentChoice
    model: ModelConfig
    spacing: float
    reverse: bool
    batch_size: int
    learning_rate: float
    warmup: float
    seed: int
    threads: int

    def parameters(self) -> TrainParameters:
        """Return what `train` takes."""
        return TrainParameters(
            self.profile.train.epochs, self.batch_size, self.learning_rate, self.warmup, self.seed, self.threads
        )


def train_recipe(recipe: Recipe, artifacts: Path, scratch: Path) -> Trained:
    """Train from the files below `artifacts`; work in progress is kept in `scratch`.

    Raises:
        ArtifactError: a file is missing or foreign, or no demonstration of a validation scene was solved.
    """
    source = artifacts / recipe.profile.name
    setup = set_up(next(iter(read_scenes(source / "scenes" / recipe.environment.name).values())).statement)
    robot, constraint = setup.robot, setup.constraint
    parameters = recipe.parameters()
    grids = read_arrays(source / "voxels" / recipe.environment.name / "voxels.npz", "voxels")
    paths = read_table(source / "demonstrations" / recipe.environment.name / "paths.parquet", "paths")
    paths = paths[paths["solved"]]
    scenes = [str(scene) for scene in grids["scene"]]
    held_out = sorted(set(paths[paths["split"] == Split.VALIDATION.value]["scene"]))
    if not held_out:
        raise ArtifactError("no validation scene has a solved demonstration: nothing to choose a checkpoint by")
    pairs = demonstration_pairs(paths, scenes, recipe.spacing, lambda Q: constraint.project_batch(Q)[0], recipe.reverse)
    data = TrainingData(grids["voxels"].astype(bool), *split_by_scene(pairs, scenes, held_out))
    normalisation = Normalisation(tuple(robot.box[0]), tuple(robot.box[1]), recipe.model.centre)
    return train(parameters, recipe.model.network, normalisation, data, scratch)
