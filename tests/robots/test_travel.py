"""Bounds on how far bodies travel hold for the bodies' own points, by pinocchio's placements."""

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import TaskSpaceRegion
from pipeline.constraints import chain as region_chain
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence
from pipeline.robots import Obstacle, Placement, Robot, Shape, Validity, attach, point_robot
from pipeline.robots.virtual import VirtualFrame, VirtualJoint, with_virtual_chain
from tests.robots.named import ROBOT_NAMES, configurations, named
from tests.robots.worlds import JOINTS, chain


def corners(body: pin.GeometryObject) -> np.ndarray:
    """Points of a body in its own frame: vertices of a hull, otherwise points of a shape's surface (m, 3)."""
    shape = body.geometry
    if hasattr(shape, "points"):
        return np.array([shape.point(i) for i in range(0, shape.num_points, max(shape.num_points // 40, 1))])
    name, rng = type(shape).__name__, np.random.default_rng(0)
    directions = rng.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    if name == "Sphere":
        return shape.radius * directions
    if name in ("Cylinder", "Capsule"):
        ring = directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1, keepdims=True)
        return np.column_stack([shape.radius * ring, np.sign(directions[:, 2]) * shape.halfLength])
    assert name == "Box"
    return np.sign(directions) * shape.halfSide


def placed(robot: Robot, points: list[np.ndarray], q: np.ndarray) -> list[np.ndarray]:
    """World positions of the points of every body."""
    data, where = robot.model.createData(), robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, where, q)
    return [found @ M.rotation.T + M.translation for found, M in zip(points, where.oMg, strict=True)]


def random_chain(seed: int) -> Robot:
    """Seven joints of random kinds with a ball at each."""
    rng = np.random.default_rng(seed)
    return chain(rng, rng.choice(list(JOINTS), 7).tolist(), balls=0.05)


def robots():
    """Named robots, random chains, and one that holds something."""
    cup = Obstacle(Shape.CYLINDER, (0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0), (0.06, 0.06, 0.2), "cup")
    panda = named("panda")
    return [
        *((name, named(name)) for name in ROBOT_NAMES),
        *((f"chain {seed}", random_chain(seed)) for seed in range(6)),
        ("panda with a cup", attach(panda, cup, panda.tool)),
    ]


@pytest.mark.parametrize(("name", "robot"), robots(), ids=[name for name, _ in robots()])
def test_no_point_travels_farther(name, robot):
    """Between two configurations, near or far, no point of a body moves farther than lever arms times joint motions."""
    arms, _ = robot.lever_arms
    points = [corners(body) for body in robot.geometry.geometryObjects]
    rng = np.random.default_rng(1)
    for scale in (0.05, 1.0):
        for q in configurations(robot, rng, 15):
            other = np.clip(q + scale * rng.normal(size=len(q)), robot.lower, robot.upper)
            bounds = arms @ np.abs(other - q)
            for before, after, bound in zip(*(placed(robot, points, x) for x in (q, other)), bounds, strict=True):
                assert np.linalg.norm(after - before, axis=1).max() <= bound + 1e-9


@pytest.mark.parametrize("name", ["panda", "baxter_both", "pholus"])
def test_no_pair_comes_closer(name):
    """The distance of points of two bodies changes by no more than the pair's lever arms times the joint motions."""
    robot, rng = named(name), np.random.default_rng(2)
    _, between = robot.lever_arms
    points = [corners(body) for body in robot.geometry.geometryObjects]
    for q in configurations(robot, rng, 6):
        other = np.clip(q + 0.3 * rng.normal(size=len(q)), robot.lower, robot.upper)
        before, after, bounds = placed(robot, points, q), placed(robot, points, other), between @ np.abs(other - q)
        for pair, bound in zip(robot.geometry.collisionPairs, bounds, strict=True):
            gaps = [
                np.linalg.norm(where[pair.first][:5, None] - where[pair.second][None, :5], axis=2)
                for where in (before, after)
            ]
            assert np.abs(gaps[1] - gaps[0]).max() <= bound + 1e-9


def sliding(seed: int) -> Robot:
    """Two chains of sliding joints with balls, held against each other."""
    rng, model, geometry = np.random.default_rng(seed), pin.Model(), pin.GeometryModel()
    kinds = [kind for kind in JOINTS if kind.startswith("P") or kind.startswith("prismatic")]
    for side in range(2):
        joint = 0
        for kind in rng.choice(kinds, rng.integers(1, 4)):
            joint = model.addJoint(joint, JOINTS[kind](rng), pin.SE3.Random(), f"{side} {model.njoints}")
        at = pin.SE3(np.eye(3), 5.0 * side * np.ones(3))
        geometry.addGeometryObject(pin.GeometryObject(f"ball {side}", joint, at, pin.hppfcl.Sphere(0.1)))
    geometry.addCollisionPair(pin.CollisionPair(0, 1))
    return Robot("sliding", model, geometry, -np.ones(model.nq), np.ones(model.nq))


@pytest.mark.parametrize("seed", range(6))
def test_sliding_robots_have_a_bound(seed):
    """Without joints that turn no body, and no two against each other, move farther than `travel`; some do as far."""
    robot, rng, farthest = sliding(seed), np.random.default_rng(seed), 0.0
    for _ in range(2000):
        q, step = rng.uniform(-1, 1, robot.dimension), rng.normal(size=robot.dimension)
        before, after = (placed(robot, [np.zeros((1, 3))] * 2, x) for x in (q, q + step))
        moves = [a - b for a, b in zip(after, before, strict=True)]
        farthest = max(farthest, *(np.linalg.norm(m) / np.linalg.norm(step) for m in (*moves, moves[0] - moves[1])))
    assert 0.9 * robot.travel < farthest <= robot.travel * (1 + 1e-9)


def test_travel_of_what_slides_and_turns():
    """A point travels as its joints do; whatever turns with it, or hangs on a hinge beside it, has no such bound."""
    point = point_robot(0.01, [-3] * 3, [3] * 3)
    box = Obstacle(Shape.BOX, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (2.0, 0.1, 0.1), "panel")
    assert point.travel == 1.0 and attach(point, box, "point").travel == 1.0
    for direction, bound in (
        (0, np.sqrt(2)),
        (3, None),
    ):  # along x, where the point may slide away from it, and a hinge
        joint = VirtualJoint(direction, pin.SE3.Identity(), -1.0, 1.0, "joint")
        wider = with_virtual_chain(point, [joint, VirtualFrame(pin.SE3.Identity(), "end")])
        assert wider.travel == 1.0
        assert attach(wider, box, "end").travel == (bound if bound is None else pytest.approx(bound))
    assert all(named(name).travel is None for name in ROBOT_NAMES)


def test_nothing_is_covered_on_a_hinge():
    """A panel on a hinge beside a sliding point meets a post on its way, however far from the point that is."""
    point = point_robot(0.01, [-3] * 3, [3] * 3)
    free = TaskSpaceRegion((0, 0, 0, -3, -1, -3), (0, 0, 0, 3, 1, 3), Placement((1.0, 0.0, 0.0)))
    door = region_chain(point, [TaskSpaceRegion((0, 0, 0, 0, 0, -1.5), (0, 0, 0, 0, 0, 1.5)), free], name="door")
    panel = Obstacle(Shape.BOX, (2.55, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (2.8, 0.004, 0.02), "panel")
    robot = attach(door.robot, panel, "door_0")

    def at(angle: float) -> np.ndarray:
        q = np.zeros(robot.dimension)
        q[:5] = np.cos(angle), np.sin(angle), 0.0, angle, -angle
        return q

    for angle in np.arange(0.6, 0.64, 0.005):
        turn, place = (
            (0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)),
            3.9 * np.array([np.cos(angle), np.sin(angle), 0]),
        )
        post = Obstacle(Shape.BOX, tuple(place), turn, (0.06, 0.06, 0.5), "post")
        space = ProjectionAdherence(door.constraint, Validity(robot, [post]), AdherenceParameters())
        assert not space.traverse(at(0.2), at(1.2)).reached
