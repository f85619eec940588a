"""Scenes and tasks come back from their files as they were; foreign and damaged ones are refused by name."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf

from pipeline.config import ROOT, compose, load
from pipeline.errors import ArtifactError, ConfigError
from pipeline.evaluation.families import Setting
from pipeline.keys import digest
from pipeline.problems import read_problem
from pipeline.problems.build import statement_of
from pipeline.robots import Obstacle, Placement, Shape
from pipeline.spec.codec import decode, encode
from pipeline.spec.scene import (
    Scene,
    Split,
    flatten,
    leg_of,
    pick,
    read_scenes,
    read_tasks,
    task_rows,
    unflatten,
    write_scenes,
    write_tasks,
)
from pipeline.spec.statement import Carried, InRegion, Level, OnSphere, Point, Posed, Region, Statement
from tests.robots.worlds import random_obstacles

RNG = np.random.default_rng(0)
POINT = Point(0.001, (-1.0,) * 3, (1.0,) * 3)
EXAMPLES = sorted((ROOT / "examples").glob("*.yaml"))
FAMILIES = sorted(path.stem for path in Path(ROOT, "conf", "family").glob("*.yaml"))


def statement(count: int) -> Statement:
    return Statement(POINT, (OnSphere("point", 1.0),), obstacles=tuple(random_obstacles(RNG, count)))


SCENES = [
    Scene("kitchen", "z", Split.TEST, (statement(3),)),
    Scene("kitchen", "a", Split.TRAIN, (statement(0), replace(statement(2), equations=()))),
    Scene("bar", "m", Split.VALIDATION, (statement(7),)),
]


def tasks(*places: tuple[str, str, str, int]) -> pd.DataFrame:
    """Return a table of (scenario, scene, split, number of tasks)."""
    rows = [(*place, i, 0) for *place, count in places for i in range(count)]
    frame = pd.DataFrame(rows, columns=["scenario", "scene", "split", "problem", "leg"])
    for column in ("start", "goal"):
        frame[column] = list(np.random.default_rng(len(column)).normal(size=(len(frame), 3)))
    return frame


def test_scenes_come_back(tmp_path):
    """Scenes come back equal and in order, with every leg, and every obstacle of every shape to the last bit."""
    write_scenes(SCENES, tmp_path)
    found = read_scenes(tmp_path)
    assert list(found) == ["z", "a", "m"]
    for scene, read in zip(SCENES, found.values(), strict=True):
        assert (read.scenario, read.name, read.split) == (scene.scenario, scene.name, scene.split)
        assert read.legs == scene.legs and read.obstacles == scene.obstacles
    before = (tmp_path / "scenes.jsonl").read_bytes()
    write_scenes(found.values(), tmp_path)
    assert (tmp_path / "scenes.jsonl").read_bytes() == before


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_what_problem_files_say_comes_back(path):
    """The statement of every example is the same after a way through JSON: each field, its type and its numbers."""
    said = statement_of(read_problem(path))
    read = decode(json.loads(json.dumps(encode(said), allow_nan=False)))
    assert read == said and digest(read) == digest(said) and type(read.robot) is type(said.robot)


@pytest.mark.parametrize("name", FAMILIES)
def test_what_families_say_comes_back(name):
    """So is that of a task of every family, pictures of mazes among them."""
    content = OmegaConf.to_container(compose(f"family/{name}"))
    leg = load(content.get("family", content), Setting).family().task(77, 0).leg
    read = decode(json.loads(json.dumps(encode(leg.statement), allow_nan=False)))
    assert digest(read) == digest(leg.statement)


def test_odd_numbers_and_arrays_come_back():
    """Infinite bounds, points of octrees, depths by pairs and negative zeros come back, and nothing is code."""
    points = np.random.default_rng(0).normal(size=(5, 3))
    tree = Obstacle(Shape.OCTREE, (0.0, -0.0, 1e-300), (0.0, 0.0, 0.0, 1.0), (0.1,) * 3, "tree", points=points)
    region = Region((-np.inf, 0.1, 0.2, 0, -np.inf, 0), (np.inf, 0.1, 0.2, 0, np.inf, 0), Placement((1.0, 2.0, 3.0)))
    said = Statement(
        POINT,
        (InRegion("point", region), Level("point", (0.0, 0.0, 1.0), (0.6, 0.0, 0.8)), Posed("point", Placement())),
        obstacles=(tree,),
        carried=(Carried(tree, "point", 0.5, {"link": None}, {"table": 0.001}),),
        touching={("point", "tree"): 0.002, ("point", "floor"): None},
    )
    read = decode(json.loads(json.dumps(encode(said), allow_nan=False)))
    assert read == said and read.touching == said.touching
    np.testing.assert_array_equal(read.obstacles[0].points, points)
    assert np.signbit(read.obstacles[0].position[1])
    with pytest.raises(TypeError, match="holds no function"):
        encode(replace(said, touching={("a", "b"): lambda: None}))
    for damaged in ({"kind": "Path"}, {"kind": "Level", "frame": "x"}, {"enum": "Shape", "value": "cone"}, {"x": 1}):
        with pytest.raises(ArtifactError, match="here is none that can be read"):
            decode(damaged, "here")


def test_damaged_scenes_are_refused(tmp_path):
    """What cannot be is refused with the file and the scene, a truncated or foreign file by name."""
    write_scenes(SCENES, tmp_path)
    path = tmp_path / "scenes.jsonl"
    head, first, second, third = path.read_text().splitlines()
    for damaged, message in (
        (second.replace('"OnSphere"', '"OnCube"'), "scene 'a' is none that can be read: KeyError: 'OnCube'"),
        (second.replace('"train"', '"exam"'), "scene 'a' lacks 'exam' is not a valid Split"),
        (second.replace('"legs"', '"arms"'), "scene 'a' lacks 'legs'"),
        (second[: second.index('"legs"')] + '"legs": []}', "scene 'a' has no statement"),
        (second[:-20], "truncated or foreign"),
    ):
        path.write_text("\n".join([head, first, damaged, third]))
        with pytest.raises(ArtifactError, match=rf"scenes.jsonl.*{message}"):
            read_scenes(tmp_path)
    path.write_text("\n".join([head.replace("scenes", "tasks"), first]))
    with pytest.raises(ArtifactError, match="schema 'tasks'"):
        read_scenes(tmp_path)


def test_tasks_come_back(tmp_path):
    """Tasks come back with their order, names and configurations to the last bit."""
    written = tasks(("kitchen", "z", "test", 3), ("bar", "m", "validation", 2))
    write_tasks(written, tmp_path)
    found = read_tasks(tmp_path, {scene.name: scene for scene in SCENES})
    assert list(found.columns) == list(written.columns)
    assert found.drop(columns=["start", "goal"]).equals(written.drop(columns=["start", "goal"]))
    for column in ("start", "goal"):
        assert [q.tobytes() for q in found[column]] == [q.tobytes() for q in written[column]]


def test_a_row_is_a_leg():
    """A row has the statement of its leg, and its start and goal."""
    frame = task_rows(SCENES[1], [(np.zeros(3), np.ones(3)), (np.ones(3), np.zeros(3))])
    assert frame["problem"].tolist() == [0, 1] and set(frame["leg"]) == {0}
    row = frame.assign(leg=1).iloc[1]
    leg = leg_of(SCENES[1], row)
    assert leg.statement is SCENES[1].legs[1]
    np.testing.assert_array_equal([leg.start, leg.goal], [np.ones(3), np.zeros(3)])


@pytest.mark.parametrize("column", ["start", "goal"])
@pytest.mark.parametrize("value", [[0.0, 1.0], [], [0.0, float("nan"), 1.0], [0.0, float("inf"), 1.0], [0.0] * 4])
def test_damaged_configuration_is_refused(tmp_path, column, value):
    """A start or goal of the wrong length, or not finite, is refused with its file, column, row and value."""
    frame = tasks(("kitchen", "z", "test", 4))
    damaged = [*frame[column]]
    damaged[2] = np.array(value)
    write_tasks(frame.assign(**{column: damaged}), tmp_path)
    with pytest.raises(ArtifactError, match=rf"tasks.parquet: {column} of row 2 is .*, expected 3 finite numbers"):
        read_tasks(tmp_path, {"z": SCENES[0]})


def test_files_are_not_mixed_up(tmp_path):
    """Missing files name the command, tasks of scenes that are not there the scenes."""
    for read in (read_scenes, lambda folder: read_tasks(folder, {})):
        with pytest.raises(
            ArtifactError, match=r"does not exist: run the stage that writes it \(`make repro`, its PROFILE\)"
        ):
            read(tmp_path)
    write_tasks(tasks(("kitchen", "z", "test", 1)), tmp_path)
    with pytest.raises(ArtifactError, match=r"tasks in scenes that are not there: \['z'\]"):
        read_tasks(tmp_path, {"m": SCENES[2]})


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
    frame = tasks(("a", "s2", "test", 3), ("a", "s1", "test", 1), ("a", "s3", "train", 3), ("b", "s4", "test", 4))
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
