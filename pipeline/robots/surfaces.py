"""Triangles of collision shapes, for pictures and recordings."""

import coal
import numpy as np
from scipy.spatial import ConvexHull

_AROUND = 24  # corners of a circle


def triangles(geometry: coal.CollisionGeometry) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (V, 3) [m] in the shape's frame and faces (F, 3) as indices into them.

    Shapes without a surface (half-spaces, planes) give none.
    """
    if isinstance(geometry, coal.Box):
        return _hull(np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * geometry.halfSide)
    if isinstance(geometry, coal.Sphere):
        return _lathe([(geometry.radius * np.sin(t), -geometry.radius * np.cos(t)) for t in np.linspace(0, np.pi, 13)])
    if isinstance(geometry, coal.Capsule):
        r, h = geometry.radius, geometry.halfLength
        low = [(r * np.sin(t), -h - r * np.cos(t)) for t in np.linspace(0, np.pi / 2, 7)]
        return _lathe([*low, *((x, -z) for x, z in reversed(low))])
    if isinstance(geometry, coal.Cylinder):
        r, h = geometry.radius, geometry.halfLength
        return _lathe([(0.0, -h), (r, -h), (r, h), (0.0, h)])
    if isinstance(geometry, coal.ConvexBase):
        return _hull(np.array(geometry.points()))
    if isinstance(geometry, coal.BVHModelBase):
        corners = [geometry.tri_indices(i) for i in range(geometry.num_tris)]
        faces = [[corner[0], corner[1], corner[2]] for corner in corners]  # iterating over one runs past its end
        return np.array(geometry.vertices()), np.array(faces).reshape(-1, 3)
    if isinstance(geometry, coal.OcTree):
        return _leaves(np.array(geometry.toBoxes()))
    return np.empty((0, 3)), np.empty((0, 3), int)


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    a, b, c = (points[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return points, faces


def _lathe(profile: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """A surface of revolution about z of points (radius, z) from the lowest to the highest."""
    turn = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    rings = [np.stack([r * np.cos(turn), r * np.sin(turn), np.full(_AROUND, z)], axis=1) for r, z in profile]
    i, ahead = np.arange(_AROUND), (np.arange(_AROUND) + 1) % _AROUND
    faces = []
    for k in range(len(rings) - 1):
        low, high = k * _AROUND, (k + 1) * _AROUND
        faces += [
            np.stack([low + i, low + ahead, high + ahead], axis=1),
            np.stack([low + i, high + ahead, high + i], axis=1),
        ]
    return np.concatenate(rings), np.concatenate(faces)


def _leaves(boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cubes of rows (x, y, z, edge, ...)."""
    corners, faces = _hull(np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]))
    vertices = boxes[:, None, :3] + corners * boxes[:, None, 3:4]
    return vertices.reshape(-1, 3), (faces + 8 * np.arange(len(boxes))[:, None, None]).reshape(-1, 3)
