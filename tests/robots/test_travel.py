"""Bounds on how far bodies travel hold for the bodies' own points, by pinocchio's placements."""

import numpy as np
import pinocchio as pin
import pytest

from pipeline.robots import Obstacle, Robot, Shape, attach
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
