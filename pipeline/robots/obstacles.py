"""Obstacles: shapes at a fixed pose in the world."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import coal
import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.errors import ProblemError

_OCTREE_REACH = 32768  # leaves from the origin; octomap drops points beyond without a word
COLUMNS = ("shape", "x", "y", "z", "qx", "qy", "qz", "qw", "size_x", "size_y", "size_z")


class Shape(Enum):
    """What an obstacle is; `size` is given per shape in metres."""

    BOX = "box"  # full extents
    SPHERE = "sphere"  # (diameter, diameter, diameter)
    CYLINDER = "cylinder"  # (diameter, diameter, length along z)
    MESH = "mesh"  # scale of the file's units along x, y, z
    OCTREE = "octree"  # (edge, edge, edge) of a leaf


PRIMITIVES = (Shape.BOX, Shape.SPHERE, Shape.CYLINDER)


@dataclass(frozen=True)
class Obstacle:
    """A shape at a pose in the world frame.

    Attributes:
        shape: which one.
        position: of its centre, or the origin of its file or points, in the world (3,) [m].
        quaternion: orientation in the world, (x, y, z, w).
        size: full extents (3,) [m], see `Shape`.
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
            ProblemError: a size that is not above 0 m, a pose that is not finite, a mesh file that is missing or cannot
                be read, or an octree without points.
        """
        x, y, z = self.size
        if not all(0 < extent < np.inf for extent in self.size) and self.shape is not Shape.MESH:
            raise ProblemError(f"{self.shape.value} {self.name!r} has size {self.size}; sizes must be above 0 m")
        if not np.isfinite([*self.position, *self.quaternion]).all():
            raise ProblemError(f"{self.shape.value} {self.name!r} is at {self.position}, {self.quaternion}: not finite")
        if self.shape is Shape.BOX:
            return coal.Box(x, y, z)
        if self.shape is Shape.SPHERE:
            return coal.Sphere(x / 2)
        if self.shape is Shape.CYLINDER:
            return coal.Cylinder(x / 2, z)
        if self.shape is Shape.MESH:
            return _mesh(self.file, np.array(self.size))
        if self.points is None or not len(self.points) or not np.isfinite(self.points).all():
            raise ProblemError(f"octree {self.name!r} needs points, and finite ones")
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


def _mesh(file: str, scale: np.ndarray) -> coal.BVHModelBase:
    path = Path(file)
    if not path.is_file():
        raise ProblemError(f"there is no mesh {file!r}")
    try:
        mesh = coal.MeshLoader().load(str(path), scale)
    except Exception as error:  # what assimp's C++ throws has no class of its own
        raise ProblemError(f"mesh {file!r} cannot be read: {str(error).strip()}") from None
    if not mesh.num_vertices or not np.isfinite(mesh.vertices()).all():
        raise ProblemError(f"mesh {file!r} has no vertices, or some that are not finite")
    return mesh


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
        ProblemError: an unknown shape, a value that is not finite, a size that is not positive, or no rotation.
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
    found = []
    for shape, row in zip(frame["shape"], numbers.tolist(), strict=True):
        if shape not in [kind.value for kind in PRIMITIVES]:
            raise ProblemError(f"unknown obstacle shape {shape!r}; known: {[s.value for s in PRIMITIVES]}")
        found.append(Obstacle(Shape(shape), tuple(row[:3]), tuple(row[3:7]), tuple(row[7:])))
    return tuple(found)
