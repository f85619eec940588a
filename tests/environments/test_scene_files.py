"""Scenes and problems come back from their files as they were; foreign ones are refused by name."""

import numpy as np
import pandas as pd
import pytest

from pipeline.environments import (
    Scene,
    Split,
    flatten,
    pick,
    read_problems,
    read_scenes,
    unflatten,
    write_problems,
    write_scenes,
)
from pipeline.errors import ArtifactError, ConfigError, ProblemError
from pipeline.files import read_table, write_table
from tests.robots.worlds import random_obstacles

RNG = np.random.default_rng(0)
SCENES = [
    Scene("kitchen", "z", Split.TEST, tuple(random_obstacles(RNG, 3))),
    Scene("kitchen", "a", Split.TRAIN, tuple(random_obstacles(RNG, 1))),
    Scene("bar", "m", Split.VALIDATION, tuple(random_obstacles(RNG, 7))),
]


def problems(*places: tuple[str, str, str, int]) -> pd.DataFrame:
    """Return a table of (scenario, scene, split, number of problems)."""
    rows = [(*place, i) for *place, count in places for i in range(count)]
    frame = pd.DataFrame(rows, columns=["scenario", "scene", "split", "problem"])
    for column in ("start", "goal"):
        frame[column] = list(np.random.default_rng(len(column)).normal(size=(len(frame), 3)))
    return frame


def test_scenes_come_back(tmp_path):
    """Scenes come back equal and in order, with every obstacle of every shape to the last bit."""
    write_scenes(SCENES, tmp_path)
    found = read_scenes(tmp_path)
    assert list(found) == ["z", "a", "m"]
    assert list(found.values()) == SCENES


def test_scene_without_obstacles_is_refused(tmp_path):
    """A scene that a table of obstacles would lose is refused by name, and no file is written."""
    with pytest.raises(ProblemError, match="scene 'empty' has no obstacles"):
        write_scenes([*SCENES, Scene("bar", "empty", Split.TEST, ())], tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_damaged_scenes_are_refused(tmp_path):
    """An obstacle that cannot be is refused with file, scene and values; a missing column with what there is."""
    write_scenes(SCENES, tmp_path)
    path = tmp_path / "scenes.parquet"
    frame = read_table(path, "scenes")
    write_table(frame.assign(y=np.where(frame["scene"] == "a", np.nan, frame["y"])), path, "scenes")
    with pytest.raises(ArtifactError, match=r"scenes.parquet: scene 'a': obstacle 0 .* not finite: \["):
        read_scenes(tmp_path)
    write_table(frame.drop(columns=["qw", "split"]), path, "scenes")
    with pytest.raises(ArtifactError, match=r"scenes\.parquet lacks split, qw; it has scenario, scene, shape"):
        read_scenes(tmp_path)


def test_problems_come_back(tmp_path):
    """Problems come back with their order, names and configurations to the last bit."""
    written = problems(("blocks", "b", "train", 3), ("bands", "a", "test", 2))
    write_problems(written, tmp_path)
    found = read_problems(tmp_path, 3)
    assert list(found.columns) == list(written.columns)
    assert found.drop(columns=["start", "goal"]).equals(written.drop(columns=["start", "goal"]))
    for column in ("start", "goal"):
        assert [q.tobytes() for q in found[column]] == [q.tobytes() for q in written[column]]


@pytest.mark.parametrize("column", ["start", "goal"])
@pytest.mark.parametrize("value", [[0.0, 1.0], [], [0.0, float("nan"), 1.0], [0.0, float("inf"), 1.0], [0.0] * 4])
def test_damaged_configuration_is_refused(tmp_path, column, value):
    """A start or goal of the wrong length, or not finite, is refused with its file, column, row and value."""
    frame = problems(("blocks", "b", "train", 4))
    damaged = [*frame[column]]
    damaged[2] = np.array(value)
    write_problems(frame.assign(**{column: damaged}), tmp_path)
    with pytest.raises(ArtifactError, match=rf"problems.parquet: {column} of row 2 is .*, expected 3 finite numbers"):
        read_problems(tmp_path, 3)


def test_files_are_not_mixed_up(tmp_path):
    """Scenes are refused as problems and problems as scenes, and missing ones name the command."""
    for read in (read_scenes, lambda folder: read_problems(folder, 3)):
        with pytest.raises(
            ArtifactError, match=r"does not exist: run the stage that writes it \(`make repro`, its PROFILE\)"
        ):
            read(tmp_path)
    write_scenes(SCENES, tmp_path)
    (tmp_path / "scenes.parquet").rename(tmp_path / "problems.parquet")
    with pytest.raises(ArtifactError, match="holds schema 'scenes', expected 'problems'"):
        read_problems(tmp_path, 3)


def test_path_is_flat_and_back():
    """A path (T, n) and its flat columns are the same numbers, row by row; also a path of no states."""
    for path in (np.arange(12.0).reshape(4, 3), np.empty((0, 3)), np.array([[0.5]])):
        columns = flatten(path)
        assert columns["waypoints"] * columns["dimension"] == path.size == len(columns["path"])
        np.testing.assert_array_equal(unflatten(pd.Series(columns)), path)
        assert unflatten(pd.Series(columns)).shape == path.shape
    assert flatten(np.arange(6.0).reshape(2, 3))["path"].tolist() == [0, 1, 2, 3, 4, 5]


def test_pick_takes_the_first_of_each_scene():
    """The first problems of each scene of the splits are taken, in file order; scenarios may differ."""
    frame = problems(("a", "s2", "test", 3), ("a", "s1", "test", 1), ("a", "s3", "train", 3), ("b", "s4", "test", 4))
    taken = pick(frame, [Split.TEST], 2, {"b": 3})
    expected = [("s2", 0), ("s2", 1), ("s1", 0), ("s4", 0), ("s4", 1), ("s4", 2)]
    assert list(zip(taken["scene"], taken["problem"], strict=True)) == expected
    assert taken.index.tolist() == [0, 1, 2, 3, 4, 5]
    assert len(pick(frame, [Split.TEST, Split.TRAIN], 9)) == 11
    assert len(pick(frame, [Split.VALIDATION], 9)) == 0
    for count in (0, -1):
        with pytest.raises(ConfigError, match=f"problems per scene is {count}; it must be at least 1"):
            pick(frame, [Split.TEST], count)
        with pytest.raises(ConfigError, match=f"problems per scene is {count}; it must be at least 1"):
            pick(frame, [Split.TEST], 1, {"b": count})
