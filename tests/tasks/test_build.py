"""What tasks share is made once, and anew where what it was made from has changed."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import ProblemError
from pipeline.robots import Obstacle, Shape, UrdfRobot
from pipeline.spec.statement import Balanced, Carried, Level, OnPlane, Statement
from pipeline.spec.task import Leg
from pipeline.tasks import build, forget, robot_of, set_up
from pipeline.verification.judge import Judge
from pipeline.verification.reader import read
from pipeline.verification.rows import Rows
from tests.robots import meshes
from tests.robots.named import settings

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
ARM = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><collision><origin xyz="0 0 {half}"/>
    <geometry><box size="0.05 0.05 {length}"/></geometry></collision></link>
  <link name="hand"><collision><geometry><mesh filename="hand.obj"/></geometry></collision></link>
  <joint name="first" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="second" type="revolute"><parent link="upper"/><child link="hand"/><origin xyz="0 0 {length}"/>
    <axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
</robot>"""


@pytest.fixture(autouse=True)
def anew():
    """No test sees what another one made."""
    forget()


def write(path: Path, content: str, hour: int) -> None:
    """Write a file that was changed at some hour: clocks of file systems are coarse."""
    path.write_text(content)
    os.utime(path, (3600 * hour, 3600 * hour))


def arm(folder: Path, length: float, hand: float, hour: int) -> UrdfRobot:
    write(folder / "arm.urdf", ARM.format(length=length, half=length / 2), hour)
    file = Path(meshes.write(folder / "hand.obj", meshes.box((hand,) * 3)))
    os.utime(file, (3600 * hour, 3600 * hour))
    return UrdfRobot(str(folder / "arm.urdf"), ("first", "second"), "hand", "arm")


def test_robots_follow_their_files(tmp_path):
    """A robot is read once while its files stay the same, anew when the URDF or a mesh that it names has changed."""
    asked = arm(tmp_path, 0.5, 0.1, 1)
    first = robot_of(asked)
    assert robot_of(replace(asked)) is first
    longer = robot_of(arm(tmp_path, 0.7, 0.1, 2))
    assert longer.pose(np.zeros(2), "hand").translation[2] == pytest.approx(0.7)
    wider = robot_of(arm(tmp_path, 0.7, 0.4, 3))
    assert wider is not longer
    wall = Obstacle(Shape.BOX, (0.15, 0.0, 0.7), UPRIGHT, (0.02, 1.0, 1.0), "wall")
    statement = Statement(asked, (), obstacles=(wall,))
    q = np.zeros((1, 2))
    for hand, hour, free in ((0.1, 4, True), (0.4, 5, False), (0.1, 6, True)):
        arm(tmp_path, 0.7, hand, hour)
        assert set_up(statement).validity().free(q[0]) == free == Judge(statement).verify(q, q[0], q[0]).passed


def test_what_is_carried_follows_its_file(tmp_path):
    """A carried mesh that grows is seen by planning and by the verifier, in the same process."""
    asked = arm(tmp_path, 0.5, 0.02, 1)
    cup = tmp_path / "cup.obj"
    carried = Carried(Obstacle(Shape.MESH, (0.0, 0.0, 0.1), UPRIGHT, (1.0,) * 3, "cup", str(cup)), "hand")
    wall = Obstacle(Shape.BOX, (0.3, 0.0, 0.6), UPRIGHT, (0.02, 1.0, 1.0), "wall")
    statement, q = Statement(asked, (), obstacles=(wall,), carried=(carried,)), np.zeros((1, 2))
    for size, hour, free in ((0.1, 1, True), (0.8, 2, False), (0.1, 3, True)):
        meshes.write(cup, meshes.box((size,) * 3))
        os.utime(cup, (3600 * hour, 3600 * hour))
        assert set_up(statement).validity().free(q[0]) == free == Judge(statement).verify(q, q[0], q[0]).passed


def test_tasks_share_what_they_have_in_common():
    """Scenes share robot and constraint; another equation, tolerance or load shares the robot; nothing else changes."""
    panda = settings("panda")
    level, box = (
        Level(panda.tool, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)),
        Obstacle(Shape.BOX, (0.5, 0.0, 0.2), UPRIGHT, (0.1,) * 3, "box"),
    )
    one, other = set_up(Statement(panda, (level,))), set_up(Statement(panda, (level,), obstacles=(box,)))
    assert one.robot is other.robot and one.constraint is other.constraint and other.obstacles == (box,)
    stricter = set_up(Statement(panda, (level,), 1e-4))
    assert stricter.robot is one.robot and stricter.constraint is not one.constraint
    assert stricter.constraint.structure is one.constraint.structure and stricter.constraint.tolerance == 1e-4
    higher = set_up(Statement(panda, (OnPlane(panda.tool, (0.0, 0.0, 1.0), 0.4),)))
    assert higher.robot is one.robot and higher.constraint.k == 1
    loaded = set_up(Statement(panda, (level,), carried=(Carried(box, panda.tool, 1.0),)))
    assert loaded.robot is not one.robot and loaded.held.arm is one.robot
    feet = ((0.3, 0.3, 0.0), (-0.3, 0.3, 0.0), (0.0, -0.3, 0.0))
    standing = Statement(panda, (level,), conditions=(Balanced(feet),))
    assert set_up(standing).conditions[0] is set_up(replace(standing, obstacles=(box,))).conditions[0]
    task = build(Leg(standing, np.zeros((1, 7)), np.ones((1, 7))))
    assert task.constraint is one.constraint and task.start.tolist() == [0] * 7 and task.goal.tolist() == [1] * 7


@pytest.mark.parametrize("depth", [None, 0.005])
def test_standing_bodies_may_touch_what_they_are_said_to(depth):
    """A body that a frame of the base carries may touch an obstacle as deep as it is said, by planning and verifier."""
    panda = settings("panda")
    pot = Obstacle(Shape.BOX, (-0.4, 0.0, 0.2), UPRIGHT, (0.1,) * 3, "pot")
    for deep, free in ((0.0015, True), (0.003, depth is not None), (0.008, False)):
        shelf = Obstacle(Shape.BOX, (-0.4, 0.0, 0.1 + deep), UPRIGHT, (0.3, 0.3, 0.1), "shelf")
        carried = Carried(pot, "panda_link0", touches={"shelf": depth})
        statement = Statement(panda, (), obstacles=(shelf,), carried=(carried,))
        q = robot_of(panda).rest[None]
        verdict = Judge(statement).verify(q, q[0], q[0])
        assert verdict.passed == free, verdict.message
        if free:
            assert set_up(statement).validity().free(q[0])
        else:
            with pytest.raises(ProblemError, match=r"obstacle 'shelf' stands 0.00[38] m inside body 'pot'"):
                set_up(statement).validity()


@pytest.mark.parametrize("scale", [1e-200, 1e-160, 1.0, 1e160, 1e200])
def test_directions_of_any_length(scale):
    """A direction says the same whatever its length, to planning and to the verifier."""
    panda, q = settings("panda"), np.random.default_rng(0).uniform(-1, 1, (5, 7))
    values = []
    for size in (1.0, scale):
        equations = (
            Level(panda.tool, (0.0, 0.6 * size, 0.8 * size), (size, 0.0, -size)),
            OnPlane(panda.tool, (size, 2 * size, 0.0), 0.3),
        )
        statement = Statement(panda, equations)

        theirs = Rows(statement, read(statement)).values(q)
        ours = set_up(statement).constraint.value_batch(q)
        np.testing.assert_allclose(np.linalg.norm(theirs, axis=1), np.linalg.norm(ours, axis=1), atol=1e-9)
        values.append(ours)
    np.testing.assert_allclose(*values, atol=1e-12)
