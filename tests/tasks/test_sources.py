"""What scenes, keys and later stages know of the files that a robot was read from."""

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from pipeline.config import compose, load
from pipeline.environments import FamilyEnvironment
from pipeline.errors import ArtifactError
from pipeline.evaluation.families import Setting
from pipeline.evaluation.routes import cases
from pipeline.evaluation.soak import Soak
from pipeline.robots import Obstacle, Shape
from pipeline.robots.description import SHARE, resolve
from pipeline.schema import Choice
from pipeline.spec.scene import Scene, Split, write_scenes
from pipeline.spec.statement import Carried, Statement
from pipeline.tasks.sources import check_sources, contents, current_scenes, read_by
from tests.environments.published import published
from tests.robots import meshes
from tests.tasks.test_build import arm

PANDA = "package://example-robot-data/robots/panda_description/urdf/panda.urdf"
ONE = {Split.TRAIN: 1, Split.VALIDATION: 0, Split.TEST: 0}


def with_limit(path: Path, lower: float) -> None:
    """Write Panda's description with another lower limit of the fourth joint [rad]."""
    before, after = resolve(PANDA, ()).read_text().split('<joint name="panda_joint4"', 1)
    path.write_text(
        f'{before}<joint name="panda_joint4"' + re.sub(r'lower="[^"]*"', f'lower="{lower}"', after, count=1)
    )


@pytest.fixture
def own(tmp_path, monkeypatch) -> Choice:
    """Panda's settings with a description of one's own, `panda.urdf` in the working folder."""
    monkeypatch.chdir(tmp_path)
    robot = published("transport_panda").robot
    with_limit(Path("panda.urdf"), -3.0)
    return replace(robot, parameters={**robot.parameters, "urdf": "panda.urdf"})


def test_an_edited_description_changes_scenes_and_ends_what_was_made_of_them(own, tmp_path):
    """After an edit of a family's URDF its scenes have other sources, which keys follow; the old scenes are refused."""
    environment = FamilyEnvironment("mine", "transport", own, 7, 0.005, 0.002)
    before = environment.scenes(ONE)
    write_scenes(before, tmp_path)
    assert current_scenes(tmp_path)[before[0].name].sources == before[0].sources
    with_limit(Path("panda.urdf"), -2.4)
    (after,) = environment.scenes(ONE)
    changed = {name for name in after.sources if after.sources[name] != before[0].sources[name]}
    assert changed == {"panda.urdf"} and set(after.sources) == set(before[0].sources)
    check_sources([after])
    for refused in (
        lambda: current_scenes(tmp_path),
        lambda: next(cases("mine", {s.name: s for s in before}, pd.DataFrame({"scene": [before[0].name]}))),
    ):
        with pytest.raises(
            ArtifactError, match=r"scene 'transport-train-000' was made from panda\.urdf .*scenes stage"
        ):
            refused()


def test_an_edited_description_changes_what_keys_of_families_hold(own):
    """The soak test's and the contest's families have other sources after an edit of a URDF; mazes have none."""
    soak = load(compose("soak").soak, Soak)
    setting = replace(soak.families["transport_panda"], robot=own)
    before = setting.sources()
    with_limit(Path("panda.urdf"), -2.4)
    after = setting.sources()
    assert before != after and set(before) == set(after)
    maze: Setting = soak.families["maze"]
    assert maze.sources() == {}


def test_files_of_packages_have_names_of_no_machine():
    """A published robot's files are named by package, each with a hash of the bytes that stand there."""
    (scene,) = published("transport_panda").scenes(ONE)
    assert {PANDA, PANDA.replace("urdf", "srdf")} < set(scene.sources)
    assert any(name.endswith((".stl", ".dae", ".obj")) for name in scene.sources)
    for name, found in scene.sources.items():
        content = (SHARE / name.removeprefix("package://")).read_bytes()
        assert name.startswith("package://") and found == hashlib.sha256(content + b"\0").hexdigest()[:16]


def test_every_file_of_a_statement_counts(tmp_path):
    """The description, a mesh of it, that of a carried body and that of an obstacle count; each is refused edited."""
    robot = arm(tmp_path, 0.5, 0.1, 1)
    for name in ("held.obj", "stone.obj"):
        meshes.write(tmp_path / name, meshes.box((0.1,) * 3))
    held, stone = (
        Obstacle(Shape.MESH, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (1.0,) * 3, name, str(tmp_path / f"{name}.obj"))
        for name in ("held", "stone")
    )
    statement = Statement(robot, (), carried=(Carried(held, "hand"),), obstacles=(stone,))
    files = {tmp_path / name for name in ("arm.urdf", "hand.obj", "held.obj", "stone.obj")}
    assert read_by(statement) == files
    scene = Scene("any", "one", Split.TRAIN, (statement,), contents(files))
    check_sources([scene])
    for path in files:
        whole = path.read_text()
        path.write_text(whole + "\n")
        with pytest.raises(ArtifactError, match=f"made from {path} with another content"):
            check_sources([scene])
        path.write_text(whole)
        check_sources([scene])
