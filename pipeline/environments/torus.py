"""Mazes on a torus: a picture wrapped around it, whose dark pixels are walls (after OMPL's torus example)."""

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.image import imread

from pipeline.constraints import Constraint
from pipeline.errors import ConstraintError, ProblemError, require
from pipeline.robots import Robot, Validity, point_robot

MAJOR, MINOR = 2.0, 1.0  # radii of OMPL's example [m]
_DARK = 0.5  # brightness below which a pixel is a wall
_RADIUS = 1e-3  # of the point [m]; the picture knows nothing of it


def torus_constraint(
    robot: Robot,
    frame: str,
    major: float = MAJOR,
    minor: float = MINOR,
    tolerance: float = 1e-3,
    max_iterations: int = 50,
) -> Constraint:
    """Return F(q) = distance of `frame` [m] from a circle of radius `major` about the world's z axis, less `minor`.

    Raises:
        ConstraintError: radii that are not 0 < minor < major.
        RobotError: the robot has no such frame.
    """
    if not 0 < minor < major < np.inf:
        raise ConstraintError(f"a torus has 0 < minor < major; minor is {minor} m, major {major} m")
    q = ca.SX.sym("q", robot.dimension)
    p = robot.symbolic_pose(q, frame).position
    ring = ca.sqrt(p[0] ** 2 + p[1] ** 2) - major
    return Constraint(
        "torus",
        q,
        ca.sqrt(ring**2 + p[2] ** 2) - minor,
        tolerance,
        max_iterations,
        [f"distance of {frame} from the torus [m]"],
    )


class TorusMaze:
    """The condition that a point's pixel is bright: columns go around the axis, rows around the tube.

    Args:
        walls: True where there is a wall (rows, columns); both directions are closed.
        major: radius of the torus [m].
    """

    name = "the maze"

    def __init__(self, walls: np.ndarray, major: float = MAJOR) -> None:
        if walls.ndim != 2 or walls.dtype != bool or not walls.size or walls.all():
            raise ProblemError(
                f"a maze is a picture with bright pixels; this one has shape {walls.shape}, no way through"
            )
        self.walls, self.major = walls, major
        self._rows, self._columns = walls.shape
        self._flat = walls.ravel().tolist()

    def holds(self, q: np.ndarray) -> bool:
        """True when the pixel of the point q (3,) is bright."""
        row, column = self.pixel(q)
        return not self._flat[row * self._columns + column]

    def pixel(self, q: np.ndarray) -> tuple[int, int]:
        """Return row and column of the pixel under q (3,) [m]."""
        x, y, z = q
        around, tube = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y) - self.major)
        row, column = tube / (2 * np.pi) * self._rows, around / (2 * np.pi) * self._columns
        return int(np.floor(row)) % self._rows, int(np.floor(column)) % self._columns

    def point(self, row: float, column: float, minor: float = MINOR) -> np.ndarray:
        """Return the point of the torus (3,) [m] at a place of the picture; +0.5 is the middle of a pixel."""
        around, tube = 2 * np.pi * column / self._columns, 2 * np.pi * row / self._rows
        ring = self.major + minor * np.cos(tube)
        return np.array([ring * np.cos(around), ring * np.sin(around), minor * np.sin(tube)])


def read_maze(path: Path, major: float = MAJOR) -> TorusMaze:
    """Read any picture (PNG, and what Pillow reads) as a maze: pixels darker than half are walls.

    Raises:
        ProblemError: no picture, or one without a bright pixel.
    """
    try:
        picture = np.asarray(imread(path), float)
    except Exception as error:  # matplotlib and Pillow raise half a dozen kinds for what is no picture
        raise ProblemError(f"maze {str(path)!r} cannot be read: {' '.join(str(error).split())}") from None
    picture = picture / (255.0 if picture.max(initial=0) > 1 else 1.0)
    brightness = picture if picture.ndim == 2 else picture[..., :3].mean(axis=2)
    return TorusMaze(brightness < _DARK, major)


def random_maze(rng: np.random.Generator, rows: int, columns: int, corridor: int = 3, wall: int = 1) -> np.ndarray:
    """Return the walls of a maze, in which one way joins any two cells: (rows, columns) times (corridor + wall) pixels.

    Drawn by depth-first search on the torus' grid of cells; the way may go around it.

    Args:
        rng: of the maze.
        rows: cells.
        columns: likewise.
        corridor: width in pixels.
        wall: width in pixels.
    """
    for name, value in (("rows", rows), ("columns", columns)):
        require(f"maze.{name}", value, at_least=2)
    for name, value in (("corridor", corridor), ("wall", wall)):
        require(f"maze.{name}", value, at_least=1)
    pitch = corridor + wall
    walls = np.ones((rows * pitch, columns * pitch), bool)
    seen, stack = {(0, 0)}, [(0, 0)]
    walls[:corridor, :corridor] = False
    while stack:
        row, column = stack[-1]
        steps = [(row + dr, column + dc) for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0))]
        fresh = [s for s in steps if (s[0] % rows, s[1] % columns) not in seen]
        if not fresh:
            stack.pop()
            continue
        to_row, to_column = fresh[int(rng.integers(len(fresh)))]
        # From cell to cell, the wall between included; indices wrap around the torus.
        r = np.arange(min(row, to_row) * pitch, max(row, to_row) * pitch + corridor) % (rows * pitch)
        c = np.arange(min(column, to_column) * pitch, max(column, to_column) * pitch + corridor) % (columns * pitch)
        walls[np.ix_(r, c)] = False
        cell = (to_row % rows, to_column % columns)
        seen.add(cell)
        stack.append(cell)
    return walls


@dataclass(frozen=True)
class MazeProblem:
    """A maze with a start and a goal (3,) on the torus [m]."""

    robot: Robot
    constraint: Constraint
    validity: Validity
    start: np.ndarray
    goal: np.ndarray


def maze_problem(maze: TorusMaze, start: tuple[float, float], goal: tuple[float, float]) -> MazeProblem:
    """Return the problem of getting from one place (row, column) of a maze's picture to another.

    Raises:
        ProblemError: a place in a wall.
    """
    reach = maze.major + MINOR + 0.1
    robot = point_robot(_RADIUS, [-reach, -reach, -MINOR - 0.1], [reach, reach, MINOR + 0.1])
    ends = [maze.point(*place) for place in (start, goal)]
    for name, place, q in zip(("start", "goal"), (start, goal), ends, strict=True):
        if not maze.holds(q):
            raise ProblemError(f"{name} {place} of the maze is in a wall")
    constraint = torus_constraint(robot, "point", maze.major)
    return MazeProblem(robot, constraint, Validity(robot, (), conditions=[maze]), *ends)
