"""Cutting meshes by planes: parts are clipped at the plane and closed there, as a saw leaves two solids."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError

_TOUCH = 1e-9  # a corner nearer to a plane lies in it [m]
_GAP = 1e-6  # corners of an outline that are nearer than this are one [m]


@dataclass(frozen=True)
class Plane:
    """Points whose coordinate `axis` is `offset` [m]."""

    axis: int
    offset: float

    def height(self, points: np.ndarray) -> np.ndarray:
        """Return how far points (..., 3) are above, exactly 0 for those in the plane (...) [m]."""
        found = points[..., self.axis] - self.offset
        return np.where(np.abs(found) < _TOUCH, 0.0, found)


def cut(part: np.ndarray, plane: Plane) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the triangles (M, 3, 3) [m] of a mesh that are below a plane, above it, and in it.

    Those below and those above are closed in the plane: the hull of each holds what the mesh encloses on its side.
    Triangles in the plane may be added to either.
    """
    height = plane.height(part)
    flat = (height == 0).all(axis=1)
    below, above = (_closed(_clipped(part[~flat], sign * height[~flat]), plane) for sign in (1, -1))
    return below, above, part[flat]


def _clipped(part: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return triangles (K, 3, 3) that cover what is below of those (M, 3, 3) with corners at heights (M, 3)."""
    count = (height < 0).sum(axis=1)
    kept = [part[(height <= 0).all(axis=1) & (count > 0)]]
    crossed = (height > 0).any(axis=1)
    for below in (1, 2):
        rows = crossed & (count == below)
        lone = np.argmax(height[rows] < 0 if below == 1 else height[rows] >= 0, axis=1)
        order = (lone[:, None] + np.arange(3)) % 3  # the corner that is alone on its side comes first
        a, b, c = np.take_along_axis(part[rows], order[:, :, None], axis=1).swapaxes(0, 1)
        h, k, m = np.take_along_axis(height[rows], order, axis=1).T
        first, second = a + (h / (h - k))[:, None] * (b - a), a + (h / (h - m))[:, None] * (c - a)
        if below == 1:
            kept.append(np.stack([a, first, second], axis=1))
        else:
            kept += [np.stack([first, b, c], axis=1), np.stack([first, c, second], axis=1)]
    return np.concatenate(kept)


def _closed(part: np.ndarray, plane: Plane) -> np.ndarray:
    """Return triangles (M, 3, 3) on one side of a plane with those that close their section in the plane (K, 3, 3).

    The corners of the outline are joined to triangles. Those that no edge of the outline crosses, and that can be
    reached from without over sides that are no edges, are outside the section; all others close it. So corners may come
    in any order, outlines may cross each other, and holes are closed as well.
    """
    away = plane.height(part) != 0
    rows, lone = np.nonzero(away & (away.sum(axis=1) == 1)[:, None])  # an edge in the plane, one corner beside it
    if not len(rows):
        return part
    ends = np.stack([part[rows, (lone + 1) % 3], part[rows, (lone + 2) % 3]], axis=1).reshape(-1, 3)
    _, first, of = np.unique(np.round(ends / _GAP), axis=0, return_index=True, return_inverse=True)
    edges = np.unique(np.sort(of.reshape(-1, 2), axis=1), axis=0)
    corners = ends[first]
    flat = np.delete(corners, plane.axis, axis=1)  # (V, 2)
    try:
        mesh = Delaunay(flat)
    except (QhullError, ValueError):  # fewer than three corners, or all in a line: there is nothing to close
        return part
    shut, walls = _met(mesh.simplices, flat, edges[edges[:, 0] != edges[:, 1]])
    triangles, sides = np.nonzero(~shut[:, None] & ~walls)  # ways from triangles over their sides
    beyond, outside = mesh.neighbors[triangles, sides], len(mesh.simplices)
    free = (beyond < 0) | ~shut[beyond]
    ways = triangles[free], np.where(beyond < 0, outside, beyond)[free]
    joined = coo_array((np.ones(len(ways[0])), ways), shape=(outside + 1, outside + 1))
    reached = connected_components(joined, directed=False)[1]
    return np.concatenate([part, corners[mesh.simplices[reached[:-1] != reached[-1]]]])


def _met(triangles: np.ndarray, corners: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tell which triangles (K, 3) of a plane an edge (E, 2) passes through (K,), and which sides lie on one (K, 3).

    Both name corners (V, 2); side j is opposite to corner j.
    """
    shut, shared = np.zeros(len(triangles), bool), np.zeros((len(corners), len(corners)), bool)
    shape = corners[triangles]  # (K, 3, 2)
    normals = _across(np.roll(shape, -1, axis=1) - shape)  # of the sides
    own = np.einsum("kjd,kid->kji", normals, shape)  # (K, 3, 3)
    lowest, highest = own.min(axis=2) + _GAP, own.max(axis=2) - _GAP
    for begin, end in corners[edges]:
        off = (corners - begin) @ _across(end - begin)  # (V,) from the edge's line
        on = np.flatnonzero(np.abs(off) <= _GAP)
        on = on[((corners[on] - begin) * (corners[on] - end)).sum(axis=1) <= _GAP**2]  # between its ends
        shared[np.ix_(on, on)] = True
        split = off[triangles]  # (K, 3)
        near = np.flatnonzero((split.min(axis=1) < -_GAP) & (split.max(axis=1) > _GAP) & ~shut)
        one, other = normals[near] @ begin, normals[near] @ end  # (N, 3)
        passed = (np.minimum(one, other) < highest[near]) & (np.maximum(one, other) > lowest[near])
        shut[near[passed.all(axis=1)]] = True  # no line is between the triangle and the edge
    a, b, c = triangles.T
    return shut, np.stack([shared[b, c], shared[c, a], shared[a, b]], axis=1)


def _across(vectors: np.ndarray) -> np.ndarray:
    """Return unit vectors perpendicular to vectors (..., 2)."""
    turned = np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)
    unit: np.ndarray = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    return unit
