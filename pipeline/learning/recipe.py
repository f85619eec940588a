"""Models by kind: what the train stage and the sweeps over it share."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.files import read_table
from pipeline.learning.compnetx import Model
from pipeline.learning.compnetx.recipe import CompnetxRecipe, train_compnetx
from pipeline.learning.engine import Trained, TrainParameters
from pipeline.perception import read_voxels
from pipeline.profile import Profile
from pipeline.schema import Choice
from pipeline.spec.environment import EnvironmentChoice
from pipeline.tasks.sources import current_scenes

RECIPES = {"compnetx": CompnetxRecipe}


@dataclass(frozen=True)
class Training:
    """How to train, but for the epochs, which are the profile's; see `TrainParameters`."""

    batch_size: int
    learning_rate: float
    warmup: float
    seed: int
    threads: int


@dataclass(frozen=True)
class Recipe:
    """See `conf/train.yaml` and `conf/recipe/`."""

    profile: Profile
    environment: EnvironmentChoice
    model: Choice
    training: Training

    def __post_init__(self) -> None:
        self.made()

    def made(self) -> CompnetxRecipe:
        """Return what is trained on what.

        Raises:
            ConfigError: no such kind of model, or parameters that do not fit it.
        """
        recipe: CompnetxRecipe = self.model.make(RECIPES, "model")
        return recipe

    def parameters(self) -> TrainParameters:
        """Return what `train` takes."""
        given = self.training
        return TrainParameters(
            self.profile.train.epochs, given.batch_size, given.learning_rate, given.warmup, given.seed, given.threads
        )


def train_recipe(recipe: Recipe, artifacts: Path, scratch: Path) -> tuple[Model, Trained]:
    """Train from the files below `artifacts`; work in progress is kept in `scratch`.

    Raises:
        ArtifactError: a file is missing or foreign, or no demonstration of a validation scene was solved.
    """
    source, name = artifacts / recipe.profile.name, recipe.environment.name
    scenes = current_scenes(source / "scenes" / name)
    voxels = read_voxels(source / "voxels" / name / "voxels.npz")
    paths = read_table(source / "demonstrations" / name / "paths.parquet", "paths")
    return train_compnetx(recipe.made(), recipe.parameters(), scenes, voxels, paths, scratch)
