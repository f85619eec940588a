"""Angles come round: what is measured of joints that turn is the same a turn later, and as short as on the circle."""

import itertools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import TaskSpaceRegion, chain, plane
from pipeline.errors import RobotError
from pipeline.planners.tree import Tree
from pipeline.robots import Validity, point_robot
from pipeline.robots.turning import TURN, Turning, turns_within
from tests.robots.named import named

MASK = np.array([True, False, True, False])


def circle(Q: np.ndarray) -> np.ndarray:
    """Angles as points of the circle, where a turn changes nothing: (..., n) becomes (..., 2 * angles + others)."""
    angles, others = Q[..., MASK], Q[..., ~MASK]
    return np.concatenate([np.cos(angles), np.sin(angles), others], axis=-1)


def later(rng: np.random.Generator, Q: np.ndarray) -> np.ndarray:
    """The same configurations some turns later or before."""
    return Q + TURN * MASK * rng.integers(-3, 4, Q.shape)


def test_differences_are_those_of_the_circle():
    """Wrapped angles lie in (-pi, pi], say the same place, and are the arc between two points; others stay."""
    rng, turning = np.random.default_rng(0), Turning(MASK)
    D = rng.uniform(-20, 20, (500, 4))
    found = turning.wrapped(D)
    assert (np.abs(found[:, MASK]) <= np.pi).all()
    np.testing.assert_array_equal(found[:, ~MASK], D[:, ~MASK])
    np.testing.assert_allclose(circle(found), circle(D), atol=1e-12)
    arcs = np.arccos(np.clip(np.cos(D[:, MASK]), -1, 1))
    np.testing.assert_allclose(np.abs(found[:, MASK]), arcs, atol=1e-6)
    np.testing.assert_allclose(turning.wrapped(later(rng, D)), found, atol=1e-9)


def test_half_a_turn_and_infinity():
    """Both ways round are as long at half a turn, which counts as pi; what is infinite stays, without a warning."""
    turning = Turning(MASK)
    found = turning.wrapped(np.array([[np.pi, 9, -np.pi, 9], [np.inf, np.inf, -np.inf, 0]]))
    np.testing.assert_array_equal(found, [[np.pi, 9, np.pi, 9], [np.inf, np.inf, -np.inf, 0]])


def test_distances_are_a_metric_that_no_turn_changes():
    """Distances are symmetric, meet the triangle inequality, and are the same between any turns."""
    rng, turning = np.random.default_rng(1), Turning(MASK)
    A, B, C = rng.uniform(-6, 6, (3, 300, 4))
    d = turning.distances
    np.testing.assert_allclose(d(A, B), d(B, A), atol=1e-12)
    np.testing.assert_allclose(d(later(rng, A), later(rng, B)), d(A, B), atol=1e-9)
    assert (d(A, C) <= d(A, B) + d(B, C) + 1e-12).all()
    assert (d(A, B) <= np.linalg.norm(A - B, axis=1) + 1e-12).all()


def test_nearest_is_the_least_of_all_turns():
    """Of all turns the nearest is found, as by trying them; what is nearest already comes back as it is."""
    rng, turning = np.random.default_rng(2), Turning(MASK)
    for q, near in rng.uniform(-9, 9, (50, 2, 4)):
        tried = [q + TURN * np.array([i, 0, j, 0]) for i, j in itertools.product(range(-4, 5), repeat=2)]
        best = min(tried, key=lambda other: np.linalg.norm(other - near))
        np.testing.assert_allclose(turning.nearest(q, near), best, atol=1e-12)
        found = turning.nearest(q, near)
        assert turning.nearest(found, near) is found


def test_unwrapped_paths_are_continuous():
    """A path whose states are at any turns comes out as it was before, up to the turns of its first state."""
    rng, turning = np.random.default_rng(3), Turning(MASK)
    path = np.cumsum(rng.uniform(-1, 1, (200, 4)), axis=0)
    torn = later(rng, path)
    found = turning.unwrapped(torn)
    np.testing.assert_array_equal(found[0], torn[0])
    np.testing.assert_allclose(found - found[0], path - path[0], atol=1e-9)
    assert turning.unwrapped(path) is path


def test_neighbours_in_a_tree_are_those_of_the_circle():
    """The nearest node is that of brute force over all turns, one by one and by the k-d tree, also after removals."""
    rng, turning = np.random.default_rng(4), Turning(MASK)
    nodes = rng.uniform(-10, 10, (900, 4))
    tree = Tree(nodes[0], turns=turning)
    for node in nodes[1:]:
        tree.add(0, node[None])
    Q = rng.uniform(-10, 10, (200, 4))
    for removed in (None, 5, 600):
        if removed is not None:
            tree.remove(removed)
            nodes[removed] = np.inf
        expected = np.array([turning.distances(nodes, q) for q in Q])
        np.testing.assert_array_equal([tree.nearest(q) for q in Q], expected.argmin(axis=1))
        found, distances = tree.nearest_of(Q)
        np.testing.assert_array_equal(found, expected.argmin(axis=1))
        np.testing.assert_allclose(distances, expected.min(axis=1), atol=1e-9)


def test_all_turns_within_limits():
    """The turns offered are all within the limits, as by trying them, nearest first, and no more than asked."""
    rng = np.random.default_rng(5)
    lower, upper = np.array([-TURN, -1.0, -7.0, -2.0]), np.array([TURN, 8.0, 12.0, 2.0])
    for _ in range(20):
        q, near = rng.uniform(lower, upper), rng.uniform(lower, upper)
        tried = [q + TURN * np.array([i, 0, j, 0]) for i, j in itertools.product(range(-5, 6), repeat=2)]
        inside = [other for other in tried if ((other >= lower) & (other <= upper)).all()]
        inside.sort(key=lambda other: np.linalg.norm(other - near))
        found = turns_within(q, lower, upper, MASK, near, 100)
        np.testing.assert_allclose(found, inside, atol=1e-12)
        np.testing.assert_allclose(turns_within(q, lower, upper, MASK, near, 2), inside[:2], atol=1e-12)


def test_a_robot_without_such_joints_pays_nothing():
    """Where no joint turns there is nothing to measure by, and configurations are drawn from the limits themselves."""
    robot = named("ur5")
    assert robot.turns is None and not robot.turning.any()
    assert robot.box[0] is robot.lower and robot.box[1] is robot.upper


def test_limits_and_turning_exclude_each_other():
    """A joint that turns without end and has limits is refused by name."""
    robot = point_robot(0.1, [-1] * 3, [1] * 3)
    with pytest.raises(RobotError, match="joint 'y' of 'point' has limits and turns without end"):
        replace(robot, turning=np.array([False, True, False]))


@pytest.mark.parametrize("bounds", [(-np.inf, np.inf), (-np.pi, np.pi), (0.0, TURN), (1.0, np.inf), (-4.0, 4.0)])
def test_free_angles_of_a_chain_turn(bounds):
    """An angle of a region that is free, or has a turn or more, turns without end; narrower intervals are limits."""
    robot = named("panda")
    for axis in (3, 4, 5):
        low, high = np.zeros(6), np.zeros(6)
        low[0], high[0], low[axis], high[axis] = -1.0, 1.0, *bounds
        held = chain(robot, [TaskSpaceRegion(tuple(low), tuple(high))]).robot
        np.testing.assert_array_equal(held.turning[7:], [False, True])
        np.testing.assert_array_equal(held.lower[7:], [-1, -np.inf])
        np.testing.assert_array_equal([bound[7:] for bound in held.box], [[-1, -np.pi], [1, np.pi]])
        assert np.isfinite(held.rest).all() and not held.turning[:7].any()
        low[axis], high[axis] = -3.0, 3.0
        assert not chain(robot, [TaskSpaceRegion(tuple(low), tuple(high))]).robot.turning.any()


def test_verdicts_are_the_same_a_turn_later():
    """Contact, clearance, limits and the constraint's value do not change by turns of a joint that turns."""
    robot = replace(named("panda"))
    low, high = [0.3, 0, 0.4, 0, np.pi, -np.inf], [0.6, 0, 0.4, 0, np.pi, np.inf]
    held = chain(robot, [TaskSpaceRegion(tuple(low), tuple(high))])
    validity, rng = Validity(held.robot, []), np.random.default_rng(6)
    for q in rng.uniform(*held.robot.box, (50, held.robot.dimension)):
        turned = q + TURN * held.robot.turning * rng.integers(-3, 4)
        assert validity.in_bounds(turned) and validity.free(turned) == validity.free(q)
        np.testing.assert_allclose(held.constraint.value(turned), held.constraint.value(q), atol=1e-9)
    assert not validity.in_bounds(np.where(held.robot.turning, np.inf, q))
    assert plane(held.robot, robot.tool, (0, 0, 0)).n == held.robot.dimension
    assert isinstance(held.robot.pose(turned, "chain_0"), pin.SE3)
