"""Mazes on a torus, drawn at random or read from a picture."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.image import imread

from pipeline.constraints.torus import TorusMaze
from pipeline.environments.task import Ends, Family, Pair
from pipeline.errors import ProblemError, require
from pipeline.spec.statement import Mazed, OnTorus, Point, Statement
from pipeline.spec.task import TaskSpec, single
from pipeline.tasks import Setup

_DARK = 0.5  # brightness below which a pixel is a wall
_RADIUS = 1e-3  # of the point [m]; the picture knows nothing of it


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


def maze_task(maze: TorusMaze, start: tuple[float, float], goal: tuple[float, float], name: str = "maze") -> TaskSpec:
    """Return the task of getting from one place (row, column) of a maze's picture to another.

    Raises:
        ProblemError: a place in a wall.
    """
    ends = [maze.point(*place) for place in (start, goal)]
    for which, place, q in zip(("start", "goal"), (start, goal), ends, strict=True):
        if not maze.holds(q):
            raise ProblemError(f"{which} {place} of the maze is in a wall")
    return single(name, maze_statement(maze), *ends)


def maze_statement(maze: TorusMaze) -> Statement:
    """Return what is asked of ways through a maze: to stay on the torus, and off the walls."""
    return Statement(
        Point(_RADIUS, *_limits(maze.major, maze.minor)),
        (OnTorus(maze.major, maze.minor),),
        conditions=(Mazed(maze.walls, maze.major, maze.minor),),
    )


def _limits(major: float, minor: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return lower and upper limits of a point on a torus (3,) [m]."""
    reach, high = major + minor + 0.1, minor + 0.1
    return (-reach, -reach, -high), (reach, reach, high)


@dataclass(frozen=True)
class Mazes(Family):
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

    def scene(self, number: int, rng: np.random.Generator) -> tuple[Statement, Ends] | None:
        """See `Family`; from a random place to the farthest one, along the corridors.

        Raises:
            ProblemError: a picture that is none.
        """
        del number
        maze = (
            read_maze(self.picture)
            if self.picture is not None
            else TorusMaze(random_maze(rng, self.rows, self.columns, self.corridor, self.wall))
        )
        return maze_statement(maze), partial(_far_apart, maze)

    def name(self, number: int) -> str:
        """See `Family`."""
        return f"maze {number}"


def _far_apart(maze: TorusMaze, setup: Setup, rng: np.random.Generator) -> Pair | None:
    """Return a random place and the farthest one, in the middle of a corridor where pixels tell: among bright ones."""
    del setup
    bright = ~maze.walls
    around = [np.roll(bright, shift, axis) for axis in (0, 1) for shift in (1, -1)]
    inner = np.argwhere(np.logical_and.reduce([bright, *around]))
    places = inner if len(inner) else np.argwhere(bright)
    start = places[rng.integers(len(places))]
    steps = _steps(maze.walls, (int(start[0]), int(start[1])))
    goal = places[int(np.argmax(steps[places[:, 0], places[:, 1]]))]
    return maze.point(*(start + 0.5)), maze.point(*(goal + 0.5))


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
