"""The constraints a problem file can ask for, by kind."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pipeline.constraints import (
    Condition,
    Constraint,
    balanced,
    closed_chain,
    feet_on_ground,
    height,
    line,
    plane,
    pose,
    position,
    upright,
)
from pipeline.constraints.poses import unit
from pipeline.errors import ConfigError
from pipeline.problems.region import Region
from pipeline.robots import Placement, Robot


class Part(Protocol):
    """One entry of a problem's list of constraints."""

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint | Condition:
        """Return the constraint on `robot`; what the entry leaves open is taken from the start q (n,)."""
        ...


@dataclass(frozen=True)
class UprightPart:
    """See `upright`; the frame is the tool by default."""

    frame: str = ""
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    direction: tuple[float, ...] | None = (0.0, 0.0, 1.0)

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        frame = self.frame or robot.tool
        direction = self.direction
        if direction is None:
            R = robot.pose(_start(q, "upright.direction"), frame).rotation
            direction = tuple(R @ unit(self.axis, "axis"))
        return upright(robot, frame, self.axis, direction)


@dataclass(frozen=True)
class PlanePart:
    """See `plane`; without a point, the one through the frame at the start."""

    frame: str = ""
    point: tuple[float, ...] | None = None
    normal: tuple[float, ...] = (0.0, 0.0, 1.0)

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        return plane(robot, self.frame or robot.tool, _point(self, robot, q, "plane.point"), self.normal)


@dataclass(frozen=True)
class HeightPart:
    """See `height`; without a value [m], that of the frame at the start."""

    frame: str = ""
    value: float | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        frame, value = self.frame or robot.tool, self.value
        if value is None:
            value = float(robot.pose(_start(q, "height.value"), frame).translation[2])
        return height(robot, frame, value)


@dataclass(frozen=True)
class LinePart:
    """See `line`; without a point, the one through the frame at the start."""

    direction: tuple[float, ...]
    frame: str = ""
    point: tuple[float, ...] | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        return line(robot, self.frame or robot.tool, _point(self, robot, q, "line.point"), self.direction)


@dataclass(frozen=True)
class PositionPart:
    """See `position`; without a point, where the frame is at the start."""

    frame: str = ""
    point: tuple[float, ...] | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        return position(robot, self.frame or robot.tool, _point(self, robot, q, "position.point"))


@dataclass(frozen=True)
class PosePart:
    """See `pose`; without a placement, that of the frame at the start."""

    frame: str = ""
    placement: Placement | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        frame = self.frame or robot.tool
        wanted = self.placement.se3() if self.placement else robot.pose(_start(q, "pose.placement"), frame)
        return pose(robot, frame, wanted)


@dataclass(frozen=True)
class RegionPart(Region):
    """See `TaskSpaceRegion.constraint`: its fixed dimensions."""

    frame: str = ""

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        return self.region().constraint(robot, self.frame)


@dataclass(frozen=True)
class ClosedChainPart:
    """See `closed_chain`; without a relative placement, that of `other` in `frame` at the start."""

    frame: str
    other: str
    relative: Placement | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        if self.relative:
            return closed_chain(robot, self.frame, self.other, self.relative.se3())
        begin = _start(q, "closed_chain.relative")
        return closed_chain(
            robot, self.frame, self.other, robot.pose(begin, self.frame).actInv(robot.pose(begin, self.other))
        )


@dataclass(frozen=True)
class FeetPart:
    """See `feet_on_ground`: the feet stay where they are at the start."""

    frames: tuple[str, ...]

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Constraint:
        """Return the constraint."""
        begin = _start(q, "feet")
        return feet_on_ground(robot, {frame: robot.pose(begin, frame).translation for frame in self.frames})


@dataclass(frozen=True)
class BalancePart:
    """See `balanced`: the centre of mass stays over where these frames are at the start."""

    frames: tuple[str, ...]
    margin: float = 0.0

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Condition:
        """Return the condition."""
        begin = _start(q, "balance")
        return balanced(robot, [robot.pose(begin, frame).translation for frame in self.frames], self.margin)


PARTS: dict[str, Any] = {
    "upright": UprightPart,
    "plane": PlanePart,
    "height": HeightPart,
    "line": LinePart,
    "position": PositionPart,
    "pose": PosePart,
    "region": RegionPart,
    "closed_chain": ClosedChainPart,
    "feet": FeetPart,
    "balance": BalancePart,
}


def _start(q: np.ndarray | None, what: str) -> np.ndarray:
    if q is None:
        raise ConfigError(
            f"{what} is left open, to be taken from the start: then the start must be a `configuration` or `joints`"
        )
    return q


def _point(part: Any, robot: Robot, q: np.ndarray | None, what: str) -> Any:
    if part.point is not None:
        return part.point
    return robot.pose(_start(q, what), part.frame or robot.tool).translation
