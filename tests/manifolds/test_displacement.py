"""Bodies move along chords no faster than the bounds say, and not much slower where chords are short."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from pipeline.constraints import TaskSpaceRegion, chain
from pipeline.manifolds.displacement import Displacement
from pipeline.robots import Obstacle, Placement, Robot, Shape, attach
from tests.robots.named import configurations, named
from tests.robots.test_travel import corners
from tests.robots.worlds import ball
from tests.robots.worlds import chain as random_chain

_PIECES = 40  # of a chord: motion between two of its points is at most this share of the bound


def door() -> Robot:
    """The Panda that holds the handle of a door, which is a body on a virtual joint."""
    robot = named("panda")
    regions = [
        TaskSpaceRegion((0, 0, 0, 0, 0, -1.2), (0, 0, 0, 0, 0, 0), Placement((0.75, 0.35, 0.45))),
        TaskSpaceRegion((0, 0, 0, 0, -0.5, 0), (0, 0, 0, 0, 0.5, 0), Placement((-0.06, -0.4, 0.0))),
    ]
    panel = Obstacle(Shape.BOX, (0.0, -0.2, 0.0), (0, 0, 0, 1), (0.02, 0.4, 0.6), "panel")
    return attach(chain(robot, regions).robot, panel, "chain_0")


def arm_with_slides() -> Robot:
    """A random arm whose joints turn and slide, with a body on every joint."""
    rng = np.random.default_rng(5)
    robot = random_chain(rng, ["RX", "PY", "RZ", "revolute unaligned", "PX", "RY", "prismatic unaligned"])
    for joint in range(1, robot.model.njoints):
        placement = pin.SE3(np.eye(3), rng.uniform(-0.2, 0.2, 3))
        robot.geometry.addGeometryObject(
            pin.GeometryObject(f"body {joint}", joint, placement, pin.hppfcl.Box(*rng.uniform(0.05, 0.3, 3)))
        )
    robot.geometry.addAllCollisionPairs()
    return robot


ROBOTS = {
    "panda": lambda: named("panda"),
    "both arms of Baxter": lambda: named("baxter_both"),
    "pholus": lambda: named("pholus"),
    "door": door,
    "slides": arm_with_slides,
    "point": ball,
}


def placed(robot: Robot, points: list[np.ndarray], q: np.ndarray) -> list[np.ndarray]:
    """World positions of each body's corners, by pinocchio."""
    data, geometry = robot.model.createData(), robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, geometry, q)
    return [np.asarray(M.rotation) @ P.T + M.translation[:, None] for M, P in zip(geometry.oMg, points, strict=True)]


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("size", [0.05, 0.5])
def test_nothing_is_faster(name, size):
    """No corner of a body moves faster along a chord, in the world or as the other body of its pair sees it."""
    robot, rng = ROBOTS[name](), np.random.default_rng(1)
    bodies, pairs = robot.geometry.geometryObjects, list(robot.geometry.collisionPairs)
    points, motion, ratios = [corners(body) for body in bodies], Displacement(robot), []
    asked = rng.choice(len(pairs), min(40, len(pairs)), replace=False) if pairs else []
    for q in configurations(robot, rng, 5):
        step = rng.normal(size=robot.dimension)
        other = np.clip(q + size * step / np.linalg.norm(step), robot.lower, robot.upper)
        rates = np.append(motion.rates(np.stack([q, other]))[0], 0.0)
        seen = [placed(robot, points, q + share * (other - q)) for share in np.linspace(0, 1, _PIECES + 1)]
        for before, after in pairwise(seen):
            for i, number in enumerate(motion.of_bodies):
                moved = np.linalg.norm(after[i] - before[i], axis=0).max()
                assert moved * _PIECES <= rates[number] + 1e-9
        for k in asked:
            first, second = pairs[k].first, pairs[k].second
            bound = rates[motion.of_pairs[k]].sum()
            gaps = [np.linalg.norm(where[first][:, :, None] - where[second][:, None, :], axis=0) for where in seen]
            changed = max(np.abs(b - a).max() for a, b in pairwise(gaps))
            assert changed * _PIECES <= bound + 1e-9
            if bound:
                ratios.append(np.abs(gaps[-1] - gaps[0]).max() / bound)
    if size == 0.05 and ratios:
        assert np.max(ratios) > 0.3  # of motion that brings bodies nearer, in the best case


def test_what_two_hands_hold_together_does_not_move():
    """Where both arms move as one, by the base below them, the hands do not move as seen from each other."""
    robot = arm_with_slides()
    motion, pairs = Displacement(robot), list(robot.geometry.collisionPairs)
    q, step = np.zeros(robot.dimension), np.zeros(robot.dimension)
    step[0] = 0.3
    rates = np.append(motion.rates(np.stack([q, q + step]))[0], 0.0)
    for pair, numbers in zip(pairs, motion.of_pairs, strict=True):
        moves = 1 in {robot.geometry.geometryObjects[i].parentJoint for i in (pair.first, pair.second)}
        assert rates[numbers].sum() <= 1e-12 or not moves


def test_many_relations_are_seen_from_common_joints():
    """Of a robot with many limbs the relations stay few: two limbs are seen from the joint that carries both."""
    robot = named("pholus")
    motion = Displacement(robot)
    assert len(motion.relations) < 200 < len(robot.geometry.collisionPairs)
