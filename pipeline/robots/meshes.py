"""Triangle meshes: which of their parts are closed, and whether the whole is convex."""

from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

_SAME = 1e-6  # of a mesh's diagonal: nearer vertices are one, as files round them to 6e-8 of their coordinates
_FLAT = 1e-12  # area of a face that is none, in squares of its longest side
_COMPARED = 3_000_000  # faces times planes that are compared to tell whether a mesh is convex


@dataclass(frozen=True)
class Mesh:
    """Triangles whose common vertices are one, each triangle once.

    Attributes:
        vertices: (V, 3) [m].
        faces: indices of corners (F, 3). Their winding has no meaning: files have it either way.
        part: of each face (F,): faces that share edges are one part.
        closed: of each part (P,) of bool: its edges have an even number of faces, so that it has an inside.
    """

    vertices: np.ndarray
    faces: np.ndarray
    part: np.ndarray
    closed: np.ndarray

    @classmethod
    def of(cls, vertices: np.ndarray, faces: np.ndarray) -> "Mesh":
        """Return the mesh of vertices (V, 3) [m] and faces (F, 3) as files have them, with vertices once per face."""
        points, once = np.unique(vertices, axis=0, return_inverse=True)
        near = cKDTree(points).query_pairs(_SAME * float(np.linalg.norm(np.ptp(points, axis=0))), output_type="ndarray")
        merged = _labels(near, len(points))
        points = points[np.unique(merged, return_index=True)[1]]
        faces = merged[once.ravel()][faces]
        corners = np.sort(faces, axis=1)
        kept = np.flatnonzero((np.diff(corners, axis=1) > 0).all(axis=1))  # others are lines
        kept = kept[np.sort(np.unique(corners[kept], axis=0, return_index=True)[1])]
        faces, corners = faces[kept], corners[kept]
        edges = corners[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2)
        edge = np.unique(edges[:, 0].astype(np.int64) * len(points) + edges[:, 1], return_inverse=True)[1].ravel()
        face = np.repeat(np.arange(len(faces)), 3)
        part = _labels(np.stack([face, len(faces) + edge], axis=1), len(faces) + int(edge.max(initial=-1)) + 1)
        odd = np.bincount(edge) % 2 == 1
        closed = np.ones(int(part.max(initial=-1)) + 1, bool)
        closed[part[len(faces) :][odd]] = False
        return cls(points, faces, part[: len(faces)], closed)

    @property
    def corners(self) -> np.ndarray:
        """The corners of the faces (F, 3, 3) [m]."""
        found: np.ndarray = self.vertices[self.faces]
        return found

    @property
    def areas(self) -> np.ndarray:
        """The areas of the faces (F,) [m^2]."""
        a, b, c = self.corners.swapaxes(0, 1)
        found: np.ndarray = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        return found

    @cached_property
    def hull(self) -> coal.ConvexBase | None:
        """The convex hull, where the mesh is closed and is its hull; None otherwise, or where coal cannot hold it."""
        if len(self.closed) != 1 or not self.closed[0]:
            return None
        try:  # qhull inside coal ends the process where it fails, inside scipy it raises
            hull = ConvexHull(self.vertices)
        except (QhullError, ValueError):
            return None
        return convex(self.vertices[hull.vertices]) if self._lies_on(hull) else None

    def surface(self, given: coal.BVHModelBase) -> coal.BVHModelBase:
        """Return coal's mesh of the faces that have an area: `given`, where it has no others.

        Without one, a face is in contact with balls far away from it (coal 3.0.3).
        """
        a, b, c = self.corners.swapaxes(0, 1)
        longest = np.maximum.reduce([np.einsum("fi,fi->f", side, side) for side in (b - a, c - b, a - c)])
        faces = self.faces[self.areas > _FLAT * longest]
        if len(faces) in (0, given.num_tris):
            return given
        made = coal.BVHModelOBBRSS()
        made.beginModel(len(faces), len(self.vertices))
        made.addVertices(self.vertices)
        made.addTriangles(faces.astype(np.int64))
        made.endModel()
        return made

    def _lies_on(self, hull: ConvexHull) -> bool:
        """Tell whether every face lies on a face of the hull: a closed surface that does is all of it."""
        tolerance = _SAME * float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

        def in_plane(face: np.ndarray, plane: np.ndarray) -> np.ndarray:
            """Tell for pairs of faces (K,) and planes of the hull (K,) whether the one lies in the other (K,)."""
            off = np.einsum("kci,ki->kc", self.corners[face], hull.equations[plane, :3])
            return np.abs(off + hull.equations[plane, 3:]).max(axis=1) <= tolerance

        # Of a face with a corner of the hull, the planes around that corner are those it may lie in.
        order = np.argsort(hull.simplices.ravel(), kind="stable")
        begin = np.searchsorted(hull.simplices.ravel()[order], np.arange(len(self.vertices) + 1))
        corner = np.take_along_axis(self.faces, np.diff(begin)[self.faces].argmax(axis=1)[:, None], axis=1)[:, 0]
        count = np.diff(begin)[corner]
        face = np.repeat(np.arange(len(self.faces)), count)
        place = np.arange(len(face)) + np.repeat(begin[corner] - np.cumsum(count) + count, count)
        lies = np.zeros(len(self.faces), bool)
        lies[face[in_plane(face, order[place] // 3)]] = True
        if not lies[count > 0].all():
            return False
        rest = np.flatnonzero(count == 0)  # in the middle of a face of the hull
        planes = np.unique(hull.equations.round(7), axis=0, return_index=True)[1]
        if len(rest) * len(planes) > _COMPARED:
            return False
        found = in_plane(np.repeat(rest, len(planes)), np.tile(planes, len(rest)))
        return bool(found.reshape(len(rest), len(planes)).any(axis=1).all())


def convex(points: np.ndarray) -> coal.ConvexBase | None:
    """Return coal's hull of the corners (N, 3) [m] of a convex body; None where coal cannot hold it."""
    listed = coal.StdVec_Vec3s()
    listed.extend(list(points))
    try:
        return coal.Convex.convexHull(listed, True, "Qt")
    except Exception:  # coal raises what its C++ throws: a corner with more than 255 neighbours
        return None


def arrays(mesh: coal.BVHModelBase) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (V, 3) [m] and faces (F, 3) of coal's mesh."""
    corners = (mesh.tri_indices(i) for i in range(mesh.num_tris))  # iterating over one runs past its end
    faces = [(corner[0], corner[1], corner[2]) for corner in corners]
    return np.array(mesh.vertices()).reshape(-1, 3), np.array(faces, int).reshape(-1, 3)


def _labels(pairs: np.ndarray, count: int) -> np.ndarray:
    """Return for 0 to count - 1 which group each is in (count,), where pairs (N, 2) belong together."""
    links = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    found: np.ndarray = connected_components(links, directed=False)[1]
    return found
