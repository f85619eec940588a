"""Scenes and problems as every environment gives them, and their files."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd

from pipeline.constraints import Constraint
from pipeline.errors import ArtifactError, ProblemError, require
from pipeline.files import read_table, write_table
from pipeline.robots import Obstacle, Robot, Validity, obstacles_from_frame, obstacles_to_frame
from pipeline.robots.obstacles import COLUMNS
from pipeline.spec.statement import Statement

SCENES, PROBLEMS = "scenes.parquet", "problems.parquet"


class Split(Enum):
    """What a scene may be used for."""

    TRAIN = "train"
    VALIDATION = "validation"  # early stopping and every choice of a parameter
    TEST = "test"  # measured, never looked at for a choice


@dataclass(frozen=True)
class Scene:
    """Obstacles under a name.

    Attributes:
        scenario: the family it belongs to.
        name: unique among all scenes of an environment.
        split: what it may be used for.
        obstacles: in the world frame.
    """

    scenario: str
    name: str
    split: Split
    obstacles: tuple[Obstacle, ...]


class Environment(Protocol):
    """What a stage needs of an environment; one module per environment of the papers."""

    name: str
    margin: float
    frame: str

    def robot(self) -> Robot:
        """Return the robot."""

    def constraint(self) -> Constraint:
        """Return the constraint."""

    def statement(self, scene: Scene) -> Statement:
        """Return what is asked of paths in a scene, for the verifier."""

    def scenes(self, counts: dict[Split, int]) -> list[Scene]:
        """Return the scenes, with `counts` of them per split where a scenario has several."""

    def problems(self, scene: Scene, count: int) -> pd.DataFrame:
        """Return `count` problems of a scene: columns scenario, scene, split, problem, start, goal."""


def validity(environment: Environment, scene: Scene, robot: Robot, margin: float | None = None) -> Validity:
    """Return the checker of a scene, with the environment's margin unless another is given."""
    return Validity(robot, scene.obstacles, environment.margin if margin is None else margin)


def write_scenes(scenes: Iterable[Scene], folder: Path) -> None:
    """Write all obstacles of all scenes as one table.

    Raises:
        ProblemError: a scene has none, so that it would be lost.
    """
    frames = []
    for scene in scenes:
        if not scene.obstacles:
            raise ProblemError(f"scene {scene.name!r} has no obstacles; a table of obstacles cannot hold it")
        frame = obstacles_to_frame(scene.obstacles)
        frame.insert(0, "scenario", scene.scenario)
        frame.insert(1, "scene", scene.name)
        frame.insert(2, "split", scene.split.value)
        frames.append(frame)
    write_table(pd.concat(frames, ignore_index=True), folder / SCENES, "scenes")


def read_scenes(folder: Path) -> dict[str, Scene]:
    """Read scenes back by name, in file order.

    Raises:
        ArtifactError: the file is missing or damaged, or holds an obstacle that cannot be; it names the scene.
    """
    frame = read_table(folder / SCENES, "scenes", ("scenario", "scene", "split", *COLUMNS))
    found = {}
    for name, rows in frame.groupby("scene", sort=False):
        first = rows.iloc[0]
        try:
            obstacles = obstacles_from_frame(rows)
        except ProblemError as error:
            raise ArtifactError(f"{folder / SCENES}: scene {name!r}: {error}") from error
        found[str(name)] = Scene(str(first.scenario), str(name), Split(first.split), obstacles)
    return found


def write_problems(problems: pd.DataFrame, folder: Path) -> None:
    """Write all problems as one table."""
    write_table(problems, folder / PROBLEMS, "problems")


def read_problems(folder: Path, dimension: int) -> pd.DataFrame:
    """Read problems back and check that start and goal have `dimension` finite numbers."""
    frame = read_table(folder / PROBLEMS, "problems", ("scenario", "scene", "split", "problem", "start", "goal"))
    for column in ("start", "goal"):
        bad = [i for i, q in enumerate(frame[column]) if len(q) != dimension or not np.isfinite(q).all()]
        if bad:
            raise ArtifactError(
                f"{folder / PROBLEMS}: {column} of row {bad[0]} is {list(frame[column].iloc[bad[0]])}, "
                f"expected {dimension} finite numbers"
            )
    return frame


def flatten(path: np.ndarray) -> dict[str, object]:
    """Return a path (T, n) as the columns path, waypoints and dimension."""
    return {"path": path.ravel(), "waypoints": len(path), "dimension": path.shape[1]}


def unflatten(row: pd.Series) -> np.ndarray:
    """Return the path (T, n) of a row with the columns of `flatten`."""
    return np.asarray(row["path"], float).reshape(int(row["waypoints"]), int(row["dimension"]))


def pick(
    problems: pd.DataFrame, splits: Sequence[Split], per_scene: int, others: Mapping[str, int] | None = None
) -> pd.DataFrame:
    """Return the first `per_scene` problems of each scene of the splits; `others` says otherwise by scenario."""
    others = others or {}
    for count in (per_scene, *others.values()):
        require("the number of problems per scene", count, at_least=1)
    chosen = problems[problems.split.isin([split.value for split in splits])]
    place = chosen.groupby("scene", sort=False).cumcount()
    counts = [others.get(scenario, per_scene) for scenario in chosen.scenario]
    return chosen[place.to_numpy() < np.array(counts, int)].reset_index(drop=True)
