"""What shapes know of themselves holds for points on and in them; obstacles of wrong sizes are refused."""

from dataclasses import replace

import coal
import numpy as np
import pytest

from pipeline.errors import ProblemError
from pipeline.robots import Obstacle, Shape, Validity, attach, mesh_files, point_robot
from pipeline.robots.bodies import hull
from pipeline.robots.centre import centre_of_mass
from pipeline.robots.shapes import BodyShape
from tests.robots import meshes
from tests.robots.worlds import rotation

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def coal_mesh(mesh: meshes.Triangles) -> coal.BVHModelBase:
    """A mesh as coal has it."""
    made, (points, faces) = coal.BVHModelOBBRSS(), mesh
    made.beginModel(len(faces), len(points))
    for face in faces.tolist():
        made.addTriangle(*(points[i] for i in face))
    made.endModel()
    return made


SHAPES = {  # with their least extent [m]
    "box": (coal.Box(0.3, 0.1, 0.5), 0.1),
    "sphere": (coal.Sphere(0.2), 0.4),
    "cylinder": (coal.Cylinder(0.2, 0.3), 0.3),
    "capsule": (coal.Capsule(0.1, 0.3), 0.2),
    "hull": (hull(meshes.box((0.3, 0.1, 0.5))[0] @ rotation((0.3, 0.4, 0.5, 0.6)).T + [1, 2, 3], "h"), 0.1),
    "convex mesh": (coal_mesh(meshes.box((0.3, 0.1, 0.5), (0.2, 0, 0))), 0.1),
    "corner": (coal_mesh(meshes.corner(0.4)), 0.4),
    "octree": (coal.makeOctree(np.array([[0.05, 0.05, 0.05], [0.55, 0.05, 0.05]]), 0.1), 0.1),
}


@pytest.mark.parametrize("name", SHAPES)
def test_boxes_balls_and_points(name):
    """The box and the ball around a shape hold it, the ball in it is in it, each part's point is in it."""
    given, thickness = SHAPES[name]
    shape, rng = BodyShape(given), np.random.default_rng(1)
    middle, half = shape.box
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)

    def distance(point: np.ndarray) -> float:
        there = coal.Transform3s(np.eye(3), point)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return coal.distance(shape.shape, coal.Transform3s.Identity(), coal.Sphere(1e-9), there, request, result)

    for u in directions:
        out = shape.radius + 0.1
        assert distance(middle + out * u) >= 0.1 - 1e-6
        beyond = middle + (half + 0.1) * np.sign(u) * (np.abs(u) == np.abs(u).max())
        assert distance(beyond) >= 0.1 - 1e-6
    centre, inner = shape.kernel
    for u in directions if inner else ():
        assert distance(centre + 0.999 * inner * u) <= 0
    assert all(distance(p) <= 1e-6 for p in shape.points)
    assert len(shape.points) == (2 if name == "octree" else 1)
    assert shape.thickness == pytest.approx(thickness, rel=1e-6)
    assert shape.convex == (name not in ("corner", "octree"))
    assert (shape.inside is not None) == (name == "corner")
    pieces = [(piece.shape.shape, piece.offset) for piece in shape.pieces]
    assert all(isinstance(piece, coal.ShapeBase) for piece, _ in pieces)
    assert len(pieces) == (2 if name == "octree" else 1)


def test_centres_of_mass():
    """Centres are those in closed form: of a prism, an L, a box in a box that is hollow, leaves, a sheet."""
    wedge = np.array([[0, -1, 0], [3, -1, 0], [0, -1, 3], [0, 1, 0], [3, 1, 0], [0, 1, 3]], float) / 10
    flat = np.array([(0, 1, 2), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (0, 2, 5), (0, 5, 3)])
    rng = np.random.default_rng(0)
    hollow = meshes.flipped(meshes.joined(meshes.box((1, 1, 1)), meshes.box((0.4, 0.4, 0.4), (0.2, 0, 0))), rng)
    for shape, expected in (
        (coal.Box(1, 2, 3), (0, 0, 0)),
        (coal.Cylinder(0.2, 0.5), (0, 0, 0)),
        (hull(wedge, "wedge"), (0.1, 0, 0.1)),
        (coal_mesh((wedge, flat)), (0.1, 0, 0.1)),
        (coal_mesh(meshes.flipped(meshes.corner(), rng)), (-1 / 12, -1 / 12, 0)),
        (coal_mesh(hollow), (-0.064 * 0.2 / (1 - 0.064), 0, 0)),
        (coal.makeOctree(np.array([[0.05, 0.05, 0.05], [0.55, 0.05, 0.05]]), 0.1), (0.3, 0.05, 0.05)),
        (coal_mesh((meshes.box()[0], meshes.box()[1][:2])), (-0.5, 0, 0)),
    ):
        np.testing.assert_allclose(centre_of_mass(BodyShape(shape)), expected, atol=1e-9)


SIZES = {
    "sphere": (Shape.SPHERE, (0.2, 0.4, 0.6), "three diameters must be equal"),
    "nearly a sphere": (Shape.SPHERE, (0.2, 0.2, 0.200001), "three diameters must be equal"),
    "cylinder": (Shape.CYLINDER, (0.2, 0.3, 0.6), "its diameter across x and y, must be equal"),
    "octree": (Shape.OCTREE, (0.1, 0.1, 0.2), "three edges of its leaves must be equal"),
    "large box": (Shape.BOX, (1.0, 20.1, 1.0), r"has size \(1.0, 20.1, 1.0\); sizes are at most 20 m"),
    "large mesh": (Shape.MESH, (1.0, 20.1, 1.0), r"'cup' is 20.1 m large at scale \(1.0, 20.1, 1.0\); at most 20 m"),
    "flat mesh": (Shape.MESH, (1.0, 0.0, 1.0), r"'cup' has scale \(1.0, 0.0, 1.0\); it must be finite and not 0"),
    "no mesh": (Shape.MESH, (1.0, np.nan, 1.0), "'cup' has scale .*; it must be finite and not 0"),
}


@pytest.mark.parametrize("case", SIZES)
def test_sizes_that_make_no_shape(case, tmp_path):
    """What would be planned smaller than it is written, is nothing or is in another unit is refused, with the size."""
    shape, size, message = SIZES[case]
    file = meshes.write(tmp_path / "box.obj", meshes.box())
    body = Obstacle(shape, (0.0, 0.0, 0.0), UPRIGHT, size, "cup", file, np.zeros((1, 3)))
    for make in (
        body.geometry,
        body.collision_object,
        lambda: Validity(point_robot(0.1, [-1] * 3, [1] * 3), [body]),
        lambda: attach(point_robot(0.1, [-1] * 3, [1] * 3), body, "point"),
    ):
        with pytest.raises(ProblemError, match=message):
            make()


def test_large_clouds_and_robots():
    """Points of an octree over more than 20 m, and a robot's body larger than that, are refused."""
    scan = Obstacle(Shape.OCTREE, (0, 0, 0), UPRIGHT, (0.1,) * 3, "scan", points=np.array([[0.0, 0, 0], [21.0, 0, 0]]))
    with pytest.raises(ProblemError, match="'scan' has points over 21 m; at most 20 m"):
        scan.geometry()
    with pytest.raises(ProblemError, match=r"body 'point' of 'point' is 30 m large.*0.001 in the URDF"):
        Validity(point_robot(15.0, [-1] * 3, [1] * 3), [])


def test_many_triangles(tmp_path, monkeypatch):
    """A mesh of more triangles than planning bears is refused with their number, also by a file's size first."""
    file = meshes.write(tmp_path / "ball.obj", meshes.ball(count=40))
    ball = Obstacle(Shape.MESH, (0.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), "ball", file)
    monkeypatch.setattr(mesh_files, "_MOST", 1000)
    for bound in (10_000_000, 10):
        monkeypatch.setattr(mesh_files, "_COUNTED", bound)
        mesh_files._read.cache_clear()
        with pytest.raises(ProblemError, match=r"ball.obj' has 1\d\d\d triangles; at most 1000: simplify it"):
            ball.geometry()


def test_meshes_are_read_once(tmp_path):
    """A mesh is read again only when its file has changed, or for another scale."""
    path = tmp_path / "box.obj"
    file = meshes.write(path, meshes.box())
    box = Obstacle(Shape.MESH, (0.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), "box", file)
    assert box.body_shape() is replace(box, position=(1.0, 0, 0), name="other").body_shape()
    assert replace(box, size=(2.0, 1.0, 1.0)).body_shape().box[1].tolist() == [1.0, 0.5, 0.5]
    meshes.write(path, meshes.corner(3.0))
    assert not box.body_shape().convex
    assert box.body_shape().box[1].tolist() == [1.5] * 3
