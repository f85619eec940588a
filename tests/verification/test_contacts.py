"""What the verifier says of contact along a path is what looking closely at the path shows."""

from dataclasses import replace

import numpy as np
import pytest
from arms import BAXTER, PANDA, contacts, known, random_path

from pipeline.errors import ProblemError
from pipeline.robots import Obstacle, Shape, Validity, stands_clear
from pipeline.robots.bodies import Geometry
from pipeline.spec.statement import Point

TURNED = (0.1, 0.2, 0.3, 0.9273618495495703)


def boxes(rng: np.random.Generator, count: int, size: float) -> list[Obstacle]:
    found = []
    for k in range(count):
        quaternion = rng.normal(size=4)
        pose = tuple(rng.uniform([-0.8, -0.8, -0.2], [0.8, 0.8, 1.2])), tuple(quaternion / np.linalg.norm(quaternion))
        shape = (Shape.BOX, Shape.CYLINDER, Shape.SPHERE)[k % 3]
        extents = (size, size, size if shape is Shape.SPHERE else 2 * size)
        found.append(Obstacle(shape, *pose, extents, name=f"object {k}"))
    return found


def closely(path: np.ndarray, count: int) -> np.ndarray:
    share = np.linspace(0, 1, count)[:, None, None]
    return (path[:-1] + share * np.diff(path, axis=0)).swapaxes(0, 1).reshape(-1, path.shape[1])


@pytest.mark.parametrize(("robot", "seed"), [(PANDA, 0), (PANDA, 1), (BAXTER, 7)])
def test_agrees_with_dense_looks(robot, seed):
    """Among many obstacles contact is found where states close together show one, and only where there is one."""
    rng, planning = np.random.default_rng(seed), robot.robot()
    there, seen = [], {True: 0, False: 0}
    fixed = Validity(planning, ())
    for _ in range(25):
        path = random_path(robot, rng, 10, 0.2)
        there = [o for o in boxes(rng, 4 if robot is PANDA else 12, rng.uniform(0.02, 0.15)) if _stands(planning, o)]
        found = contacts(robot, there).check(path)
        validity = Validity(planning, there) if there else fixed
        free = [validity.free(q) for q in closely(path, 40)]
        seen[all(free)] += 1
        if all(free):
            assert found.contact is None or (found.contact.depth < 2e-4 and not validity.free(found.contact.state))
        else:
            assert found.contact is not None
            assert found.contact.chord <= int(np.argmin(free)) // 40
            assert not validity.free(found.contact.state)
    assert min(seen.values()) >= 3


def _stands(robot, obstacle: Obstacle) -> bool:
    return stands_clear(robot, [obstacle])


def test_free_paths_are_proven_wholly():
    """Paths that keep a tenth of a millimetre from everything are proven, not sampled: all chords."""
    rng, planning = np.random.default_rng(5), PANDA.robot()
    proven = 0
    for _ in range(30):
        path = random_path(PANDA, rng, 10, 0.1)
        there = [o for o in boxes(rng, 6, 0.1) if _stands(planning, o)]
        close = Validity(planning, there, margin=2e-4)
        if all(close.free(q) for q in closely(path, 40)):
            found = contacts(PANDA, there).check(path)
            assert found.contact is None and not found.sampled
            proven += 1
    assert proven > 3


def test_order_and_detail_of_what_is_said_change_nothing():
    """Obstacles in another order, a path with states put in, and one the other way round have the same verdict."""
    rng, planning, seen = np.random.default_rng(3), PANDA.robot(), set()
    for _ in range(20):
        path = random_path(PANDA, rng, 8, 0.3)
        there = [o for o in boxes(rng, 5, 0.12) if _stands(planning, o)]
        verdict = contacts(PANDA, there).check(path).contact is None
        finer = np.concatenate([closely(path, 4), path[-1:]])
        for obstacles, way in (
            (there[::-1], path),
            (there, finer),
            (there, path[::-1]),
            (there, np.repeat(path, 2, 0)),
        ):
            assert (contacts(PANDA, obstacles).check(way).contact is None) == verdict
        seen.add(verdict)
    assert seen == {True, False}


def test_the_same_body_said_in_three_ways(tmp_path):
    """A box, the closed mesh of it with its faces wound anyhow, and its mirror image have the same verdict."""
    file = write_box(tmp_path / "box.obj")
    rng, planning, seen = np.random.default_rng(4), PANDA.robot(), set()
    for _ in range(20):
        path = random_path(PANDA, rng, 6, 0.3)
        place, size = tuple(rng.uniform([-0.8, -0.8, 0.1], [0.8, 0.8, 1.0])), (0.3, 0.2, 0.1)
        box = Obstacle(Shape.BOX, place, TURNED, size, name="it")
        if not _stands(planning, box):
            continue
        mesh = replace(box, shape=Shape.MESH, file=str(file))
        mirrored = replace(mesh, size=(-0.3, 0.2, 0.1))
        verdicts = [contacts(PANDA, [o]).check(path).contact is None for o in (box, mesh, mirrored)]
        assert len(set(verdicts)) == 1
        seen.add(verdicts[0])
    assert seen == {True, False}


def test_within_a_closed_mesh_is_contact(tmp_path):
    """A robot wholly inside a closed mesh that is not convex is in contact; inside an open one it is free."""
    outer, inner = box_faces(5.0), box_faces(4.0)  # a hollow with walls; and with a third shell, solid again
    path = np.zeros((2, 7)) + np.array([0, -0.5, 0, -2.0, 0, 1.5, 0.7])
    path[1, 0] += 0.1
    base = [item for item in known(PANDA)[1] if item.joint == -1]
    assert base  # it stands, and is not asked here
    for shells, free in (
        ([outer, box_faces(0.01)], False),
        ([outer, inner], True),
        ([outer, inner, box_faces(3.0)], False),
    ):
        file = tmp_path / "shells.obj"
        file.write_text("".join(text(v, f, 8 * k) for k, (v, f) in enumerate(shells)))
        stands = Obstacle(Shape.MESH, (0.0, 0.0, 0.3), TURNED, (1.0, 1.0, 1.0), "shells", str(file))
        assert (contacts(PANDA, [stands]).check(path).contact is None) == free, len(shells)
    vertices, faces = outer
    file = tmp_path / "open.obj"
    file.write_text(text(vertices, faces[:-1], 0))
    stands = Obstacle(Shape.MESH, (0.0, 0.0, 0.3), TURNED, (1.0, 1.0, 1.0), "open", str(file))
    assert contacts(PANDA, [stands]).check(path).contact is None


def test_touching_has_a_depth():
    """What may touch may be in each other by 2 mm, or a tenth of the thinner one, or as is said, and by no more."""
    ball = Point(0.03, (-1.0,) * 3, (1.0,) * 3)
    path = np.array([[-0.1, 0.0, 0.03], [0.1, 0.0, 0.03]])
    for thickness, asked, allowed in (
        (0.05, None, 0.002),
        (0.01, None, 0.001),
        (0.05, 0.004, 0.004),
        (0.05, 1e-4, 1e-4),
    ):
        for deep, free in ((0.95 * allowed, True), (1.05 * allowed, False)):
            place = (0.0, 0.0, deep - thickness / 2)
            plate = Obstacle(Shape.BOX, place, (0.0, 0.0, 0.0, 1.0), (0.1, 0.1, thickness), name="plate")
            assert contacts(ball, [plate]).check(path).contact is not None
            found = contacts(ball, [plate], {("point", "plate"): asked}).check(path)
            assert (found.contact is None) == free, (thickness, asked, deep)
            assert not found.sampled or abs(allowed - deep) < 1e-5  # nearer to a bound than can be proven
            if found.contact is not None:
                assert found.contact.depth == pytest.approx(deep, abs=1e-5)
            deepest = contacts(ball, [plate], {("point", "plate"): asked}).deepest(path[[0]] * 0 + [0, 0, 0.03])
            assert deepest is not None and deepest[2] == pytest.approx(deep, abs=1e-6)


def test_touching_that_cannot_be_is_refused():
    """A depth beyond half of the thinner body, and one in a mesh that is not convex, are refused by name."""
    ball, plate = (
        Point(0.03, (-1.0,) * 3, (1.0,) * 3),
        Obstacle(Shape.BOX, (0.0,) * 3, TURNED, (0.1, 0.1, 0.01), "plate"),
    )
    with pytest.raises(ProblemError, match=r"0.006 m deep.*at most 0.005"):
        contacts(ball, [plate], {("point", "plate"): 0.006})
    with pytest.raises(ProblemError, match=r"platte.*did you mean 'plate'"):
        contacts(ball, [plate], {("point", "platte"): None})


def test_a_sphere_inside_an_octree_leaf_and_beside_it():
    """An octree is solid, and only where its leaves are."""
    q = np.array([0, -0.5, 0, -2.0, 0, 1.5, 0.7])
    path = np.stack([q, q + 0.3 * np.eye(7)[0]])
    kinematics, items, _ = known(PANDA)
    R, p = kinematics.joint_poses(path)
    hand = next(item for item in items if "hand" in item.name)
    at = R[1, hand.joint] @ (hand.place.R @ hand.form.middle + hand.place.p) + p[1, hand.joint]
    for points, free in (([at], False), ([at + np.array([0, 0, 1.0])], True)):
        octree = Obstacle(
            Shape.OCTREE, (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (0.02,) * 3, "leaves", points=np.array(points)
        )
        assert (contacts(PANDA, [octree]).check(path).contact is None) == free


def test_meshes_of_a_robot_are_held_as_they_are():
    """With its meshes in place of their hulls, a path free with hulls is free; no verdict is an error."""
    meshes = replace(PANDA, geometry=Geometry.MESHES, name="panda meshes")
    rng = np.random.default_rng(6)
    for _ in range(3):
        path = random_path(PANDA, rng, 5, 0.2)
        assert contacts(meshes).check(path).contact is None


def box_faces(size: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners (8, 3) and triangles (12, 3) of a cube, the triangles wound anyhow."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    squares = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return corners, np.array([face for a, b, c, d in squares for face in ((a, b, c), (c, a, d))])


def text(vertices: np.ndarray, faces: np.ndarray, first: int) -> str:
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1 + first]
    return "\n".join(lines) + "\n"


def write_box(file):
    file.write_text(text(*box_faces(1.0), 0))
    return file


def test_clearance_is_the_least_of_all_pairs():
    """The least distance over states, found without asking all pairs, is that of asking each."""
    rng, planning = np.random.default_rng(8), PANDA.robot()
    for count in (1, 8, 40):
        path = random_path(PANDA, rng, 30, 0.1)
        there = [o for o in boxes(rng, count, 0.05) if _stands(planning, o)]
        expected = min((Validity(planning, there).clearance(q) for q in path), default=np.inf)
        assert contacts(PANDA, there).least(path) == pytest.approx(expected, abs=1e-6)
