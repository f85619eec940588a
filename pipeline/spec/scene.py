"""Scenes with the tasks in them, and their files: what every stage reads of an environment."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.atomic import atomic_file
from pipeline.errors import ArtifactError, ConfigError, require, require_name
from pipeline.files import VERSION, read_table, read_text, require_file, write_table
from pipeline.robots import Obstacle
from pipeline.spec.codec import decode, encode
from pipeline.spec.statement import Statement
from pipeline.spec.task import Leg

SCENES, TASKS = "scenes.jsonl", "tasks.parquet"
_SCHEMA = "scenes"
COLUMNS = ("scenario", "scene", "split", "problem", "leg", "start", "goal")


class Split(Enum):
    """What a scene may be used for."""

    TRAIN = "train"
    VALIDATION = "validation"  # early stopping and every choice of a parameter
    TEST = "test"  # measured, never looked at for a choice


@dataclass(frozen=True)
class Scene:
    """A place with obstacles, and what is asked of paths there.

    Attributes:
        scenario: the family it belongs to.
        name: unique among all scenes of an environment.
        split: what it may be used for.
        legs: what is asked along each leg of its tasks; most have one.
        sources: files that the scene and its tasks were read from, such as the robot's description and its meshes,
            with a hash of what each says. What is made of the scene follows from them.

    Raises:
        ConfigError: the name or the scenario's is none of a file: files are named after them.
    """

    scenario: str
    name: str
    split: Split
    legs: tuple[Statement, ...]
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_name("a scene", self.name)
        require_name(f"the scenario of scene {self.name}", self.scenario)

    @property
    def statement(self) -> Statement:
        """What is asked along the first leg."""
        return self.legs[0]

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Those of the first leg."""
        return self.statement.obstacles


def write_scenes(scenes: Iterable[Scene], folder: Path) -> None:
    """Write scenes as lines of JSON, after a line with the schema's name and version."""
    lines: list[Any] = [{"schema": _SCHEMA, "version": VERSION}]
    for scene in scenes:
        head = {"scenario": scene.scenario, "scene": scene.name, "split": scene.split.value}
        sources = {"sources": dict(scene.sources)} if scene.sources else {}
        lines.append({**head, **sources, "legs": encode(scene.legs)})
    with atomic_file(folder / SCENES) as temporary:
        temporary.write_text("".join(json.dumps(line, allow_nan=False) + "\n" for line in lines), encoding="utf-8")


def read_scenes(folder: Path) -> dict[str, Scene]:
    """Read scenes back by name, in file order.

    Raises:
        ArtifactError: the file is missing or damaged, or holds a scene that cannot be; it names the scene.
    """
    path = folder / SCENES
    require_file(path)
    try:
        head, *lines = [json.loads(line) for line in read_text(path).splitlines()]
        if head["schema"] != _SCHEMA or head["version"] != VERSION:
            raise ValueError(f"schema {head['schema']!r}, version {head['version']}")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ArtifactError(f"{path} holds no scenes of this version (truncated or foreign): {error}") from error
    found = {}
    for line in lines:
        name = str(line.get("scene")) if isinstance(line, dict) else ""
        try:
            legs = decode(line["legs"], f"{path}: scene {name!r}")
            found[name] = Scene(str(line["scenario"]), name, Split(line["split"]), legs, line.get("sources", {}))
        except (KeyError, TypeError, ValueError) as error:
            raise ArtifactError(f"{path}: scene {name!r} lacks {error}") from error
        except ConfigError as error:
            raise ArtifactError(f"{path}: {error}") from error
        if not legs or not all(isinstance(leg, Statement) for leg in legs):
            raise ArtifactError(f"{path}: scene {name!r} has no statement")
    return found


def write_tasks(tasks: pd.DataFrame, folder: Path) -> None:
    """Write tasks as one table, a row for each leg."""
    write_table(tasks, folder / TASKS, "tasks")


def read_tasks(folder: Path, scenes: Mapping[str, Scene]) -> pd.DataFrame:
    """Read tasks back.

    Raises:
        ArtifactError: the file is missing or damaged, names a scene that is not there, or a start or goal is not finite
            or of another size than its neighbours in the scene.
    """
    path = folder / TASKS
    frame = read_table(path, "tasks", COLUMNS)
    unknown = sorted(set(frame["scene"]) - set(scenes))
    if unknown:
        raise ArtifactError(f"{path} has tasks in scenes that are not there: {unknown[:5]}")
    sizes = frame["scene"].map(frame.groupby("scene")["start"].first().map(len))
    for column in ("start", "goal"):
        bad = [
            i
            for i, (q, size) in enumerate(zip(frame[column], sizes, strict=True))
            if len(q) != size or not np.isfinite(q).all()
        ]
        if bad:
            raise ArtifactError(
                f"{path}: {column} of row {bad[0]} is {list(frame[column].iloc[bad[0]])}, "
                f"expected {sizes.iloc[bad[0]]} finite numbers"
            )
    return frame


def task_rows(scene: Scene, ends: Sequence[tuple[np.ndarray, np.ndarray]]) -> pd.DataFrame:
    """Return tasks of one leg in a scene as rows of their table: starts and goals (n,), numbered from 0."""
    rows = [
        (scene.scenario, scene.name, scene.split.value, number, 0, start, goal)
        for number, (start, goal) in enumerate(ends)
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def leg_of(scene: Scene, row: Any) -> Leg:
    """Return what a row of the table of tasks asks for."""
    return Leg(scene.legs[int(row.leg)], np.array(row.start, float)[None], np.array(row.goal, float)[None])


def flatten(path: np.ndarray) -> dict[str, object]:
    """Return a path (T, n) as the columns path, waypoints and dimension."""
    return {"path": path.ravel(), "waypoints": len(path), "dimension": path.shape[1]}


def unflatten(row: pd.Series) -> np.ndarray:
    """Return the path (T, n) of a row with the columns of `flatten`."""
    return np.asarray(row["path"], float).reshape(int(row["waypoints"]), int(row["dimension"]))


def pick(
    tasks: pd.DataFrame, splits: Sequence[Split], per_scene: int, others: Mapping[str, int] | None = None
) -> pd.DataFrame:
    """Return the first `per_scene` tasks of each scene of the splits; `others` says otherwise by scenario."""
    others = others or {}
    for count in (per_scene, *others.values()):
        require("the number of problems per scene", count, at_least=1)
    chosen = tasks[tasks.split.isin([split.value for split in splits])]
    place = chosen.groupby("scene", sort=False)["problem"].transform(lambda numbers: pd.factorize(numbers)[0])
    counts = [others.get(scenario, per_scene) for scenario in chosen.scenario]
    return chosen[place.to_numpy() < np.array(counts, int)].reset_index(drop=True)
