"""The constraints a problem file can ask for, by kind, and what each says."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pipeline.constraints.poses import unit, vector
from pipeline.errors import ConfigError
from pipeline.problems.region import Region
from pipeline.robots import Placement, Robot
from pipeline.spec.statement import (
    Balanced,
    Equation,
    Inequality,
    InRegion,
    Joined,
    Level,
    OnLine,
    OnPlane,
    Pinned,
    Posed,
)

Said = list[Equation | Inequality]


class Part(Protocol):
    """One entry of a problem's list of constraints."""

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return what the entry says of `robot`; what it leaves open is taken from the start q (n,)."""
        ...


@dataclass(frozen=True)
class UprightPart:
    """See `upright`; the frame is the tool by default."""

    frame: str = ""
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    direction: tuple[float, ...] | None = (0.0, 0.0, 1.0)

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the equation."""
        frame = self.frame or robot.tool
        direction = self.direction
        if direction is None:
            R = robot.pose(_start(q, "upright.direction"), frame).rotation
            direction = tuple((R @ unit(self.axis, "axis")).tolist())
        return [Level(frame, self.axis, direction)]


@dataclass(frozen=True)
class PlanePart:
    """See `plane`; without a point, the one through the frame at the start."""

    frame: str = ""
    point: tuple[float, ...] | None = None
    normal: tuple[float, ...] = (0.0, 0.0, 1.0)

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the equation."""
        normal, point = unit(self.normal, "normal"), vector(_point(self, robot, q, "plane.point"))
        return [OnPlane(self.frame or robot.tool, self.normal, float(normal @ point))]


@dataclass(frozen=True)
class HeightPart:
    """See `height`; without a value [m], that of the frame at the start."""

    frame: str = ""
    value: float | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the equation."""
        frame, value = self.frame or robot.tool, self.value
        if value is None:
            value = float(robot.pose(_start(q, "height.value"), frame).translation[2])
        return [OnPlane(frame, (0.0, 0.0, 1.0), value)]


@dataclass(frozen=True)
class LinePart:
    """See `line`; without a point, the one through the frame at the start."""

    direction: tuple[float, ...]
    frame: str = ""
    point: tuple[float, ...] | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the equation."""
        return [OnLine(self.frame or robot.tool, _point(self, robot, q, "line.point"), self.direction)]


@dataclass(frozen=True)
class PositionPart:
    """See `position`; without a point, where the frame is at the start."""

    frame: str = ""
    point: tuple[float, ...] | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the equation."""
        return [Pinned(self.frame or robot.tool, _point(self, robot, q, "position.point"))]


@dataclass(frozen=True)
class PosePart:
    """See `pose`; without a placement, that of the frame at the start."""

    frame: str = ""
    placement: Placement | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the equation."""
        frame = self.frame or robot.tool
        return [Posed(frame, self.placement or Placement.of(robot.pose(_start(q, "pose.placement"), frame)))]


@dataclass(frozen=True)
class RegionPart(Region):
    """See `TaskSpaceRegion.constraint`: its fixed dimensions."""

    frame: str = ""

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the equation."""
        return [InRegion(self.frame or robot.tool, self.said())]


@dataclass(frozen=True)
class ClosedChainPart:
    """See `closed_chain`; without a relative placement, that of `other` in `frame` at the start."""

    frame: str
    other: str
    relative: Placement | None = None

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the equation."""
        relative = self.relative
        if relative is None:
            begin = _start(q, "closed_chain.relative")
            relative = Placement.of(robot.pose(begin, self.frame).actInv(robot.pose(begin, self.other)))
        return [Joined(self.frame, self.other, relative)]


@dataclass(frozen=True)
class FeetPart:
    """The origins of foot frames stay where they are at the start."""

    frames: tuple[str, ...]

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return an equation for each foot.

        Raises:
            ConfigError: there are none.
        """
        if not self.frames:
            raise ConfigError("feet needs at least one frame")
        return [Pinned(frame, _origin(robot, _start(q, "feet"), frame)) for frame in self.frames]


@dataclass(frozen=True)
class BalancePart:
    """See `balanced`: the centre of mass stays over where these frames are at the start."""

    frames: tuple[str, ...]
    margin: float = 0.0

    def __call__(self, robot: Robot, q: np.ndarray | None) -> Said:
        """Return the inequality."""
        begin = _start(q, "balance")
        return [Balanced(tuple(_origin(robot, begin, frame) for frame in self.frames), self.margin)]


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


def _origin(robot: Robot, q: np.ndarray, frame: str) -> tuple[float, ...]:
    """Where the origin of a frame is at q (n,), in the world (3,) [m]."""
    return tuple(robot.pose(q, frame).translation.tolist())


def _point(part: Any, robot: Robot, q: np.ndarray | None, what: str) -> tuple[float, ...]:
    if part.point is not None:
        return tuple(part.point)
    return _origin(robot, _start(q, what), part.frame or robot.tool)
