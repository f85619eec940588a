"""Directions within an angle of each other, as a condition and as a target."""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from pipeline.constraints.conditions import Condition
from pipeline.constraints.poses import unit
from pipeline.constraints.targets import TARGET_TOLERANCE, Target
from pipeline.constraints.within import Within
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers, Robot
from pipeline.robots.order import revolute

_NARROWEST = 2 * TARGET_TOLERANCE  # the inset of a target leaves nothing of a narrower one [rad]


def in_cone(
    robot: Robot,
    frame: str,
    angle: float,
    axis: Sequence[float] = (0, 0, 1),
    direction: Sequence[float] = (0, 0, 1),
) -> Target:
    """An axis of a frame is within an angle of a direction of the world.

    The value is the cosine over the sine of `angle`: it has derivatives on the axis too, and near the cone's surface it
    changes by as much as the angle [rad].

    Args:
        robot: whose frame it is.
        frame: name.
        angle: half the cone's opening [rad].
        axis: in the frame (3,).
        direction: in the world (3,).

    Raises:
        ConstraintError: an angle that makes no cone.
    """
    if not _NARROWEST < angle < np.pi:
        raise ConstraintError(
            f"a cone about {list(direction)} has an angle of {angle} rad; it must be above {_NARROWEST} rad (an axis "
            "that keeps its direction is `upright`) and below half a turn"
        )
    held, wanted = unit(axis, "axis"), unit(direction, "direction")

    def within(q: ca.SX, p: Numbers) -> Within:
        cosine = ca.dot(p(wanted), robot.symbolic_pose(q, frame, p).rotation @ p(held))
        return Within(p(1 / np.sin(angle)) * cosine, np.array([1 / np.tan(angle)]), np.array([np.inf]))

    return within


def cone(
    robot: Robot,
    frame: str,
    angle: float,
    axis: Sequence[float] = (0, 0, 1),
    direction: Sequence[float] = (0, 0, 1),
) -> Condition:
    """Return the condition that an axis of a frame is within an angle [rad] of a direction; see `in_cone`."""
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    within = in_cone(robot, frame, angle, axis, direction)(q, p)
    label = f"cosine of the tilt of {frame} over the sine of {angle:.4g} rad"
    return Condition.within(f"cone of {frame}", q, within, [label], _direction_bend(robot, angle), p)


def _direction_bend(robot: Robot, angle: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function that bounds |g''| of a cone over chords with steps dq (C, n), as (C,).

    A unit vector u that joints turn has |u''| <= (sum_k |dq_k|)^2: every derivative is a cross product with an axis.
    """
    turns = revolute(robot.model)
    return lambda steps: np.abs(steps[:, turns]).sum(axis=1) ** 2 / np.sin(angle)
