"""The torus, and mazes on it: a picture wrapped around it, whose dark pixels are walls (after OMPL's example)."""

import math

import casadi as ca
import numpy as np

from pipeline.constraints.base import Constraint
from pipeline.errors import ConstraintError, ProblemError, require
from pipeline.robots import Numbers, Robot

MAJOR, MINOR = 2.0, 1.0  # radii of OMPL's example [m]
_FINEST = 5e-5  # half of a chord's piece [m]: a way that passes a wall this near does not count as proven


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
