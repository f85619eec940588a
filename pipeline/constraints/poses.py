"""Constraints on where a frame is: at a pose, on a plane or line, upright, or fixed to another frame.

Every function returns a `Constraint` on the robot's configuration; `intersection` stacks them.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.constraints.base import Constraint
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers, Robot
from pipeline.robots.symbolic import direction_error, perpendicular, rotation_vector


def upright(
    robot: Robot,
    frame: str,
    axis: Sequence[float] = (0, 0, 1),
    direction: Sequence[float] = (0, 0, 1),
    **settings: Any,
) -> Constraint:
    """Keep an axis of a frame along a direction of the world: a full cup (2 rows, [rad]).

    Args:
        robot: whose frame it is.
        frame: name.
        axis: in the frame (3,).
        direction: in the world (3,).
        **settings: tolerance and max_iterations of `Constraint`.
    """
    wanted, held = unit(direction, "direction"), unit(axis, "axis")
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    R, _ = robot.symbolic_pose(q, frame, p)
    rows = [f"tilt of {frame} about {np.round(edge, 3).tolist()} [rad]" for edge in perpendicular(wanted)]
    expression = direction_error(R @ p(held), wanted, numbers=p)
    return Constraint(f"upright {frame}", q, expression, labels=rows, numbers=p, **settings)


def plane(
    robot: Robot, frame: str, point: Sequence[float], normal: Sequence[float] = (0, 0, 1), **settings: Any
) -> Constraint:
    """Keep the origin of a frame on the plane through `point` [m, world]; horizontal by default: a height (1 row)."""
    n = unit(normal, "normal")
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    place = robot.symbolic_pose(q, frame, p).position
    rows = [f"distance of {frame} from the plane [m]"]
    expression = ca.dot(p(n), place - p(vector(point)))
    return Constraint(f"plane of {frame}", q, expression, labels=rows, numbers=p, **settings)


def height(robot: Robot, frame: str, value: float, **settings: Any) -> Constraint:
    """Keep the origin of a frame at a height over the world's origin [m] (1 row)."""
    return plane(robot, frame, (0.0, 0.0, value), **settings)


def line(robot: Robot, frame: str, point: Sequence[float], direction: Sequence[float], **settings: Any) -> Constraint:
    """Keep the origin of a frame on the line through `point` [m] along `direction`, both in the world (2 rows)."""
    across = perpendicular(unit(direction, "direction"))
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    place = robot.symbolic_pose(q, frame, p).position
    rows = [f"offset of {frame} from the line along {np.round(edge, 3).tolist()} [m]" for edge in across]
    expression = p(across) @ (place - p(vector(point)))
    return Constraint(f"line of {frame}", q, expression, labels=rows, numbers=p, **settings)


def position(robot: Robot, frame: str, point: Sequence[float], **settings: Any) -> Constraint:
    """Keep the origin of a frame at a point of the world [m] (3 rows)."""
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    place = robot.symbolic_pose(q, frame, p).position
    rows = [f"{axis} of {frame} [m]" for axis in "xyz"]
    return Constraint(f"position of {frame}", q, place - p(vector(point)), labels=rows, numbers=p, **settings)


def closed_chain(robot: Robot, frame: str, other: str, relative: pin.SE3, **settings: Any) -> Constraint:
    """Keep `other` at a fixed pose in `frame`: a tray in two hands, a hand on a virtual chain (6 rows, [m] and [rad]).

    The rows are position and rotation vector of `other` in the frame where it belongs.
    """
    if frame == other:
        raise ConstraintError(f"a closed chain joins two frames; both are {frame!r}")
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    E = (robot.symbolic_pose(q, frame, p) @ p.pose(relative)).inverse() @ robot.symbolic_pose(q, other, p)
    rows = [f"{axis} of {other} in {frame} [m]" for axis in "xyz"] + [
        f"turn of {other} about {axis} of {frame} [rad]" for axis in "xyz"
    ]
    expression = ca.vertcat(E.position, rotation_vector(E.rotation))
    return Constraint(f"closed chain {frame} - {other}", q, expression, labels=rows, numbers=p, **settings)


def pose(robot: Robot, frame: str, wanted: pin.SE3, **settings: Any) -> Constraint:
    """Keep a frame at a pose in the world (6 rows, [m] and [rad])."""
    return closed_chain(robot, "universe", frame, wanted, **settings)


def intersection(*constraints: Constraint, name: str = "") -> Constraint:
    """Return the constraint whose rows are those of all given ones, with the least tolerance among them.

    Raises:
        ConstraintError: none given, different numbers of variables, or as many rows as variables.
    """
    if not constraints:
        raise ConstraintError("an intersection needs at least one constraint")
    sizes = {c.name: c.n for c in constraints}
    if len(set(sizes.values())) > 1:
        raise ConstraintError(f"an intersection needs constraints on the same variables; they have {sizes}")
    q, p = ca.SX.sym("q", constraints[0].n), Numbers()
    return Constraint(
        name or " and ".join(c.name for c in constraints),
        q,
        ca.vertcat(*(c.rows(q, p) for c in constraints)),
        tolerance=min(c.tolerance for c in constraints),
        max_iterations=max(c.max_iterations for c in constraints),
        labels=[label for c in constraints for label in c.labels],
        numbers=p,
    )


def vector(values: Sequence[float]) -> np.ndarray:
    """Return a point or direction (3,) that is finite."""
    found = np.asarray(values, float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ConstraintError(f"a point or direction is {values}; it must be three finite numbers")
    return found


def unit(values: Sequence[float], what: str) -> np.ndarray:
    """Return a vector (3,) of length 1; `what` names it where it is none."""
    found = vector(values)
    largest = float(np.abs(found).max())
    if not largest > 0:
        raise ConstraintError(f"{what} is {list(values)}; it must not be zero")
    found = found / largest  # squares of very large or small numbers are none
    return np.asarray(found / np.linalg.norm(found))
