"""Static balance: feet that stand still, and the centre of mass over them (generative_manifolds.txt, section III)."""

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from pipeline.constraints.base import Constraint
from pipeline.constraints.conditions import Condition
from pipeline.constraints.poses import intersection, position
from pipeline.errors import ConstraintError, require
from pipeline.robots import Numbers, Robot
from pipeline.robots.bending import centre_of_mass_bend


def feet_on_ground(robot: Robot, feet: Mapping[str, Sequence[float]], **settings: Any) -> Constraint:
    """Keep the origins of foot frames at points of the world [m] (3 rows a foot)."""
    if not feet:
        raise ConstraintError("feet_on_ground needs at least one foot")
    parts = [position(robot, frame, point, **settings) for frame, point in feet.items()]
    return intersection(*parts, name=f"feet {', '.join(feet)}")


def balanced(robot: Robot, contacts: Sequence[Sequence[float]], margin: float = 0.0) -> Condition:
    """Return the condition that the centre of mass is over the support polygon.

    Not an equation: it holds on one side of each edge of the polygon, and is checked like a collision.

    Args:
        robot: with masses.
        contacts: points of the ground that carry (N >= 3, 3) [m]; their convex hull, seen from above, is the polygon.
        margin: least distance of the centre of mass from the polygon's edges [m].

    Raises:
        ConstraintError: contacts on a line, or a margin that leaves nothing of the polygon.
    """
    require("balance.margin", margin, at_least=0, unit=" m")
    points = np.asarray(contacts, float)
    if points.ndim != 2 or points.shape[1:] != (3,) or not np.isfinite(points).all():
        raise ConstraintError(f"contacts have shape {points.shape}; they must be finite points (N, 3)")
    try:
        hull = ConvexHull(points[:, :2])
    except (QhullError, ValueError):
        raise ConstraintError(
            f"the {len(points)} contacts span no polygon: three that are not on a line are needed"
        ) from None
    normals, offsets = hull.equations[:, :2], hull.equations[:, 2]  # outward; inside where normal @ p + offset < 0
    # The largest circle inside: max r with normals @ p + r <= -offsets.
    circle = linprog([0, 0, -1], np.column_stack([normals, np.ones(len(normals))]), -offsets, bounds=(None, None))
    if margin >= circle.x[2]:
        raise ConstraintError(
            f"a margin of {margin} m leaves nothing of the polygon: no more than {circle.x[2]:.4g} m fit into it"
        )
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    com = robot.symbolic_centre_of_mass(q, p)
    slack = -(p(normals) @ com[:2] + p(offsets)) - p(margin)
    rows = [f"centre of mass inside edge {i} of the support polygon [m]" for i in range(len(normals))]
    # A row is a distance along a unit vector: it bends no more than the centre of mass.
    return Condition("balance", q, slack, rows, centre_of_mass_bend(robot), p)
