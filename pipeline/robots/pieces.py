"""Convex pieces that together enclose a mesh and stand out from it little, where its convex hull stands out far.

The mesh is cut across the axes of its link, again and again, each time where the hulls of the parts lose most volume.
The hull of a part holds all that the mesh encloses there: what is in the mesh is in a piece. Of a mesh with holes the
surface is enclosed; it has no inside.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from pipeline.robots.cuts import Plane, cut

# Chosen on Baxter's torso and pedestal and a UR5's links: 18, 13 and up to 4 pieces.
_LEAST = 0.005  # of the volume of the pieces: cuts that save less are not made
_LITTLE = 2e-5  # nor those that save less than this [m^3], a cube of 27 mm
_FAR = 0.06  # parts that stand out farther are cut, whether that saves volume or not [m]
_MOST = 32  # pieces of one mesh; each costs a little at every check

_OFFSETS = 6  # planes tried across an axis, evenly spaced
_COARSE = 32  # cells along the longest side of the copy on which planes are tried
_LEVELS = 4  # corners on each side of the best plane that it may be moved to: along a face is where most is saved
_HOPE = 0.5  # of what a cut must save: where the coarse copy promises less, no plane is looked at closely
_SPACING = 0.01  # of the points by which is told how far a part stands out [m]
_THICKNESS = 1e-4  # half of what a flat part gets [m]


def convex_pieces(
    triangles: np.ndarray, least: float = _LEAST, little: float = _LITTLE, far: float = _FAR, most: int = _MOST
) -> list[np.ndarray]:
    """Return the corners (N, 3) [m] of each piece; one piece, the hull, where that is close to the mesh.

    Cuts are made while they save volume, then, across the longest side, of parts whose hulls stand out far: the first
    cuts of a ring save nothing.

    Args:
        triangles: of the mesh (M, 3, 3) [m], in any order and winding.
        least: share of the volume of all pieces together that a cut must save.
        little: what it must save at least [m^3].
        far: how far a piece may stand out from the mesh, unless there are as many as there may be [m].
        most: number of pieces.
    """
    volume = _volume(triangles.reshape(-1, 3))
    parts = [_Part(triangles, max(least * volume, little))]
    while len(parts) < most:
        worth = max(least * volume, little)
        part = max(parts, key=lambda part: part.best[0])
        saved, plane = part.best
        if plane is None or saved < worth:
            part = max(parts, key=lambda part: part.standing_out)
            saved, plane = 0.0, part.middle
            if part.standing_out <= far:
                break
        volume -= saved
        i = parts.index(part)
        parts[i : i + 1] = part.halves(plane, worth)
    return [part.corners for part in parts]


@dataclass(frozen=True, eq=False)
class _Part:
    """Triangles (M, 3, 3) of a part of the mesh [m], and what a cut of it must save to be looked at closely [m^3]."""

    triangles: np.ndarray
    worth: float

    @property
    def points(self) -> np.ndarray:
        """The corners of the triangles (3 M, 3) [m]."""
        return self.triangles.reshape(-1, 3)

    @cached_property
    def volume(self) -> float:
        """Volume of the hull [m^3]."""
        return _volume(self.points)

    @cached_property
    def best(self) -> tuple[float, Plane | None]:
        """The volume that the best cut saves [m^3], and its plane; 0 and None where that is too little.

        Planes are tried on a coarse copy; the best of them is moved to the best of the corners beside it.
        """
        if not self.volume > _HOPE * self.worth:
            return 0.0, None
        coarse, exact = _frame(_coarse(self.triangles)), _frame(self.triangles)
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        planes = [Plane(axis, at) for axis in range(3) for at in np.linspace(low[axis], high[axis], _OFFSETS + 2)[1:-1]]
        left = [_left(*coarse, plane) for plane in planes]
        if _volume(coarse[0]) - min(left) < _HOPE * self.worth:
            return 0.0, None
        best = planes[int(np.argmin(left))]
        levels = np.unique(exact[0][:, best.axis])[1:-1]
        middle = int(np.searchsorted(levels, best.offset))
        near = [best, *(Plane(best.axis, at) for at in levels[max(middle - _LEVELS, 0) : middle + _LEVELS])]
        left = [_left(*exact, plane) for plane in near]
        return self.volume - min(left), near[int(np.argmin(left))]

    @cached_property
    def standing_out(self) -> float:
        """How far the hull reaches from the triangles, to `_SPACING` [m]; 0 where it is flat."""
        try:
            hull = ConvexHull(self.points)
        except (QhullError, ValueError):
            return 0.0
        return float(cKDTree(_spread(self.triangles)).query(_spread(self.points[hull.simplices]))[0].max())

    @property
    def middle(self) -> Plane:
        """The plane that halves the longest side."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        axis = int(np.argmax(high - low))
        return Plane(axis, float(low[axis] + high[axis]) / 2)

    @property
    def corners(self) -> np.ndarray:
        """The corners of the hull (N, 3) [m], which gets some thickness where it is flat."""
        try:
            return self.points[ConvexHull(self.points).vertices]
        except (QhullError, ValueError):
            steps = _THICKNESS * np.concatenate([np.eye(3), -np.eye(3)])
            thick = (self.points[:, None] + steps).reshape(-1, 3)
            return thick[ConvexHull(thick).vertices]

    def halves(self, plane: Plane, worth: float) -> tuple["_Part", "_Part"]:
        """Return what is below and what is above a plane; what is in it goes where it adds less."""
        below, above, flat = cut(self.triangles, plane)
        ways = [(np.concatenate([below, flat]), above), (below, np.concatenate([above, flat]))]
        halves = [(_Part(one, worth), _Part(other, worth)) for one, other in ways]
        return min(halves, key=lambda pair: pair[0].volume + pair[1].volume)


def _frame(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (V, 3) and edges (E, 2), as indices into them, of triangles (M, 3, 3), each once."""
    corners, of = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    ends = np.sort(of.reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    codes = np.unique(ends[:, 0] * len(corners) + ends[:, 1])
    return corners, np.stack(np.divmod(codes, len(corners)), axis=1)


def _coarse(triangles: np.ndarray) -> np.ndarray:
    """Return triangles (M, 3, 3) with the corners in one cell of a grid made one, each once (K, 3, 3)."""
    points = triangles.reshape(-1, 3)
    low, size = points.min(axis=0), np.ptp(points, axis=0).max()
    cells = np.floor((points - low) / size * _COARSE).astype(int)
    codes = cells @ np.array([1, _COARSE + 1, (_COARSE + 1) ** 2])
    _, first, of = np.unique(codes, return_index=True, return_inverse=True)
    members = np.unique(np.sort(of.reshape(-1, 3), axis=1), axis=0)
    return points[first][members]


def _left(corners: np.ndarray, edges: np.ndarray, plane: Plane) -> float:
    """Return the volume of the hulls of what is below and of what is above a plane, together [m^3].

    Args:
        corners: of triangles (V, 3) [m].
        edges: of the triangles, as indices into them (E, 2).
        plane: see above.
    """
    height = plane.height(corners)
    ends = height[edges]
    crossed = ends.prod(axis=1) < 0
    (a, b), (h, k) = corners[edges[crossed]].swapaxes(0, 1), ends[crossed].T
    section = a + (h / (h - k))[:, None] * (b - a)
    total = 0.0
    for sign in (-1, 1):
        side = sign * height > 0
        side[edges[(sign * ends > 0).any(axis=1) & (ends == 0).any(axis=1)]] = True  # in the plane, beside the side
        total += _volume(np.concatenate([corners[side], section]))
    return total


def _volume(points: np.ndarray) -> float:
    """Return the volume of the hull of points (N, 3) [m^3]; 0 where they are flat."""
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def _spread(triangles: np.ndarray) -> np.ndarray:
    """Return points (N, 3) of triangles (M, 3, 3), their corners included, at most `_SPACING` apart in each."""
    longest = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    steps = np.maximum(np.ceil(longest / _SPACING).astype(int), 1)
    found = []
    for count in np.unique(steps):
        i, j = np.divmod(np.arange((count + 1) ** 2), count + 1)
        i, j = i[i + j <= count] / count, j[i + j <= count] / count
        weights = np.stack([1 - i - j, i, j], axis=1)  # (P, 3)
        found.append(np.einsum("pi,mid->mpd", weights, triangles[steps == count]).reshape(-1, 3))
    return np.concatenate(found)
