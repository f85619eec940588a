"""What closed meshes enclose, by closed forms, and meshes that are not convex against the boxes they are made of."""

from dataclasses import replace

import coal
import numpy as np
import pytest
from arms import PANDA, UR5, contacts, random_path

from pipeline.robots import Obstacle, Shape, stands_clear
from pipeline.spec.statement import Point
from pipeline.verification.shapes import Form, form_of
from pipeline.verification.solids import Inside, Surface

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
SQUARES = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
FACES = np.array([face for a, b, c, d in SQUARES for face in ((a, b, c), (c, a, d))])
FLAT = (0.0, 0.0, 0.0, 1.0)


def torus(major: float, minor: float, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of a closed ring."""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    u, v = (angle.ravel() for angle in np.meshgrid(turn, turn, indexing="ij"))
    ring = major + minor * np.cos(v)
    corners = np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], axis=1)
    i, j = (index.ravel() for index in np.meshgrid(range(count), range(count), indexing="ij"))
    a, b = i * count + j, i * count + (j + 1) % count
    c, d = (i + 1) % count * count + j, (i + 1) % count * count + (j + 1) % count
    return corners, np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, c, d], axis=1)])


def mesh_of(corners: np.ndarray, faces: np.ndarray) -> coal.BVHModelOBBRSS:
    made = coal.BVHModelOBBRSS()
    made.beginModel(len(faces), 3 * len(faces))
    made.addVertices(np.ascontiguousarray(corners[faces].reshape(-1, 3)))
    made.addTriangles(np.arange(3 * len(faces)).reshape(-1, 3))
    made.endModel()
    return made


def written(path, shells) -> str:
    lines, first = [], 1
    for corners, faces in shells:
        lines += [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in corners]
        lines += [f"f {a} {b} {c}" for a, b, c in faces + first]
        first += len(corners)
    path.write_text("\n".join(lines) + "\n")
    return str(path)


@pytest.mark.parametrize("wound", [False, True])
def test_points_in_a_ring(wound):
    """Points are inside a torus as its equation says, whatever way its faces are wound; a shuffled file is the same."""
    rng, (corners, faces) = np.random.default_rng(0), torus(1.0, 0.4)
    if wound:
        faces = faces[rng.permutation(len(faces))]
        faces[::2] = faces[::2, ::-1]
    inside = Inside(Surface.read(mesh_of(corners, faces)))
    points = rng.uniform([-1.5, -1.5, -0.5], [1.5, 1.5, 0.5], (2000, 3))
    off = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1, points[:, 2]) - 0.4
    clear = np.abs(off) > 0.01  # the triangles are chords of the torus
    np.testing.assert_array_equal(inside(points[clear]), off[clear] < 0)


def test_shells_in_shells():
    """Of cubes in each other every other one bounds a hollow; cubes that cut each other are solid together."""
    at = np.array([[0.0, 0, 0], [0.2, 0, 0], [0.4, 0, 0], [0.6, 0, 0]])
    shells = [CORNERS * size for size in (1.0, 0.6, 0.2)]
    corners, faces = np.concatenate(shells), np.concatenate([FACES + 8 * k for k in range(3)])
    assert Inside(Surface.of(corners, faces))(at).tolist() == [True, False, True, False]
    corners, faces = np.concatenate([CORNERS, CORNERS + np.array([0.5, 0.1, 0.1])]), np.concatenate([FACES, FACES + 8])
    assert Inside(Surface.of(corners, faces))(at).tolist() == [True, True, True, True]


def test_what_is_closed_and_what_is_convex():
    """A cube is convex, without a face open, a ring closed and not convex; vertices once per face change nothing."""
    assert Form(mesh_of(CORNERS, FACES)).convex and not Form(mesh_of(CORNERS, FACES)).open
    ring = Form(mesh_of(*torus(1.0, 0.4)))
    assert not ring.convex and not ring.open and ring.inside is not None
    sheet = Form(mesh_of(CORNERS, FACES[:-1]))
    assert sheet.open and not sheet.convex and sheet.inside is None


@pytest.mark.parametrize("robot", [PANDA, UR5], ids=lambda robot: robot.name)
def test_two_boxes_as_one_mesh(tmp_path, robot):
    """An L of two boxes and the same as one closed mesh in two shells have the same verdict, in another order too."""
    rng, planning, seen = np.random.default_rng(2), robot.robot(), {True: 0, False: 0}
    for k in range(40):
        path = random_path(robot, rng, 6, 0.5)
        at, long, high = rng.uniform([-0.6, -0.6, 0.2], [0.4, 0.6, 0.8]), (0.6, 0.1, 0.1), (0.1, 0.1, 0.6)
        up = at + np.array([0.25, 0.0, 0.25])
        boxes = [
            Obstacle(Shape.BOX, tuple(at), FLAT, long, name="long"),
            Obstacle(Shape.BOX, tuple(up), FLAT, high, name="high"),
        ]
        if not stands_clear(planning, boxes):
            continue
        shells = [(CORNERS * long, FACES), (CORNERS * high + (up - at), FACES)]
        mesh = Obstacle(Shape.MESH, tuple(at), FLAT, (1.0,) * 3, "both", written(tmp_path / f"{k}.obj", shells))
        assert not form_of(mesh).convex
        verdicts = [contacts(robot, there).check(path).contact for there in (boxes, boxes[::-1], [mesh])]
        assert len({contact is None for contact in verdicts}) == 1
        assert len({contact.chord for contact in verdicts if contact}) <= 1
        seen[verdicts[0] is None] += 1
    assert min(seen.values()) > 5


def test_a_carried_ball_in_a_hollow_ring(tmp_path):
    """A thing wholly inside a ring's tube is in contact, one in its hole is free, at starts as along the way."""
    ball = Point(0.05, (-3.0,) * 3, (3.0,) * 3)
    ring = Obstacle(Shape.MESH, (0.0,) * 3, FLAT, (1.0,) * 3, "ring", written(tmp_path / "ring.obj", [torus(1.0, 0.4)]))
    turn = np.linspace(0, 2, 40)[:, None]
    around = np.concatenate([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    for radius, free in ((1.0, False), (0.5, True), (1.5, True), (0.6, False)):
        for scale in (1.0, -1.0):
            there = replace(ring, size=(scale, 1.0, 1.0))
            found = contacts(ball, [there]).check(radius * around)
            assert (found.contact is None) == free, radius
            assert free or found.contact is None or found.contact.chord == 0
