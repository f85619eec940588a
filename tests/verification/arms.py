"""Robots and paths that tests of the verifier share."""

import numpy as np

from pipeline.robots import UrdfRobot
from pipeline.robots.bodies import Geometry
from pipeline.verification.contacts import Contacts
from pipeline.verification.kinematics import Kinematics
from pipeline.verification.pairs import Item, items_of_obstacles, items_of_robot, pairs_of_bodies, pairs_of_items
from pipeline.verification.reader import read
from pipeline.verification.statement import Point, Statement

PANDA = UrdfRobot(
    urdf="package://example-robot-data/robots/panda_description/urdf/panda.urdf",
    srdf="package://example-robot-data/robots/panda_description/srdf/panda.srdf",
    joints=tuple(f"panda_joint{i}" for i in range(1, 8)),
    tool="panda_hand_tcp",
    name="panda",
    state="default",
    fixed={"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02},
    geometry=Geometry.HULLS,
)
BAXTER = UrdfRobot(
    urdf="package://example-robot-data/robots/baxter_description/urdf/baxter.urdf",
    srdf="package://example-robot-data/robots/baxter_description/srdf/baxter_manipulation.srdf",
    joints=tuple(f"{side}_{k}" for side in ("left", "right") for k in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")),
    tool="right_gripper",
    name="baxter_both",
    geometry=Geometry.HULLS,
)


_KNOWN: dict[str, tuple[Kinematics, list[Item], list[tuple[int, int]]]] = {}


def known(robot: UrdfRobot | Point) -> tuple[Kinematics, list[Item], list[tuple[int, int]]]:
    """Return the kinematics, items and pairs of bodies of a robot."""
    name = repr(robot)
    if name not in _KNOWN:
        statement = Statement(robot, (), 1e-3)
        kinematics = read(statement)
        items = items_of_robot(kinematics, getattr(robot, "geometry", Geometry.PRIMITIVES))
        _KNOWN[name] = kinematics, items, pairs_of_bodies(statement, kinematics)
    return _KNOWN[name]


def contacts(robot: UrdfRobot | Point, obstacles=(), touching=None) -> Contacts:
    """Return the proof against obstacles."""
    kinematics, items, bodies = known(robot)
    every = [*items, *items_of_obstacles(obstacles)]
    statement = Statement(robot, (), 1e-3, tuple(obstacles), touching=touching or {})
    return Contacts(kinematics, every, pairs_of_items(statement, kinematics, every, bodies))


def random_path(robot: UrdfRobot, rng: np.random.Generator, states: int, step: float) -> np.ndarray:
    """Return a path (states, n) that is free of contact by itself, with steps of a length [rad]."""
    kinematics = known(robot)[0]
    alone = contacts(robot)
    while True:
        path = [rng.uniform(kinematics.lower, kinematics.upper)]
        while len(path) < states:
            way = rng.normal(size=len(kinematics.names))
            path.append(np.clip(path[-1] + step * way / np.linalg.norm(way), kinematics.lower, kinematics.upper))
        found = alone.check(np.array(path))
        if found.contact is None and not found.sampled:
            return np.array(path)
