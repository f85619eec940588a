"""The sphere of compnetx.txt, section VI-A: a point at a fixed distance from the origin."""

import casadi as ca

from pipeline.constraints.base import Constraint
from pipeline.errors import ConstraintError
from pipeline.robots import Numbers, Robot


def sphere_constraint(
    robot: Robot, frame: str, radius: float = 1.0, tolerance: float = 1e-3, max_iterations: int = 50
) -> Constraint:
    """Return F(q) = ||p(q)|| - radius for the position p(q) [m] of `frame` in the world.

    The authors' code uses ||p||^2 - 1; this is the paper's form, whose value is the distance to the sphere.

    Raises:
        ConstraintError: the radius is not positive.
        RobotError: the robot has no such frame.
    """
    if not radius > 0:
        raise ConstraintError(f"sphere radius is {radius} m; it must be above 0 m")
    q, p = ca.SX.sym("q", robot.dimension), Numbers()
    position = robot.symbolic_pose(q, frame, p).position
    return Constraint("sphere", q, ca.norm_2(position) - p(radius), tolerance, max_iterations, numbers=p)
