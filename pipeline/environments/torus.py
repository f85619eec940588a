"""Mazes on a torus: a picture wrapped around it, whose dark pixels are walls (after OMPL's torus example)."""

import math
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.image import imread

from pipeline.constraints import Constraint
from pipeline.environments.task import Task
from pipeline.errors import ConstraintError, ProblemError, require
from pipeline.robots import Numbers, Robot, UrdfRobot, Validity, point_robot
from pipeline.verification.statement import Mazed, OnTorus, Point, Statement

MAJOR, MINOR = 2.0, 1.0  # radii of OMPL's example [m]
_DARK = 0.5  # brightness below which a pixel is a wall
_FINEST = 5e-5  # half of a chord's piece [m]: a way that passes a wall this near does not count as proven
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
    q, numbers = ca.SX.sym("q", robot.dimension), Numbers()
    p = robot.symbolic_pose(q, frame, numbers).position
    ring = ca.sqrt(p[0] ** 2 + p[1] ** 2) - numbers(major)
    return Constraint(
        "torus",
        q,
        ca.sqrt(ring**2 + p[2] ** 2) - numbers(minor),
        tolerance,
        max_iterations,
        [f"distance of {frame} from the torus [m]"],
        numbers,
    )


class TorusMaze:
    """The condition that a point keeps away from dark pixels: columns go around the axis, rows around the tube.

    With a margin of at least half the spacing at which a walk is checked, the walk passes no wall in between.

    Args:
        walls: True where there is a wall (rows, columns); both directions are closed.
        major: radius of the torus [m].
        margin: least distance from walls, along rows and along columns [m]; at most half a pixel where they are
            smallest.
        minor: radius of the tube [m].
    """

    name = "the maze"

    def __init__(self, walls: np.ndarray, major: float = MAJOR, margin: float = 0.0, minor: float = MINOR) -> None:
        if walls.ndim != 2 or walls.dtype != bool or not walls.size or walls.all():
            raise ProblemError(
                f"a maze is a picture with bright pixels; this one has shape {walls.shape}, no way through"
            )
        self.walls, self.major, self.minor = walls, major, minor
        self._rows, self._columns = walls.shape
        self.pixel_size = 2 * np.pi * min(minor / self._rows, (major - minor) / self._columns)  # the smallest [m]
        require("maze.margin", margin, at_least=0, at_most=self.pixel_size / 2, unit=" m")
        self.margin = margin
        self._flat = walls.ravel().tolist()

    def kept(self, margin: float) -> "TorusMaze":
        """Return the same maze with another margin [m]."""
        return TorusMaze(self.walls, self.major, margin, self.minor)

    def holds(self, q: np.ndarray) -> bool:
        """True when the pixels around the point q (3,), as far as the margin, are bright."""
        row, column = self._place(q)
        if not self.margin:
            return not self._dark(row, column)
        # A wall is at least a pixel wide, which is twice the margin: one that is near holds a corner of this square.
        high = self.margin * self._rows / (2 * math.pi * self.minor)
        wide = self.margin * self._columns / (2 * math.pi * max(math.hypot(q[0], q[1]), self.major - self.minor))
        return not (
            self._dark(row - high, column - wide)
            or self._dark(row - high, column + wide)
            or self._dark(row + high, column - wide)
            or self._dark(row + high, column + wide)
        )

    def reason(self, q: np.ndarray) -> str:
        """Return which pixel the point q (3,) is over, for messages."""
        row, column = self.pixel(q)
        near = f" or within {self.margin:.3g} m of one" if self.margin else ""
        return f"not meeting {self.name}: over pixel ({row}, {column}), a wall{near}"

    def first_gap(self, states: np.ndarray) -> int | None:
        """Return the first chord of a path (T, 3) that is not proven to pass over bright pixels only, margin aside."""
        for i in range(len(states) - 1):
            if not self._bright_along(states[i], states[i + 1]):
                return i
        return None

    def _bright_along(self, p: np.ndarray, q: np.ndarray) -> bool:
        """Tell whether all pixels that a ball around the chord can be over are bright, halving it where one is not."""
        middle, radius = (p + q) / 2, math.dist(p, q) / 2
        x, y, z = middle.tolist()
        out = math.hypot(x, y)
        tube = math.hypot(out - self.major, z)  # distance from the circle in the middle of the tube
        if min(out, tube) > 2 * radius:
            row, column = self._place(middle)
            high = math.asin(radius / tube) / (2 * math.pi) * self._rows  # half of what a ball covers, seen from there
            wide = math.asin(radius / out) / (2 * math.pi) * self._columns
            rows = range(math.floor(row - high), math.floor(row + high) + 1)
            columns = range(math.floor(column - wide), math.floor(column + wide) + 1)
            if not any(self._dark(i, j) for i in rows for j in columns):
                return True
        if radius < _FINEST:
            return False
        return self._bright_along(p, middle) and self._bright_along(middle, q)

    def pixel(self, q: np.ndarray) -> tuple[int, int]:
        """Return row and column of the pixel under q (3,) [m]."""
        row, column = self._place(q)
        return math.floor(row) % self._rows, math.floor(column) % self._columns

    def _place(self, q: np.ndarray) -> tuple[float, float]:
        x, y, z = q.tolist()
        turn = 2 * math.pi
        tube = math.atan2(z, math.hypot(x, y) - self.major)
        return tube / turn * self._rows, math.atan2(y, x) / turn * self._columns

    def _dark(self, row: float, column: float) -> bool:
        return bool(self._flat[math.floor(row) % self._rows * self._columns + math.floor(column) % self._columns])

    def point(self, row: float, column: float) -> np.ndarray:
        """Return the point of the torus (3,) [m] at a place of the picture; +0.5 is the middle of a pixel."""
        around, tube = 2 * np.pi * column / self._columns, 2 * np.pi * row / self._rows
        ring = self.major + self.minor * np.cos(tube)
        return np.array([ring * np.cos(around), ring * np.sin(around), self.minor * np.sin(tube)])


def read_maze(path: Path) -> TorusMaze:
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
    return TorusMaze(brightness < _DARK)


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
class MazeTask(Task):
    """A way through a maze; its checkers keep their margin from walls.

    Attributes:
        maze: the picture.
    """

    maze: TorusMaze = field(kw_only=True)

    def validity(self, margin: float = 0.0, self_margin: float = 0.0) -> Validity:
        """Return the checker that keeps `margin` [m] from walls."""
        return Validity(self.robot, (), conditions=[self.maze.kept(margin)])

    def statement(self, robot: UrdfRobot | None = None) -> Statement:
        """Return what the task says, for the verifier; its point has no settings."""
        maze = self.maze
        walls = Mazed(maze.walls, maze.major, maze.minor)
        point = Point(_RADIUS, *_limits(maze.major, maze.minor))
        return Statement(point, (OnTorus(maze.major, maze.minor),), self.tolerance, conditions=(walls,))


def maze_task(maze: TorusMaze, start: tuple[float, float], goal: tuple[float, float], name: str = "maze") -> MazeTask:
    """Return the task of getting from one place (row, column) of a maze's picture to another.

    Raises:
        ProblemError: a place in a wall.
    """
    robot = point_robot(_RADIUS, *_limits(maze.major, maze.minor))
    ends = [maze.point(*place) for place in (start, goal)]
    for which, place, q in zip(("start", "goal"), (start, goal), ends, strict=True):
        if not maze.holds(q):
            raise ProblemError(f"{which} {place} of the maze is in a wall")
    constraint = torus_constraint(robot, "point", maze.major, maze.minor)
    says = (OnTorus(maze.major, maze.minor),)
    return MazeTask(name, robot, constraint, (), ends[0], ends[1], says, maze=maze)


def _limits(major: float, minor: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return lower and upper limits of a point on a torus (3,) [m]."""
    reach, high = major + minor + 0.1, minor + 0.1
    return (-reach, -reach, -high), (reach, reach, high)


@dataclass(frozen=True)
class Mazes:
    """Mazes drawn at random, or one given picture, with start and goal far apart.

    Attributes:
        rows, columns: cells of a random maze.
        corridor, wall: their widths in pixels.
        picture: an image file to take instead; then only start and goal are random.
    """

    rows: int = 10
    columns: int = 15
    corridor: int = 3
    wall: int = 1
    picture: Path | None = None

    def task(self, seed: int, number: int) -> MazeTask:
        """Return problem `number` of a seed: from a random place to the farthest one, along the corridors.

        Raises:
            ProblemError: a picture that is none.
        """
        rng = np.random.default_rng([seed, number])
        if self.picture is not None:
            maze = read_maze(self.picture)
        else:
            maze = TorusMaze(random_maze(rng, self.rows, self.columns, self.corridor, self.wall))
        # In the middle of a corridor, as far as pixels tell: a bright pixel among bright ones where there is one.
        bright = ~maze.walls
        around = [np.roll(bright, shift, axis) for axis in (0, 1) for shift in (1, -1)]
        inner = np.argwhere(np.logical_and.reduce([bright, *around]))
        places = inner if len(inner) else np.argwhere(bright)
        start = places[rng.integers(len(places))]
        steps = _steps(maze.walls, (int(start[0]), int(start[1])))
        goal = places[int(np.argmax(steps[places[:, 0], places[:, 1]]))]
        ends = [(float(place[0]) + 0.5, float(place[1]) + 0.5) for place in (start, goal)]
        return maze_task(maze, ends[0], ends[1], f"maze {number}")


def _steps(walls: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    """Return how many pixels away every pixel is (rows, columns), around the torus; -1 where there is no way."""
    steps = np.full(walls.shape, -1)
    steps[start] = 0
    front = steps == 0
    while front.any():
        reached = np.logical_or.reduce([np.roll(front, shift, axis) for axis in (0, 1) for shift in (1, -1)])
        front = reached & ~walls & (steps < 0)
        steps[front] = steps.max() + 1
    return steps
