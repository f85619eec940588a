"""Robots and paths that tests of the verifier share."""

import numpy as np

from pipeline.robots import Obstacle, Shape, UrdfRobot
from pipeline.robots.bodies import Geometry
from pipeline.spec.statement import Carried, Point, Statement
from pipeline.verification.contacts import Contacts
from pipeline.verification.kinematics import Kinematics
from pipeline.verification.pairs import Item, items_of_obstacles, items_of_robot, pairs_of_bodies, pairs_of_items
from pipeline.verification.reader import read

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

UR5 = UrdfRobot(
    urdf="package://example-robot-data/robots/ur_description/urdf/ur5_robot.urdf",
    srdf="package://example-robot-data/robots/ur_description/srdf/ur5.srdf",
    joints=("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", *(f"wrist_{i}_joint" for i in (1, 2, 3))),
    tool="tool0",
    name="ur5 with its meshes",
    geometry=Geometry.MESHES,
)
STICK = Carried(
    Obstacle(Shape.BOX, (0.0, 0.0, 0.25), (0.0, 0.0, 0.0, 1.0), (0.001, 0.001, 0.4), name="stick"), "panda_hand_tcp"
)
Tool = tuple[Carried, ...]

_KNOWN: dict[str, tuple[Kinematics, list[Item], list[tuple[int, int]]]] = {}


def known(robot: UrdfRobot | Point, carried: Tool = ()) -> tuple[Kinematics, list[Item], list[tuple[int, int]]]:
    """Return the kinematics, items and pairs of bodies of a robot and what it carries."""
    name = repr((robot, carried))
    if name not in _KNOWN:
        statement = Statement(robot, (), 1e-3, carried=carried)
        kinematics = read(statement)
        items = items_of_robot(kinematics, getattr(robot, "geometry", Geometry.PRIMITIVES))
        _KNOWN[name] = kinematics, items, pairs_of_bodies(statement, kinematics)
    return _KNOWN[name]


def contacts(robot: UrdfRobot | Point, obstacles=(), touching=None, carried: Tool = ()) -> Contacts:
    """Return the proof against obstacles."""
    kinematics, items, bodies = known(robot, carried)
    every = [*items, *items_of_obstacles(obstacles)]
    statement = Statement(robot, (), 1e-3, tuple(obstacles), carried, touching=touching or {})
    return Contacts(kinematics, every, pairs_of_items(statement, kinematics, every, bodies))


def random_path(robot: UrdfRobot, rng: np.random.Generator, states: int, step: float, carried: Tool = ()) -> np.ndarray:
    """Return a path (states, n) that is free of contact by itself, with steps of a length [rad]."""
    kinematics = known(robot)[0]
    alone = contacts(robot, carried=carried)
    while True:
        path = [rng.uniform(kinematics.lower, kinematics.upper)]
        while len(path) < states:
            way = rng.normal(size=len(kinematics.names))
            path.append(np.clip(path[-1] + step * way / np.linalg.norm(way), kinematics.lower, kinematics.upper))
        found = alone.check(np.array(path))
        if found.contact is None and not found.sampled:
            return np.array(path)
