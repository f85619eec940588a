"""Families of tasks: ends are valid by pinocchio and plain coal, say what they mean, and come again by seed."""

import numpy as np
import pinocchio as pin
import pytest

from pipeline.environments.families import KINDS, make_family
from pipeline.environments.task import two_ends
from pipeline.errors import ConfigError
from pipeline.evaluation.ordinary import OrdinaryConstraint, OrdinaryValidity
from pipeline.robots import Shape
from pipeline.spec.statement import Joined, Level, OnPlane, OnTorus, Pinned
from pipeline.tasks import Task, build
from tests.robots.named import settings
from tests.robots.test_arms_validity import plain
from tests.robots.worlds import differences

ROBOT_OF = {
    "transport": "panda",
    "door": "panda",
    "tray": "baxter_both",
    "reach": "pholus",
    "corridor": "panda",
    "thicket": "panda",
    "maze": None,
}
SMALL = {"rows": 4, "columns": 6}


def family(kind: str):
    """A family with the robot of its benchmark."""
    robot = ROBOT_OF[kind]
    return make_family(kind, None if robot is None else settings(robot), SMALL if robot is None else {})


@pytest.fixture(scope="module")
def tasks() -> dict[str, list[Task]]:
    """Two tasks of every family."""
    made = {kind: family(kind) for kind in KINDS}
    return {kind: [build(made[kind].task(5, number).leg) for number in range(2)] for kind in KINDS}


def off(task: Task, q: np.ndarray) -> float:
    """How far a configuration is from what the task says, by pinocchio alone [m, rad]."""
    robot, worst = task.robot, 0.0
    for says in task.equations:
        if isinstance(says, Level):
            axis = robot.pose(q, says.frame).rotation @ np.array(says.axis)
            worst = max(worst, float(np.arccos(np.clip(axis @ np.array(says.direction), -1, 1))))
        elif isinstance(says, Joined):
            error = (robot.pose(q, says.frame) * says.relative.se3()).actInv(robot.pose(q, says.other))
            worst = max(worst, float(np.linalg.norm(pin.log6(error).vector)))
        elif isinstance(says, Pinned):
            worst = max(worst, float(np.linalg.norm(robot.pose(q, says.frame).translation - says.point)))
        elif isinstance(says, OnPlane):
            worst = max(worst, abs(robot.pose(q, says.frame).translation @ says.normal - says.distance))
        else:
            assert isinstance(says, OnTorus)
            worst = max(worst, abs(np.hypot(np.hypot(q[0], q[1]) - says.major, q[2]) - says.minor))
    return worst


@pytest.mark.parametrize("kind", KINDS)
def test_ends_are_valid(kind, tasks):
    """Start and goal are where the task says by pinocchio, within limits and 2 cm free by plain coal."""
    for task in tasks[kind]:
        touching = task.validity().touching
        assert np.linalg.norm(task.start - task.goal) > 0.5
        for q in (task.start, task.goal):
            assert off(task, q) < 3e-3  # rows of several feet or arms add up
            assert ((task.robot.lower <= q) & (q <= task.robot.upper)).all()
            assert plain(task.robot, task.obstacles, q, 0.0 if kind == "maze" else 0.02, 0.0, touching)
            assert all(condition.holds(q) for condition in task.validity().conditions)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_is_a_task(kind, tasks):
    """The same seed and number give the same task to the bit; another number another one."""
    again = build(family(kind).task(5, 1).leg)
    first, other = tasks[kind][1], tasks[kind][0]
    assert again.obstacles == first.obstacles
    np.testing.assert_array_equal([again.start, again.goal], [first.start, first.goal])
    assert not np.array_equal(other.start, first.start)


@pytest.mark.parametrize("kind", KINDS)
def test_ordinary_constraint_has_the_same_manifold(kind, tasks):
    """What we project onto our manifold meets the one in numpy, whose Jacobian is that of finite differences there."""
    task = tasks[kind][0]
    ordinary, rng = OrdinaryConstraint(task), np.random.default_rng(1)
    assert ordinary.n == task.constraint.n and ordinary.k == task.constraint.k
    Q, converged = task.constraint.project_batch(task.start + 0.2 * rng.normal(size=(10, ordinary.n)))
    assert converged.sum() > 5
    for q in Q[converged]:
        assert np.linalg.norm(ordinary.value(q)) < 2e-3
        np.testing.assert_allclose(ordinary.jacobian(q), differences(ordinary.value, q), atol=2e-3)
        away = q + 0.1 * rng.normal(size=len(q))
        assert np.linalg.norm(ordinary.value(away)) > 0.2 * task.constraint.distance(away)
        assert task.constraint.distance(away) > 0.2 * np.linalg.norm(ordinary.value(away))


@pytest.mark.parametrize("kind", KINDS)
def test_ordinary_checker_gives_our_verdicts(kind, tasks):
    """Plain pinocchio over all pairs gives the verdicts of our checker, free and colliding."""
    task, rng = tasks[kind][1], np.random.default_rng(2)
    ours, ordinary = task.validity(), OrdinaryValidity(task)
    scale = rng.choice([0.02, 0.1, 0.5], size=(120, 1))
    Q = np.clip(task.start + scale * rng.normal(size=(120, task.robot.dimension)), task.robot.lower, task.robot.upper)
    verdicts = [ours.free(q) for q in Q]
    assert verdicts == [ordinary.free(q) for q in Q]
    assert 5 < sum(verdicts) < 118


def test_doors_open(tasks):
    """A door begins shut and ends open by 0.6 to 1.1 rad, towards the robot; its panel does not strike its frame."""
    for task in tasks["door"]:
        yaw = task.robot.joint_names.index("door_0_yaw")
        assert abs(task.start[yaw]) < 5e-3 and 0.6 - 5e-3 < abs(task.goal[yaw]) < 1.1 + 5e-3
        hand = [task.robot.pose(q, task.robot.tool).translation for q in (task.start, task.goal)]
        assert hand[1][0] < hand[0][0] - 0.1
        assert task.touching == {("panel", "frame"): None}


def test_trays_stay_in_both_hands(tasks):
    """The tray is between the grippers and level at both ends."""
    for task in tasks["tray"]:
        data, placed = task.robot.model.createData(), task.robot.geometry.createData()
        number = task.robot.body_names.index("tray")
        for q in (task.start, task.goal):
            pin.updateGeometryPlacements(task.robot.model, data, task.robot.geometry, placed, q)
            hands = [task.robot.pose(q, f"{side}_gripper").translation for side in ("left", "right")]
            np.testing.assert_allclose(placed.oMg[number].translation, np.mean(hands, axis=0), atol=5e-3)
            assert abs(placed.oMg[number].rotation[2, 2]) > np.cos(3e-3)


def test_mass_is_over_the_feet(tasks):
    """At both ends of a reach pinocchio's centre of mass is 2 cm inside the rectangle of the feet."""
    for task in tasks["reach"]:
        data = task.robot.model.createData()
        feet = np.array([says.point for says in task.equations])
        for q in (task.start, task.goal):
            mass = pin.centerOfMass(task.robot.model, data, q)
            assert (mass[:2] > feet[:, :2].min(axis=0) + 0.019).all()
            assert (mass[:2] < feet[:, :2].max(axis=0) - 0.019).all()


def test_sticks_touch_their_table(tasks):
    """A stick is in the table at both ends, no deeper than 2 mm; its brackets are closed meshes, and not convex."""
    for task in tasks["thicket"]:
        contact = task.validity().deepest_contact(np.array([task.start, task.goal]))
        assert contact is not None and (contact.first, contact.second) == ("stick", "table")
        assert 0 < contact.depth < 0.002
        brackets = [o.body_shape() for o in task.obstacles if o.shape is Shape.MESH]
        assert brackets and all(not shape.open and not shape.convex for shape in brackets)


def test_two_ends_are_apart():
    """The first accepted draw is the start; the goal is accepted and far enough; None when draws run out."""
    draws = iter([np.array([[0.0], [1.0]]), np.array([[1.2], [5.0]]), np.array([[2.5]])])
    ends = two_ends(lambda: next(draws), lambda q: 0.5 < q[0] < 4, 1.0, 3)
    assert ends is not None and [float(q[0]) for q in ends] == [1.0, 2.5]
    assert two_ends(lambda: np.array([[1.0]]), lambda q: True, 1.0, 5) is None


def test_bad_families():
    """Unknown kinds, missing and superfluous robots, parameters and unfit robots are refused by name."""
    panda = settings("panda")
    for kind, robot, parameters, message in (
        ("dors", panda, {}, "transport, door, tray, reach, corridor, thicket, maze"),
        ("door", None, {}, "'door' needs a robot"),
        ("maze", panda, {}, "'maze' takes no robot"),
        ("door", panda, {"rows": 3}, "takes no parameters; it was given rows"),
        ("maze", None, {"row": 3}, "row"),
        ("tray", panda, {}, "cannot hold a tray"),
        ("reach", panda, {}, "cannot stand"),
    ):
        with pytest.raises(ConfigError, match=message):
            make_family(kind, robot, parameters)
