"""Shapes as collision checks take them: solid where they are closed, with the few numbers that save queries."""

from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from pipeline.robots.meshes import Mesh, arrays, convex
from pipeline.robots.solids import Solid

LARGEST = 20.0  # extent of a body [m]: larger ones are millimetres taken for metres
_ROUND = (coal.Sphere, coal.Capsule)
_FLAT = 1e-9  # half extent of a box around what is flat [m]


class BodyShape:
    """One body's shape.

    coal takes primitives and convex hulls as solid and a mesh as its surface. A mesh that is closed and convex is given
    to coal as its hull, which is the same body; another closed one has an `inside`.

    Args:
        given: the shape as the robot or the obstacle has it; `shape` is what coal is asked with.
    """

    def __init__(self, given: coal.CollisionGeometry) -> None:
        self.given = given
        self.mesh = Mesh.of(*arrays(given)) if isinstance(given, coal.BVHModelBase) else None
        self.shape: coal.CollisionGeometry = given
        if self.mesh is not None:
            self.shape = self.mesh.hull or self.mesh.surface(given)

    @property
    def convex(self) -> bool:
        """True for primitives and hulls, of which coal knows how deep they are in each other."""
        return isinstance(self.shape, coal.ShapeBase)

    @property
    def octree(self) -> bool:
        """True for leaves of an octree, which are solid."""
        return isinstance(self.shape, coal.OcTree)

    @property
    def open(self) -> bool:
        """True for a mesh that is, or has parts that are, a surface without an inside."""
        return self.mesh is not None and not (len(self.mesh.closed) and self.mesh.closed.all())

    @cached_property
    def inside(self) -> Solid | None:
        """What tells which points are in a closed mesh; None where coal takes the shape as solid, or for a surface."""
        if self.mesh is None or self.convex or not self.mesh.closed.any():
            return None
        return Solid(self.mesh)

    @cached_property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Middle and half extents (3,), (3,) [m] of the box around the shape along the axes of its frame."""
        self.shape.computeLocalAABB()
        low, high = (np.array(corner, float) for corner in (self.shape.aabb_local.min_, self.shape.aabb_local.max_))
        return (low + high) / 2, (high - low) / 2

    @cached_property
    def radius(self) -> float:
        """Of a ball around the middle of the box that holds the shape [m]."""
        if isinstance(self.shape, coal.Sphere):
            return float(self.shape.radius)
        middle, half = self.box
        if isinstance(self.shape, coal.ConvexBase):
            return float(np.linalg.norm(np.array(self.shape.points()) - middle, axis=1).max())
        return float(np.linalg.norm(half))

    @cached_property
    def thickness(self) -> float:
        """Least extent [m]: of a hull the least across one of its faces, of others the least side of their box."""
        if isinstance(self.shape, coal.ConvexBase):
            corners = np.array(self.shape.points())
            normals = np.unique(ConvexHull(corners).equations[:, :3].round(9), axis=0)
            chunks = np.array_split(normals, len(normals) // 500 + 1)
            return min(float(np.ptp(corners @ chunk.T, axis=0).min()) for chunk in chunks)
        return float(2 * self.box[1].min())

    @cached_property
    def kernel(self) -> tuple[np.ndarray, float]:
        """A ball in the shape: its middle (3,) and radius [m], 0 where only a point of the shape is known."""
        if isinstance(self.shape, _ROUND):
            return np.zeros(3), float(self.shape.radius)
        if isinstance(self.shape, coal.ConvexBase):
            corners = np.array(self.shape.points())
            middle = corners.mean(axis=0)
            planes = ConvexHull(corners).equations
            return middle, float(-(planes[:, :3] @ middle + planes[:, 3]).max())
        if isinstance(self.shape, coal.ShapeBase):  # a box, cylinder
            return np.zeros(3), float(self.box[1].min())
        return self.points[0], 0.0

    @cached_property
    def points(self) -> np.ndarray:
        """One point of each connected part (P, 3) [m]."""
        if self.convex:
            return self.kernel[0][None]
        if self.mesh is not None:
            first = np.unique(self.mesh.part, return_index=True)[1]
            found: np.ndarray = self.mesh.vertices[self.mesh.faces[first, 0]]
            return found
        boxes = np.array(self.shape.toBoxes())  # (N, 6): middle, edge, and how it is occupied
        near = cKDTree(boxes[:, :3]).query_pairs(float(boxes[:, 3].min()) * 1.01, output_type="ndarray")
        links = coo_matrix((np.ones(len(near), bool), (near[:, 0], near[:, 1])), shape=(len(boxes),) * 2)
        parts = connected_components(links, directed=False)[1]
        found = boxes[np.unique(parts, return_index=True)[1], :3]
        return found

    @cached_property
    def pieces(self) -> "list[Piece]":
        """Convex pieces that together hold the shape: never smaller than it."""
        if self.convex:
            return [Piece(self, np.zeros(3))]
        if self.mesh is None:
            rows = np.array(self.shape.toBoxes())
            return [Piece(BodyShape(coal.Box(*[row[3]] * 3)), row[:3]) for row in rows]
        hull = convex(self.mesh.vertices) if _spans(self.mesh.vertices) else None
        if hull is not None:
            return [Piece(BodyShape(hull), np.zeros(3))]
        middle, half = self.box
        return [Piece(BodyShape(coal.Box(*(2 * np.maximum(half, _FLAT)))), middle)]


@dataclass(frozen=True)
class Piece:
    """A part of a shape: convex, its frame at an offset (3,) [m] in that of the shape."""

    shape: BodyShape
    offset: np.ndarray


def _spans(corners: np.ndarray) -> bool:
    """Tell whether points (N, 3) are not all in a plane: qhull inside coal ends the process where they are."""
    try:
        ConvexHull(corners)
    except (QhullError, ValueError):
        return False
    return True
