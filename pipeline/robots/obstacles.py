"""Obstacles: shapes at a fixed pose in the world."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum

import coal
import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.errors import ProblemError
from pipeline.robots.mesh_files import load
from pipeline.robots.shapes import LARGEST, BodyShape

_OCTREE_REACH = 32768  # leaves from the origin; octomap drops points beyond without a word
_UNIT = "are these millimetres?"
COLUMNS = ("shape", "x", "y", "z", "qx", "qy", "qz", "qw", "size_x", "size_y", "size_z")


class Shape(Enum):
    """What an obstacle is; `size` is given per shape in metres."""

    BOX = "box"  # full extents
    SPHERE = "sphere"  # (diameter, diameter, diameter)
    CYLINDER = "cylinder"  # (diameter, diameter, length along z)
    MESH = "mesh"  # scale of the file's units along x, y, z
    OCTREE = "octree"  # (edge, edge, edge) of a leaf


# Extents that are one number: a shape with others would be planned with the first one and drawn with all.
_EQUAL = {
    Shape.SPHERE: (slice(3), "its three diameters must be equal: other round bodies are meshes"),
    Shape.CYLINDER: (slice(2), "the first two, its diameter across x and y, must be equal: other columns are meshes"),
    Shape.OCTREE: (slice(3), "the three edges of its leaves must be equal"),
}
PRIMITIVES = (Shape.BOX, Shape.SPHERE, Shape.CYLINDER)


@dataclass(frozen=True)
class Obstacle:
    """A shape at a pose in the world frame.

    Attributes:
        shape: which one.
        position: of its centre, or the origin of its file or points, in the world (3,) [m].
        quaternion: orientation in the world, (x, y, z, w).
        size: full extents (3,) [m], see `Shape`. A mesh's scale may be negative, which mirrors it.
        name: by which `touching` speaks of it; may be empty.
        file: of a mesh (STL, OBJ, DAE).
        points: of an octree, in the obstacle's frame (N, 3) [m]; the leaves that hold one are occupied.
    """

    shape: Shape
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    size: tuple[float, float, float]
    name: str = ""
    file: str = ""
    points: np.ndarray | None = field(default=None, compare=False)

    @property
    def rotation(self) -> np.ndarray:
        """Rotation matrix from the obstacle's frame to the world (3, 3)."""
        return Rotation.from_quat(self.quaternion).as_matrix()

    def geometry(self) -> coal.CollisionGeometry:
        """Return the shape as coal's.

        Raises:
            ProblemError: a size that is not above 0 m or larger than a body can be, extents that differ where the shape
                has but one, a pose that is not finite, a mesh file that is missing or cannot be read, or an octree
                without points.
        """
        return self.body_shape().given

    def body_shape(self) -> BodyShape:
        """Return the shape as collision checks take it: solid where it is closed. Raises as `geometry` does."""
        if not np.isfinite([*self.position, *self.quaternion]).all():
            raise ProblemError(f"{self.shape.value} {self.name!r} is at {self.position}, {self.quaternion}: not finite")
        return load(self.file, self.size, self.name) if self.shape is Shape.MESH else BodyShape(self._made())

    def _made(self) -> coal.CollisionGeometry:
        """The shape of primitives and octrees."""
        x, y, z = self.size
        check_size(self.shape, self.size, self.name)
        if self.shape is Shape.BOX:
            return coal.Box(x, y, z)
        if self.shape is Shape.SPHERE:
            return coal.Sphere(x / 2)
        if self.shape is Shape.CYLINDER:
            return coal.Cylinder(x / 2, z)
        if self.points is None or not len(self.points) or not np.isfinite(self.points).all():
            raise ProblemError(f"octree {self.name!r} needs points, and finite ones")
        extent = float(np.ptp(self.points, axis=0).max())
        if extent > LARGEST:
            raise ProblemError(f"octree {self.name!r} has points over {extent:.4g} m; at most {LARGEST:g} m: {_UNIT}")
        if np.abs(self.points).max() >= _OCTREE_REACH * x:
            raise ProblemError(
                f"octree {self.name!r} has points {np.abs(self.points).max():.4g} m from its origin; leaves of {x:g} m "
                f"reach {_OCTREE_REACH * x:.4g} m: place its frame nearer, or take larger leaves"
            )
        return coal.makeOctree(np.ascontiguousarray(self.points, float), x)

    def collision_object(self) -> coal.CollisionObject:
        """Return the obstacle as a coal object with its bounding box computed. Raises as `geometry` does."""
        placed = coal.CollisionObject(self.geometry(), self.rotation, np.array(self.position))
        placed.computeAABB()
        return placed


def check_size(shape: Shape, size: Iterable[float], name: str) -> None:
    """Refuse sizes (3,) [m] that make no shape; not of meshes, whose size is a scale.

    Raises:
        ProblemError: names the obstacle, its size and the bound.
    """
    size = tuple(size)
    same, demand = _EQUAL.get(shape, (slice(1), ""))
    if not all(0 < extent < np.inf for extent in size):
        demand = "sizes must be above 0 m"
    elif max(size) > LARGEST:
        demand = f"sizes are at most {LARGEST:g} m: {_UNIT}"
    elif len(set(size[same])) == 1:
        return
    raise ProblemError(f"{shape.value} {name!r} has size {size}; {demand}")


def obstacles_to_frame(obstacles: Iterable[Obstacle]) -> pd.DataFrame:
    """Return one row per obstacle with the columns of `COLUMNS`. Names are not kept.

    Raises:
        ProblemError: a mesh or octree, which is no row of numbers.
    """
    obstacles = list(obstacles)
    others = sorted({o.shape.value for o in obstacles if o.shape not in PRIMITIVES})
    if others:
        raise ProblemError(f"a table of obstacles holds {[s.value for s in PRIMITIVES]}, not {others}")
    rows = [(o.shape.value, *o.position, *o.quaternion, *o.size) for o in obstacles]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def obstacles_from_frame(frame: pd.DataFrame) -> tuple[Obstacle, ...]:
    """Read obstacles back from rows with the columns of `COLUMNS`.

    Raises:
        ProblemError: an unknown shape, a value that is not finite, a size that makes no such shape, or no rotation.
    """
    numbers = frame[list(COLUMNS[1:])].to_numpy(float)
    sound = np.isfinite(numbers).all(axis=1)
    if not sound.all():
        first = int(np.argmin(sound))
        raise ProblemError(f"obstacle {first} has a pose or size that is not finite: {numbers[first].tolist()}")
    if (numbers[:, 7:] <= 0).any():
        raise ProblemError(f"an obstacle has size {numbers[:, 7:].min()} m; sizes must be above 0 m")
    if not numbers[:, 3:7].any(axis=1).all():
        raise ProblemError("an obstacle has quaternion (0, 0, 0, 0); it must not be zero")
    found: list[Obstacle] = []
    for shape, row in zip(frame["shape"], numbers.tolist(), strict=True):
        if shape not in [kind.value for kind in PRIMITIVES]:
            raise ProblemError(f"unknown obstacle shape {shape!r}; known: {[s.value for s in PRIMITIVES]}")
        check_size(Shape(shape), row[7:], f"{len(found)}")
        found.append(Obstacle(Shape(shape), tuple(row[:3]), tuple(row[3:7]), tuple(row[7:])))
    return tuple(found)
