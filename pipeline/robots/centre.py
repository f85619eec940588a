"""Centres of mass of shapes of one density."""

import coal
import numpy as np
from scipy.spatial import ConvexHull

from pipeline.robots.meshes import Mesh
from pipeline.robots.shapes import BodyShape
from pipeline.robots.solids import Solid

_OFF = 1e-6  # from a face to either side of it, of the mesh's diagonal


def centre_of_mass(shape: BodyShape) -> np.ndarray:
    """Return the centre of mass (3,) [m] in the shape's frame; of an open mesh that of its surface."""
    if isinstance(shape.shape, coal.ConvexBase):
        corners = np.array(shape.shape.points())
        faces, middle = corners[ConvexHull(corners).simplices], corners.mean(axis=0)
        volumes = np.abs(np.linalg.det(faces - middle))
        return _mean((faces.sum(axis=1) + middle) / 4, volumes)
    if shape.convex:
        return np.zeros(3)
    if shape.mesh is None:
        boxes = np.array(shape.shape.toBoxes())
        return _mean(boxes[:, :3], boxes[:, 3] ** 3)
    if shape.open or shape.inside is None:
        return _mean(shape.mesh.corners.mean(axis=1), shape.mesh.areas)
    return _of_solid(shape.mesh, shape.inside)


def _of_solid(mesh: Mesh, inside: Solid) -> np.ndarray:
    """Sum over the pyramids between the origin and the faces, those that the body lies beyond of negative volume."""
    a, b, c = mesh.corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    step = _OFF * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))) * normals / np.where(length > 0, length, 1.0)
    middles = (a + b + c) / 3
    sides = [inside.contains(middles + sign * step) for sign in (-1, 1)]
    outward = sides[0].astype(float) - sides[1]  # 0 where both sides are inside, between parts that overlap
    return _mean((a + b + c) / 4, outward * np.einsum("fi,fi->f", a, np.cross(b, c)))


def _mean(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    found: np.ndarray = weights @ points / weights.sum()
    return found
