"""What a statement asks of configurations, as constraint and conditions."""

from collections.abc import Callable
from typing import Any

from pipeline.constraints import (
    Condition,
    Constraint,
    TaskSpaceRegion,
    balanced,
    closed_chain,
    line,
    plane,
    pose,
    position,
    sphere_constraint,
    upright,
)
from pipeline.constraints.poses import unit
from pipeline.constraints.torus import TorusMaze, torus_constraint
from pipeline.robots import Robot
from pipeline.spec.statement import (
    Balanced,
    Equation,
    Inequality,
    InRegion,
    Joined,
    Level,
    OnLine,
    OnPlane,
    OnSphere,
    OnTorus,
    Pinned,
    Posed,
    Region,
)


def region_of(region: Region) -> TaskSpaceRegion:
    """Return a region of a statement as constraints take it."""
    return TaskSpaceRegion(region.lower, region.upper, region.place, region.end)


def constraint_of(robot: Robot, equation: Equation, tolerance: float) -> Constraint:
    """Return the constraint of one equation of a statement.

    Raises:
        ConstraintError, RobotError: what it names does not exist, or numbers that do not fit.
    """
    made: Constraint = _MADE[type(equation)](robot, equation, tolerance=tolerance)
    return made


def condition_of(robot: Robot, inequality: Inequality) -> Condition | TorusMaze:
    """Return the condition of one inequality of a statement. Raises as `constraint_of` does."""
    if isinstance(inequality, Balanced):
        return balanced(robot, inequality.points, inequality.margin)
    return TorusMaze(inequality.walls, inequality.major, 0.0, inequality.minor)


_MADE: dict[type, Callable[..., Constraint]] = {
    Level: lambda robot, e, **kept: upright(robot, e.frame, e.axis, e.direction, **kept),
    OnPlane: lambda robot, e, **kept: plane(robot, e.frame, _foot(e), e.normal, **kept),
    OnLine: lambda robot, e, **kept: line(robot, e.frame, e.point, e.direction, **kept),
    Pinned: lambda robot, e, **kept: position(robot, e.frame, e.point, **kept),
    Posed: lambda robot, e, **kept: pose(robot, e.frame, e.place.se3(), **kept),
    InRegion: lambda robot, e, **kept: region_of(e.region).constraint(robot, e.frame, **kept),
    Joined: lambda robot, e, **kept: closed_chain(robot, e.frame, e.other, e.relative.se3(), **kept),
    OnSphere: lambda robot, e, **kept: sphere_constraint(robot, e.frame, e.radius, **kept),
    OnTorus: lambda robot, e, **kept: torus_constraint(robot, e.frame, e.major, e.minor, **kept),
}


def _foot(e: Any) -> tuple[float, ...]:
    """The point of a plane that is nearest to the world's origin (3,) [m]."""
    return tuple((e.distance * unit(e.normal, "normal")).tolist())
