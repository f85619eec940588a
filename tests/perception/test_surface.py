"""Surface points: on the surface, uniform by area, repeatable."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chisquare, ks_2samp, kstest

from pipeline.errors import ConfigError
from pipeline.perception import VoxelParameters, scene_voxels, surface_area, surface_points
from pipeline.robots import Obstacle, Shape
from tests.robots import meshes

TURNED = tuple(Rotation.from_euler("xyz", [0.3, -1.1, 2.0]).as_quat())
BOX = Obstacle(Shape.BOX, (0.2, -0.4, 0.1), TURNED, (0.3, 0.5, 0.8))
SPHERE = Obstacle(Shape.SPHERE, (-0.5, 0.0, 0.3), TURNED, (0.4, 0.4, 0.4))
CYLINDER = Obstacle(Shape.CYLINDER, (0.6, 0.6, -0.2), TURNED, (0.4, 0.4, 0.7))


def in_frame(points: np.ndarray, obstacle: Obstacle) -> np.ndarray:
    return Rotation.from_quat(obstacle.quaternion).inv().apply(points - obstacle.position)


def draw(obstacle: Obstacle, count: int, seed: int = 0) -> np.ndarray:
    density = count / surface_area(obstacle)
    return in_frame(surface_points([obstacle], density, np.random.default_rng(seed)), obstacle)


@pytest.mark.parametrize(
    ("obstacle", "area"),
    [
        (BOX, 2 * (0.3 * 0.5 + 0.3 * 0.8 + 0.5 * 0.8)),
        (SPHERE, 4 * np.pi * 0.2**2),
        (CYLINDER, 2 * np.pi * 0.2 * 0.7 + 2 * np.pi * 0.2**2),
    ],
)
def test_area(obstacle, area):
    """The area of each shape is the textbook's."""
    assert surface_area(obstacle) == pytest.approx(area, rel=1e-12)


def signed_distance(local: np.ndarray, obstacle: Obstacle) -> np.ndarray:
    """Closed forms; coal's distance to a cylinder is off by decimetres for a sphere half inside it."""
    x, y, z = np.array(obstacle.size) / 2
    if obstacle.shape is Shape.SPHERE:
        return np.linalg.norm(local, axis=1) - x
    if obstacle.shape is Shape.BOX:
        outside = np.abs(local) - [x, y, z]
    else:
        outside = np.stack([np.hypot(local[:, 0], local[:, 1]) - x, np.abs(local[:, 2]) - z], axis=1)
    return np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0)


@pytest.mark.parametrize("obstacle", [BOX, SPHERE, CYLINDER])
def test_on_surface(obstacle):
    """Every point lies at signed distance 0 of its shape at its pose in the world."""
    points = surface_points([obstacle], 600.0, np.random.default_rng(0))
    assert len(points) == round(600.0 * surface_area(obstacle))
    np.testing.assert_allclose(signed_distance(in_frame(points, obstacle), obstacle), 0, atol=1e-12)


def test_box_uniform():
    """On a box, the six faces get points by their areas, and points are uniform within a face."""
    local = draw(BOX, 30_000) / BOX.size * 2  # faces at +-1
    axis = np.abs(local).argmax(axis=1)
    face = 2 * axis + (local[np.arange(len(local)), axis] > 0)
    areas = np.repeat([0.5 * 0.8, 0.3 * 0.8, 0.3 * 0.5], 2)
    assert chisquare(np.bincount(face, minlength=6), len(local) * areas / areas.sum()).pvalue > 1e-4
    for across in range(3):
        for along in {0, 1, 2} - {across}:
            assert kstest(local[axis == across][:, along], "uniform", args=(-1, 2)).pvalue > 1e-4


def test_sphere_uniform():
    """On a sphere, each coordinate is uniform (Archimedes' hat box)."""
    local = draw(SPHERE, 20_000)
    for column in local.T:
        assert kstest(column, "uniform", args=(-0.2, 0.4)).pvalue > 1e-4


def test_cylinder_uniform():
    """On a cylinder, mantle and caps get points by area; angle, height and squared radius are uniform."""
    local = draw(CYLINDER, 30_000)
    radius, angle = np.hypot(local[:, 0], local[:, 1]), np.arctan2(local[:, 1], local[:, 0])
    top, bottom = local[:, 2] > 0.35 - 1e-9, local[:, 2] < -0.35 + 1e-9
    mantle = ~(top | bottom)
    cap, side = np.pi * 0.2**2, 2 * np.pi * 0.2 * 0.7
    expected = np.array([side, cap, cap]) / (side + 2 * cap) * len(local)
    assert chisquare([mantle.sum(), top.sum(), bottom.sum()], expected).pvalue > 1e-4
    np.testing.assert_allclose(radius[mantle], 0.2, rtol=1e-9)
    assert kstest(angle, "uniform", args=(-np.pi, 2 * np.pi)).pvalue > 1e-4
    assert kstest(local[mantle, 2], "uniform", args=(-0.35, 0.7)).pvalue > 1e-4
    assert kstest(radius[~mantle] ** 2, "uniform", args=(0, 0.04)).pvalue > 1e-4


def test_shared_by_area():
    """Among several obstacles, each gets points in the proportion of its area."""
    scene = [BOX, SPHERE, CYLINDER]
    points = surface_points(scene, 5000.0, np.random.default_rng(1))
    areas = np.array([surface_area(o) for o in scene])
    assert len(points) == round(5000 * areas.sum())
    on_sphere = np.abs(np.linalg.norm(in_frame(points, SPHERE), axis=1) - 0.2) < 1e-9
    local = in_frame(points, BOX)
    on_box = np.abs(np.abs(local / BOX.size * 2).max(axis=1) - 1) < 1e-9
    found = [on_box.sum(), on_sphere.sum(), (~on_box & ~on_sphere).sum()]
    assert chisquare(found, len(points) * areas / areas.sum()).pvalue > 1e-4


def test_repeatable():
    """Equal seeds give equal points, other seeds others."""
    points = [surface_points([BOX, CYLINDER], 100.0, np.random.default_rng(seed)) for seed in (3, 3, 4)]
    assert np.array_equal(points[0], points[1])
    assert not np.array_equal(points[0], points[2])


def test_nothing_to_draw():
    """No obstacles, or no density, give no points; a negative density is refused by value."""
    assert surface_points([], 100.0, np.random.default_rng(0)).shape == (0, 3)
    assert surface_points([BOX], 0.0, np.random.default_rng(0)).shape == (0, 3)
    with pytest.raises(ConfigError, match=r"-1\.0 points"):
        surface_points([BOX], -1.0, np.random.default_rng(0))


# Meshes of which closed forms are known, and of octrees the box that their leaves fill.
MESHES = {"box": BOX, "cylinder": CYLINDER, "sphere": SPHERE}


def depicted(name: str, folder, rng: np.random.Generator, mirrored: bool = False) -> Obstacle:
    """The mesh that depicts a primitive, its faces wound anyhow."""
    drawn = {"box": meshes.box(), "cylinder": meshes.tube(count=100), "sphere": meshes.ball(count=100)}[name]
    sign = -1.0 if mirrored else 1.0
    points, faces = meshes.soup(meshes.flipped(drawn, rng), rng)
    file = meshes.write(folder / f"{name}.obj", (points * sign, faces))
    return replace(MESHES[name], shape=Shape.MESH, size=tuple(sign * s for s in MESHES[name].size), file=file)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("name", MESHES)
def test_meshes_have_the_points_of_what_they_depict(name, mirrored, tmp_path):
    """A mesh has its primitive's area, its points are on the primitive's surface, and as many in each octant."""
    primitive, mesh = MESHES[name], depicted(name, tmp_path, np.random.default_rng(0), mirrored)
    assert surface_area(mesh) == pytest.approx(surface_area(primitive), rel=1e-3)
    drawn, expected = draw(mesh, 20_000), draw(primitive, 20_000, seed=1)
    assert len(drawn) == pytest.approx(20_000, rel=1e-3)
    error = 1e-9 if name == "box" else 4e-4
    assert np.abs(signed_distance(drawn, primitive)).max() < error
    for column, other in zip(drawn.T, expected.T, strict=True):
        assert ks_2samp(column.round(6), other.round(6)).pvalue > 1e-4


def leaves(edge: float, points: np.ndarray) -> Obstacle:
    """An octree at the box's pose."""
    return replace(BOX, shape=Shape.OCTREE, size=(edge,) * 3, points=points)


def test_octrees_have_the_points_of_the_box_they_fill():
    """Leaves that fill a box have the box's area and points on its faces only, none on faces between two leaves."""
    edge, counts = 0.1, (3, 5, 8)
    grid = np.stack(np.meshgrid(*[(np.arange(n) - n // 2 + 0.5) * edge for n in counts], indexing="ij"), axis=-1)
    octree, low = leaves(edge, np.repeat(grid.reshape(-1, 3), 2, axis=0)), -edge * np.array([n // 2 for n in counts])
    assert surface_area(octree) == pytest.approx(2 * (0.3 * 0.5 + 0.3 * 0.8 + 0.5 * 0.8))
    middle = low + edge * np.array(counts) / 2
    local = draw(octree, 20_000) - middle
    box = replace(BOX, size=tuple(edge * np.array(counts)))
    np.testing.assert_allclose(signed_distance(local, box), 0, atol=1e-7)
    expected = draw(box, 20_000, seed=1)
    for column, other in zip(local.T, expected.T, strict=True):
        assert ks_2samp(column.round(6), other.round(6)).pvalue > 1e-4
    two = leaves(0.1, np.array([[0.05, 0.05, 0.05], [-0.35, 0.05, 0.05]]))
    assert surface_area(two) == pytest.approx(12 * 0.01)


def test_every_shape_among_the_others(tmp_path):
    """In a scene of all shapes each has its share of points, and a mesh fills the voxels of its primitive."""
    mesh = depicted("box", tmp_path, np.random.default_rng(0))
    octree = leaves(0.1, np.array([[0.05, 0.05, 0.05]]))
    scene = [replace(mesh, position=(3.0, 0, 0)), BOX, replace(octree, position=(-3.0, 0, 0)), SPHERE]
    points = surface_points(scene, 3000.0, np.random.default_rng(2))
    areas = np.array([surface_area(o) for o in scene])
    assert np.isfinite(points).all() and len(points) == round(3000 * areas.sum())
    near = np.stack([np.linalg.norm(points - np.array(o.position), axis=1) for o in scene]).argmin(axis=0)
    far = [(near == 0).sum(), (near == 2).sum()]
    assert far == pytest.approx(3000 * areas[[0, 2]], rel=0.1)
    grid = scene_voxels([replace(mesh, position=(0.2, 0.0, 0.0))], VoxelParameters(), 0)
    like = scene_voxels([replace(BOX, position=(0.2, 0.0, 0.0))], VoxelParameters(), 0)
    assert grid.sum() == pytest.approx(like.sum(), rel=0.05) and like.sum() > 100
