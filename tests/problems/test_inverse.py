"""Inverse kinematics: what it yields is on the manifold, within limits, and where it was asked for, by pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pipeline.constraints import TaskSpaceRegion, height, upright
from pipeline.constraints.inverse import InverseKinematics
from pipeline.constraints.targets import at_pose, in_region, with_values
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


def turn_to(region: TaskSpaceRegion, T: pin.SE3) -> float:
    """The smallest angle from a pose to an orientation of the region: tried on a grid, then refined."""
    R = (region.origin.se3().inverse() * T * region.offset.se3().inverse()).rotation
    low, high = (np.nan_to_num(side[3:], neginf=-np.pi, posinf=np.pi) for side in (region.lower, region.upper))

    wide = low < high

    def turn(angles: np.ndarray) -> np.ndarray:
        whole = np.broadcast_to(low, (*angles.shape[:-1], 3)).copy()
        whole[..., wide] = angles
        return (Rotation.from_matrix(R).inv() * Rotation.from_euler("xyz", whole)).as_rotvec()

    if not wide.any():
        return float(np.linalg.norm(turn(np.zeros(0))))
    axes = [np.linspace(a, b, 20) for a, b in zip(low[wide], high[wide], strict=True)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, len(axes))
    begin = grid[np.argsort(np.linalg.norm(turn(grid), axis=1))[:3]]
    ends = [
        least_squares(turn, np.clip(x, low[wide] + 1e-9, high[wide] - 1e-9), bounds=(low[wide], high[wide]))
        for x in begin
    ]
    return min(float(np.linalg.norm(end.fun)) for end in ends)


@pytest.mark.parametrize("pitch", [0.0, np.pi / 2, -np.pi / 2, 2.0, 7.0])
def test_regions_of_any_pitch(pitch):
    """For regions about a pose that the hand can have, whatever their pitch, configurations are found inside them."""
    robot, rng = named("panda"), np.random.default_rng(1)
    for _ in range(5):
        q = rng.uniform(robot.lower, robot.upper)
        middle = np.r_[0, 0, 0, rng.uniform(-7, 7), pitch, rng.uniform(-7, 7)]
        half = np.r_[[0.05] * 3, rng.choice([0.0, 0.1, INF]), rng.choice([0.0, 0.3]), rng.choice([0.0, 0.1, INF])]
        lower, upper = tuple(middle - half), tuple(middle + half)
        drawn = TaskSpaceRegion(lower, upper).sample(rng)
        region = TaskSpaceRegion(lower, upper, Placement.of(robot.pose(q, robot.tool) * drawn.inverse()))
        constraint = height(robot, "panda_link4", float(robot.pose(q, "panda_link4").translation[2]))
        inverse = InverseKinematics(robot, constraint, in_region(robot, robot.tool, region))
        found = list(inverse.solutions(rng, 20))
        assert len(found) > 2
        for T in (robot.pose(x, robot.tool) for x in found[:2]):
            assert np.abs(region.displacement(T)[:3]).max() < 1e-3
            assert turn_to(region, T) < 1.1e-3


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
