"""Clearances of paths are the least of all pairs, asked one by one, and cost little among many obstacles."""

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from pipeline.robots import Obstacle, Shape, Validity, attach
from pipeline.robots import clearance as clearance_module
from tests.robots import meshes
from tests.robots.named import configurations, named
from tests.robots.test_arms_validity import spread
from tests.robots.worlds import random_obstacles

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def brute_force(validity: Validity, Q: np.ndarray) -> np.ndarray:
    """The least of coal's distances over all moving bodies and obstacles that may not touch, for each row."""
    robot, found = validity.robot, []
    data, placed = robot.model.createData(), robot.geometry.createData()
    there = [obstacle.collision_object() for obstacle in validity.obstacles]
    for q in Q:
        pin.updateGeometryPlacements(robot.model, data, robot.geometry, placed, q)
        least = np.inf
        for body, M in zip(robot.geometry.geometryObjects, placed.oMg, strict=True):
            here = coal.CollisionObject(body.geometry, M.rotation, M.translation)
            for obstacle, other in zip(validity.obstacles, there, strict=True):
                if body.parentJoint and (body.name, obstacle.name) not in validity.touching:
                    least = min(least, coal.distance(here, other, coal.DistanceRequest(), coal.DistanceResult()))
        found.append(least)
    return np.array(found)


@pytest.mark.parametrize("name", ["panda", "baxter_right", "sawyer"])
def test_every_pair_is_held(name):
    """The clearance of a configuration, and the least of many, are the least of all pairs by brute force."""
    robot, rng = named(name), np.random.default_rng(1)
    obstacles = spread(rng, 25, robot)
    moving = next(b.name for b in reversed(robot.geometry.geometryObjects) if b.parentJoint)
    validity = Validity(robot, obstacles, 0.01, touching=[(moving, obstacles[3].name)])
    Q = configurations(robot, rng, 40)
    expected = brute_force(validity, Q)
    deep = expected < -0.01  # coal overstates how deep a sphere is in a cylinder
    found = np.array([validity.clearance(q) for q in Q])
    np.testing.assert_allclose(found[~deep], expected[~deep], atol=1e-6)
    assert (found[deep] < 0).all() and 3 < (~deep).sum()
    assert validity.least_clearance(Q[~deep]) == pytest.approx(expected[~deep].min(), abs=1e-6)
    assert validity.widened(0.1).clearance(Q[0]) == found[0]


def test_large_and_small_obstacles():
    """Bounds of long, flat and large bodies are bounds: the nearest is found among obstacles of very unequal sizes."""
    rng, robot = np.random.default_rng(2), named("panda")
    stick = Obstacle(Shape.BOX, (0.0, 0.0, 0.3), (0.1, 0.2, 0.3, 0.9), (0.01, 0.02, 0.6), "stick")
    robot = attach(robot, stick, "panda_hand_tcp")
    scene = []
    for i in range(40):
        size = tuple(10 ** rng.uniform(-2.5, 0.3, 3))
        place = rng.uniform(-1.3, 1.3, 3)
        scene.append(Obstacle(Shape.BOX, tuple(place), tuple(rng.normal(size=4)), size, f"o{i}"))
    scene = [o for o in scene if np.linalg.norm(o.position) - np.linalg.norm(o.size) / 2 > 0.3]
    validity, Q = Validity(robot, scene), configurations(robot, rng, 40)
    expected = brute_force(validity, Q)
    found = np.array([validity.clearance(q) for q in Q])
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert 5 < (expected > 0).sum()


def test_meshes_and_leaves(tmp_path):
    """Among meshes, convex or not, and octrees the clearance is coal's least distance where nothing is inside."""
    rng, robot = np.random.default_rng(3), named("panda")
    files = [
        meshes.write(tmp_path / f"{i}.obj", m) for i, m in enumerate((meshes.torus(), meshes.box(), meshes.corner()))
    ]
    scene = []
    for i in range(9):
        shape = {"shape": Shape.MESH, "file": files[i % 3], "size": (0.4, 0.3, 0.5)}
        if i % 4 == 3:
            shape = {"shape": Shape.OCTREE, "points": rng.uniform(-0.1, 0.1, (50, 3)), "size": (0.03,) * 3}
        angle = rng.uniform(-np.pi, np.pi)
        place = (0.8 * np.cos(angle), 0.8 * np.sin(angle), rng.uniform(0, 1))
        scene.append(Obstacle(position=place, quaternion=tuple(rng.normal(size=4)), name=f"o{i}", **shape))
    validity, Q = Validity(robot, scene), configurations(robot, rng, 60)
    expected = brute_force(validity, Q)
    found = np.array([validity.clearance(q) for q in Q])
    np.testing.assert_allclose(found[found > 0], expected[found > 0], atol=1e-6)
    assert (found <= expected + 1e-6).all() and 10 < (found > 0).sum() < 60
    assert validity.least_clearance(Q[found > 0]) == pytest.approx(found[found > 0].min(), abs=1e-6)


def test_what_there_is_nothing_of():
    """Without obstacles or configurations the clearance is infinite, and so where all pairs may touch."""
    robot = named("panda")
    assert Validity(robot, []).clearance(robot.rest) == np.inf
    box = Obstacle(Shape.BOX, (1.0, 0.0, 0.5), UPRIGHT, (0.1,) * 3, "box")
    assert Validity(robot, [box]).least_clearance(np.empty((0, 7))) == np.inf
    touching = [(name, "box") for name in robot.body_names]
    assert Validity(robot, [box], touching=touching).clearance(robot.rest) == np.inf
    assert Validity(robot, [box]).deepest_contact(robot.rest[None]) is None


def test_few_pairs_are_asked(monkeypatch):
    """Along a path among 500 boxes coal is asked for a thousandth of all distances, whatever is asked at once."""
    robot, rng = named("panda"), np.random.default_rng(4)
    scene = [o for o in random_obstacles(rng, 600, (0.02, 0.05)) if np.linalg.norm(o.position[:2]) > 0.4][:500]
    path = np.linspace(robot.rest, robot.rest + 0.5, 60)
    asked, distance = [0], coal.distance

    def counted(*arguments):
        asked[0] += 1
        return distance(*arguments)

    monkeypatch.setattr(coal, "distance", counted)
    validity = Validity(robot, scene)
    found = validity.least_clearance(path)
    assert asked[0] < 60 * 11 * 500 / 1000
    monkeypatch.setattr(clearance_module, "_AT_ONCE", 10_000)
    assert validity.least_clearance(path) == pytest.approx(found, abs=1e-9)
    assert found == pytest.approx(min(validity.clearance(q) for q in path), abs=1e-9)
    shifted = Validity(robot, [replace(o, name=f"o{i}") for i, o in enumerate(scene[::-1])])
    assert shifted.least_clearance(path) == pytest.approx(found, abs=1e-9)
