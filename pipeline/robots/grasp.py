"""Grasped objects: bodies that a frame of the robot carries."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pipeline.errors import RobotError, unknown
from pipeline.robots.bodies import body_of
from pipeline.robots.model import Robot
from pipeline.robots.obstacles import Obstacle


def attach(robot: Robot, body: Obstacle, frame: str, touching: Collection[str] = ()) -> Robot:
    """Return the robot with one more body that moves with a frame: a cup in the hand, a door on its hinge.

    It collides with obstacles and with the robot's other bodies, but not with those on the same joint (the hand that
    holds it). What it stands on when it is picked up is named to `Validity` as touching.

    Args:
        robot: that carries it.
        body: shape, and position and orientation in the frame [m]; its name becomes the body's.
        frame: name of the frame that carries it.
        touching: names of further bodies it may touch.

    Raises:
        RobotError: no such frame or body, or a name that is empty or taken.
        ProblemError: a mesh that cannot be read.
    """
    if not body.name or body.name in robot.body_names:
        raise RobotError(
            f"a grasped object needs a name of its own; {body.name!r} is {'taken' if body.name else 'empty'}"
        )
    for name in touching:
        if not robot.pieces_of(name):
            there = map(body_of, robot.body_names)
            raise RobotError(unknown(f"{body.name!r} may touch a body that {robot.name!r} lacks:", name, there))
    beside = {piece for name in touching for piece in robot.pieces_of(name)}
    number = robot.frame_id(frame)
    carrier = robot.model.frames[number]
    placement = carrier.placement * pin.SE3(body.rotation, np.array(body.position))
    geometry = robot.geometry.copy()
    added = geometry.addGeometryObject(
        pin.GeometryObject(body.name, carrier.parentJoint, number, placement, body.geometry())
    )
    for i, other in enumerate(robot.geometry.geometryObjects):
        if other.parentJoint != carrier.parentJoint and other.name not in beside:
            geometry.addCollisionPair(pin.CollisionPair(i, added))
    return replace(robot, geometry=geometry)
