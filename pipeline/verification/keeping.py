"""Conditions along whole paths: balance over a support polygon, and the walls of a maze on a torus."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from pipeline.errors import ConstraintError
from pipeline.spec.statement import Balanced, Inequality, Mazed
from pipeline.verification.along import Held, bend_of_mass, inequality
from pipeline.verification.kinematics import Kinematics

_FINEST = 5e-6  # half of a stretch of a chord past walls [m]: shorter ones are not asked for


def keeper(term: Inequality, kinematics: Kinematics) -> "Balance | Walls":
    """Return what holds a path against a condition."""
    return Balance(term, kinematics) if isinstance(term, Balanced) else Walls(term, kinematics)


class Balance:
    """The centre of mass is over the convex hull of points, seen from above, by a margin at least.

    Args:
        said: the condition.
        kinematics: of a robot with masses.

    Raises:
        ConstraintError: points that span no polygon.
    """

    name = "balance"

    def __init__(self, said: Balanced, kinematics: Kinematics) -> None:
        corners = np.asarray(said.points, float).reshape(-1, 3)[:, :2]
        try:
            corners = corners[ConvexHull(corners).vertices]  # counter-clockwise
        except (QhullError, ValueError):
            raise ConstraintError(f"the {len(corners)} points of support span no polygon") from None
        edges = np.roll(corners, -1, axis=0) - corners
        self._normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]  # inward
        self._least = np.sum(self._normals * corners, axis=1) + said.margin
        self._kinematics, self._bend = kinematics, bend_of_mass(kinematics)

    def slack(self, Q: np.ndarray) -> np.ndarray:
        """Return the distance of the centre of mass from the nearest edge, less the margin, at rows of Q (T, n) [m]."""
        over = self._kinematics.centre_of_mass(Q)[:, :2]
        return np.asarray((over @ self._normals.T - self._least).min(axis=1))

    def held(self, path: np.ndarray) -> Held:
        """Tell how far it holds along a path (T, n): a row bends no more than the centre of mass does."""
        return inequality(self.slack, self._bend, path)

    def message(self, worst: float) -> str:
        """Say in a sentence what is wrong."""
        return f"the robot is out of balance: its centre of mass is {-worst:.3g} m beyond the support polygon"


class Walls:
    """A point on a torus is over bright pixels: columns go around the axis, rows around the tube.

    Args:
        said: the condition.
        kinematics: of a robot with a frame `point`.
    """

    name = "the maze"

    def __init__(self, said: Mazed, kinematics: Kinematics) -> None:
        self._kinematics, self._major = kinematics, said.major
        self._dark = np.asarray(said.walls, bool)
        sums = np.cumsum(np.cumsum(np.tile(self._dark, (2, 2)).astype(int), axis=0), axis=1)
        self._sums = np.pad(sums, ((1, 0), (1, 0)))  # of dark pixels above and left, over two turns either way

    def slack(self, Q: np.ndarray) -> np.ndarray:
        """Return 1 over bright pixels and -1 over dark ones, at rows of Q (T, n)."""
        at = np.floor(self._place(self._points(Q))).astype(int) % self._dark.shape
        return np.where(self._dark[at[:, 0], at[:, 1]], -1.0, 1.0)

    def held(self, path: np.ndarray) -> Held:
        """Tell how far it holds along a path (T, 3): a ball around a stretch covers bright pixels only."""
        held = Held()
        bad = self.slack(path) < 0
        if bad.any():
            held.chord, held.worst = max(min(int(np.argmax(bad)), len(path) - 2), 0), -1.0
        chord, begin, end = np.arange(len(path) - 1), self._points(path[:-1]), self._points(path[1:])
        while len(chord):
            if held.chord is not None:
                before = chord < held.chord
                chord, begin, end = chord[before], begin[before], end[before]
            middle, radius = (begin + end) / 2, np.linalg.norm(end - begin, axis=1) / 2
            at = self._place(middle)
            dark = self._dark[tuple((np.floor(at).astype(int) % self._dark.shape).T)]
            if dark.any():
                held.chord, held.worst = int(chord[dark].min()), -1.0
            left = ~dark & ~self._bright_around(middle, radius, at)
            small = left & (radius < _FINEST)
            held.sampled.update(chord[small].tolist())
            left &= ~small
            chord = np.tile(chord[left], 2)
            begin, end = np.concatenate([begin[left], middle[left]]), np.concatenate([middle[left], end[left]])
        return held

    def message(self, worst: float) -> str:
        """Say in a sentence what is wrong."""
        return "the point is over a wall of the maze"

    def _points(self, Q: np.ndarray) -> np.ndarray:
        return self._kinematics.frame_poses(Q, "point")[1]

    def _place(self, points: np.ndarray) -> np.ndarray:
        """Return row and column, as real numbers, under points (N, 3) as (N, 2)."""
        x, y, z = points.T
        tube, around = np.arctan2(z, np.hypot(x, y) - self._major), np.arctan2(y, x)
        return np.stack([tube, around], axis=1) / (2 * np.pi) * self._dark.shape

    def _bright_around(self, points: np.ndarray, radius: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Tell whether balls (N,) cover bright pixels only; False as well where one is large for the torus."""
        out = np.hypot(points[:, 0], points[:, 1])
        tube = np.hypot(out - self._major, points[:, 2])
        fits = np.minimum(out, tube) > 2 * radius
        seen = np.stack([tube, out], axis=1)
        half = np.arcsin(np.minimum(radius[:, None] / np.maximum(seen, 1e-12), 0.5)) / (2 * np.pi) * self._dark.shape
        low, high = np.floor(at - half).astype(int), np.floor(at + half).astype(int) + 1
        span = high - low
        low %= self._dark.shape
        (r, c), (rows, columns) = low.T, (low + span).T
        count = self._sums[rows, columns] - self._sums[r, columns] - self._sums[rows, c] + self._sums[r, c]
        return np.asarray(fits & (count == 0))
