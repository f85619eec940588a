"""Collision bodies: meshes as they are, as convex hulls or pieces, or as the primitive that fits best."""

import re
from enum import Enum

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from pipeline.errors import RobotError
from pipeline.robots.kept import kept_pieces
from pipeline.robots.surfaces import triangles

_GRID = 0.002  # hull vertices are moved out to it where coal finds too many neighbours [m]
_PIECE = re.compile(r" \(\d+ of \d+\)$")


class Geometry(Enum):
    """What meshes of a description become; boxes, cylinders, spheres and capsules stay what they are."""

    PRIMITIVES = "primitives"  # the box, capsule or sphere of least volume around the mesh
    HULLS = "hulls"
    PIECES = "pieces"  # convex ones, see `pipeline.robots.pieces`: a hull each where that is close to the mesh
    MESHES = "meshes"


def simplified(geometry: pin.GeometryModel, kind: Geometry) -> pin.GeometryModel:
    """Return the bodies of a geometry model with their meshes replaced; pairs are left out.

    Pieces are bodies of their own, named after the one they are of: `body_of` tells which.

    Raises:
        RobotError: a mesh without vertices or, for hulls, without volume.
    """
    made = pin.GeometryModel()
    for body in geometry.geometryObjects:
        shapes = [(body.geometry, pin.SE3.Identity())]
        if isinstance(body.geometry, coal.BVHModelBase):
            shapes = _shapes(body, kind)
            body.meshScale = np.ones(3)  # the vertices carry it already
        for number, (shape, placement) in enumerate(shapes, 1):
            name = body.name if len(shapes) == 1 else f"{body.name} ({number} of {len(shapes)})"
            made.addGeometryObject(
                pin.GeometryObject(name, body.parentJoint, body.parentFrame, body.placement * placement, shape)
            )
    return made


def body_of(name: str) -> str:
    """Return the name of the body that a piece is of; any other name as it is."""
    return _PIECE.sub("", name)


def _shapes(body: pin.GeometryObject, kind: Geometry) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Return what a body with a mesh becomes: shapes, and their poses in its frame."""
    vertices = np.array(body.geometry.vertices())
    if len(vertices) == 0 or not np.isfinite(vertices).all():
        raise RobotError(f"the mesh of body {body.name!r} has no vertices or some that are not finite")
    if kind is Geometry.PRIMITIVES:
        return [primitive(vertices)]
    found = [body.geometry]
    if kind is Geometry.HULLS:
        found = [hull(vertices, body.name)]
    elif kind is Geometry.PIECES:
        corners, members = triangles(body.geometry)
        found = [hull(piece, body.name) for piece in kept_pieces(corners[members])]
    return [(shape, pin.SE3.Identity()) for shape in found]


def hull(vertices: np.ndarray, name: str) -> coal.ConvexBase:
    """Return the convex hull of vertices (N, 3) [m], or one that is larger by up to `_GRID` where coal needs it.

    Raises:
        RobotError: the vertices lie in a plane.
    """
    try:  # qhull inside coal ends the process where it fails, inside scipy it raises
        corners = vertices[ConvexHull(vertices).vertices]
    except (QhullError, ValueError):
        raise RobotError(
            f"the mesh of body {name!r} has no convex hull: its {len(vertices)} vertices are flat"
        ) from None
    for prepare in (np.asarray, _moved_out):
        listed = coal.StdVec_Vec3s()
        listed.extend(list(prepare(corners)))
        try:
            return coal.Convex.convexHull(listed, True, "Qt")
        except Exception as error:  # coal raises what its C++ throws: a hull with more than 255 neighbours, or qhull's
            reason = str(error).strip().splitlines()[0]
    raise RobotError(f"the mesh of body {name!r} has no convex hull: {reason}")


def _moved_out(corners: np.ndarray) -> np.ndarray:
    """Return fewer corners whose hull holds corners (N, 3): those of the cells of a grid in which they are."""
    cells = np.floor(corners / _GRID)[:, None] + np.stack(np.meshgrid(*[[0, 1]] * 3), axis=-1).reshape(-1, 3)
    points = np.unique(cells.reshape(-1, 3), axis=0) * _GRID
    found: np.ndarray = points[ConvexHull(points).vertices]
    return found


def primitive(vertices: np.ndarray) -> tuple[coal.ShapeBase, pin.SE3]:
    """Return the box, capsule or sphere of least volume found around vertices (N, 3) [m], and its pose in their frame.

    Boxes and capsules lie along the frame's axes or along the principal axes of the vertices.
    """
    centred = vertices - vertices.mean(axis=0)
    principal = np.linalg.svd(centred, full_matrices=False)[2]
    if np.linalg.det(principal) < 0:
        principal[2] *= -1
    found: list[tuple[float, coal.ShapeBase, pin.SE3]] = []
    for rotation in (np.eye(3), principal.T):
        local = vertices @ rotation
        low, high = local.min(axis=0), local.max(axis=0)
        middle, size = (low + high) / 2, np.maximum(high - low, 1e-6)
        found.append((float(size.prod()), coal.Box(*size), pin.SE3(rotation, rotation @ middle)))
        for axis in range(3):
            found.append(_capsule(local - middle, axis, rotation, middle))
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    found.append((4 / 3 * np.pi * radius**3, coal.Sphere(max(radius, 1e-6)), pin.SE3(np.eye(3), middle)))
    _, shape, placement = min(found, key=lambda item: item[0])
    return shape, placement


def _capsule(
    local: np.ndarray, axis: int, rotation: np.ndarray, middle: np.ndarray
) -> tuple[float, coal.ShapeBase, pin.SE3]:
    """The shortest capsule along one axis of a box around centred vertices (N, 3)."""
    across = np.linalg.norm(np.delete(local, axis, axis=1), axis=1)
    radius = max(float(across.max()), 1e-6)
    # Each vertex must lie within the half ball at the end it is nearest to.
    reach = np.abs(local[:, axis]) - np.sqrt(np.maximum(radius**2 - across**2, 0))
    half = max(float(reach.max()), 0.0)
    volume = np.pi * radius**2 * 2 * half + 4 / 3 * np.pi * radius**3
    turn = np.roll(np.eye(3), 2 - axis, axis=1)  # its third column is the axis
    return volume, coal.Capsule(radius, 2 * half), pin.SE3(rotation @ turn, rotation @ middle)
