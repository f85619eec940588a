"""Points are inside closed meshes where a closed form says so, whatever way the mesh is written."""

import numpy as np
import pytest

from pipeline.robots import solids
from pipeline.robots.meshes import Mesh
from pipeline.robots.solids import Solid
from tests.robots import meshes
from tests.robots.test_meshes import WAYS

RNG = np.random.default_rng


def in_torus(points: np.ndarray) -> np.ndarray:
    """Signed distance of points to the torus of `meshes.torus`."""
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.4, points[:, 2]) - 0.15


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-2, -1, 1), (0.5, 1, -1)])
@pytest.mark.parametrize("way", WAYS)
def test_torus(way, scale):
    """Of random points those are inside that are so in closed form, but within a facet's error of the surface."""
    points, faces = WAYS[way](meshes.torus(), RNG(2))
    solid, Q = Solid(Mesh.of(points * scale, faces)), RNG(3).uniform(-0.6, 0.6, (4000, 3))
    distance = in_torus(Q)
    decided = np.abs(distance) > 1.5e-3
    found = solid.contains(Q * scale)
    np.testing.assert_array_equal(found[decided], distance[decided] < 0)
    assert found.mean() > 0.05


def test_rays_through_corners_and_edges():
    """A ray that leaves through a corner or an edge counts the surface once."""
    points, faces = meshes.torus(count=24)
    mesh, ray = Mesh.of(points, faces), solids._TURN[:, 2]
    solid = Solid(mesh)
    edges = (mesh.vertices[mesh.faces[:, 0]] + mesh.vertices[mesh.faces[:, 1]]) / 2
    for targets in (mesh.vertices, edges):
        for back in (0.003, 0.05, 0.2, 1.0):
            Q = targets - back * ray
            distance = in_torus(Q)
            decided = np.abs(distance) > 0.01
            np.testing.assert_array_equal(solid.contains(Q)[decided], distance[decided] < 0)


def test_brute_force():
    """Few points against many meshes of few faces, as many cells as there are: the solid angle says the same."""
    for seed in range(40):
        rng = RNG(seed)
        points, faces = meshes.box(rng.uniform(0.01, 1, 3)) if seed % 2 else meshes.corner()
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        points = points @ turn + rng.normal(size=3)
        Q = points.mean(axis=0) + rng.uniform(-0.8, 0.8, (50, 3))
        np.testing.assert_array_equal(
            Solid(Mesh.of(points, faces)).contains(Q), np.abs(winding(points, faces, Q)) > 0.5
        )


def winding(points: np.ndarray, faces: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Solid angle of a mesh seen from points, in whole spheres (van Oosterom and Strackee); 0 outside."""
    a, b, c = (points[faces[:, i]][None] - Q[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    triple = np.einsum("qfi,qfi->qf", a, np.cross(b, c))
    below = la * lb * lc
    below += (
        np.einsum("qfi,qfi->qf", a, b) * lc + np.einsum("qfi,qfi->qf", b, c) * la + np.einsum("qfi,qfi->qf", a, c) * lb
    )
    return np.arctan2(triple, below).sum(axis=1) / (2 * np.pi)


def test_corner_is_wound_consistently():
    """The mesh that solid angles are taken of has all faces outwards, or all inwards."""
    for points, faces in (meshes.box(), meshes.corner()):
        assert abs(winding(points, faces, points.mean(axis=0)[None] - 0.01)[0]) == pytest.approx(1)


def shells(*sizes: float):
    """Boxes one in the other."""
    return meshes.joined(*(meshes.box((size,) * 3) for size in sizes))


@pytest.mark.parametrize("way", WAYS)
def test_hollows(way):
    """A box in a box bounds a hollow, one in the hollow is solid again, whatever way their faces are wound."""
    solid = Solid(Mesh.of(*WAYS[way](shells(1.0, 0.6, 0.2), RNG(5))))
    Q = RNG(6).uniform(-0.7, 0.7, (3000, 3))
    reach = 2 * np.abs(Q).max(axis=1)
    np.testing.assert_array_equal(solid.contains(Q), (reach < 0.2) | ((reach > 0.6) & (reach < 1.0)))


def test_parts_that_reach_into_each_other():
    """Two boxes that overlap are solid together, where they overlap too."""
    solid = Solid(Mesh.of(*meshes.joined(meshes.box(), meshes.box(middle=(0.5, 0.3, 0.2)))))
    Q = RNG(7).uniform(-0.6, 1.2, (3000, 3))
    inside = [(np.abs(Q - middle) < 0.5).all(axis=1) for middle in ((0, 0, 0), (0.5, 0.3, 0.2))]
    np.testing.assert_array_equal(solid.contains(Q), inside[0] | inside[1])


def test_open_parts_enclose_nothing():
    """Of a closed and an open part only the closed one has an inside."""
    points, faces = meshes.joined(meshes.box(), meshes.box(middle=(2.0, 0, 0)))
    solid = Solid(Mesh.of(points, faces[:-1]))
    assert solid.contains(np.array([[0.0, 0, 0], [2.0, 0, 0], [0.1, 0.2, 0.3]])).tolist() == [True, False, True]


def test_long_faces(monkeypatch):
    """Faces that reach over all cells are found in each, with fewer cells where the lists would be long."""
    needle = meshes.tube(0.001, 3.0, 300)
    Q = np.array([0, 0, 1]) * RNG(8).uniform(-2, 2, (500, 1)) + RNG(9).normal(0, 5e-4, (500, 3)) * [1, 1, 0]
    inside = (np.hypot(Q[:, 0], Q[:, 1]) < 0.001 * np.cos(np.pi / 300)) & (np.abs(Q[:, 2]) < 1.5)
    for entries in (4_000_000, 5000):
        monkeypatch.setattr(solids, "_ENTRIES", entries)
        found = Solid(Mesh.of(*needle)).contains(Q)
        assert (found == inside).mean() > 0.99  # a few lie between the chord and the arc
    assert 0.1 < inside.mean() < 0.9
