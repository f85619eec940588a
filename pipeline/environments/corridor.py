"""Corridors that an arm threads with a pen: thin walls, a long tool, a fixed height and no tilt."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.environments.furniture import box
from pipeline.environments.task import NEAR, NEAR_ITSELF, Ends, Family, Pair, held_down, over
from pipeline.robots import Obstacle, Shape, UrdfRobot, Validity
from pipeline.spec.statement import Statement
from pipeline.tasks import Setup

_CELL = 0.11  # from wall to wall, middle to middle [m]: corridors are 10 cm wide
_WALL = 0.01  # thickness [m]
_PEN = 0.01  # thickness [m]
_LENGTH = 0.14  # of the pen below the fingers [m]
_DEEP = 0.05  # the pen reaches this far between the walls [m]
_HIGH = 0.08  # walls [m]
_ROWS, _COLUMNS = 3, 5  # cells away from the robot, and beside each other
_CORNER = (0.36, -2.5 * _CELL)  # of the corridors, the nearest one [m]
_FLOOR = 0.1  # height of what the walls stand on [m]
_LOOPS = 2  # walls taken out of the maze, so that there is more than one way
_TRIES = 60  # of inverse kinematics


class PenCorridors(Family):
    """Tasks of an arm that holds a pen 1 cm thick, whose tip goes from one cell of a maze to the farthest one.

    Args:
        settings: of an arm that stands before the corridors.

    Raises:
        ConfigError: another one.
    """

    def __init__(self, settings: UrdfRobot) -> None:
        pen = Obstacle(Shape.BOX, (0.0, 0.0, _LENGTH / 2), (0.0, 0.0, 0.0, 1.0), (_PEN, _PEN, _LENGTH), "pen")
        self.height = _FLOOR + _HIGH - _DEEP + _LENGTH  # of the tool
        self._asked = held_down(settings, pen, self.height)
        self._arm = settings.name

    def scene(self, number: int, rng: np.random.Generator) -> tuple[Statement, Ends] | None:
        """See `Family`."""
        del number
        walls = _maze(rng)
        return replace(self._asked, obstacles=tuple(_boxes(walls))), partial(self._ends, walls)

    def name(self, number: int) -> str:
        """See `Family`."""
        return f"corridor {self._arm} {number}"

    def _ends(self, walls: set[frozenset[tuple[int, int]]], setup: Setup, rng: np.random.Generator) -> Pair | None:
        validity = setup.validity(NEAR, NEAR_ITSELF)
        first = (int(rng.integers(_ROWS)), int(rng.integers(_COLUMNS)))
        start, goal = (self._over(cell, setup, validity, rng) for cell in (first, _farthest(walls, first)))
        return None if start is None or goal is None else (start, goal)

    def _over(
        self, cell: tuple[int, int], setup: Setup, validity: Validity, rng: np.random.Generator
    ) -> np.ndarray | None:
        """Return a free configuration (n,) with the pen in the middle of a cell; None where none is found."""
        x, y = (corner + (index + 0.5) * _CELL for corner, index in zip(_CORNER, cell, strict=True))
        found = over(setup, (x, y, self.height)).solutions(rng, _TRIES, setup.robot.rest)
        return next((q for q in found if validity.free(q)), None)


def _maze(rng: np.random.Generator) -> set[frozenset[tuple[int, int]]]:
    """Return the walls between neighbouring cells of a maze drawn by depth-first search, less a few."""
    cells = [(i, j) for i in range(_ROWS) for j in range(_COLUMNS)]
    walls = {frozenset((a, b)) for a in cells for b in cells if abs(a[0] - b[0]) + abs(a[1] - b[1]) == 1}
    seen = {cells[int(rng.integers(len(cells)))]}
    stack = list(seen)
    while stack:
        around = sorted(next(iter(wall - {stack[-1]})) for wall in walls if stack[-1] in wall)
        fresh = [cell for cell in around if cell not in seen]
        if not fresh:
            stack.pop()
            continue
        following = fresh[int(rng.integers(len(fresh)))]
        walls.discard(frozenset((stack[-1], following)))
        seen.add(following)
        stack.append(following)
    order = sorted(walls, key=sorted)
    for i in rng.choice(len(order), _LOOPS, replace=False).tolist():
        walls.discard(order[i])
    return walls


def _farthest(walls: set[frozenset[tuple[int, int]]], cell: tuple[int, int]) -> tuple[int, int]:
    """Return the cell that is the most cells away, along corridors."""
    seen, front = [cell], [cell]
    while front:
        grown = []
        for i, j in front:
            for other in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                inside = 0 <= other[0] < _ROWS and 0 <= other[1] < _COLUMNS
                if inside and other not in seen and frozenset(((i, j), other)) not in walls:
                    seen.append(other)
                    grown.append(other)
        front = grown
    return seen[-1]


def _boxes(walls: set[frozenset[tuple[int, int]]]) -> Iterator[Obstacle]:
    """The floor, the walls around, and those between cells."""
    x, y = _CORNER
    deep, wide = _ROWS * _CELL, _COLUMNS * _CELL
    middle, z = (x + deep / 2, y + wide / 2), _FLOOR + _HIGH / 2
    yield box("floor", (*middle, _FLOOR - 0.01), (deep + 0.02, wide + 0.02, 0.02))
    for name, offset in (("near", -deep / 2), ("far", deep / 2)):
        yield box(f"{name} wall", (middle[0] + offset, middle[1], z), (_WALL, wide + _WALL, _HIGH))
    for name, offset in (("right", -wide / 2), ("left", wide / 2)):
        yield box(f"{name} wall", (middle[0], middle[1] + offset, z), (deep + _WALL, _WALL, _HIGH))
    for number, (a, b) in enumerate(sorted(sorted(wall) for wall in walls)):
        at = np.array(_CORNER) + (np.array(a) + np.array(b) + 1) / 2 * _CELL
        size = (_WALL, _CELL + _WALL, _HIGH) if a[0] != b[0] else (_CELL + _WALL, _WALL, _HIGH)
        yield box(f"wall {number}", (*at, z), size)
