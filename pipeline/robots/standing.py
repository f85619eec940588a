"""Bodies that no joint moves, held against obstacles once: a robot stands on its floor, and in nothing else."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pipeline.errors import ProblemError
from pipeline.robots.bodies import body_of
from pipeline.robots.clearance import Distances
from pipeline.robots.contact import Contact, usual_depth
from pipeline.robots.model import Robot
from pipeline.robots.obstacles import Obstacle
from pipeline.robots.placed import Placed
from pipeline.robots.scene import Scene

_NOTHING = 1e-6  # [m] of bodies that may not touch: what rounding in a file makes of touching


def contacts_of_standing(distances: Distances) -> list[tuple[Contact, float]]:
    """Return the contacts of bodies that no joint moves with obstacles, and how deep each may be [m].

    Bodies of the root link may touch what they stand on to the usual depth, others only what they are said to touch.
    Of meshes that are not convex the depth is that of their hull, which is no less.
    """
    scene, found = distances.scene, []
    if not scene.fixed or not scene.obstacle_shapes:
        return []
    R, p = distances.at(pin.neutral(scene.robot.model))
    for body, obstacle in distances.near(scene.fixed, R, p, 0.0):
        depth = _depth(distances.body(body, R, p), distances.obstacle(obstacle))
        if depth <= 0:
            continue
        name, allowed = scene.body_names[body], scene.depth(body, obstacle)
        if not allowed:
            shapes = scene.body_shapes[body], scene.obstacle_shapes[obstacle]
            allowed = usual_depth(shapes) if name in scene.robot.base else _NOTHING
        found.append((Contact(body_of(name), scene.names[obstacle], depth), allowed))
    return found


def stands_clear(robot: Robot, obstacles: Sequence[Obstacle]) -> bool:
    """Tell whether obstacles may stand where they are: none in a body that no joint moves."""
    found = contacts_of_standing(Distances(Scene(robot, obstacles, ())))
    return all(contact.depth <= allowed for contact, allowed in found)


def check_standing(distances: Distances) -> None:
    """Refuse obstacles that stand in bodies that no joint moves.

    Raises:
        ProblemError: names the body, the obstacle and how deep.
    """
    beyond = [(contact, allowed) for contact, allowed in contacts_of_standing(distances) if contact.depth > allowed]
    if not beyond:
        return
    contact, allowed = max(beyond, key=lambda item: item[0].depth)
    others = f" (and {len(beyond) - 1} pairs more)" if len(beyond) > 1 else ""
    may = f"it may touch it {allowed:.4g} m deep" if allowed > _NOTHING else "it may not touch it"
    raise ProblemError(
        f"obstacle {contact.second!r} stands {contact.depth:.4g} m inside body {contact.first!r} of "
        f"{distances.scene.robot.name!r}, which no joint moves; {may}{others}: move the obstacle, or what is fixed"
    )


def _depth(here: Placed, there: Placed) -> float:
    """Return how deep two shapes are in each other at most [m]; 0 or less where they are not."""
    if here.shape.convex and there.shape.convex:
        return -here.distance(there)
    if not here.nearer(there, 0.0):
        return 0.0
    return max(-one.distance(other) for one in _pieces(here, there) for other in _pieces(there, here))


def _pieces(body: Placed, other: Placed) -> list[Placed]:
    """Return the convex pieces of a shape that are near another one: together never smaller than the shape."""
    middle = other.R @ other.shape.box[0] + other.p
    found = []
    for piece in body.shape.pieces:
        where = Placed(piece.shape, body.R, body.R @ piece.offset + body.p)
        reach = piece.shape.radius + other.shape.radius
        if np.linalg.norm(where.R @ piece.shape.box[0] + where.p - middle) <= reach:
            found.append(where)
    return found
