"""Bounds of distances are never above coal's distances, and equal to them where bodies are capsules."""

from dataclasses import replace

import casadi as ca
import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import lsq_linear

from pipeline.constraints import Expressions, structure_of
from pipeline.errors import ProblemError
from pipeline.robots import PRIMITIVES, ClearanceBounds, Numbers, Obstacle, Robot, Shape, attach, obstacle_numbers
from pipeline.robots.clearance_bounds import _segments
from tests.robots.named import configurations, named
from tests.robots.worlds import RADIUS, ball, differences, on_sphere, random_obstacles, signed_distance

EXACT = 1e-9  # of coal's distances [m]
STEP = 1e-6  # of differences [rad]


def tray(size: tuple[float, float, float] = (0.4, 0.3, 0.02)) -> Obstacle:
    return Obstacle(Shape.BOX, (0.0, 0.05, 0.02), (0.1, 0.2, -0.1, 0.9), size, "tray")


def carrying() -> Robot:
    """A Panda with a tray in its hand."""
    return attach(named("panda"), tray(), "panda_hand_tcp")


ROBOTS = {"panda with a tray": carrying, "olivia": lambda: named("olivia"), "kinova": lambda: named("kinova")}


def distances(robot: Robot, Q: np.ndarray, obstacles: list[Obstacle] | None) -> np.ndarray:
    """coal's distances of self-collision pairs (m, P), or of moving bodies to obstacles (m, O, M)."""
    data, placed, found = robot.model.createData(), robot.geometry.createData(), []
    there = [obstacle.collision_object() for obstacle in obstacles or []]
    for q in Q:
        pin.updateGeometryPlacements(robot.model, data, robot.geometry, placed, q)
        here = [
            coal.CollisionObject(body.geometry, M.rotation, M.translation)
            for body, M in zip(robot.geometry.geometryObjects, placed.oMg, strict=True)
        ]
        pairs = [[(here[pair.first], here[pair.second])] for pair in robot.geometry.collisionPairs]
        if obstacles is not None:
            moving = [o for o, body in zip(here, robot.geometry.geometryObjects, strict=True) if body.parentJoint]
            pairs = [[(body, other) for body in moving] for other in there]
        request = coal.DistanceRequest()
        found.append([[coal.distance(*pair, request, coal.DistanceResult()) for pair in row] for row in pairs])
    return np.array(found)[..., 0] if obstacles is None else np.array(found)


def beside(robot: Robot, Q: np.ndarray, rng: np.random.Generator, shape: Shape) -> list[Obstacle]:
    """An obstacle of a shape near a moving body of each configuration (m, n)."""
    data, placed, found = robot.model.createData(), robot.geometry.createData(), []
    moving = [i for i, body in enumerate(robot.geometry.geometryObjects) if body.parentJoint]
    made = (obstacle for obstacle in random_obstacles(rng, 3 * len(Q)) if obstacle.shape is shape)
    for q, obstacle in zip(Q, made, strict=True):
        pin.updateGeometryPlacements(robot.model, data, robot.geometry, placed, q)
        middle = placed.oMg[int(rng.choice(moving))].translation + 0.2 * on_sphere(rng, 1)[0]
        found.append(replace(obstacle, position=tuple(middle)))
    return found


def between(robot: Robot) -> ca.Function:
    q = ca.SX.sym("q", robot.dimension)
    return ca.Function("between", [q], [ca.densify(ClearanceBounds(robot).between(q))])


def to_obstacle(robot: Robot, shape: Shape) -> ca.Function:
    q, numbers = ca.SX.sym("q", robot.dimension), ca.SX.sym("o", 15)
    return ca.Function("to_obstacle", [q, numbers], [ca.densify(ClearanceBounds(robot).to_obstacle(q, numbers, shape))])


@pytest.mark.parametrize("name", ROBOTS)
def test_bounds_between_bodies(name):
    """No bound of a self-collision pair is above coal's distance; of spheres and capsules it is that distance."""
    robot, rng = ROBOTS[name](), np.random.default_rng(0)
    Q = configurations(robot, rng, 60)
    bounds, exact = np.array(between(robot).map(len(Q))(Q.T)).T, distances(robot, Q, None)
    apart = exact > 0
    assert bounds.shape == exact.shape and 0.5 < apart.mean() < 1
    assert (bounds[apart] <= exact[apart] + EXACT).all() and (bounds[~apart] <= 0).all()
    if name == "olivia":
        np.testing.assert_allclose(bounds[apart], exact[apart], atol=1e-6)
    assert np.quantile(exact[apart] - bounds[apart], 0.9) < 0.12


def test_segments():
    """The distance of segments is that of bounded least squares: of parallel, nearly parallel and short ones too."""
    rng = np.random.default_rng(5)
    for i in range(400):
        a, c = rng.uniform(-0.6, 0.6, (2, 3))
        u, v = rng.normal(size=(2, 3)) * rng.choice([0.0, 1e-9, 0.02, 0.2, 0.6], (2, 1))
        if i % 2:
            v = u * rng.uniform(-2, 2) + rng.choice([0.0, 1e-12, 1e-8, 1e-5]) * rng.normal(size=3)
        shares = lsq_linear(np.stack([u, -v], axis=1), c - a, (0, 1), "bvls", tol=1e-14).x
        expected = np.linalg.norm(a + shares[0] * u - c - shares[1] * v)
        assert float(_segments()(a, a + u, c, c + v)) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])  # [m]
@pytest.mark.parametrize("angle", [1e-4, 1e-6, 1e-7, 3e-8, 1e-8, 1e-9, 0.0])
def test_segments_that_cross_nearly_parallel(angle, length):
    """Of segments across a gap at right angles to both the bound is not above the gap, and below it by little."""
    rng, count = np.random.default_rng(6), 2000
    frames = np.array([pin.Quaternion(*q).normalized().matrix() for q in rng.normal(size=(count, 4))])
    shares, gaps = rng.uniform(0, 1, (2, count, 1)), length * rng.choice([0.0, 1e-8, 1e-3, 1.0], (count, 1))
    u, n = length * frames[..., 0], frames[..., 2]
    v = length * (np.cos(angle) * frames[..., 0] + np.sin(angle) * frames[..., 1]) * rng.choice([-1, 1], (count, 1))
    a = rng.uniform(-0.1, 0.1, (count, 3)) * length
    c = a + shares[0] * u + gaps * n - shares[1] * v
    bounds = np.array(_segments().map(count)(*(x.T for x in (a, a + u, c, c + v)))).T
    assert (bounds >= 0).all() and (bounds <= gaps + 1e-12).all()
    np.testing.assert_allclose(bounds, gaps, atol=1e-7 * length)


@pytest.mark.parametrize("shape", PRIMITIVES)
@pytest.mark.parametrize("name", ["panda with a tray", "olivia"])
def test_bounds_to_obstacles(name, shape):
    """No bound to a primitive is above coal's distance; of spheres and capsules it is nearly always that distance."""
    robot, rng = ROBOTS[name](), np.random.default_rng(1)
    Q = configurations(robot, rng, 8)
    obstacles = beside(robot, Q, rng, shape)
    asked = np.array([obstacle_numbers(obstacle) for obstacle in obstacles]).T
    function = to_obstacle(robot, shape).map(len(obstacles))
    bounds = np.array([np.array(function(np.tile(q[:, None], len(obstacles)), asked)).T for q in Q])
    exact = distances(robot, Q, obstacles)
    apart = exact > 0
    assert bounds.shape == exact.shape and 0.5 < apart.mean() < 1
    assert (bounds[apart] <= exact[apart] + EXACT).all() and (bounds[~apart] <= 0).all()
    if name == "olivia":
        assert np.quantile(exact[apart] - bounds[apart], 0.99) < 1e-5


@pytest.mark.parametrize("shape", PRIMITIVES)
def test_a_ball_beside_obstacles(shape):
    """The bound of a ball is its distance in closed form, outside of obstacles and inside."""
    rng, robot = np.random.default_rng(2), ball()
    function = to_obstacle(robot, shape)
    for obstacle in (obstacle for obstacle in random_obstacles(rng, 30) if obstacle.shape is shape):
        for q in obstacle.position + rng.normal(size=(20, 3)) * 0.2:
            expected = signed_distance(obstacle, q)[0] - RADIUS
            assert float(function(q, obstacle_numbers(obstacle))) == pytest.approx(expected, abs=3e-9)


@pytest.mark.parametrize("shape", [None, *PRIMITIVES])
@pytest.mark.parametrize("name", ["panda with a tray", "olivia"])
def test_derivatives(name, shape):
    """Derivatives are those of central differences wherever differences of two widths agree; of balls too."""
    robot, rng = ROBOTS[name](), np.random.default_rng(3)
    made, numbers = (between(robot), None) if shape is None else (to_obstacle(robot, shape), ca.SX.sym("o", 15))
    q = ca.SX.sym("q", robot.dimension)
    arguments = [q] if numbers is None else [q, numbers]
    jacobian = ca.Function("J", arguments, [ca.densify(ca.jacobian(made(*arguments), q))])
    compared = 0
    for point in configurations(robot, rng, 12):
        given = []
        if shape is not None:
            extent = {Shape.BOX: (0.3, 0.4, 0.5), Shape.SPHERE: (0.3, 0.3, 0.3), Shape.CYLINDER: (0.3, 0.3, 0.5)}[shape]
            where = Obstacle(shape, tuple(on_sphere(rng, 1)[0]), tuple(rng.normal(size=4)), extent)
            given = [obstacle_numbers(where)]
        function = lambda x, given=given: np.array(made(x, *given)).ravel()  # noqa: E731
        wide, narrow = differences(function, point, 2 * STEP), differences(function, point, STEP)
        smooth = np.abs(wide - narrow).max(axis=1) < 1e-7
        np.testing.assert_allclose(np.array(jacobian(point, *given))[smooth], narrow[smooth], atol=1e-6)
        compared += smooth.mean()
    assert compared > 9


def test_one_structure_for_all_grasps():
    """Grasps and trays of other sizes differ in numbers only, and numbers give what constants do."""
    made = []
    for size in ((0.4, 0.3, 0.02), (0.5, 0.35, 0.01)):
        robot, p = attach(named("panda"), tray(size), "panda_hand_tcp"), Numbers()
        q = ca.SX.sym("q", robot.dimension)
        rows = ClearanceBounds(robot).between(q, p)
        structure = structure_of(q, rows, p.symbols, "bounds")
        made.append(structure)
        Q = configurations(robot, np.random.default_rng(4), 4)
        compiled = structure.compiled(
            ("bounds",), lambda q=q, s=structure: Expressions([q], [s.rows(q)]), p.values, len(Q)
        )
        np.testing.assert_allclose(compiled(Q)[0], np.array(between(robot).map(4)(Q.T)).T, atol=1e-12)
    assert made[0] is made[1]


def test_what_has_no_bound():
    """A mesh as an obstacle is refused, with what may be asked for."""
    with pytest.raises(ProblemError, match=r"to a mesh have no bound; those to \['box', 'sphere', 'cylinder'\] have"):
        to_obstacle(ball(), Shape.MESH)
