"""Inverse kinematics: what it yields is on the manifold, within limits, and where it was asked for, by pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import TaskSpaceRegion, upright
from pipeline.constraints.inverse import InverseKinematics, at_pose, in_region, with_values
from pipeline.robots import Placement
from tests.robots.named import named

INF = np.inf


def solutions(robot, target, near=None, tries=60):
    inverse = InverseKinematics(robot, upright(robot, robot.tool, direction=(0, 0, -1)), target)
    found = list(inverse.solutions(np.random.default_rng(0), tries, near))
    for q in found:
        assert ((robot.lower <= q) & (q <= robot.upper)).all()
        assert robot.pose(q, robot.tool).rotation[2, 2] < -np.cos(1e-3)
    return found


def test_pose():
    """Many tries for a pose in reach succeed, in different configurations, though the pose is upright already."""
    robot = named("panda")
    wanted = pin.SE3(pin.rpy.rpyToMatrix(np.pi, 0, 0.4), np.array([0.45, 0.2, 0.35]))
    found = solutions(robot, at_pose(robot, robot.tool, wanted))
    assert len(found) > 20
    for q in found:
        assert np.linalg.norm(pin.log6(wanted.actInv(robot.pose(q, robot.tool))).vector) < 3e-3
    assert max(np.linalg.norm(q - found[0]) for q in found) > 1


def test_region():
    """Configurations for a region are inside it, not only at its edge, and whatever it leaves free differs."""
    robot = named("panda")
    region = TaskSpaceRegion((0.3, -0.3, 0.3, -INF, -INF, -INF), (0.6, 0.3, 0.3, INF, INF, INF))
    found = solutions(robot, in_region(robot, robot.tool, region))
    assert len(found) > 20
    places = np.array([robot.pose(q, robot.tool).translation for q in found])
    assert max(region.distance(robot.pose(q, robot.tool)) for q in found) < 1.1e-3
    assert np.ptp(places[:, 0]) > 0.1 and np.ptp(places[:, 1]) > 0.3


def test_half_bounded_and_turned_regions():
    """One-sided bounds and angles across half a turn are met."""
    robot = named("panda")
    region = TaskSpaceRegion(
        (0.3, -INF, 0.4, -INF, -INF, 3.0), (INF, INF, INF, INF, INF, 3.5), Placement(), Placement(rpy=(np.pi, 0, 0))
    )
    found = solutions(robot, in_region(robot, robot.tool, region))
    assert len(found) > 10
    assert max(region.distance(robot.pose(q, robot.tool)) for q in found) < 2e-3


def test_values():
    """Joints have the values that are asked for; the others are solved for."""
    robot = named("panda")
    found = solutions(robot, with_values([(0, 0.7), (3, -1.5)]))
    assert len(found) > 10
    np.testing.assert_allclose([q[[0, 3]] for q in found], np.tile([0.7, -1.5], (len(found), 1)), atol=1e-3)


def test_near_a_configuration():
    """From a configuration that meets the target the first solution is that configuration's neighbour."""
    robot = named("panda")
    start = upright(robot, robot.tool, direction=(0, 0, -1)).project(robot.rest).q
    wanted = robot.pose(start, robot.tool)
    first = solutions(robot, at_pose(robot, robot.tool, wanted), near=start, tries=1)[0]
    assert np.linalg.norm(first - start) < 0.01


@pytest.mark.parametrize("height", [2.0, -1.0])
def test_out_of_reach(height):
    """For a pose that no configuration has nothing is yielded."""
    robot = named("panda")
    wanted = pin.SE3(pin.rpy.rpyToMatrix(np.pi, 0, 0), np.array([0.4, 0.0, height]))
    assert not solutions(robot, at_pose(robot, robot.tool, wanted), tries=20)
