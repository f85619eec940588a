"""Capsules around bodies: few, close to the body, and known to hold all of it.

A capsule is convex: one that holds the corners of a part of a body holds the part, and what a closed mesh encloses
there. A ball is a capsule of no length, so that so many capsules are never looser than as many balls. Where one stands
out far, the body is cut across a principal axis and each part gets its own.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import coal
import numpy as np
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from pipeline.errors import RobotError
from pipeline.robots.surfaces import triangles

_MOST = 4  # capsules of one body: the pairs of two bodies grow with the square
_LOOSE = 3.0  # times the body's volume: a capsule of more is cut. Links of arms fill theirs, plates and trays do not
_FINE = 0.06  # radius [m] of capsules that are not cut: what they stand out by matters little
_WIDTHS = 50  # tried of capsules around a cylinder
_STEPS = 300  # of the search for an axis: with twice as many, volumes are less by a hundredth at most
_ROUNDING = 1e-9  # by which radii are larger [m]: of corners, kinematics and distances
_THIN = 1e-6  # least radius [m]
_KEPT = 512  # shapes whose capsules are kept


@dataclass(frozen=True)
class Capsule:
    """The points within `radius` [m] of the segment between two `ends` (2, 3) [m]."""

    ends: np.ndarray
    radius: float

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        length = float(np.linalg.norm(self.ends[1] - self.ends[0]))
        return float(np.pi * self.radius**2 * (length + 4 / 3 * self.radius))

    def beyond(self, points: np.ndarray) -> np.ndarray:
        """Return how far points (N, 3) are from the capsule [m], below 0 inside (N,)."""
        first, along = self.ends[0], self.ends[1] - self.ends[0]
        share = np.clip((points - first) @ along / max(float(along @ along), np.finfo(float).tiny), 0, 1)
        found: np.ndarray = np.linalg.norm(points - first - share[:, None] * along, axis=1) - self.radius
        return found


def capsules(shape: coal.CollisionGeometry) -> tuple[Capsule, ...]:
    """Return capsules that together hold a shape, in its frame; the same ones for the same shape.

    Of a mesh or an octree the convex hull is held.

    Raises:
        RobotError: a shape without a surface, such as a half-space, or one that coal makes thicker.
    """
    thicker = shape.getSweptSphereRadius() if isinstance(shape, coal.ShapeBase) else 0.0
    if thicker:
        raise RobotError(
            f"a {type(shape).__name__} has a swept sphere radius of {thicker:g} m, which capsules do not hold; it must "
            "be 0, and the shape itself as thick as is meant"
        )
    if isinstance(shape, coal.Sphere):
        return (_along_z(shape.radius, 0.0),)
    if isinstance(shape, coal.Capsule):
        return (_along_z(shape.radius, shape.halfLength),)
    if isinstance(shape, coal.Cylinder):
        return (_around_cylinder(shape.radius, shape.halfLength),)
    corners = triangles(shape)[0]
    if not len(corners):
        raise RobotError(f"a {type(shape).__name__} has no surface that capsules could hold")
    return _around(np.ascontiguousarray(corners, float).tobytes())


@lru_cache(maxsize=_KEPT)
def _around(content: bytes) -> tuple[Capsule, ...]:
    """Return capsules around points (N, 3), as bytes; kept, for every grasp makes a robot anew."""
    parts = [_Part(np.frombuffer(content).reshape(-1, 3))]
    while len(parts) < _MOST:
        loosest = max(parts, key=lambda part: part.loose)
        if not loosest.loose:
            break
        parts.remove(loosest)
        parts += loosest.halves
    return tuple(part.capsule for part in parts)


@dataclass(frozen=True, eq=False)
class _Part:
    """A convex part of a body: the hull of points (M, 3) [m]."""

    points: np.ndarray

    @cached_property
    def hull(self) -> ConvexHull | None:
        """The hull of the points; None where they are flat."""
        try:
            return ConvexHull(self.points)
        except (QhullError, ValueError):
            return None

    @property
    def corners(self) -> np.ndarray:
        """The corners of the hull (N, 3) [m]; all points where they are flat."""
        return self.points if self.hull is None else self.points[self.hull.vertices]

    @cached_property
    def axes(self) -> np.ndarray:
        """The principal axes of the corners as columns (3, 3)."""
        found: np.ndarray = np.linalg.svd(self.corners - self.corners.mean(axis=0), full_matrices=False)[2].T
        return found

    @cached_property
    def rough(self) -> tuple[float, np.ndarray]:
        """The volume of the least capsule along a principal axis [m^3], and a frame (3, 3) whose z is that axis."""
        frames = [np.roll(self.axes, 2 - k, axis=1) for k in range(3)]
        volumes = [_shortest(local, _middle(local)).volume for local in (self.corners @ frame for frame in frames)]
        return min(volumes), frames[int(np.argmin(volumes))]

    @property
    def loose(self) -> float:
        """The volume of its capsule [m^3]; 0 where the part fills it well or is flat, or the capsule is thin."""
        filled = self.hull is None or self.capsule.volume <= _LOOSE * self.hull.volume
        return 0.0 if filled or self.capsule.radius <= _FINE else self.capsule.volume

    @cached_property
    def capsule(self) -> Capsule:
        """The capsule of least volume that a simplex finds, from the best one along a principal axis."""
        frame, middle = self.rough[1], self.corners.mean(axis=0)
        size = float(np.ptp(self.corners, axis=0).max()) + _THIN
        local = (self.corners - middle) @ frame / size
        simplex = _middle(local) + 0.1 * np.vstack([np.zeros(5), np.eye(5)])
        best = minimize(
            lambda x: _shortest(local, x).volume,
            simplex[0],
            method="Nelder-Mead",
            options={"maxfev": _STEPS, "initial_simplex": simplex},
        )
        ends = middle + size * _shortest(local, best.x).ends @ frame.T
        # The radius is what corners need that were not turned and turned back.
        return Capsule(ends, max(float(Capsule(ends, 0.0).beyond(self.corners).max()), _THIN) + _ROUNDING)

    @cached_property
    def halves(self) -> list["_Part"]:
        """The parts on both sides of the best of three planes, each across a principal axis; not of a flat part."""
        assert self.hull is not None
        edges = np.sort(self.hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        ends, found = self.points[np.unique(edges, axis=0)], []  # (E, 2, 3)
        for axis in self.axes.T:
            height = ends @ axis
            height -= (height.min() + height.max()) / 2
            crossed = height.prod(axis=1) < 0
            (a, b), (h, k) = ends[crossed].swapaxes(0, 1), height[crossed].T
            section = a + (h / (h - k))[:, None] * (b - a)
            found.append([_Part(np.concatenate([ends[side * height >= 0], section])) for side in (-1, 1)])
        return min(found, key=lambda parts: sum(part.rough[0] for part in parts))


def _middle(points: np.ndarray) -> np.ndarray:
    """Return the parameters of `_shortest` (5,) of the axis along z through the middle of points (N, 3)."""
    return np.array([0, 0, *(points[:, :2].min(axis=0) + points[:, :2].max(axis=0)) / 2, 0])


def _shortest(points: np.ndarray, x: np.ndarray) -> Capsule:
    """Return the shortest capsule around points (N, 3) of a given axis and radius.

    Args:
        points: see above.
        x: the slopes of the axis against z, where it passes z = 0, and the root of what the radius has more than the
            farthest point needs, for a wider capsule may be shorter (5,).
    """
    axis = np.array([x[0], x[1], 1.0]) / np.sqrt(1 + x[0] ** 2 + x[1] ** 2)
    away = points - [x[2], x[3], 0.0]
    along = away @ axis
    across = np.maximum(np.einsum("ni,ni->n", away, away) - along**2, 0.0)
    radius = float(np.sqrt(across.max())) + x[4] ** 2
    reach = np.sqrt(radius**2 - np.minimum(across, radius**2))
    low, high = float((along + reach).min()), float((along - reach).max())
    if low > high:  # one ball is enough
        low = high = (low + high) / 2
    return Capsule(np.array([x[2], x[3], 0.0]) + np.outer([low, high], axis), radius)


def _along_z(radius: float, half: float) -> Capsule:
    return Capsule(np.array([[0, 0, -half], [0, 0, half]]), radius + _ROUNDING)


def _around_cylinder(radius: float, half: float) -> Capsule:
    """Return the capsule of least volume around a cylinder along z: a wider one is shorter."""
    widths = np.linspace(radius, np.hypot(radius, half), _WIDTHS)
    found = [_along_z(float(wide), half - float(np.sqrt(wide**2 - radius**2))) for wide in widths]
    return min(found, key=lambda capsule: capsule.volume)
