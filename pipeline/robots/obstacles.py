"""Obstacles: shapes at a fixed pose in the world."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

import coal
import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.errors import ProblemError

COLUMNS = ("shape", "x", "y", "z", "qx", "qy", "qz", "qw", "size_x", "size_y", "size_z")


class Shape(Enum):
    """Geometric primitive; `size` is given per shape in metres."""

    BOX = "box"  # full extents
    SPHERE = "sphere"  # (diameter, diameter, diameter)
    CYLINDER = "cylinder"  # (diameter, diameter, length along z)


@dataclass(frozen=True)
class Obstacle:
    """A primitive at a pose in the world frame.

    Attributes:
        shape: which primitive.
        position: of its centre in the world (3,) [m].
        quaternion: orientation in the world, (x, y, z, w).
        size: full extents (3,) [m], see `Shape`.
    """

    shape: Shape
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    size: tuple[float, float, float]

    @property
    def rotation(self) -> np.ndarray:
        """Rotation matrix from the obstacle's frame to the world (3, 3)."""
        return Rotation.from_quat(self.quaternion).as_matrix()

    def collision_object(self) -> coal.CollisionObject:
        """Return the obstacle as a coal object with its bounding box computed."""
        x, y, z = self.size
        geometry: coal.CollisionGeometry
        if self.shape is Shape.BOX:
            geometry = coal.Box(x, y, z)
        elif self.shape is Shape.SPHERE:
            geometry = coal.Sphere(x / 2)
        else:
            geometry = coal.Cylinder(x / 2, z)
        placed = coal.CollisionObject(geometry, self.rotation, np.array(self.position))
        placed.computeAABB()
        return placed


def obstacles_to_frame(obstacles: Iterable[Obstacle]) -> pd.DataFrame:
    """Return one row per obstacle with the columns of `COLUMNS`."""
    rows = [(o.shape.value, *o.position, *o.quaternion, *o.size) for o in obstacles]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def obstacles_from_frame(frame: pd.DataFrame) -> tuple[Obstacle, ...]:
    """Read obstacles back from rows with the columns of `COLUMNS`.

    Raises:
        ProblemError: an unknown shape, a value that is not finite, a size that is not positive, or no rotation.
    """
    numbers = frame[list(COLUMNS[1:])].to_numpy(float)
    if not np.isfinite(numbers).all():
        raise ProblemError("an obstacle has a pose or size that is not finite")
    if (numbers[:, 7:] <= 0).any():
        raise ProblemError(f"an obstacle has size {numbers[:, 7:].min()} m; sizes must be above 0 m")
    if not numbers[:, 3:7].any(axis=1).all():
        raise ProblemError("an obstacle has quaternion (0, 0, 0, 0); it must not be zero")
    found = []
    for shape, row in zip(frame["shape"], numbers.tolist(), strict=True):
        try:
            kind = Shape(shape)
        except ValueError:
            raise ProblemError(f"unknown obstacle shape {shape!r}; known: {[s.value for s in Shape]}") from None
        found.append(Obstacle(kind, tuple(row[:3]), tuple(row[3:7]), tuple(row[7:])))
    return tuple(found)
