"""Grasped objects: bodies that a frame of the robot carries."""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pipeline.errors import RobotError, unknown
from pipeline.robots.bodies import body_of
from pipeline.robots.centre import centre_of_mass
from pipeline.robots.model import Robot
from pipeline.robots.obstacles import Obstacle


def attach(
    robot: Robot,
    body: Obstacle,
    frame: str,
    touching: Collection[str] | Mapping[str, float | None] = (),
    mass: float = 0.0,
) -> Robot:
    """Return the robot with one more body that moves with a frame: a cup in the hand, a door on its hinge.

    It collides with obstacles and with the robot's other bodies, but not with those on the same joint (the hand that
    holds it). What it stands on when it is picked up is named to `Validity` as touching.

    Args:
        robot: that carries it.
        body: shape, and position and orientation in the frame [m]; its name becomes the body's.
        frame: name of the frame that carries it.
        touching: names of further bodies it may touch and, as a mapping, how deep [m] (see `Validity`).
        mass: of the body [kg], of one density; the robot's mass has it from then on.

    Raises:
        RobotError: no such frame or body, a name that is empty or taken, or a mass that is negative or not finite.
        ProblemError: a mesh that cannot be read.
    """
    if not body.name or body.name in robot.body_names:
        raise RobotError(
            f"a grasped object needs a name of its own; {body.name!r} is {'taken' if body.name else 'empty'}"
        )
    if not 0 <= mass < np.inf:
        raise RobotError(f"the mass of {body.name!r} is {mass} kg; it must be finite and at least 0 kg")
    asked = dict(touching) if isinstance(touching, Mapping) else dict.fromkeys(touching)
    for name in asked:
        if not robot.pieces_of(name):
            there = map(body_of, robot.body_names)
            raise RobotError(unknown(f"{body.name!r} may touch a body that {robot.name!r} lacks:", name, there))
    number = robot.frame_id(frame)
    carrier = robot.model.frames[number]
    placement = carrier.placement * pin.SE3(body.rotation, np.array(body.position))
    geometry = robot.geometry.copy()
    shape = body.body_shape()
    added = geometry.addGeometryObject(
        pin.GeometryObject(body.name, carrier.parentJoint, number, placement, shape.given)
    )
    for i, other in enumerate(robot.geometry.geometryObjects):
        if other.parentJoint != carrier.parentJoint:
            geometry.addCollisionPair(pin.CollisionPair(i, added))
    model, loaded = robot.model, robot.loaded
    if mass > 0:
        loaded = loaded | {int(carrier.parentJoint)}
        model = pin.Model(robot.model)
        point = pin.Inertia(mass, centre_of_mass(shape), np.zeros((3, 3)))  # balance asks for no more
        model.appendBodyToJoint(carrier.parentJoint, point, placement)
    allowed = {(body.name, piece): depth for name, depth in asked.items() for piece in robot.pieces_of(name)}
    touching_now = {**robot.touching, **allowed}
    return replace(robot, model=model, geometry=geometry, touching=touching_now, loaded=loaded)
