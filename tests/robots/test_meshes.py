"""Whether a mesh is closed and convex follows from its surface, however it is written."""

import numpy as np
import pytest

from pipeline.robots.meshes import Mesh
from tests.robots import meshes

BODIES = {
    "box": (meshes.box((1.0, 2.0, 0.3)), True),
    "ball": (meshes.ball(), True),
    "tube": (meshes.tube(), True),
    "torus": (meshes.torus(), False),
    "corner": (meshes.corner(), False),
    "two boxes": (meshes.joined(meshes.box(), meshes.box(middle=(3.0, 0, 0))), False),
}
WAYS = {
    "as drawn": lambda mesh, rng: mesh,
    "faces turned": meshes.flipped,
    "soup": meshes.soup,
    "turned soup": lambda mesh, rng: meshes.soup(meshes.flipped(mesh, rng), rng),
    "every face twice": lambda mesh, rng: meshes.joined(mesh, meshes.flipped(mesh, rng)),
}


def rounded(mesh: meshes.Triangles, rng: np.random.Generator) -> meshes.Triangles:
    """A soup whose vertices are those of a file of single precision."""
    points, faces = meshes.soup(mesh, rng)
    return points.astype(np.float32).astype(float), faces


@pytest.mark.parametrize("way", [*WAYS, "rounded"])
@pytest.mark.parametrize("name", BODIES)
def test_closed_and_convex(name, way):
    """A body is closed and convex or not in whatever way its faces are listed, wound or repeated."""
    mesh, convex = BODIES[name]
    found = Mesh.of(*WAYS.get(way, rounded)(mesh, np.random.default_rng(1)))
    assert found.closed.all() and len(found.closed) == (2 if name == "two boxes" else 1)
    assert (found.hull is not None) == convex
    assert found.areas.sum() == pytest.approx(Mesh.of(*mesh).areas.sum(), rel=1e-6)


@pytest.mark.parametrize("name", BODIES)
def test_a_hole_opens(name):
    """Without one of its faces a body is open, and so has no hull that could stand for it."""
    points, faces = BODIES[name][0]
    found = Mesh.of(points, faces[:-1])
    assert not found.closed.all() and found.hull is None


def test_sheets_are_open():
    """A square is open, also with each of its faces twice, as of two sides; a fin on a box opens the whole."""
    points, faces = meshes.box()
    assert not Mesh.of(points, faces[:2]).closed.any()
    assert not Mesh.of(points, np.concatenate([faces[:2], faces[:2, ::-1]])).closed.any()
    fin = np.concatenate([points, [[2.0, 0, 0]]]), np.concatenate([faces, [[0, 1, 8]]])
    assert not Mesh.of(*fin).closed.any()


def test_hulls_are_the_bodies():
    """The hull that stands for a closed convex mesh has its corners, and those only."""
    points, faces = meshes.tube(count=12)
    hull = Mesh.of(points, faces).hull
    found = np.array(hull.points())
    assert len(found) == 24  # the middles of the caps are no corners
    assert {tuple(p) for p in found.round(9)} == {tuple(p) for p in points[:24].round(9)}


def test_corners_with_too_many_neighbours():
    """coal holds no corner with more than 255 neighbours: then there is no hull, and no error."""
    apex = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    turn = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(300)], axis=1)
    i, after = np.arange(300), (np.arange(300) + 1) % 300
    faces = [np.stack([np.full(300, 300 + k), i, after], axis=1) for k in (0, 1)]
    found = Mesh.of(np.concatenate([ring, apex]), np.concatenate(faces))
    assert found.closed.all() and found.hull is None
