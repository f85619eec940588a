"""Triangle meshes: their closed parts, and what these enclose. The winding of faces has no meaning here."""

from dataclasses import dataclass

import coal
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

_SAME = 1e-6  # of a mesh's diagonal: nearer vertices are one, as single precision in files rounds them to 6e-8
_NO_AREA = 1e-12  # of a face, in squares of its longest side
_ASKED = 16  # corners of a part that tell whether it is inside another one
# Rays go along directions that no drawn edge has; three of them vote, so that one which meets an edge decides nothing.
_RAYS = np.array([[0.4271, 0.3113, 0.8489], [-0.7237, 0.5417, 0.4275], [0.2939, -0.8713, -0.3929]])


@dataclass(frozen=True)
class Surface:
    """Triangles with common corners.

    Attributes:
        corners: (V, 3) [m].
        faces: numbers of corners (F, 3); none without an area.
        parts: of each face (F,): faces that share an edge are of one part.
        closed: of each part, whether an even number of faces meets at every edge, so that it encloses something.
    """

    corners: np.ndarray
    faces: np.ndarray
    parts: np.ndarray
    closed: np.ndarray

    @classmethod
    def read(cls, mesh: coal.BVHModelBase) -> "Surface":
        """Return the triangles of coal's mesh."""
        given = np.array(mesh.vertices()).reshape(-1, 3)
        rows = (mesh.tri_indices(i) for i in range(mesh.num_tris))
        return cls.of(given, np.array([(row[0], row[1], row[2]) for row in rows], int).reshape(-1, 3))

    @classmethod
    def of(cls, given: np.ndarray, faces: np.ndarray) -> "Surface":
        """Return the triangles of corners (V, 3) [m], which may be there once for every face, and faces (F, 3)."""
        near = cKDTree(given).query_pairs(_SAME * float(np.linalg.norm(np.ptp(given, axis=0))), output_type="ndarray")
        labels = _groups(near, len(given))
        corners = given[np.unique(labels, return_index=True)[1]]
        faces = np.unique(np.sort(labels[faces], axis=1), axis=0)
        faces = faces[(np.diff(faces, axis=1) > 0).all(axis=1)]
        # Whether a surface is closed is told with the faces that have no area: they fill its edges.
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [0, 2]]])
        edge = np.unique(edges, axis=0, return_inverse=True)[1].ravel()
        count = int(edge.max(initial=-1)) + 1
        face = np.tile(np.arange(len(faces)), 3)
        parts = _groups(np.stack([face, len(faces) + edge], axis=1), len(faces) + count)[: len(faces)]
        names, parts = np.unique(parts, return_inverse=True)
        closed = np.ones(len(names), bool)
        closed[parts[face[(np.bincount(edge, minlength=count) % 2 == 1)[edge]]]] = False
        a, b, c = corners[faces].swapaxes(0, 1)
        longest = np.max([np.sum(np.square(side), axis=1) for side in (b - a, c - b, a - c)], axis=0)
        solid = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 2 * _NO_AREA * longest
        return cls(corners, faces[solid], parts[solid], closed)

    @property
    def open(self) -> bool:
        """True where a part encloses nothing."""
        return not self.closed.all()

    def coal(self) -> coal.BVHModelBase:
        """Return coal's mesh of the faces."""
        made = coal.BVHModelOBBRSS()
        made.beginModel(len(self.faces), len(self.corners))
        made.addVertices(np.ascontiguousarray(self.corners))
        made.addTriangles(self.faces.astype(np.int64))
        made.endModel()
        return made

    def is_convex(self) -> bool:
        """Tell whether the mesh is closed and the surface of its convex hull."""
        if len(self.closed) != 1 or not self.closed[0]:
            return False
        try:
            hull = ConvexHull(self.corners)
        except (QhullError, ValueError):
            return False
        planes = np.unique(hull.equations.round(8), axis=0)
        # Every face lies in a plane of the hull: its middle is then no farther from one than its corners are.
        middles = self.corners[self.faces].mean(axis=1)
        within = _SAME * float(np.linalg.norm(np.ptp(self.corners, axis=0)))
        for block in np.array_split(middles, len(middles) * len(planes) // 2_000_000 + 1):
            if (-(block @ planes[:, :3].T + planes[:, 3])).min(axis=1).max(initial=0.0) > within:
                return False
        return True

    def first_corners(self) -> np.ndarray:
        """Return one corner of each part (P, 3) [m]."""
        first = np.unique(self.parts, return_index=True)[1]
        return np.asarray(self.corners[self.faces[first, 0]])


class Inside:
    """What the closed parts of a surface enclose.

    A part inside another one bounds a hollow in it, one inside that is solid again; parts that cut through each other
    are solid together.
    """

    def __init__(self, surface: Surface) -> None:
        kept = surface.closed[surface.parts]
        self._triangles = surface.corners[surface.faces[kept]]  # (F, 3, 3)
        self._parts = np.unique(surface.parts[kept], return_inverse=True)[1]
        self._low, self._high = self._triangles.min(axis=(0, 1)), self._triangles.max(axis=(0, 1))
        self._sign = np.ones(int(self._parts.max(initial=-1)) + 1)
        if len(self._sign) > 1:
            for part in range(len(self._sign)):
                corners = np.unique(self._triangles[self._parts == part].reshape(-1, 3), axis=0)
                asked = corners[np.linspace(0, len(corners) - 1, min(len(corners), _ASKED)).astype(int)]
                around = np.delete(self._enclosing(asked), part, axis=1).all(axis=0)
                self._sign[part] = 1 - 2 * (around.sum() % 2)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Tell which points (N, 3) [m] are enclosed (N,)."""
        points = np.asarray(points, float).reshape(-1, 3)
        found = np.zeros(len(points), bool)
        near = ((points >= self._low) & (points <= self._high)).all(axis=1)
        if near.any():
            found[near] = self._enclosing(points[near]) @ self._sign > 0
        return found

    def _enclosing(self, points: np.ndarray) -> np.ndarray:
        """Tell which parts enclose points (N, 3), each by itself (N, P)."""
        found = np.zeros((len(points), len(self._sign)), bool)
        for row, point in enumerate(points):
            votes = [np.bincount(self._parts[self._met(point, ray)], minlength=len(self._sign)) % 2 for ray in _RAYS]
            found[row] = np.sum(votes, axis=0) >= 2
        return found

    def _met(self, point: np.ndarray, ray: np.ndarray) -> np.ndarray:
        """Tell which triangles a ray from a point meets (F,) (Moeller and Trumbore 1997)."""
        a = self._triangles[:, 0]
        one, two = self._triangles[:, 1] - a, self._triangles[:, 2] - a
        normal = np.cross(ray, two)
        scale = np.einsum("fi,fi->f", one, normal)
        scale = np.where(scale == 0, np.finfo(float).tiny, scale)
        off = point - a
        u = np.einsum("fi,fi->f", off, normal) / scale
        across = np.cross(off, one)
        v, along = across @ ray / scale, np.einsum("fi,fi->f", two, across) / scale
        return np.asarray((u >= 0) & (v >= 0) & (u + v <= 1) & (along > 0))


def _groups(pairs: np.ndarray, count: int) -> np.ndarray:
    """Return for 0 to count - 1 the number of the group each is in (count,), where pairs (N, 2) belong together."""
    links = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])
