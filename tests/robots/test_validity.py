"""Verdicts and clearances are those of balls against boxes, spheres and cylinders in closed form."""

import numpy as np
import pinocchio as pin
import pytest

from pipeline.errors import ProblemError
from pipeline.robots import PRIMITIVES, Obstacle, Robot, Shape, Validity, point_robot
from tests.robots.worlds import RADIUS, ball, ball_clearance, chain, on_sphere, random_obstacles

SOLVER = 1e-6  # coal's iterative distances stop within this of the exact one [m]
MARGINS = (0.0, 0.005, 0.05, 0.3)


def near_contact(obstacles, rng: np.random.Generator, level: float, gap: float) -> np.ndarray:
    """Points whose ball is `gap` too near or too far from contact at `level`: bisection outwards from each centre."""
    points = []
    for obstacle in obstacles:
        directions = on_sphere(rng, 4)
        for wanted in (level - gap, level + gap):
            low, high = np.zeros((4, 1)), np.full((4, 1), 2.0)
            for _ in range(50):
                middle = (low + high) / 2
                inside = ball_clearance([obstacle], obstacle.position + middle * directions)[:, None] < wanted
                low, high = np.where(inside, middle, low), np.where(inside, high, middle)
            points.append(obstacle.position + high * directions)
    return np.concatenate(points)


@pytest.mark.parametrize("margin", MARGINS)
def test_verdict_is_the_closed_form(margin):
    """A ball is free exactly when its closed-form clearance is at least the margin, near contact as elsewhere."""
    rng, robot, seen = np.random.default_rng(7), ball(), []
    for count in (1, 3, 30):
        obstacles = random_obstacles(rng, count)
        validity = Validity(robot, obstacles, margin)
        points = np.concatenate([rng.uniform(-1.5, 1.5, (200, 3)), near_contact(obstacles, rng, margin, 1e-5)])
        clearance = ball_clearance(obstacles, points)
        decided = np.abs(clearance - margin) > SOLVER
        assert decided.mean() > 0.99
        verdicts = np.array([validity.free(q) for q in points])
        np.testing.assert_array_equal(verdicts[decided], clearance[decided] > margin)
        assert validity.checks == len(points)
        seen += verdicts[decided].tolist()
    assert 0.1 < np.mean(seen) < 0.9


@pytest.mark.parametrize("shape", PRIMITIVES)
def test_clearance_is_the_closed_form(shape):
    """The clearance of a ball to an obstacle is the closed form; inside, negative, by the depth where coal knows it.

    coal 3.0.3 overstates how deep a sphere is inside a cylinder (up to 0.17 m here).
    """
    rng = np.random.default_rng(3)
    obstacles = [o for o in random_obstacles(rng, 12) if o.shape is shape]
    outside = inside = 0
    for radius in (RADIUS, 0.05):
        robot = point_robot(radius, [-2] * 3, [2] * 3)
        for obstacle in obstacles:
            validity = Validity(robot, [obstacle])
            points = np.concatenate([rng.uniform(-1.5, 1.5, (15, 3)), obstacle.position + rng.normal(0, 0.05, (15, 3))])
            expected = ball_clearance([obstacle], points, radius)
            found = np.array([validity.clearance(q) for q in points])
            known = (expected > 0) if shape is Shape.CYLINDER else np.full(len(points), True)
            np.testing.assert_allclose(found[known], expected[known], atol=1e-9)
            assert (found[~known] < expected[~known] + 1e-9).all()
            outside, inside = outside + (expected > 0).sum(), inside + (expected < 0).sum()
    assert outside > 50 and inside > 50


def test_clearance_of_a_scene_is_the_nearest_one():
    """Among many obstacles the clearance is the smallest; without any it is infinite; the margin plays no part."""
    rng, robot = np.random.default_rng(4), ball()
    obstacles = random_obstacles(rng, 25)
    points = rng.uniform(-1.5, 1.5, (60, 3))
    for margin in (0.0, 0.2):
        validity = Validity(robot, obstacles, margin)
        found = np.array([validity.clearance(q) for q in points])
        np.testing.assert_allclose(found, ball_clearance(obstacles, points), atol=1e-5)
    assert Validity(robot, []).clearance(points[0]) == np.inf
    assert Validity(robot, [], 0.1).free(points[0])


@pytest.mark.parametrize("margin", [0.0, 0.02])
def test_every_body_of_a_chain_counts(margin):
    """A chain of balls is free exactly when every ball, placed by pinocchio, is."""
    rng = np.random.default_rng(5)
    robot = chain(rng, ["PX", "RY", "PZ", "RX", "revolute unaligned"], balls=0.03)
    obstacles = random_obstacles(rng, 12, size=(0.1, 0.5))
    validity, data = Validity(robot, obstacles, margin), robot.model.createData()
    culprits, free = set(), 0
    for q in rng.uniform(-1, 1, (300, 5)):
        pin.forwardKinematics(robot.model, data, q)
        clearances = ball_clearance(obstacles, np.array([data.oMi[i].translation for i in range(1, 6)]), 0.03)
        if abs(clearances.min() - margin) > SOLVER:
            assert validity.free(q) == (clearances.min() > margin)
            assert validity.clearance(q) == pytest.approx(clearances.min(), abs=1e-5)
        if (clearances < margin).sum() == 1:
            culprits.add(int(clearances.argmin()))
        free += clearances.min() > margin
    assert len(culprits) >= 3 and free > 30


@pytest.mark.parametrize("margin", [0.0, 0.04])
def test_self_collision_pairs(margin):
    """Two balls of one robot collide when they are nearer than the margin, but only if they are a pair to check."""
    model, geometry = pin.Model(), pin.GeometryModel()
    for name, kind in (("a", pin.JointModelPX()), ("b", pin.JointModelPY())):
        joint = model.addJoint(0, kind, pin.SE3.Identity(), name)
        geometry.addGeometryObject(pin.GeometryObject(name, joint, pin.SE3.Identity(), pin.hppfcl.Sphere(0.1)))
    rng = np.random.default_rng(6)
    points = np.concatenate([rng.uniform(-0.4, 0.4, (100, 2)), [[0.2 + margin + 1e-5, 0], [0, 0.2 + margin - 1e-5]]])
    far = [Obstacle(Shape.SPHERE, (0.0, 0.0, 5.0), (0.0, 0.0, 0.0, 1.0), (0.1, 0.1, 0.1))]
    unpaired = Validity(Robot("pair", model, geometry, -np.ones(2), np.ones(2)), far, margin)
    assert all(unpaired.free(q) for q in points)
    geometry.addCollisionPair(pin.CollisionPair(0, 1))
    paired = Validity(Robot("pair", model, geometry, -np.ones(2), np.ones(2)), far, margin)
    verdicts = np.array([paired.free(q) for q in points])
    np.testing.assert_array_equal(verdicts, np.linalg.norm(points, axis=1) - 0.2 > margin)
    assert 0.1 < verdicts.mean() < 0.9


def test_bounds_hold_their_limits_and_nothing_else():
    """Limits themselves are inside; the next number beyond, infinities and NaN in any joint are outside."""
    lower, upper = np.array([-1.0, -0.5, 0.0]), np.array([1.0, 0.5, 2.0])
    validity = Validity(point_robot(0.1, lower, upper), [])
    assert validity.in_bounds(lower) and validity.in_bounds(upper) and validity.in_bounds((lower + upper) / 2)
    for joint in range(3):
        beyond = [np.nextafter(lower[joint], -9), np.nextafter(upper[joint], 9), np.inf, -np.inf, np.nan]
        for value in beyond:
            q = (lower + upper) / 2
            q[joint] = value
            assert not validity.in_bounds(q)
            assert not validity.valid(q)


def test_valid_needs_bounds_and_freedom():
    """A configuration is valid when it is within the limits and free, and outside them no collision is asked for."""
    validity = Validity(ball(), [Obstacle(Shape.SPHERE, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.2, 0.2, 0.2))])
    assert validity.valid(np.zeros(3))
    assert not validity.valid(np.array([0.5, 0.05, 0.0]))
    checks = validity.checks
    assert not validity.valid(np.array([1.6, 0.0, 0.0]))
    assert validity.checks == checks


@pytest.mark.parametrize("margin", [-0.001, np.inf, np.nan])
def test_margin_must_be_a_distance(margin):
    """A negative, infinite or undefined margin is refused with its value."""
    with pytest.raises(ProblemError, match=rf"margin is {margin} m"):
        Validity(ball(), [], margin)
