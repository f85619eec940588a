"""The sphere environment (compnetx.txt, section VI-A): a point mass among blocks on the unit sphere.

Scenario 1, "blocks": cubes centred on the sphere and aligned to its tangent plane, placed as in the authors' generator
(AtlasSphere, GenerateBrickConfig.cpp): phi = acos(0.75 U[-1, 1]), theta = pi U[-1, 1]. Scenario 2, "bands": the three
slabs with one gap each of OMPL's sphere demo, never trained on.

Where this departs from the original: starts and goals are uniform on the sphere (the original normalises uniform
points of a cube, which favours its corners), and start and goal of a problem lie in one connected piece of the free
space, found by flood fill: pairs that no path joins measure nothing.
"""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pipeline.errors import ConfigError, ProblemError, require
from pipeline.robots import Obstacle, Shape
from pipeline.spec.scene import Scene, Split, task_rows
from pipeline.spec.statement import OnSphere, Point, Statement
from pipeline.tasks import set_up

BLOCKS, BANDS = "blocks", "bands"
_IDENTITY = (0.0, 0.0, 0.0, 1.0)
_MOST_TRIES = 10_000  # draws of a start or goal before a scene counts as full


@dataclass(frozen=True)
class Band:
    """A slab low < z < high with a gap |x| or |y| < gap / 2 on one side.

    Attributes:
        low, high: its range of z [m].
        gap_axis: the coordinate that is small in the gap, "x" or "y".
        side: sign of the other coordinate in the gap, +1 or -1.
        gap: width of the gap [m].
    """

    low: float
    high: float
    gap_axis: str
    side: int
    gap: float = 0.1

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ConfigError(f"band has low = {self.low} and high = {self.high}; low must be below high")
        if self.gap_axis not in ("x", "y"):
            raise ConfigError(f"band.gap_axis is {self.gap_axis!r}; choices: x, y")
        if self.side not in (-1, 1):
            raise ConfigError(f"band.side is {self.side}; choices: -1, 1")
        require("band.gap", self.gap, above=0, unit=" m")

    def obstacles(self, reach: float) -> list[Obstacle]:
        """Return the slab out to |x|, |y| = reach [m] as one box behind the gap and two beside it."""
        centre, height, half = (self.low + self.high) / 2, self.high - self.low, self.gap / 2
        parts = [((-reach, 0.0), (-reach, reach)), ((0.0, reach), (half, reach)), ((0.0, reach), (-reach, -half))]
        found = []
        for (a_low, a_high), (b_low, b_high) in parts:  # a: across the gap, b: along the small coordinate
            a, b = self.side * (a_low + a_high) / 2, (b_low + b_high) / 2
            a_size, b_size = a_high - a_low, b_high - b_low
            x, y = (a, b) if self.gap_axis == "y" else (b, a)
            size = (a_size, b_size, height) if self.gap_axis == "y" else (b_size, a_size, height)
            found.append(Obstacle(Shape.BOX, (x, y, centre), _IDENTITY, size))
        return found


@dataclass(frozen=True)
class SphereEnvironment:
    """Parameters of the environment; see `conf/environment/sphere.yaml` for where each number comes from."""

    name: str = "sphere"
    seed: int = 0
    radius: float = 1.0
    robot_radius: float = 0.001
    reach: float = 1.1
    tolerance: float = 0.001
    margin: float = 0.005
    blocks: int = 500
    block_size: float = 0.1
    latitude: float = 0.75
    bands: tuple[Band, ...] = field(default_factory=tuple)
    grid: int = 100_000
    slack: float = 0.003
    self_margin: float = 0.0

    def __post_init__(self) -> None:
        positive = ("radius", "robot_radius", "reach", "tolerance", "block_size", "latitude", "grid")
        for name in positive:
            require(f"environment.{name}", getattr(self, name), above=0)
        for name in ("seed", "blocks", "margin", "slack"):
            require(f"environment.{name}", getattr(self, name), at_least=0)
        if self.reach <= self.radius:
            raise ConfigError(f"environment.reach is {self.reach} m; it must be above the radius, {self.radius} m")
        require("environment.latitude", self.latitude, at_most=1)  # the poles

    def statement(self, obstacles: tuple[Obstacle, ...]) -> Statement:
        """Return what is asked of paths among obstacles: a point at a distance from the origin, clear of them."""
        point = Point(self.robot_radius, (-self.reach,) * 3, (self.reach,) * 3)
        return Statement(point, (OnSphere("point", self.radius),), self.tolerance, obstacles)

    def scenes(self, counts: dict[Split, int]) -> list[Scene]:
        """Return the scenes of scenario 1, `counts` per split, and the one of scenario 2.

        Scene i depends on the seed and i only: a smaller profile has the first scenes of a larger one's splits.
        """
        for split, count in counts.items():
            require(f"scenes.{split.value}", count, at_least=0)
        found = []
        for k, split in enumerate(Split):
            for i in range(counts.get(split, 0)):
                rng = np.random.default_rng([self.seed, 1, k, i])
                blocks = self.statement(self._blocks(rng))
                found.append(Scene(BLOCKS, f"{BLOCKS}-{split.value}-{i:03d}", split, (blocks,)))
        slabs = tuple(box for band in self.bands for box in band.obstacles(self.reach))
        if slabs:
            found.append(Scene(BANDS, BANDS, Split.TEST, (self.statement(slabs),)))
        return found

    def tasks(self, scene: Scene, count: int) -> pd.DataFrame:
        """See `Environment`.

        Raises:
            ProblemError: the scene has no room for a start and a goal.
        """
        require("the number of problems", count, at_least=0)
        rng = np.random.default_rng([self.seed, 2, *scene.name.encode()])
        space = _FreeSpace(self, scene)
        ends: list[tuple[np.ndarray, np.ndarray]] = []
        for _ in range(count):
            for _ in range(_MOST_TRIES):
                start, goal = space.draw(rng), space.draw(rng)
                if space.piece(start) == space.piece(goal):
                    break
            else:
                raise ProblemError(f"scene {scene.name!r}: no connected start and goal in {_MOST_TRIES} draws")
            ends.append((start, goal))
        return task_rows(scene, ends)

    def _blocks(self, rng: np.random.Generator) -> tuple[Obstacle, ...]:
        size = (self.block_size,) * 3
        found = []
        for z, theta in zip(
            self.latitude * rng.uniform(-1, 1, self.blocks), np.pi * rng.uniform(-1, 1, self.blocks), strict=True
        ):
            phi = np.arccos(z)
            # Local z along the radius, local x along the meridian: the block is aligned to the tangent plane.
            orientation = Rotation.from_euler("ZY", [theta, phi])
            x, y, height = (self.radius * orientation.apply([0.0, 0.0, 1.0])).tolist()
            qx, qy, qz, qw = orientation.as_quat().tolist()
            found.append(Obstacle(Shape.BOX, (x, y, height), (qx, qy, qz, qw), size))
        return tuple(found)


class _FreeSpace:
    """The free part of the sphere as a grid with its connected pieces, found with `slack` on top of the margin."""

    def __init__(self, environment: SphereEnvironment, scene: Scene) -> None:
        self.environment = environment
        margin = environment.margin + environment.slack
        self.validity = set_up(scene.statement).validity(margin)
        grid = environment.radius * fibonacci_sphere(environment.grid)
        free = self.validity.free_rows(grid)
        if not free.any():
            raise ProblemError(f"scene {scene.name!r} has no free space at a margin of {margin} m")
        # Grid points are sqrt(4 pi / N) apart; neighbours in all directions are within 1.8 times that.
        reach = 1.8 * environment.radius * np.sqrt(4 * np.pi / environment.grid)
        pairs = cKDTree(grid).query_pairs(reach, output_type="ndarray")
        ends = free[pairs]
        border = np.zeros(len(grid), bool)
        border[pairs[ends.any(axis=1) & ~ends.all(axis=1)]] = True
        links = pairs[ends.all(axis=1)]
        # Along an obstacle a link may cut a corner: it counts only where its middle is free too.
        along = border[links].all(axis=1)
        middles = grid[links[along]].mean(axis=1)
        sound = np.ones(len(links), bool)
        sound[along] = self.validity.free_rows(middles)
        links = links[sound]
        graph = coo_matrix((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(len(grid),) * 2)
        _, pieces = connected_components(graph, directed=False)
        self.tree, self.pieces = cKDTree(grid[free]), pieces[free]

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return a free point, uniform on the sphere (3,)."""
        for _ in range(_MOST_TRIES):
            q = rng.normal(size=3)
            q *= self.environment.radius / np.linalg.norm(q)
            if self.validity.free(q):
                return q
        raise ProblemError(f"no free point on the sphere in {_MOST_TRIES} draws")

    def piece(self, q: np.ndarray) -> int:
        """Return the number of the connected piece that q (3,) belongs to."""
        return int(self.pieces[self.tree.query(q)[1]])


def fibonacci_sphere(count: int) -> np.ndarray:
    """Return `count` nearly even points on the unit sphere (count, 3)."""
    i = np.arange(count) + 0.5
    phi, theta = np.arccos(1 - 2 * i / count), np.pi * (1 + np.sqrt(5)) * i
    return np.column_stack([np.cos(theta) * np.sin(phi), np.sin(theta) * np.sin(phi), np.cos(phi)])
