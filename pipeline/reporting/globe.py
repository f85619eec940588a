"""Geometry of a picture of the sphere: what to show, from where, and what of it can be seen. No drawing here."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from pipeline.errors import ProblemError
from pipeline.robots import Obstacle, Shape

HORIZON = 0.05  # a point is seen well where its unit vector reaches this far towards the camera; less is edge-on
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2


@dataclass(frozen=True)
class Globe:
    """What one column of a picture shows.

    Attributes:
        obstacles: of the scene, in the world.
        start, goal: configurations on the sphere (3,) [m].
        paths: method -> path (T, 3) [m].
        cloud: samples (N, 3) [m], or None.
        cloud_color: of the samples.
        title: over the column; the caller puts n or the lengths there.
        radius: of the sphere [m].
    """

    obstacles: Sequence[Obstacle]
    start: np.ndarray
    goal: np.ndarray
    paths: Mapping[str, np.ndarray] = field(default_factory=dict)
    cloud: np.ndarray | None = None
    cloud_color: str = "#444444"
    title: str = ""
    radius: float = 1.0

    def __post_init__(self) -> None:
        named = {"start": self.start, "goal": self.goal, **{f"path of {m}": p for m, p in self.paths.items()}}
        if self.cloud is not None:
            named["cloud"] = self.cloud
        for name, points in named.items():
            if np.shape(points)[-1:] != (3,) or not np.isfinite(points).all():
                raise ProblemError(f"{name} has shape {np.shape(points)}; a picture needs finite points (..., 3)")

    def markers(self) -> np.ndarray:
        """Return everything that must be seen: start, goal and all paths (N, 3) [m]."""
        return np.vstack([self.start, self.goal, *self.paths.values()])


@dataclass(frozen=True)
class View:
    """An orthographic camera that looks at the origin.

    Attributes:
        direction: unit vector from the origin to the camera (3,).
        right, up: unit vectors of the picture's axes in the world (3,).
    """

    direction: np.ndarray
    right: np.ndarray
    up: np.ndarray

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return picture coordinates and depth towards the camera of points (..., 3) [m]."""
        return points @ np.column_stack([self.right, self.up, self.direction])  # (..., 3)

    def opposite(self) -> "View":
        """Return the view from the other side, with the same axis upwards."""
        return View(-self.direction, -self.right, self.up)


def views(globe: Globe, both_sides: bool = False) -> list[View]:
    """Return the cameras for a globe: along the mean direction of its paths, and from behind where that hides a part.

    Args:
        globe: what must be seen.
        both_sides: show the far side even where nothing but background is there.
    """
    near = look_at(globe.markers())
    hidden = (near.project(globe.markers())[:, 2] < HORIZON * globe.radius).any()
    return [near, near.opposite()] if both_sides or hidden else [near]


def look_at(points: np.ndarray) -> View:
    """Return the camera over the mean direction of points (N, 3); over the middle point where they cancel out."""
    units = points / np.linalg.norm(points, axis=1, keepdims=True)
    mean = units.mean(axis=0)
    direction = mean if np.linalg.norm(mean) > 0.05 else units[len(units) // 2]  # shorter means are mostly rounding
    direction = direction / np.linalg.norm(direction)
    # North is up, except over the poles, where it has no direction in the picture.
    north = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.95 else np.array([0.0, 1.0, 0.0])
    right = np.cross(north, direction)
    right /= np.linalg.norm(right)
    return View(direction, right, np.cross(direction, right))


def covered(points: np.ndarray, obstacles: Sequence[Obstacle]) -> np.ndarray:
    """Return which points (N, 3) lie inside an obstacle (N,)."""
    inside = np.zeros(len(points), bool)
    if not len(points):
        return inside
    tree = cKDTree(points)
    for obstacle in obstacles:
        near = np.array(tree.query_ball_point(obstacle.position, np.linalg.norm(obstacle.size) / 2), int)
        local = (points[near] - obstacle.position) @ obstacle.rotation  # (K, 3) in the obstacle's frame
        half = np.array(obstacle.size) / 2
        if obstacle.shape is Shape.BOX:
            hit = (np.abs(local) <= half).all(axis=1)
        elif obstacle.shape is Shape.SPHERE:
            hit = np.linalg.norm(local, axis=1) <= half[0]
        else:
            hit = (np.hypot(local[:, 0], local[:, 1]) <= half[0]) & (np.abs(local[:, 2]) <= half[2])
        inside[near[hit]] = True
    return inside


def corners(boxes: Sequence[Obstacle]) -> np.ndarray:
    """Return the corners of boxes in the world (N, 8, 3) [m], x slowest and z fastest."""
    found = [_CORNERS * box.size @ box.rotation.T + box.position for box in boxes]
    return np.array(found).reshape(-1, 8, 3)
