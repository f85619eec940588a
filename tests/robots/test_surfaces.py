"""Triangles of shapes enclose the shapes' volumes and lie on their surfaces; primitives enclose what they replace."""

from collections import Counter

import coal
import numpy as np
import pytest

from pipeline.errors import RobotError
from pipeline.robots.bodies import hull, primitive
from pipeline.robots.surfaces import triangles
from tests.robots.worlds import rotation


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume by the divergence theorem; positive when faces turn outwards."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 0.5)])


def bvh() -> coal.BVHModelBase:
    mesh = coal.BVHModelOBBRSS()
    vertices, faces = triangles(coal.Box(1, 2, 0.5))
    mesh.beginModel(len(faces), len(vertices))
    mesh.addVertices(vertices)
    for face in faces.tolist():
        mesh.addTriangle(*(vertices[i] for i in face))
    mesh.endModel()
    return mesh


SHAPES = {
    "box": (lambda: coal.Box(1, 2, 0.5), 1.0),
    "sphere": (lambda: coal.Sphere(0.7), 4 / 3 * np.pi * 0.7**3),
    "cylinder": (lambda: coal.Cylinder(0.3, 2.0), np.pi * 0.09 * 2),
    "capsule": (lambda: coal.Capsule(0.3, 2.0), np.pi * 0.09 * 2 + 4 / 3 * np.pi * 0.027),
    "hull": (lambda: hull(CORNERS, "box"), 1.0),
    "mesh": (bvh, 1.0),
    "octree": (lambda: coal.makeOctree(np.array([[0.05, 0.05, 0.05], [0.55, 0.05, 0.05]]), 0.1), 2e-3),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_volume(kind):
    """The triangles enclose the shape's volume, to 5 % where a circle has 24 corners, and turn outwards."""
    make, expected = SHAPES[kind]
    vertices, faces = triangles(make())
    assert volume(vertices, faces) == pytest.approx(
        expected, rel=0.05 if kind in ("sphere", "cylinder", "capsule") else 1e-6
    )


@pytest.mark.parametrize("kind", ["box", "hull", "octree"])
def test_closed(kind):
    """Every edge belongs to two triangles, once in each direction."""
    _, faces = triangles(SHAPES[kind][0]())
    edges = Counter((int(f[i]), int(f[(i + 1) % 3])) for f in faces for i in range(3))
    assert set(edges.values()) == {1} and all((b, a) in edges for a, b in edges)


def test_shapes_without_a_surface():
    """A half-space has no triangles."""
    vertices, faces = triangles(coal.Halfspace(np.array([0, 0, 1.0]), 0.0))
    assert len(vertices) == len(faces) == 0


@pytest.mark.parametrize("seed", range(8))
def test_primitive_encloses_its_mesh(seed):
    """The box, capsule or sphere around random points holds all of them, and is no larger than their bounding box."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3)) * rng.uniform(0.02, 0.5, 3) @ rotation(rng.normal(size=4)) + rng.normal(size=3)
    shape, placement = primitive(points)
    local = placement.inverse().rotation @ points.T + placement.inverse().translation[:, None]
    if isinstance(shape, coal.Box):
        assert (np.abs(local.T) <= shape.halfSide + 1e-9).all()
        size = 8 * np.prod(shape.halfSide)
    elif isinstance(shape, coal.Capsule):
        beyond = np.maximum(np.abs(local[2]) - shape.halfLength, 0)
        assert (np.hypot(np.hypot(local[0], local[1]), beyond) <= shape.radius + 1e-9).all()
        size = np.pi * shape.radius**2 * 2 * shape.halfLength + 4 / 3 * np.pi * shape.radius**3
    else:
        assert (np.linalg.norm(local, axis=0) <= shape.radius + 1e-9).all()
        size = 4 / 3 * np.pi * shape.radius**3
    assert size <= np.ptp(points, axis=0).prod() * (1 + 1e-9)


def test_round_things_become_round():
    """Points of a long tube become a capsule, points of a ball a sphere or capsule, corners of a box a box."""
    rng = np.random.default_rng(1)
    turn = rng.uniform(0, 2 * np.pi, 400)
    tube = np.stack([0.05 * np.cos(turn), rng.uniform(-0.5, 0.5, 400), 0.05 * np.sin(turn)], axis=1)
    ends = np.array([[0, 0.55, 0], [0, -0.55, 0]])
    assert isinstance(primitive(np.concatenate([tube, ends]))[0], coal.Capsule)
    assert isinstance(primitive(CORNERS)[0], coal.Box)


def test_flat_mesh_has_no_hull():
    """Points in a plane span no hull: the body is named."""
    with pytest.raises(RobotError, match="'plate' has no convex hull"):
        hull(np.random.default_rng(0).uniform(size=(20, 3)) * [1, 1, 0], "plate")
