"""Bodies and obstacles as plain coal is asked about them: solid where they are closed, surfaces where they are not."""

from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property, lru_cache
from pathlib import Path

import coal
import numpy as np
from scipy.spatial import ConvexHull

from pipeline.errors import ProblemError, RobotError
from pipeline.robots.bodies import Geometry, hull, primitive
from pipeline.robots.kept import kept_pieces
from pipeline.robots.obstacles import Obstacle, Shape
from pipeline.verification.kinematics import Place
from pipeline.verification.solids import Inside, Surface

_BEYOND = 1e-6  # how far a mesh may stick out of what stands for it: rounding [m]
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_KEPT = 512  # bodies of robots, with their hulls and trees of triangles


class Form:
    """One shape, in its own frame.

    Attributes:
        shape: as coal is asked with it.
        convex: whether coal tells how far it is from another such one, or how deep in it.
        open: whether it is, or has parts that are, a surface that encloses nothing.
        inside: what tells which points a closed mesh encloses; None where coal takes the shape as solid.
        middle, half: of the box around it (3,), (3,) [m].
        radius: of a ball around the middle of the box, which holds it [m].
    """

    def __init__(self, given: coal.CollisionGeometry) -> None:
        self.shape, self.open, self.inside, self._surface = given, False, None, None
        if isinstance(given, coal.BVHModelBase):
            self._surface = surface = Surface.read(given)
            if surface.is_convex() and (made := _convex(surface.corners)) is not None:
                self.shape = made
            else:
                self.shape, self.open = surface.coal(), surface.open
                self.inside = Inside(surface) if surface.closed.any() else None
        self.convex = isinstance(self.shape, coal.ShapeBase)
        self.shape.computeLocalAABB()
        low, high = (np.array(corner, float) for corner in (self.shape.aabb_local.min_, self.shape.aabb_local.max_))
        self.middle, self.half = (low + high) / 2, (high - low) / 2
        self.radius = float(np.linalg.norm(self.half))
        if isinstance(self.shape, coal.Sphere):
            self.radius = float(self.shape.radius)
        elif (corners := self._corners) is not None:
            self.radius = float(np.linalg.norm(corners - self.middle, axis=1).max())

    @cached_property
    def moving(self) -> np.ndarray:
        """Points (8, 3) [m] of which no point of the shape moves farther than the farthest; of a ball its middle."""
        size = np.zeros(3) if isinstance(self.shape, coal.Sphere) else self.half
        return np.asarray(self.middle + _CORNERS * size)

    @cached_property
    def thickness(self) -> float:
        """Least extent [m]: of a hull across its faces, of others along the sides of their box."""
        if isinstance(self.shape, coal.ConvexBase):
            corners = np.array(self.shape.points())
            planes = np.unique(ConvexHull(corners).equations[:, :3].round(9), axis=0)
            return min(float(np.ptp(corners @ plane)) for plane in planes)
        return float(2 * self.half.min())

    @cached_property
    def points(self) -> np.ndarray:
        """A point of every part of the shape (P, 3) [m]: where surfaces do not meet, inside or outside as it is."""
        if isinstance(self.shape, coal.ConvexBase):
            return np.array(self.shape.points()).mean(axis=0)[None]
        if self._surface is not None:
            return self._surface.first_corners()
        if isinstance(self.shape, coal.OcTree):
            return np.array(self.shape.toBoxes())[:, :3]
        return np.zeros((1, 3))

    @cached_property
    def hulls(self) -> "list[tuple[Form, np.ndarray]]":
        """Convex shapes, and their offsets (3,) [m], that together hold this one: where a depth of it is needed."""
        if self.convex:
            return [(self, np.zeros(3))]
        if isinstance(self.shape, coal.OcTree):
            return [(Form(coal.Box(*[row[3]] * 3)), row[:3]) for row in np.array(self.shape.toBoxes())]
        made = None if self._surface is None else _convex(self._surface.corners)
        if made is not None:
            return [(Form(made), np.zeros(3))]
        return [(Form(coal.Box(*(2 * np.maximum(self.half, 1e-9)))), self.middle)]

    @property
    def _corners(self) -> np.ndarray | None:
        if isinstance(self.shape, coal.ConvexBase):
            return np.array(self.shape.points())
        return None if self._surface is None else self._surface.corners


_made: OrderedDict[tuple[int, Geometry], tuple[coal.CollisionGeometry, list[tuple[Form, Place]]]] = OrderedDict()


def forms_of_body(name: str, given: coal.CollisionGeometry, kind: Geometry) -> list[tuple[Form, Place]]:
    """Return what a body of a robot is judged as, and where that is in its frame; made once for each body read.

    What a mesh becomes (a primitive, a hull, pieces) is what the problem's `geometry` asks for; it is made by the
    robot's own code and held here against the mesh, which must not stick out of it.

    Raises:
        RobotError: a mesh sticks out of what stands for it.
    """
    key = id(given), kind
    if key not in _made:
        _made[key] = given, _forms(name, given, kind)  # `given` is kept, so that its id stays its own
        if len(_made) > _KEPT:
            _made.popitem(last=False)
    return _made[key][1]


def _forms(name: str, given: coal.CollisionGeometry, kind: Geometry) -> list[tuple[Form, Place]]:
    if not isinstance(given, coal.BVHModelBase) or kind is Geometry.MESHES:
        return [(Form(given), Place())]
    corners = np.array(given.vertices()).reshape(-1, 3)
    if kind is Geometry.PRIMITIVES:
        shape, at = primitive(corners)
        found = [(Form(shape), Place(np.array(at.rotation), np.array(at.translation)))]
        around = found[0][1].inverse()
        asked = corners @ around.R.T + around.p
        out = max_out(shape, asked)
    else:
        faces = _triangles(given)
        hulls = [corners] if kind is Geometry.HULLS else kept_pieces(corners[faces])
        found = [(Form(hull(piece, name)), Place()) for piece in hulls]
        asked = np.concatenate([corners, corners[faces].mean(axis=1)])
        if len(found) == 1:  # what is convex holds a mesh where it holds the corners of the mesh's own hull
            asked = corners[ConvexHull(corners).vertices]
        out = _out_of_all([form.shape for form, _ in found], asked)
    if out > _BEYOND:
        raise RobotError(f"the mesh of body {name!r} sticks {out:.3g} m out of the {kind.value} that stand for it")
    return found


def form_of(obstacle: Obstacle) -> Form:
    """Return the shape of an obstacle, or of a carried body.

    Raises:
        ProblemError: sizes that make no such shape, or a mesh that cannot be read.
    """
    if obstacle.shape is Shape.OCTREE:
        points = np.array([] if obstacle.points is None else obstacle.points, float).reshape(-1, 3)
        if not len(points):
            raise ProblemError(f"octree {obstacle.name!r} has no points")
        return _octree(points.tobytes(), float(obstacle.size[0]))
    if obstacle.shape is Shape.MESH:
        if not all(obstacle.size) or not np.isfinite(obstacle.size).all():
            raise ProblemError(f"mesh {obstacle.name!r} has scale {obstacle.size}; it must be finite and not 0")
        try:
            state = Path(obstacle.file).stat()
            return _mesh(obstacle.file, tuple(map(float, obstacle.size)), state.st_mtime_ns, state.st_size)
        except (OSError, ValueError, RuntimeError) as error:
            raise ProblemError(f"mesh {obstacle.name!r} cannot be read: {str(error).strip()}") from None
    return _primitive(obstacle.shape, tuple(map(float, obstacle.size)))


def max_out(shape: coal.ShapeBase, points: np.ndarray) -> float:
    """Return how far the farthest of points (N, 3) is out of a box, capsule or ball about its own frame [m]."""
    if isinstance(shape, coal.Box):
        return float((np.abs(points) - shape.halfSide).max())
    if isinstance(shape, coal.Capsule):
        along = np.clip(points[:, 2], -shape.halfLength, shape.halfLength)
        points = points - along[:, None] * np.array([0.0, 0.0, 1.0])
    return float(np.linalg.norm(points, axis=1).max() - shape.radius)


def _out_of_all(hulls: Sequence[coal.ConvexBase], points: np.ndarray) -> float:
    """Return how far points (N, 3) are out of the hull that is nearest to each, of the farthest one [m]."""
    out = np.full(len(points), np.inf)
    for shape in hulls:
        planes = ConvexHull(np.array(shape.points())).equations
        planes = np.unique(planes.round(12), axis=0)
        for block in np.array_split(np.arange(len(points)), len(points) * len(planes) // 2_000_000 + 1):
            beyond = (points[block] @ planes[:, :3].T + planes[:, 3]).max(axis=1)
            out[block] = np.minimum(out[block], beyond)
    return float(out.max())


@lru_cache(maxsize=16)
def _mesh(file: str, scale: tuple[float, ...], changed: int, size: int) -> Form:
    """Read a mesh; `changed` and `size` are only there to read it again when the file is another one."""
    return Form(coal.MeshLoader().load(file, np.array(scale)))


@lru_cache(maxsize=4096)
def _primitive(shape: Shape, size: tuple[float, ...]) -> Form:
    if not all(0 < extent < np.inf for extent in size):
        raise ProblemError(f"a {shape.value} has size {size}; sizes must be above 0 m")
    if shape is Shape.BOX:
        return Form(coal.Box(*size))
    return Form(coal.Sphere(size[0] / 2) if shape is Shape.SPHERE else coal.Cylinder(size[0] / 2, size[2]))


@lru_cache(maxsize=8)
def _octree(points: bytes, edge: float) -> Form:
    return Form(coal.makeOctree(np.frombuffer(points).reshape(-1, 3).copy(), edge))


def _triangles(mesh: coal.BVHModelBase) -> np.ndarray:
    rows = (mesh.tri_indices(i) for i in range(mesh.num_tris))
    return np.array([(row[0], row[1], row[2]) for row in rows], int).reshape(-1, 3)


def _convex(corners: np.ndarray) -> coal.ConvexBase | None:
    """Return coal's hull of corners (N, 3); None where they are flat, or where coal cannot hold it."""
    try:  # qhull inside coal ends the process where it fails, inside scipy it raises
        kept = corners[ConvexHull(corners).vertices]
        listed = coal.StdVec_Vec3s()
        listed.extend(list(kept))
        return coal.Convex.convexHull(listed, True, "Qt")
    except Exception:  # scipy's QhullError, or what coal's C++ throws: a corner with more than 255 neighbours
        return None
