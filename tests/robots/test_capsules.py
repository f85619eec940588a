"""Capsules hold the bodies they are made for, and stand out from them little."""

import tracemalloc

import coal
import numpy as np
import pytest

from pipeline.errors import RobotError
from pipeline.robots.capsules import Capsule, capsules
from pipeline.robots.shapes import BodyShape
from pipeline.robots.surfaces import triangles
from tests.robots import meshes
from tests.robots.named import named
from tests.robots.test_shapes import coal_mesh
from tests.robots.worlds import fibonacci, on_sphere, rotation


def beyond(found: tuple[Capsule, ...], points: np.ndarray) -> np.ndarray:
    """How far points (N, 3) are from the nearest capsule (N,), by the distance to a segment written out."""
    distances = []
    for capsule in found:
        first, second = capsule.ends
        along = second - first
        foot = (points - first) @ along / (along @ along) if along.any() else np.zeros(len(points))
        nearest = first + np.clip(foot, 0, 1)[:, None] * along
        distances.append(np.linalg.norm(points - nearest, axis=1) - capsule.radius)
    return np.min(distances, axis=0)


def points_of(shape: coal.CollisionGeometry, rng: np.random.Generator, count: int = 1000) -> np.ndarray:
    """Points on and in a shape: of its surface in closed form where it is round, else corners, faces and inside."""
    if isinstance(shape, coal.Sphere):
        return shape.radius * on_sphere(rng, count)
    if isinstance(shape, coal.Capsule):
        ball = on_sphere(rng, count)
        return shape.radius * ball + shape.halfLength * np.sign(ball[:, 2:]) * [0, 0, 1]
    if isinstance(shape, coal.Cylinder):
        angle, z = rng.uniform(0, 2 * np.pi, count), shape.halfLength * rng.choice([-1, 1, 0.9], count)
        return np.stack([shape.radius * np.cos(angle), shape.radius * np.sin(angle), z], axis=1)
    corners, faces = triangles(shape)
    on = np.einsum("fk,fki->fi", rng.dirichlet(np.ones(3), count), corners[faces[rng.integers(len(faces), size=count)]])
    within = np.einsum(
        "nk,nki->ni", rng.dirichlet(np.ones(4), count), corners[rng.integers(len(corners), size=(count, 4))]
    )
    return np.concatenate([corners, on, within] if BodyShape(shape).convex else [corners, on])


@pytest.mark.parametrize("name", ["panda", "ur5", "kinova", "baxter_both", "sawyer"])
def test_bodies_are_held(name):
    """All corners of a body, and points on its faces and inside, are in a capsule; of a robot without exception."""
    rng = np.random.default_rng(0)
    for body in named(name).geometry.geometryObjects:
        found = capsules(body.geometry)
        assert 1 <= len(found) <= 4
        assert beyond(found, points_of(body.geometry, rng)).max() <= 0, body.name


def test_grasped_bodies_are_held():
    """So are plates, needles, cubes, surfaces, meshes with a hole, flat meshes and octrees, however thin."""
    rng = np.random.default_rng(1)
    boxes = [coal.Box(*10 ** rng.uniform(-4, 0, 3)) for _ in range(8)]
    points, faces = meshes.box()
    flat = points * [1, 1, 0], faces[:2]
    bodies = [coal_mesh(mesh) for mesh in (meshes.torus(), (points, faces[:2]), flat)]
    octree = coal.makeOctree(rng.uniform(-0.3, 0.3, (50, 3)), 0.05)
    for shape in (*boxes, *bodies, octree):
        assert beyond(capsules(shape), points_of(shape, rng)).max() <= 0


def test_round_bodies_are_their_own_capsules():
    """A sphere and a capsule get themselves, a long cylinder its radius, a flat one the ball around it."""
    for shape, length, radius in (
        (coal.Sphere(0.2), 0.0, 0.2),
        (coal.Capsule(0.1, 0.5), 0.5, 0.1),
        (coal.Cylinder(0.1, 20.0), 20.0, 0.1),
        (coal.Cylinder(0.3, 1e-3), 0.0, 0.3),
    ):
        (found,) = capsules(shape)
        assert np.linalg.norm(found.ends[1] - found.ends[0]) == pytest.approx(length, abs=0.05 * radius)
        assert radius < found.radius < 1.002 * radius
        assert beyond((found,), points_of(shape, np.random.default_rng(2))).max() <= 0


def test_capsules_are_close():
    """The capsule of a capsule's points is that capsule; that of any body is no larger than the ball around its box."""
    turn, middle = rotation([0.3, -0.5, 0.2, 0.7]), np.array([0.3, -2.0, 1.0])
    ball = 0.07 * fibonacci(400)
    points = (ball + 0.15 * np.sign(ball[:, 2:]) * [0, 0, 1]) @ turn.T + middle
    listed = coal.StdVec_Vec3s()
    listed.extend(list(points))
    (found,) = capsules(coal.Convex.convexHull(listed, True, "Qt"))
    assert found.volume == pytest.approx(np.pi * 0.07**2 * (0.3 + 4 / 3 * 0.07), rel=0.02)
    for body, shape in zip(named("panda").geometry.geometryObjects, named("panda").shapes, strict=True):
        assert sum(found.volume for found in capsules(body.geometry)) <= 4 / 3 * np.pi * shape.radius**3


def test_plates_are_cut():
    """A tray gets capsules around four strips of it: a quarter as wide as one around all of it."""
    strips = capsules(coal.Box(0.4, 0.3, 0.02))
    assert len(strips) == 4
    for strip in strips:
        assert strip.radius == pytest.approx(np.hypot(0.3 / 8, 0.01), rel=0.05)


def test_same_body_same_capsules():
    """The same shape gives the same capsules to the bit, whether they were kept or are made again."""
    first = capsules(coal.Box(0.4, 0.3, 0.02))
    capsules.__globals__["_around"].cache_clear()
    for one, other in zip(first, capsules(coal.Box(0.4, 0.3, 0.02)), strict=True):
        assert one.ends.tobytes() == other.ends.tobytes() and one.radius == other.radius


def test_fine_meshes():
    """A plate of 10 000 corners has the capsule of the same plate of four, in memory that grows with them only."""
    turn, size, found = rotation([0.3, -0.5, 0.2, 0.7]), np.array([0.4, 0.1, 0.0]), []
    for count in (2, 41):
        steps = np.linspace(-0.5, 0.5, count)
        points = np.stack([*np.meshgrid(steps, steps, indexing="ij"), np.zeros((count, count))], axis=-1).reshape(-1, 3)
        plate = coal_mesh((points * size @ turn.T, meshes.grid(count, count, False)))
        tracemalloc.start()
        found.append(capsules(plate))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert most < 1e6 + 1000 * plate.num_vertices  # [bytes]; the squares of 10 000 numbers are 800 MB
    (few,), (fine,) = found
    assert fine.radius == pytest.approx(few.radius, rel=1e-3) and fine.volume == pytest.approx(few.volume, rel=1e-3)
    np.testing.assert_allclose(np.sort(fine.ends, axis=0), np.sort(few.ends, axis=0), atol=1e-3)


def test_what_coal_makes_thicker():
    """A shape with coal's swept sphere radius is refused with its value."""
    shape = coal.Box(0.1, 0.1, 0.1)
    shape.setSweptSphereRadius(0.05)
    with pytest.raises(RobotError, match=r"a Box has a swept sphere radius of 0\.05 m"):
        capsules(shape)


def test_what_has_no_surface():
    """A half-space is refused by name."""
    with pytest.raises(RobotError, match="a Halfspace has no surface"):
        capsules(coal.Halfspace(np.array([0.0, 0, 1]), 0.0))
