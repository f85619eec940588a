"""What a task says, as plain data: the verifier reads it, and nothing that planning made of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.robots.obstacles import Obstacle
from pipeline.robots.placement import IDENTITY, Placement
from pipeline.robots.urdf import UrdfRobot


@dataclass(frozen=True)
class Point:
    """A ball on three prismatic joints x, y, z: the point mass of sphere and maze, whose frame is `point`.

    Attributes:
        radius: of the ball [m].
        lower, upper: limits of x, y, z (3,) [m].
    """

    radius: float
    lower: tuple[float, ...]
    upper: tuple[float, ...]


@dataclass(frozen=True)
class Carried:
    """A body that moves with a frame.

    Attributes:
        body: its shape, and its pose in the frame; its name is the body's.
        frame: that carries it.
        mass: [kg].
        beside: bodies of the robot that it may touch, and how deep [m]; None for the usual depth.
        touches: obstacles that it may touch, likewise.
    """

    body: Obstacle
    frame: str
    mass: float = 0.0
    beside: Mapping[str, float | None] = field(default_factory=dict)
    touches: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Region:
    """Poses of a frame e within bounds, seen from a frame w (Berenson et al. 2011, section 4).

    Attributes:
        lower, upper: bounds of x, y, z [m], roll, pitch, yaw [rad] of e, less its end, in w (6,). Equal ones are fixed.
        place: where w is in the world (or, in a chain, in the end of the region before).
        end: where e is in w when all displacements are 0.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    place: Placement = IDENTITY
    end: Placement = IDENTITY


@dataclass(frozen=True)
class ChainSpec:
    """A chain of regions whose end a frame of the robot holds; every dimension that is not fixed is a variable.

    Attributes:
        regions: one after the other, the first in the world.
        frame: of the robot, which is at the end.
        name: of the chain: frames after each region are `<name>_<i>`, variables `<name>_<i>_<dimension>`.
    """

    regions: tuple[Region, ...]
    frame: str
    name: str = "chain"

    @property
    def end(self) -> str:
        """The frame at its end."""
        return f"{self.name}_{len(self.regions) - 1}"


@dataclass(frozen=True)
class Level:
    """An axis of a frame (3,) keeps a direction of the world (3,)."""

    frame: str
    axis: tuple[float, ...]
    direction: tuple[float, ...]


@dataclass(frozen=True)
class OnPlane:
    """The origin of a frame keeps a distance [m] from the world's origin along a normal (3,) of any length."""

    frame: str
    normal: tuple[float, ...]
    distance: float


@dataclass(frozen=True)
class OnLine:
    """The origin of a frame stays on the line through a point (3,) [m] along a direction (3,), both in the world."""

    frame: str
    point: tuple[float, ...]
    direction: tuple[float, ...]


@dataclass(frozen=True)
class Pinned:
    """The origin of a frame stays at a point of the world (3,) [m]."""

    frame: str
    point: tuple[float, ...]


@dataclass(frozen=True)
class Posed:
    """A frame stays at a pose in the world."""

    frame: str
    place: Placement


@dataclass(frozen=True)
class InRegion:
    """A frame keeps the fixed dimensions of a region, whose others are free."""

    frame: str
    region: Region


@dataclass(frozen=True)
class Joined:
    """`other` keeps a pose in `frame`."""

    frame: str
    other: str
    relative: Placement = IDENTITY


@dataclass(frozen=True)
class OnSphere:
    """The origin of a frame keeps a distance from the world's origin [m]."""

    frame: str
    radius: float


@dataclass(frozen=True)
class OnTorus:
    """The origin of a frame stays on a torus about the world's z axis: radii of the ring and of the tube [m]."""

    major: float
    minor: float
    frame: str = "point"


@dataclass(frozen=True)
class Follows:
    """A variable is a multiple of another one plus an offset [rad or m], by the names of their joints."""

    joint: str
    leader: str
    multiplier: float
    offset: float


Equation = Follows | Level | OnPlane | OnLine | Pinned | Posed | InRegion | Joined | OnSphere | OnTorus


@dataclass(frozen=True)
class Balanced:
    """The centre of mass of what moves stays over the convex hull of points, seen from above.

    Attributes:
        points: of the ground that carry (N >= 3, 3) [m].
        margin: least distance to the hull's edges [m].
    """

    points: tuple[tuple[float, ...], ...]
    margin: float = 0.0


@dataclass(frozen=True, eq=False)
class Mazed:
    """A point keeps away from walls on a torus.

    Attributes:
        walls: True where there is a wall (rows, columns): columns go around the axis, rows around the tube.
        major, minor: radii of the ring and of the tube [m].
    """

    walls: np.ndarray
    major: float
    minor: float


Inequality = Balanced | Mazed


@dataclass(frozen=True)
class Statement:
    """A task: everything a path must keep.

    Attributes:
        robot: settings of the planning group, or a point.
        equations: the equations, all of which hold; those of the chain are not among them.
        tolerance: of ||F||, with the rows of all equations below each other (compnetx.txt, appendix D).
        obstacles: in the world.
        carried: what the robot holds.
        chain: regions whose end it holds.
        touching: pairs (body, obstacle) that may touch besides those of `carried`, and how deep [m].
        conditions: what else configurations must meet.
    """

    robot: UrdfRobot | Point
    equations: tuple[Equation, ...]
    tolerance: float = 1e-3
    obstacles: tuple[Obstacle, ...] = ()
    carried: tuple[Carried, ...] = ()
    chain: ChainSpec | None = None
    touching: Mapping[tuple[str, str], float | None] = field(default_factory=dict)
    conditions: tuple[Inequality, ...] = ()
