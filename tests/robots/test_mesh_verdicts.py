"""Meshes are the bodies they depict: the same verdicts and distances as of primitives, however the mesh is written."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from pipeline.errors import ProblemError
from pipeline.robots import Obstacle, Robot, Shape, Validity, attach, point_robot
from tests.robots import meshes
from tests.robots.named import configurations, named
from tests.robots.test_meshes import WAYS
from tests.robots.worlds import ball_clearance, rotation

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
FAR = [Obstacle(Shape.SPHERE, (20.0 + i, 0, 0), UPRIGHT, (0.1,) * 3, f"far {i}") for i in range(70)]
# Primitives of extents 1, the mesh that depicts each, and how far its facets are from it for a size of 0.5.
DEPICTED = {
    "box": (Shape.BOX, meshes.box(), 1e-6),
    "cylinder": (Shape.CYLINDER, meshes.tube(count=64), 3.5e-4),
    "sphere": (Shape.SPHERE, meshes.ball(count=64), 8e-4),
}
# A dent in one face, too narrow for the balls below: the mesh is not convex any more, and its verdicts are the same.
DENT = 1e-4


def dented(mesh: meshes.Triangles) -> meshes.Triangles:
    """The same with one vertex pulled a little inwards along a new middle of its first face."""
    points, faces = mesh
    a, b, c = faces[0]
    middle = points[faces[0]].mean(axis=0) * (1 - DENT)
    new = len(points)
    return np.vstack([points, middle]), np.vstack([faces[1:], [(a, b, new), (b, c, new), (c, a, new)]])


def twins(kind: str, way: str, dent: bool, rng: np.random.Generator, folder) -> tuple[Obstacle, Obstacle]:
    """A primitive anywhere, and the mesh that depicts it there, written in some way."""
    shape, mesh, _ = DEPICTED[kind]
    a, b, c = rng.uniform(0.3, 0.5, 3)
    size = {Shape.SPHERE: (a, a, a), Shape.CYLINDER: (a, a, c)}.get(shape, (a, b, c))
    primitive = Obstacle(shape, tuple(rng.uniform(-0.3, 0.3, 3)), tuple(rng.normal(size=4)), size, "block")
    written = WAYS[way](dented(mesh) if dent else mesh, rng)
    signs = rng.choice([-1.0, 1.0], 3)  # a negative scale mirrors the file: mirrored beforehand, it is what it was
    file = meshes.write(folder / f"{kind} {rng.integers(10**9)}.obj", (written[0] * signs, written[1]))
    return primitive, replace(primitive, shape=Shape.MESH, size=tuple(signs * size), file=file)


@pytest.mark.parametrize("dent", [False, True])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", DEPICTED)
def test_a_mesh_is_what_it_depicts(kind, way, dent, tmp_path):
    """A ball, in the mesh, beside it or far off, has the verdict and clearance of the primitive within a facet's error.

    So of a convex mesh and of one with a dent; in a list and among a crowd; for one and for many configurations.
    """
    rng, error = np.random.default_rng(len(way)), DEPICTED[kind][2] + (2 * DENT if dent else 0)
    primitive, mesh = twins(kind, way, dent, rng, tmp_path)
    seen = []
    for radius, margin, more in ((0.01, 0.0, []), (0.03, 0.005, FAR)):
        robot = point_robot(radius, [-2] * 3, [2] * 3)
        solid, drawn = (Validity(robot, [o, *more], margin) for o in (primitive, mesh))
        Q = np.array(primitive.position) + rng.uniform(-0.3, 0.3, (150, 3))
        distance = ball_clearance([primitive], Q, radius)
        decided = np.abs(distance - margin) > error
        wanted = (distance > margin)[decided]
        assert [drawn.free(q) for q in Q[decided]] == wanted.tolist() == [solid.free(q) for q in Q[decided]]
        np.testing.assert_array_equal(drawn.free_rows(Q[decided]), wanted)
        np.testing.assert_array_equal(drawn.all_free(Q[decided][:, None]), wanted)
        assert [bool(drawn.contacts(q)) for q in Q[decided]] == (~wanted).tolist()
        found = np.array([drawn.clearance(q) for q in Q])
        known = distance > 0 if kind == "cylinder" and not dent else np.abs(distance) > 0
        np.testing.assert_allclose(found[known], distance[known], atol=error)  # coal overstates depths in cylinders
        assert (np.sign(found) == np.sign(distance))[np.abs(distance) > error].all()
        assert drawn.least_clearance(Q) == pytest.approx(found.min())
        assert drawn.surfaces == ()
        seen += wanted.tolist()
    assert 0.2 < np.mean(seen) < 0.95


def split(mesh: meshes.Triangles) -> meshes.Triangles:
    """The same with every face cut in two at the middle of an edge, and faces without area that close the gaps."""
    points, faces = mesh
    a, b, c = faces.T
    middle = len(points) + np.arange(len(faces))
    cut = [np.stack(corners, axis=1) for corners in ((a, middle, c), (middle, b, c), (a, b, middle))]
    return np.vstack([points, (points[a] + points[b]) / 2]), np.vstack(cut)


def test_faces_without_area_do_not_count(tmp_path):
    """A mesh whose faces meet corners in the middle of edges, closed by faces without area, is the same body."""
    rng, robot, found = np.random.default_rng(2), point_robot(0.05, [-2] * 3, [2] * 3), []
    Q = rng.uniform(-0.8, 0.8, (200, 3))
    for mesh in (meshes.corner(), split(meshes.corner())):
        file = meshes.write(tmp_path / f"{len(mesh[0])}.obj", mesh)
        validity = Validity(robot, [Obstacle(Shape.MESH, (0.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), "corner", file)])
        assert validity.surfaces == ()
        found.append([(validity.free(q), round(validity.clearance(q), 7)) for q in Q])
    assert found[0] == found[1] and 0.2 < np.mean([free for free, _ in found[0]]) < 0.9


def test_a_mesh_that_is_open_is_a_surface(tmp_path):
    """Without one of its faces a box is free inside, in contact at its faces, and listed among the surfaces."""
    points, faces = meshes.box()
    file = meshes.write(tmp_path / "open.obj", (points, faces[:-1]))
    box = Obstacle(Shape.MESH, (0.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), "lid", file)
    validity = Validity(point_robot(0.05, [-2] * 3, [2] * 3), [box, replace(box, name="", position=(5.0, 0, 0))])
    assert validity.surfaces == ("lid", "obstacle 1")
    assert validity.free(np.zeros(3)) and validity.clearance(np.zeros(3)) == pytest.approx(0.45)
    assert not validity.free(np.array([-0.5, 0.0, 0.0]))


@cache
def carried(shape: Shape, file: str, size: float) -> Robot:
    """A robot that carries a body at the origin of its frame, and nothing else."""
    bare = replace(point_robot(0.01, [-2] * 3, [2] * 3), geometry=pin.GeometryModel())
    return attach(bare, Obstacle(shape, (0.0, 0.0, 0.0), UPRIGHT, (size,) * 3, "held", file), "point")


def test_an_obstacle_inside_a_carried_mesh(tmp_path):
    """An obstacle wholly inside a body that is a mesh, convex or not, is in contact, and outside of it, it is not."""
    for mesh in (meshes.box(), dented(meshes.box()), meshes.soup(meshes.corner(), np.random.default_rng(0))):
        corner = len(np.unique(mesh[0].round(9), axis=0)) == 12
        robot = carried(Shape.MESH, meshes.write(tmp_path / f"{len(mesh[0])}.obj", mesh), 1.0)
        ball = Obstacle(Shape.SPHERE, (0.0, 0.0, 0.0), UPRIGHT, (0.02,) * 3, "ball")
        for obstacles in ([ball], [ball, *FAR]):
            validity, rng = Validity(robot, obstacles), np.random.default_rng(1)
            Q = rng.uniform(-0.8, 0.8, (300, 3))
            inside = (np.abs(Q) < 0.48).all(axis=1)
            near = np.abs(np.abs(Q) - 0.5).min(axis=1) < 0.02
            if corner:
                inside &= ~((-Q[:, 0] > 0) & (-Q[:, 1] > 0))
                near |= np.abs(Q[:, :2]).min(axis=1) < 0.02
            np.testing.assert_array_equal(validity.free_rows(Q[~near]), ~inside[~near])
            assert (np.array([validity.clearance(q) for q in Q[~near]]) < 0).tolist() == inside[~near].tolist()


def test_a_mesh_in_a_mesh(tmp_path):
    """Each of two tori can hold the other's box; a box in the hole is free, one in the ring is not, both ways."""
    ring = meshes.write(tmp_path / "ring.obj", meshes.torus())
    small = meshes.write(tmp_path / "corner.obj", meshes.corner())
    torus = Obstacle(Shape.MESH, (0.0, 0.0, 0.0), (0.1, 0.2, 0.3, 0.9), (1.0, 1.0, 1.0), "ring", ring)
    R = rotation(torus.quaternion)
    places = R @ np.array([[0, 0, 0], [0.4, 0, 0], [0, -0.4, 0.02], [0.4, 0, 0.3], [1.2, 0, 0]], float).T
    expected = [True, False, False, True, True]
    there = Validity(carried(Shape.MESH, small, 0.05), [torus])
    assert [there.free(q) for q in places.T] == expected
    assert [there.clearance(q) > 0 for q in places.T] == expected
    # The same the other way round: the ring is carried, the small one stands.
    bare = replace(point_robot(0.01, [-2] * 3, [2] * 3), geometry=pin.GeometryModel())
    other = Validity(attach(bare, torus, "point"), [Obstacle(Shape.MESH, (0, 0, 0), UPRIGHT, (0.05,) * 3, "c", small)])
    assert [other.free(-q) for q in places.T] == expected
    assert [other.clearance(-q) > 0 for q in places.T] == expected


def test_bodies_of_one_robot(tmp_path):
    """A body of a robot that is wholly inside another one of its bodies, a mesh, collides with it."""
    model, geometry = pin.Model(), pin.GeometryModel()
    for name, kind in (("a", pin.JointModelPX()), ("b", pin.JointModelPY())):
        joint = model.addJoint(0, kind, pin.SE3.Identity(), name)
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    robot = Robot("pair", model, geometry, -2 * np.ones(2), 2 * np.ones(2))
    file = meshes.write(tmp_path / "box.obj", dented(meshes.box()))
    robot = attach(robot, Obstacle(Shape.MESH, (0, 0, 0), UPRIGHT, (1.0, 1.0, 1.0), "shell", file), "a")
    robot = attach(robot, Obstacle(Shape.SPHERE, (0, 0, 0), UPRIGHT, (0.1, 0.1, 0.1), "pea"), "b")
    for obstacles in ((), FAR):
        validity = Validity(robot, obstacles)
        assert [validity.free(np.array(q)) for q in ((0, 0), (0.4, 0.3), (0.7, 0), (0, 0.52))] == [
            False,
            False,
            True,
            False,
        ]
        assert validity.contacts(np.zeros(2)) == [("shell", "pea")]


def test_parts_of_a_body_each_count(tmp_path):
    """A carried mesh, or octree, of two parts is in contact where only its second part is inside."""
    file = meshes.write(tmp_path / "block.obj", dented(meshes.box()))
    block = Obstacle(Shape.MESH, (0.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), "block", file)
    two = meshes.joined(meshes.box((0.1,) * 3, (-1.0, 0, 0)), meshes.box((0.1,) * 3, (1.0, 0, 0)))
    mesh = carried(Shape.MESH, meshes.write(tmp_path / "two.obj", two), 1.0)
    leaves = Obstacle(
        Shape.OCTREE, (0, 0, 0), UPRIGHT, (0.1,) * 3, "leaves", points=np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    )
    bare = replace(point_robot(0.01, [-2] * 3, [2] * 3), geometry=pin.GeometryModel())
    for robot in (mesh, attach(bare, leaves, "point")):
        validity = Validity(robot, [block])
        assert [validity.free(np.array([x, 0, 0])) for x in (-1.0, 0.0, 1.0, 1.8)] == [False, True, False, True]


def test_order_does_not_count(tmp_path):
    """Meshes and primitives in another order, and among a crowd, give the same verdicts and clearances."""
    rng = np.random.default_rng(3)
    scene = []
    for kind in DEPICTED:
        for dent in (False, True):
            scene += [replace(o, name="") for o in twins(kind, "soup", dent, rng, tmp_path)]
    scene = [replace(o, position=tuple(rng.uniform(-1, 1, 3))) for o in scene]
    robot, Q = point_robot(0.02, [-2] * 3, [2] * 3), rng.uniform(-1, 1, (300, 3))
    shuffled = [scene[i] for i in rng.permutation(len(scene))]
    lists = [Validity(robot, obstacles, 0.01) for obstacles in (scene, shuffled, [*shuffled, *FAR])]
    first, *others = ([v.free(q) for q in Q] for v in lists)
    assert all(first == other for other in others) and 0.2 < np.mean(first) < 0.97
    clearances = [[v.clearance(q) for q in Q] for v in lists]
    np.testing.assert_allclose(clearances[0], clearances[1], atol=1e-9)
    np.testing.assert_allclose(clearances[0], clearances[2], atol=1e-9)


def test_two_octrees_are_refused():
    """coal takes octrees to be in contact wherever they are: a carried one among others is refused, both named."""
    leaves = Obstacle(Shape.OCTREE, (0, 0, 0), UPRIGHT, (0.1,) * 3, "vase", points=np.zeros((1, 3)))
    robot = attach(point_robot(0.01, [-2] * 3, [2] * 3), leaves, "point")
    with pytest.raises(ProblemError, match=r"'vase' and 'scan' are both octrees.*give what is carried as a mesh"):
        Validity(robot, [replace(leaves, name="scan", position=(1.0, 0, 0))])


def sheet(folder, turn: np.ndarray) -> str:
    """A square of two triangles, flat along z of its file, or turned in it."""
    corners = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]) @ turn.T
    return meshes.write(folder / "sheet.obj", (corners, np.array([[0, 1, 2], [0, 2, 3]])))


@pytest.mark.parametrize("more", [0, 70])
@pytest.mark.parametrize("flat", [True, False])
def test_flat_sheets_are_there(flat, more, tmp_path):
    """A ball meets a sheet just where it is nearer than its margin, however the file's axes lie in the sheet."""
    rng = np.random.default_rng(0)
    turn = np.eye(3) if flat else pin.rpy.rpyToMatrix(0.3, -0.4, 0.5)
    quaternion = tuple(pin.Quaternion(turn.T).coeffs().tolist())
    wall = Obstacle(Shape.MESH, (0.1, 0.0, 0.2), quaternion, (1.0, 1.0, 1.0), "sheet", sheet(tmp_path, turn))
    checker = Validity(point_robot(0.05, [-2] * 3, [2] * 3), [wall, *FAR[:more]], 0.01)
    Q = np.array(wall.position) + rng.uniform(-0.6, 0.6, (300, 3))
    offsets = Q - np.array(wall.position)
    distance = np.linalg.norm(offsets - np.clip(offsets, [-0.5, -0.5, 0], [0.5, 0.5, 0]), axis=1)
    decided = np.abs(distance - 0.06) > 1e-6
    wanted = (distance > 0.06)[decided]
    assert [checker.free(q) for q in Q[decided]] == wanted.tolist() and 20 < wanted.sum() < 280
    np.testing.assert_array_equal(checker.free_rows(Q[decided]), wanted)


@pytest.mark.parametrize("count", range(4))
def test_flat_bodies_hide_no_others(count, tmp_path):
    """Whatever flat plates a robot carries, its own bodies meet what they met without them, and so do the plates."""
    robot, box = named("panda"), Obstacle(Shape.BOX, (0.5, 0.0, 0.5), UPRIGHT, (0.2, 0.2, 0.2), "box")
    file, carrying = sheet(tmp_path, np.eye(3)), robot
    for i in range(count):
        plate = Obstacle(Shape.MESH, (0.0, 0.0, 0.3 + 0.1 * i), UPRIGHT, (0.02, 0.02, 1.0), f"plate {i}", file)
        carrying = attach(carrying, plate, robot.tool)
    with_plates, without = Validity(carrying, [box]), Validity(robot, [box])
    seen = set()
    for q in configurations(robot, np.random.default_rng(1), 400):
        met = {pair for pair in with_plates.contacts(q)}
        assert with_plates.free(q) == (not met)
        if not any("plate" in name for pair in met for name in pair):
            assert with_plates.free(q) == without.free(q)
            seen.add(without.free(q))
    assert seen == {True, False}
