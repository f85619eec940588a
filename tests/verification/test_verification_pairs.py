"""The verifier's pairs of bodies, read from the files by itself, are those that the files mean."""

from dataclasses import replace
from pathlib import Path

import coal
import numpy as np
import pytest
from arms import BAXTER, PANDA, known

from pipeline.robots import Obstacle, Shape, UrdfRobot
from pipeline.robots.bodies import body_of
from pipeline.spec.statement import Carried, Statement
from pipeline.verification.pairs import disabled_pairs, pairs_of_bodies
from pipeline.verification.reader import read

LINE = """<robot name="line">{links}{joints}</robot>"""


def of_planning(robot) -> set[frozenset[str]]:
    names = [body_of(name) for name in robot.body_names]
    return {frozenset((names[pair.first], names[pair.second])) for pair in robot.geometry.collisionPairs}


def of_verifier(statement: Statement) -> set[frozenset[str]]:
    kinematics = read(statement)
    names = [body.name for body in kinematics.bodies]
    return {frozenset((names[i], names[j])) for i, j in pairs_of_bodies(statement, kinematics)}


@pytest.mark.parametrize(
    "robot",
    [PANDA, BAXTER, replace(PANDA, srdf=""), replace(PANDA, ignored=(("panda_link0", "panda_hand"),))],
    ids=["panda", "baxter", "without srdf", "ignored"],
)
def test_pairs_agree_with_planning(robot):
    """Two readers of the same files hold the same bodies against each other."""
    settings = replace(robot, state="") if not robot.srdf else robot
    assert of_verifier(Statement(settings, (), 1e-3)) == of_planning(settings.robot())


def test_a_pair_that_planning_drops_is_still_held():
    """What is taken out of planning's model does not reach the verifier."""
    robot = PANDA.robot()
    before = of_verifier(Statement(PANDA, (), 1e-3))
    robot.geometry.removeAllCollisionPairs()
    assert of_verifier(Statement(PANDA, (), 1e-3)) == before and len(before) > 20


def test_pairs_of_what_is_carried():
    """A carried body is held against all bodies but those of the joint that moves it."""
    cup = Obstacle(Shape.CYLINDER, (0.0, 0.0, 0.05), (0.0, 0.0, 0.0, 1.0), (0.06, 0.06, 0.1), name="cup")
    statement = Statement(PANDA, (), 1e-3, carried=(Carried(cup, "panda_hand_tcp"),))
    kinematics, bare = read(statement), of_verifier(Statement(PANDA, (), 1e-3))
    joint = next(body.joint for body in kinematics.bodies if body.name == "cup")
    others = {body.name for body in kinematics.bodies if body.joint != joint}
    assert of_verifier(statement) - bare == {frozenset((name, "cup")) for name in others}


@pytest.mark.parametrize("srdf", ["", '<robot name="line"><disable_collisions link1="l3" link2="l0"/></robot>'])
def test_neighbours(tmp_path: Path, srdf: str):
    """Without a disabled pair bodies of neighbouring joints are left out; with one, all but the disabled are held."""
    links = "".join(
        f'<link name="l{i}"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>'
        for i in range(4)
    )
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.1"/>'
        '<axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for i in range(3)
    )
    (tmp_path / "line.urdf").write_text(LINE.format(links=links, joints=joints))
    (tmp_path / "line.srdf").write_text(srdf or '<robot name="line"/>')
    robot = UrdfRobot(
        str(tmp_path / "line.urdf"), ("j0", "j1", "j2"), "l3", "line", srdf=str(tmp_path / "line.srdf") if srdf else ""
    )
    every = {frozenset((f"l{i}_0", f"l{j}_0")) for i in range(4) for j in range(i)}
    beside = {frozenset((f"l{i}_0", f"l{i + 1}_0")) for i in range(3)}
    expected = every - {frozenset(("l0_0", "l3_0"))} if srdf else every - beside
    assert of_verifier(Statement(robot, (), 1e-3)) == expected
    assert len(disabled_pairs(robot)) == bool(srdf)


def test_what_stands_for_a_mesh_holds_it():
    """Hulls and pieces that planning and verifier both use enclose the meshes they stand for: read again, and asked."""
    _, items, _ = known(PANDA)
    kinematics = known(PANDA)[0]
    for item in items:
        given = kinematics.bodies[item.body].geometry
        if not isinstance(given, coal.BVHModelBase):
            continue
        points = np.array(given.vertices())
        inside = np.array(item.form.shape.points())
        for way in np.random.default_rng(0).normal(size=(50, 3)):
            assert (points @ way).max() <= (inside @ way).max() + 1e-6
