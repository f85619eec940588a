"""What a network is told of a task: found from the constraints themselves, and refused where it was never learned."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint
from pipeline.constraints.poses import height
from pipeline.environments.door import DoorOpening
from pipeline.errors import ProblemError
from pipeline.learning.task_kinds import kind_of, task_input, task_kinds, task_vector
from pipeline.robots import Numbers, Placement, Robot, UrdfRobot
from pipeline.spec.statement import Level, OnLine, OnPlane, Pinned, Posed
from pipeline.tasks import set_up
from pipeline.tasks.equations import constraint_of
from tests.robots.named import named, settings
from tests.robots.worlds import ball, sphere


def plane(robot: Robot, height: float, tilt: float = 0.3) -> Constraint:
    """z + tilt x = height."""
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    return Constraint("plane", q, q[2] + p(tilt) * q[0] - p(height), labels=["z [m]"], numbers=p)


def test_tasks_that_differ_in_nothing_need_no_words():
    """Tasks of one kind with equal numbers make no input."""
    robot = ball()
    kinds = task_kinds([(robot, sphere())] * 3, centre=False)
    assert len(kinds) == 1 and task_input(kinds) == 0
    assert task_vector(kinds, 0, sphere().said).shape == (0,)


def test_only_what_differs_is_said():
    """Of two numbers the one that differs is an input, from -1 to 1 over the tasks that were learned."""
    robot = ball()
    kinds = task_kinds([(robot, plane(robot, height)) for height in (0.2, 0.7, 0.3)], centre=False)
    assert len(kinds) == 1 and task_input(kinds) == 1
    for z, expected in ((0.2, -1.0), (0.7, 1.0), (0.45, 0.0), (0.95, 2.0)):
        np.testing.assert_allclose(task_vector(kinds, 0, plane(robot, z).said), [expected], atol=1e-12)


def test_special_values_are_like_others():
    """A height of 0, 1 or -1, which an expression keeps as a constant, is told as any other, and so are directions."""
    arm = named("panda")
    heights = (-0.2, 0.0, 0.3, 1.0, -1.0)
    tasks = [(arm, height(arm, arm.tool, value)) for value in heights]
    kinds = task_kinds(tasks, centre=True)
    assert len(kinds) == 1
    told = [float(task_vector(kinds, 0, constraint.said)[0]) for _, constraint in tasks]
    np.testing.assert_allclose(told, heights, atol=1e-12)  # they are learned from -1 to 1
    for value in (0.1, 0.0):
        assert kind_of(kinds, arm, height(arm, arm.tool, value)) == 0


@pytest.mark.parametrize(
    "tasks",
    [
        [Level("panda_hand_tcp", (0, 0, 1), way) for way in ((0, 0, -1), (0, 0, 1), (1, 0, 0))],
        [OnPlane("panda_hand_tcp", way, 0.4) for way in ((0, 0, 1), (1, 0, 0))],
        [Pinned("panda_hand_tcp", point) for point in ((0, 0.4, 0.5), (0.4, 0.5, 0))],
        [OnLine("panda_hand_tcp", point, (0, 0, 1)) for point in ((0.4, 0, 0), (0, 0.4, 0))],
        [Posed("panda_hand_tcp", Placement((0.4, 0, 0.5), rpy=way)) for way in ((0, 0, 1.57), (1.57, 0, 0))],
        [OnPlane(frame, (0, 0, 1), 0.4) for frame in ("panda_link7", "panda_link6")],
    ],
    ids=lambda tasks: type(tasks[0]).__name__,
)
def test_different_tasks_are_told_apart(tasks):
    """Whatever two constraints differ in (direction, place, frame), the network is told something else."""
    arm = named("panda")
    made = [constraint_of(arm, equation, 1e-3) for equation in tasks]
    kinds = task_kinds([(arm, constraint) for constraint in made], centre=True)
    told = {tuple(task_vector(kinds, kind_of(kinds, arm, one), one.said)) for one in made}
    assert len(told) == len(tasks)


def test_frames_that_differ_in_a_number():
    """Names of frames keep their numbers: a height of foot-1 is another kind of task than one of foot-2."""
    robot = ball()
    q = ca.SX.sym("q", 3)
    feet = [Constraint("foot", q, q[2], labels=[f"height of foot{name} [m]"]) for name in ("-1", "-2", " 1", " 2")]
    assert len(task_kinds([(robot, foot) for foot in feet], centre=False)) == 4


def test_another_robot_of_the_same_names_is_refused(tmp_path):
    """Other lengths of links, or joints that turn where they had limits, are another robot, whatever its names."""
    one, longer, turning = (arm_like(tmp_path, *change) for change in ((0.3, True), (0.5, True), (0.3, False)))
    kinds = task_kinds([(one, height(one, "tip", 0.1))], centre=False)
    assert kind_of(kinds, arm_like(tmp_path, 0.3, True), height(one, "tip", 0.2)) == 0
    for other in (longer, turning):
        with pytest.raises(ProblemError, match="another robot with the joints"):
            kind_of(kinds, other, height(other, "tip", 0.1))
    both = task_kinds([(robot, height(robot, "tip", 0.1)) for robot in (one, turning)], centre=False)
    assert [kind_of(both, robot, height(robot, "tip", 0.1)) for robot in (one, turning)] == [0, 1]


def arm_like(folder: Path, length: float, limited: bool) -> Robot:
    """Three joints with links of a length, the first of them limited or not."""
    joints = "".join(
        f"""<joint name="joint{i}" type="{"revolute" if limited or i else "continuous"}"><parent link="link{i}"/>
        <child link="link{i + 1}"/><origin xyz="0 0 {length}"/><axis xyz="{i % 2} {1 - i % 2} 0"/>
        <limit lower="-2" upper="2" effort="1" velocity="1"/></joint><link name="link{i + 1}"/>"""
        for i in range(3)
    )
    tip = '<link name="tip"/><joint name="end" type="fixed"><parent link="link3"/><child link="tip"/></joint>'
    path = folder / f"arm_{length}_{limited}.urdf"
    path.write_text(f'<robot name="arm"><link name="link0"/>{joints}{tip}</robot>')
    return UrdfRobot(urdf=str(path), joints=("joint0", "joint1", "joint2"), tool="tip", name="arm").robot()


def test_far_from_what_was_learned_is_refused():
    """A number far outside of those of the tasks that were learned is no proposal's business."""
    robot = ball()
    kinds = task_kinds([(robot, plane(robot, height)) for height in (0.5, 0.6)], centre=False)
    assert task_vector(kinds, 0, plane(robot, 0.65).said) == pytest.approx([2.0])
    with pytest.raises(ProblemError, match=r"is 0\.8, far from those .* 0\.5 to 0\.6"):
        task_vector(kinds, 0, plane(robot, 0.8).said)
    same = task_kinds([(robot, plane(robot, height)) for height in (0.5, 0.50001)], centre=False)
    assert task_input(same) == 0


def test_another_value_of_what_never_differed_is_refused():
    """A number that was the same in all tasks has to be that one."""
    robot = ball()
    kinds = task_kinds([(robot, plane(robot, height)) for height in (0.2, 0.7)], centre=False)
    with pytest.raises(ProblemError, match=r"is 0\.4, and 0\.3 in all tasks"):
        task_vector(kinds, 0, plane(robot, 0.5, tilt=0.4).said)


def test_several_kinds():
    """Tasks of several kinds are told apart, in whatever order they come, and shorter ones are filled up."""
    robot = ball()
    tasks = [(robot, sphere()), (robot, plane(robot, 0.2)), (robot, plane(robot, 0.7))]
    for order in (tasks, tasks[::-1]):
        kinds = task_kinds(order, centre=False)
        assert len(kinds) == 2 and task_input(kinds) == 3
        told = {
            tuple(task_vector(kinds, kind_of(kinds, robot, constraint), constraint.said)) for _, constraint in tasks
        }
        assert len(told) == 3


def test_an_unknown_kind_is_refused():
    """A task of another constraint or robot is refused, with what is known."""
    robot = ball()
    kinds = task_kinds([(robot, sphere())], centre=False)
    with pytest.raises(ProblemError, match=r"learned tasks of sphere\[\*\] \(x, y, z\), not of z \[m\]"):
        kind_of(kinds, robot, plane(robot, 0.2))


def test_doors_are_one_kind():
    """A hundred doors, hinged left and right anywhere, are tasks of one kind that tells where the hinge is."""
    family = DoorOpening(settings("panda"))
    setups = [set_up(family.scene(i, np.random.default_rng([3, i]))[0]) for i in range(100)]
    kinds = task_kinds([(setup.robot, setup.constraint) for setup in setups], centre=True)
    assert len(kinds) == 1
    assert kinds[0].codec.size == setups[0].robot.dimension
    told = np.array([task_vector(kinds, 0, setup.constraint.said) for setup in setups])
    assert task_input(kinds) >= 3 and np.abs(told).max() <= 1 + 1e-9
    hinges = np.array([setup.statement.chain.regions[0].place.xyz for setup in setups])
    design = np.column_stack([told, np.ones(100)])  # what is told determines where the hinge is
    fitted = design @ np.linalg.lstsq(design, hinges, rcond=None)[0]
    np.testing.assert_allclose(fitted, hinges, atol=1e-6)
