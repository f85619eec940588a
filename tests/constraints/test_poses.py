"""Constraints on frames: values are pinocchio's, Jacobians finite differences', and what is projected holds."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import (
    Constraint,
    closed_chain,
    feasible,
    height,
    intersection,
    line,
    plane,
    pose,
    position,
    upright,
)
from pipeline.errors import ConstraintError, RobotError
from pipeline.robots import Robot
from tests.robots.named import configurations, named
from tests.robots.worlds import chain as serial
from tests.robots.worlds import differences, unit

HELD = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.05, 0.1, -0.05]))
MIDDLE = {"panda": 0.5, "baxter_right": 0.2, "sawyer": 0.3, "olivia": 1.0, "pholus": 1.0, "baxter_both": 0.2}  # [m]


def held(robot: Robot) -> pin.SE3:
    """A pose of the tool that the robot reaches: near that at rest."""
    return HELD if robot.rest is None else robot.pose(robot.rest, robot.tool) * HELD


@dataclass
class Case:
    """A constraint of a robot, and the same rows' sizes by pinocchio."""

    make: Callable[[Robot], Constraint]
    expected: Callable[[Robot, np.ndarray], np.ndarray]
    rows: int


def angle(robot: Robot, q: np.ndarray) -> np.ndarray:
    return np.array([np.arccos(np.clip(robot.pose(q, robot.tool).rotation[:, 2] @ [0, 0, 1], -1, 1))])


def cross_distance(robot: Robot, q: np.ndarray) -> np.ndarray:
    offset = robot.pose(q, robot.tool).translation - [0.1, 0.2, 0.3]
    return np.array([np.linalg.norm(np.cross(offset, [0.6, 0.0, 0.8]))])


def log_norms(robot: Robot, q: np.ndarray) -> np.ndarray:
    E = held(robot).actInv(robot.pose(q, robot.tool))
    return np.array([np.linalg.norm(E.translation), np.linalg.norm(pin.log3(E.rotation))])


def norms(F: np.ndarray, rows: int) -> np.ndarray:
    """What does not depend on the choice of basis: lengths of position and turn."""
    return np.array([np.linalg.norm(F[:3]), np.linalg.norm(F[3:])]) if rows == 6 else np.array([np.linalg.norm(F)])


CASES = {
    "upright": Case(lambda r: upright(r, r.tool), angle, 2),
    "height": Case(
        lambda r: height(r, r.tool, MIDDLE[r.name]),
        lambda r, q: np.abs(r.pose(q, r.tool).translation[2:] - MIDDLE[r.name]),
        1,
    ),
    "plane": Case(
        lambda r: plane(r, r.tool, (0.3, 0, 0.2), (0, 3.0, 4.0)),
        lambda r, q: np.abs([(r.pose(q, r.tool).translation - [0.3, 0, 0.2]) @ [0, 0.6, 0.8]]),
        1,
    ),
    "line": Case(lambda r: line(r, r.tool, (0.1, 0.2, 0.3), (3.0, 0, 4.0)), cross_distance, 2),
    "position": Case(
        lambda r: position(r, r.tool, (0.4, -0.3, 0.5)),
        lambda r, q: np.array([np.linalg.norm(r.pose(q, r.tool).translation - [0.4, -0.3, 0.5])]),
        3,
    ),
    "pose": Case(lambda r: pose(r, r.tool, held(r)), log_norms, 6),
}


def check(robot: Robot, case: Case, Q: np.ndarray) -> None:
    constraint = case.make(robot)
    assert constraint.k == case.rows == len(constraint.labels)
    for q in Q:
        F = constraint.value(q)
        np.testing.assert_allclose(norms(F, case.rows), case.expected(robot, q), atol=1e-8)
        np.testing.assert_allclose(constraint.jacobian(q), differences(constraint.value, q), atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("kind", CASES)
@pytest.mark.parametrize("name", ["panda", "baxter_right", "sawyer", "olivia", "pholus"])
def test_value_and_jacobian(name, kind):
    """Sizes of the rows are pinocchio's distances and angles, and the Jacobian is that of finite differences."""
    robot = named(name)
    check(robot, CASES[kind], configurations(robot, np.random.default_rng(1), 8))


@pytest.mark.parametrize("seed", range(4))
def test_random_robots(seed):
    """The same on random serial chains with joints of all kinds."""
    rng = np.random.default_rng(seed)
    robot = serial(
        rng, rng.choice(["RX", "RY", "RZ", "PX", "PY", "revolute unaligned", "prismatic unaligned"], 8).tolist()
    )
    object.__setattr__(robot, "tool", "tool")
    MIDDLE[robot.name] = 0.1
    for case in CASES.values():
        check(robot, case, rng.uniform(-2, 2, (4, 8)))


@pytest.mark.parametrize("kind", CASES)
@pytest.mark.parametrize("name", ["panda", "baxter_right", "sawyer"])
def test_projection_holds_by_pinocchio(name, kind):
    """Random configurations that project onto the manifold meet the constraint by pinocchio; most of them do."""
    robot, case = named(name), CASES[kind]
    constraint = case.make(robot)
    Q, converged = constraint.project_batch(configurations(robot, np.random.default_rng(2), 50))
    assert converged.mean() > 0.3
    for q in Q[converged]:
        assert np.linalg.norm(case.expected(robot, q)) < constraint.tolerance


def test_upside_down_is_not_upright():
    """A hand turned over is half a turn from upright, not upright: no projection ends there."""
    robot = named("panda")
    constraint = upright(robot, robot.tool)
    Q, converged = constraint.project_batch(configurations(robot, np.random.default_rng(3), 300))
    for q in Q[converged]:
        assert robot.pose(q, robot.tool).rotation[2, 2] > 0.999
    over = upright(robot, robot.tool, direction=(0, 0, -1))
    assert constraint.distance(over.project(robot.rest).q) == pytest.approx(np.pi, abs=2e-3)


def test_closed_chain_of_two_arms():
    """Two hands keep a relative pose: by pinocchio, the pose of one in the other is the given one."""
    robot, rng = named("baxter_both"), np.random.default_rng(4)
    relative = robot.pose(robot.rest, "left_gripper").actInv(robot.pose(robot.rest, "right_gripper"))
    tray = closed_chain(robot, "left_gripper", "right_gripper", relative)
    assert (tray.k, tray.n) == (6, 14) and tray.satisfied(robot.rest)
    Q, converged = tray.project_batch(robot.rest + rng.normal(scale=0.3, size=(30, 14)))
    assert converged.sum() > 20
    for q in Q[converged]:
        held = robot.pose(q, "left_gripper").actInv(robot.pose(q, "right_gripper"))
        assert np.linalg.norm(pin.log6(relative.actInv(held)).vector) < 1.1 * tray.tolerance
        np.testing.assert_allclose(tray.jacobian(q), differences(tray.value, q), atol=1e-6)


def test_rotation_error_is_the_logarithm():
    """The turn between two frames is pinocchio's log3, from the identity to just below half a turn."""
    import casadi as ca

    from pipeline.robots.symbolic import rotation_vector

    R = ca.SX.sym("R", 3, 3)
    vector = ca.Function("v", [R], [rotation_vector(R)])
    rng = np.random.default_rng(5)
    for size in (0.0, 1e-9, 1e-4, 0.1, 1.0, 3.0, 3.14):
        turn = size * unit(rng)
        np.testing.assert_allclose(np.asarray(vector(pin.exp3(turn)))[:, 0], turn, atol=1e-7)


def test_intersection_stacks_rows():
    """An intersection's value is the parts' values one after the other, with the least tolerance and all labels."""
    robot, q = named("panda"), named("panda").rest
    parts = [upright(robot, robot.tool, tolerance=1e-2), height(robot, robot.tool, 0.5, tolerance=1e-4)]
    both = intersection(*parts)
    np.testing.assert_allclose(both.value(q), np.concatenate([part.value(q) for part in parts]))
    assert both.tolerance == 1e-4 and both.labels == parts[0].labels + parts[1].labels
    assert "upright" in both.name and "plane" in both.name


def test_dependent_rows_are_named():
    """Asking for the same height twice is refused with the two rows' names, at the configuration where it was found."""
    robot = named("panda")
    twice = intersection(
        height(robot, "panda_hand_tcp", 0.5), upright(robot, "panda_hand_tcp"), height(robot, "panda_hand_tcp", 0.5)
    )
    with pytest.raises(ConstraintError, match=r"rank 3 of 4 at q = \[.*panda_hand_tcp from the plane") as error:
        feasible(twice, robot.lower, robot.upper, np.random.default_rng(6))
    assert "tilt" not in str(error.value)


def test_a_row_that_no_joint_changes_is_named():
    """The height of Panda's base cannot be changed: its row is named."""
    robot = named("panda")
    stuck = intersection(height(robot, "panda_link1", 0.333), upright(robot, "panda_hand_tcp"))
    with pytest.raises(ConstraintError, match=r"row 'distance of panda_link1 from the plane \[m\]' does not change"):
        feasible(stuck, robot.lower, robot.upper, np.random.default_rng(7))


def test_out_of_reach_is_named():
    """A hand 2 m up is out of Panda's reach: the row and by how much it is missed are named, and nothing else."""
    robot = named("panda")
    far = intersection(height(robot, "panda_hand_tcp", 2.0), upright(robot, "panda_hand_tcp"))
    with pytest.raises(ConstraintError, match=r"joint limits .* panda_hand_tcp from the plane \[m\] by -0\.[5-9]"):
        feasible(far, robot.lower, robot.upper, np.random.default_rng(8))


def test_feasible_is_within_limits():
    """What is found is on the manifold and within the limits, also when random projections rarely are."""
    robot = named("panda")
    constraint = pose(robot, robot.tool, robot.pose(robot.rest, robot.tool))
    for tries in (1, 200):
        q = feasible(constraint, robot.rest - 0.02, robot.rest + 0.02, np.random.default_rng(9), tries)
        assert constraint.satisfied(q) and (np.abs(q - robot.rest) <= 0.02).all()


MALFORMED = {
    "zero direction": (lambda r: upright(r, r.tool, direction=(0, 0, 0)), ConstraintError, "must not be zero"),
    "two numbers": (lambda r: upright(r, r.tool, axis=(0, 1)), ConstraintError, "three finite numbers"),
    "NaN": (lambda r: position(r, r.tool, (0, 0, np.nan)), ConstraintError, "three finite numbers"),
    "no frame": (lambda r: height(r, "panda_hnad", 0.3), RobotError, "did you mean 'panda_hand'"),
    "one frame": (lambda r: closed_chain(r, r.tool, r.tool, HELD), ConstraintError, "both are 'panda_hand_tcp'"),
    "nothing": (lambda r: intersection(), ConstraintError, "at least one"),
    "too many rows": (
        lambda r: intersection(pose(r, r.tool, HELD), height(r, r.tool, 1.0)),
        ConstraintError,
        "7 rows on 7 .*turn of .*plane",
    ),
    "other robots": (
        lambda r: intersection(height(r, r.tool, 1.0), height(named("olivia"), "left_palm", 1.0)),
        ConstraintError,
        "7.*17",
    ),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_is_refused(case):
    """Malformed constraints are refused with the offending value."""
    make, kind, message = MALFORMED[case]
    with pytest.raises(kind, match=message):
        make(named("panda"))


@pytest.mark.parametrize("axis", "xyz")
def test_exactly_half_a_turn_is_not_met(axis):
    """What is turned by exactly half a turn, as round angles make it, is pi away: a pose, and a cup upside down."""
    robot = named("panda")
    q = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])  # the hand points straight down
    turned = robot.pose(q, robot.tool) * pin.SE3(pin.utils.rotate(axis, np.pi), np.zeros(3))
    constraint = pose(robot, robot.tool, turned)
    assert constraint.distance(q) == pytest.approx(np.pi, abs=1e-6) and np.isfinite(constraint.jacobian(q)).all()
    cup = upright(robot, robot.tool)
    assert cup.distance(q) == pytest.approx(np.pi, abs=1e-6) and np.isfinite(cup.jacobian(q)).all()
    assert upright(robot, robot.tool, direction=(0, 0, -1)).satisfied(q)
