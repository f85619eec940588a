"""What closed meshes enclose: whether points are inside, whatever way the faces are wound.

A ray from a point outside leaves a closed surface as often as it enters it, one from inside once more. Rays go in one
direction that no drawn face is parallel to; faces are sorted into cells across it, so that a point is held against
those in its cell only. Whether a ray passes an edge is decided from the edge alone, the same way for all its faces: no
ray slips through between two of them.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.robots.meshes import Mesh

_TURN = Rotation.from_euler("xyz", [0.5377, 0.8339, -0.2588]).as_matrix()  # arbitrary: rays are along no drawn axis
_FINEST = 512  # cells along a side
_ENTRIES = 4_000_000  # most faces in cells, over all cells
_NESTED = 32  # vertices of a part that are asked for to tell that it is inside another one


class Solid:
    """The inside of the closed parts of a mesh.

    A part wholly inside another one bounds a hollow in it, one inside that is solid again, and so on; parts that reach
    into each other are solid together.

    Args:
        mesh: with at least one closed part; open ones enclose nothing.
    """

    def __init__(self, mesh: Mesh) -> None:
        chosen = mesh.closed[mesh.part]
        faces, part = mesh.faces[chosen], mesh.part[chosen]
        self._parts, self._part = np.unique(part, return_inverse=True)
        turned = mesh.vertices @ _TURN
        self._corners = turned[np.sort(faces, axis=1)]  # (F, 3, 3): edges always from the lower to the higher index
        low, high = self._corners[..., :2].min(axis=1), self._corners[..., :2].max(axis=1)
        self._low, span = low.min(axis=0), np.ptp(np.concatenate([low, high]), axis=0)
        self._cells = int(np.clip(np.sqrt(len(faces)), 1, _FINEST))
        while True:
            self._width = np.maximum(span, np.finfo(float).tiny) / self._cells
            first, last = (self._cell(corner) for corner in (low, high))
            count = (last - first + 1).prod(axis=1)
            if count.sum() <= _ENTRIES or self._cells == 1:
                break
            self._cells //= 2
        face = np.repeat(np.arange(len(faces)), count)
        place = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
        height = (last - first + 1)[face, 1]
        cell = (first[face, 0] + place // height) * self._cells + first[face, 1] + place % height
        order = np.argsort(cell, kind="stable")
        self._faces = face[order]
        self._begin = np.searchsorted(cell[order], np.arange(self._cells**2 + 1))
        self._signs = np.ones(len(self._parts))
        if len(self._parts) > 1:
            self._signs = self._nesting(mesh, faces)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Tell which points (N, 3) [m] in the mesh's frame are inside (N,)."""
        found: np.ndarray = self._odd(points) @ self._signs > 0
        return found

    def _nesting(self, mesh: Mesh, faces: np.ndarray) -> np.ndarray:
        """Return 1 for parts that are solid and -1 for those that bound a hollow (P,)."""
        depth = np.zeros(len(self._parts), int)
        for k in range(len(self._parts)):
            vertices = np.unique(faces[self._part == k])
            asked = vertices[np.linspace(0, len(vertices) - 1, min(len(vertices), _NESTED)).astype(int)]
            within: np.ndarray = np.logical_and.reduce(self._odd(mesh.vertices[asked]))
            depth[k] = within.sum() - within[k]
        return np.where(depth % 2 == 0, 1.0, -1.0)

    def _cell(self, points: np.ndarray) -> np.ndarray:
        """Return the cells of points (N, 2) across the rays (N, 2), the nearest ones of points beyond."""
        cells = np.floor((points - self._low) / self._width)
        return np.clip(cells, 0, self._cells - 1).astype(int)

    def _odd(self, points: np.ndarray) -> np.ndarray:
        """Tell of which closed parts rays from points (N, 3) pass an odd number of faces (N, P)."""
        points = np.asarray(points, float).reshape(-1, 3) @ _TURN
        cell = self._cell(points[:, :2]) @ [self._cells, 1]
        begin, count = self._begin[cell], self._begin[cell + 1] - self._begin[cell]
        point = np.repeat(np.arange(len(points)), count)
        face = self._faces[np.arange(len(point)) + np.repeat(begin - np.cumsum(count) + count, count)]
        passed = _above(points[point], self._corners[face])
        hits = np.bincount(
            point[passed] * len(self._parts) + self._part[face[passed]], minlength=len(points) * len(self._parts)
        )
        return hits.reshape(len(points), -1) % 2 == 1


def _above(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Tell for points (N, 3) and faces (N, 3, 3) whether the ray along z from the point passes the face (N,)."""
    inside = np.zeros(len(p), bool)
    weights = []
    for i, j in ((0, 1), (1, 2), (0, 2)):
        a, b = corners[:, i], corners[:, j]
        area = (b[:, 0] - a[:, 0]) * (p[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (p[:, 0] - a[:, 0])
        rising, falling = (a[:, 1] <= p[:, 1]) & (b[:, 1] > p[:, 1]), (b[:, 1] <= p[:, 1]) & (a[:, 1] > p[:, 1])
        inside ^= (rising & (area > 0)) | (falling & (area < 0))
        weights.append(area)
    # The weight of a corner is the area across the edge it is not on; that of edge (0, 2) has the other sign.
    w = np.stack([weights[1], -weights[2], weights[0]], axis=1)
    total = w.sum(axis=1)
    flat = total == 0
    height = np.einsum("ni,ni->n", w, corners[..., 2]) / np.where(flat, 1.0, total)
    low, high = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    height = np.where(flat, high, np.clip(height, low, high))
    return inside & (height > p[:, 2])
