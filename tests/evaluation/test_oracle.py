"""Demonstrations are sound, repeat, and count their failures."""

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf

from pipeline.config import compose, load
from pipeline.environments import SphereEnvironment
from pipeline.errors import ConfigError
from pipeline.evaluation.oracle import UNVERIFIED, Oracle, demonstrate, shards
from pipeline.robots import Validity
from pipeline.spec.scene import Scene, Split, unflatten
from pipeline.verification.judge import Judge
from tests.environments import published as environments


def published(**changes) -> Oracle:
    """The oracle of conf/oracle/sphere.yaml, with changes."""
    return load({**OmegaConf.to_container(compose("demonstrations").oracle), **changes}, Oracle)


@pytest.fixture(scope="module")
def environment() -> SphereEnvironment:
    return environments.published("sphere", blocks=200, grid=5000)


@pytest.fixture(scope="module")
def scene(environment) -> Scene:
    return environment.scenes({Split.TRAIN: 1})[0]


@pytest.fixture(scope="module")
def problems(environment, scene) -> pd.DataFrame:
    return environment.tasks(scene, 6)


@pytest.fixture(scope="module")
def paths(environment, scene, problems) -> pd.DataFrame:
    return demonstrate(published(), environment, {scene.name: scene}, problems)


def test_demonstrations_are_sound(environment, scene, problems, paths):
    """Every path leads from start to goal and passes the verifier; shortcuts make none longer and most shorter."""
    assert paths["solved"].all() and set(paths["status"]) == {"solved"}
    judge = Judge(scene.statement)
    for problem, row in zip(problems.itertuples(), paths.itertuples(), strict=True):
        path = unflatten(pd.Series(row._asdict()))
        verdict = judge.verify(path, problem.start, problem.goal)
        assert verdict.passed, verdict.message
        assert row.length == pytest.approx(verdict.length, rel=1e-12)
        assert row.length <= row.raw_length
        assert (row.scenario, row.scene, row.split, row.problem) == ("blocks", scene.name, "train", problem.problem)
    assert paths["length"].median() < 0.95 * paths["raw_length"].median()


def test_refused_paths_are_no_demonstrations(environment, scene, problems, monkeypatch):
    """With a planner whose checker passes everything, paths that the verifier refuses are counted and left out."""
    monkeypatch.setattr(Validity, "free", lambda self, q: True)
    monkeypatch.setattr(Validity, "all_free", lambda self, Q, *rest: True)
    blind = published(adherence={"kind": "projection", "parameters": {"proof": False}}, shortcuts=0)
    found = demonstrate(blind, environment, {scene.name: scene}, problems)
    refused = found[found["status"] == UNVERIFIED]
    assert len(refused) and not refused["solved"].any() and (refused["waypoints"] == 0).all()
    assert refused["message"].str.contains("contact").all() and refused["length"].isna().all()
    judge = Judge(scene.statement)
    for problem, row in zip(problems.itertuples(), found.itertuples(), strict=True):
        if row.solved:
            assert judge.verify(unflatten(pd.Series(row._asdict())), problem.start, problem.goal).passed


def test_demonstrations_repeat(environment, scene, problems, paths):
    """Equal seeds give equal tables but for the wall clock, in whatever pieces; another seed gives other paths."""
    pieces = [demonstrate(published(), environment, {scene.name: scene}, problems.iloc[i : i + 3]) for i in (3, 0)]
    again = pd.concat([pieces[1], pieces[0]], ignore_index=True)
    pd.testing.assert_frame_equal(again.drop(columns="planning_time"), paths.drop(columns="planning_time"))
    assert not again["planning_time"].equals(paths["planning_time"])
    other = demonstrate(published(seed=2), environment, {scene.name: scene}, problems.iloc[:1])
    assert other["path"][0].tolist() != paths["path"][0].tolist()


def test_problems_without_a_plan_are_counted(environment):
    """A start inside an obstacle is refused and said so, an exhausted search is not solved; neither ends the work."""
    bands = environment.scenes({})[0]
    north, south, inside = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
    rows = [("bands", bands.name, "test", i, 0, start, south) for i, start in enumerate((north, inside, north))]
    broken = pd.DataFrame(rows, columns=["scenario", "scene", "split", "problem", "leg", "start", "goal"])
    found = demonstrate(published(max_iterations=1), environment, {bands.name: bands}, broken)
    assert found["problem"].tolist() == [0, 1, 2]
    assert found["status"].tolist() == ["iteration limit", "refused", "iteration limit"]
    assert not found["solved"].any()
    assert "start is in collision" in found["message"][1] and found["message"][0] == ""
    assert found[["length", "raw_length"]].isna().all(axis=None)
    assert [unflatten(row).shape for _, row in found.iterrows()] == [(0, 3)] * 3


def test_shards_cut_by_scene():
    """Pieces are of one scene and at most the size, keep order and number, and have names of their own."""
    frame = pd.DataFrame({"scene": ["b"] * 5 + ["a"] * 2, "problem": [0, 1, 2, 3, 4, 0, 1]})
    found = dict(shards(frame, 2))
    assert list(found) == ["b-00000", "b-00002", "b-00004", "a-00000"]
    assert [len(piece) for piece in found.values()] == [2, 2, 1, 2]
    pd.testing.assert_frame_equal(pd.concat(found.values()), frame)
    for size in (0, -3):
        with pytest.raises(ConfigError, match=f"shard is {size}; it must be at least 1"):
            list(shards(frame, size))


@pytest.mark.parametrize(("name", "bound"), [("max_iterations", 1), ("shortcuts", 0), ("seed", 0)])
def test_wrong_oracle_is_refused(name, bound):
    """A number below its bound is refused with its name, value and bound."""
    assert getattr(published(**{name: bound}), name) == bound
    with pytest.raises(ConfigError, match=rf"oracle\.{name} is {bound - 1}; it must be at least {bound}"):
        published(**{name: bound - 1})
