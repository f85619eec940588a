"""Voxel grids: a cube of cells, each of which tells whether a surface point lies in it (compnetx.txt, section VI-C)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.errors import ConfigError, require
from pipeline.files import read_arrays
from pipeline.perception.reach import reached
from pipeline.perception.surface import surface_points
from pipeline.robots import Obstacle, UrdfRobot
from pipeline.spec.statement import Point


@dataclass(frozen=True)
class VoxelParameters:
    """How a scene becomes a voxel grid.

    Attributes:
        size: cells per side; 40 for the sphere (compnetx.txt, section VI-C).
        density: surface points per area [1/m^2]. The authors draw 20 000 points on 500 blocks of side 0.1 m, that is
            on 30 m^2. A density and not a number, so that a scene with another surface looks alike. At this density
            and cells of 0.05 m, an inner cell of a flat surface is missed in exp(-1.67) = 19 % of all cases.
        lower, upper: corners of the grid [m]; both None where the robot's reach says them (`Perception.of`). The
            authors' are the limits of the robot, +-1 m. Blocks of side 0.1 m lying on the unit sphere reach out to
            1.052 m (1.087 m, were they turned at will), so that the grid clips 4 % of the points (`clipped_share`, 20
            scenes of scenario 1: 3.4 to 5.7 %): the outer faces of the blocks around +-x and +-y. The middle of such
            a block is still seen, its inner face is at 0.95 m.
        shell: None, or (radius, thickness) [m]: keep only points whose distance from the origin differs from the
            radius by at most the thickness. For scenes whose obstacles reach through the inside of the sphere, where
            no state is, so that they look as blocks on the sphere do. It cuts, it does not close: between the two
            faces of a thick slab the shell stays empty.
    """

    size: int = 40
    density: float = 20_000 / 30
    lower: tuple[float, float, float] | None = (-1.0, -1.0, -1.0)
    upper: tuple[float, float, float] | None = (1.0, 1.0, 1.0)
    shell: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        require("voxels.size", self.size, at_least=1)
        corners = (self.lower, self.upper)
        if corners != (None, None):
            if any(corner is None or np.shape(corner) != (3,) for corner in corners):
                raise ConfigError(f"voxel bounds are {corners}; each needs x, y and z [m], or both none")
            _check_grid(self.bounds, self.size)
        require("voxels.density", self.density, at_least=0)
        if self.shell is not None and not (
            np.shape(self.shell) == (2,) and all(0 < value < np.inf for value in self.shell)
        ):
            raise ConfigError(f"voxels.shell is {self.shell}; it must be empty or (radius, thickness), both above 0 m")

    @property
    def bounds(self) -> np.ndarray:
        """Corners of the grid (2, 3) [m].

        Raises:
            ConfigError: there are none; see `Perception.of`.
        """
        if self.lower is None or self.upper is None:
            raise ConfigError("voxel bounds are empty; name a robot, whose reach says them, or lower and upper")
        return np.array([self.lower, self.upper], float)


@dataclass(frozen=True)
class Perception:
    """How scenes become voxels; see `conf/perception/`."""

    seed: int
    voxels: VoxelParameters

    def __post_init__(self) -> None:
        require("perception.seed", self.seed, at_least=0)

    def of(self, robot: UrdfRobot | Point) -> VoxelParameters:
        """Return the voxels of scenes in which this robot acts."""
        if self.voxels.lower is not None:
            return self.voxels
        lower, upper = (tuple(corner) for corner in reached(robot).tolist())
        return replace(self.voxels, lower=lower, upper=upper)


def voxelise(points: np.ndarray, bounds: np.ndarray, size: int) -> np.ndarray:
    """Return which cells of a grid hold at least one point.

    Args:
        points: in the world (N, 3) [m]. Points outside the bounds are left out; a point on an upper bound belongs to
            the last cell.
        bounds: corners of the grid (2, 3) [m].
        size: cells per side.

    Returns:
        Occupancy (size, size, size) of bool, indexed [x, y, z].

    Raises:
        ConfigError: the bounds are empty, not finite or of another shape, or the size is below 1.
    """
    bounds = np.asarray(bounds, float)
    _check_grid(bounds, size)
    points = points[_inside(points, bounds)]
    cells = np.minimum(((points - bounds[0]) / (bounds[1] - bounds[0]) * size).astype(int), size - 1)
    grid = np.zeros((size, size, size), bool)
    grid[tuple(cells.T)] = True
    return grid


def scene_voxels(obstacles: Sequence[Obstacle], parameters: VoxelParameters, seed: int) -> np.ndarray:
    """Return the voxel grid of a scene (size, size, size) of bool, indexed [x, y, z]; equal seeds give equal grids."""
    return voxelise(_points(obstacles, parameters, seed), parameters.bounds, parameters.size)


def clipped_share(obstacles: Sequence[Obstacle], parameters: VoxelParameters, seed: int) -> float:
    """Return the share of a scene's surface points that the bounds leave out, after the shell; 0 without any points."""
    points = _points(obstacles, parameters, seed)
    return 1.0 - float(_inside(points, parameters.bounds).mean()) if len(points) else 0.0


def _points(obstacles: Sequence[Obstacle], parameters: VoxelParameters, seed: int) -> np.ndarray:
    points = surface_points(obstacles, parameters.density, np.random.default_rng(seed))
    if parameters.shell is None:
        return points
    radius, thickness = parameters.shell
    return points[np.abs(np.linalg.norm(points, axis=1) - radius) <= thickness]


def _inside(points: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    return ((points >= bounds[0]) & (points <= bounds[1])).all(axis=1)


def _check_grid(bounds: np.ndarray, size: int) -> None:
    require("voxels.size", size, at_least=1)
    if bounds.shape != (2, 3) or not np.isfinite(bounds).all() or not (bounds[0] < bounds[1]).all():
        raise ConfigError(f"voxel bounds are {bounds.tolist()}; expected finite corners (2, 3) [m], lower below upper")


def read_voxels(path: Path) -> dict[str, np.ndarray]:
    """Return the grids (L, W, H) of bool that the voxels stage wrote, by scene.

    Raises:
        ArtifactError: the file is missing, truncated or foreign.
    """
    grids = read_arrays(path, "voxels", ("scene", "voxels"))
    return dict(zip(grids["scene"].tolist(), grids["voxels"], strict=True))
