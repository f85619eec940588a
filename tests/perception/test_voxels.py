"""Voxel grids: the cells that hold points, no other ones."""

from dataclasses import replace

import numpy as np
import pytest
from omegaconf import OmegaConf
from scipy.spatial.transform import Rotation

from pipeline.errors import ConfigError
from pipeline.perception import VoxelParameters, clipped_share, scene_voxels, surface_points, voxelise
from pipeline.robots import Obstacle, Shape

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
SLAB = Obstacle(Shape.BOX, (0.0, 0.0, 0.0), UPRIGHT, (2.0, 2.0, 0.2))
PARAMETERS = VoxelParameters(density=400.0)


def blocks(count: int, seed: int) -> list[Obstacle]:
    """Blocks of side 0.1 lying on the unit sphere, as the authors place them."""
    rng = np.random.default_rng(seed)
    polar, around = np.arccos(0.75 * rng.uniform(-1, 1, count)), np.pi * rng.uniform(-1, 1, count)
    turns = Rotation.from_euler("ZY", np.stack([around, polar], axis=1))
    return [
        Obstacle(Shape.BOX, tuple(centre), tuple(quaternion), (0.1, 0.1, 0.1))
        for centre, quaternion in zip(turns.apply([0, 0, 1]), turns.as_quat(), strict=True)
    ]


def test_brute_force():
    """A cell is occupied exactly when one of the points is within its six planes."""
    rng = np.random.default_rng(0)
    bounds = np.array([[-1.0, 0.0, 2.0], [1.0, 0.5, 5.0]])
    points = rng.uniform(bounds[0] - 0.3, bounds[1] + 0.3, (120, 3))
    size = 7
    edges = np.linspace(bounds[0], bounds[1], size + 1)  # (size + 1, 3)
    expected = np.zeros((size, size, size), bool)
    for i, j, k in np.ndindex(expected.shape):
        low, high = edges[[i, j, k], range(3)], edges[[i + 1, j + 1, k + 1], range(3)]
        expected[i, j, k] = any((low <= p).all() and (p < high).all() for p in points)
    assert np.array_equal(voxelise(points, bounds, size), expected)
    assert 0 < expected.sum() < size**3


def test_edges():
    """Points on the outer planes belong to the outermost cells; points beyond, or none at all, to no cell."""
    bounds = np.array([[-1.0] * 3, [1.0] * 3])
    assert np.argwhere(voxelise(np.array([[-1.0, 1.0, 1.0]]), bounds, 40)).tolist() == [[0, 39, 39]]
    assert not voxelise(np.array([[0.0, 0.0, 1.0 + 1e-9]]), bounds, 40).any()
    assert not voxelise(np.empty((0, 3)), bounds, 40).any()


def test_sphere_scene():
    """The published scene of 500 blocks gives 20 000 points on 40^3 cells, at most 1.0525 m from the origin."""
    scene = blocks(500, seed=1)
    assert len(surface_points(scene, VoxelParameters().density, np.random.default_rng(0))) == 20_000
    grid = scene_voxels(scene, VoxelParameters(), seed=0)
    assert grid.shape == (40, 40, 40)
    assert grid.dtype == bool
    centres = -1 + (np.argwhere(grid) + 0.5) * 0.05
    distance = np.linalg.norm(centres, axis=1)
    half_cell = 0.025 * np.sqrt(3)
    assert distance.min() > 0.95 - half_cell
    assert distance.max() < np.sqrt(1.05**2 + 2 * 0.05**2) + half_cell


def test_clipped():
    """The authors' bounds leave out about 4 % of the points, all beyond 1 m in x or y; wider bounds none."""
    share = clipped_share(blocks(500, seed=2), VoxelParameters(), seed=0)
    points = surface_points(blocks(500, seed=2), VoxelParameters().density, np.random.default_rng(0))
    assert share == pytest.approx((np.abs(points) > 1).any(axis=1).mean())
    assert 0.03 < share < 0.06
    wide = VoxelParameters(lower=(-1.1, -1.1, -1.1), upper=(1.1, 1.1, 1.1))
    assert clipped_share(blocks(500, seed=2), wide, seed=0) == 0
    assert clipped_share([], wide, seed=0) == 0


def test_shell():
    """With a shell, only cells that touch it are occupied; without one, the slab fills its whole plane."""
    whole = scene_voxels([SLAB], PARAMETERS, seed=0)
    cut = scene_voxels([SLAB], replace(PARAMETERS, shell=(1.0, 0.05)), seed=0)
    assert not (cut & ~whole).any()
    distance = np.linalg.norm(-1 + (np.argwhere(cut) + 0.5) * 0.05, axis=1)
    assert np.abs(distance - 1).max() < 0.05 + 0.025 * np.sqrt(3)
    assert whole[:, :, 17:23].sum() > 5 * cut.sum() > 0
    assert whole[20, 20].any()
    assert not cut[20, 20].any()


def test_repeatable():
    """Equal seeds give equal grids, other seeds others."""
    grids = [scene_voxels([SLAB], PARAMETERS, seed) for seed in (5, 5, 6)]
    assert np.array_equal(grids[0], grids[1])
    assert not np.array_equal(grids[0], grids[2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 0}, "size is 0"),
        ({"size": -3}, "size is -3"),
        ({"density": -1.0}, r"density is -1\.0"),
        ({"density": float("nan")}, "density is nan"),
        ({"lower": (1.0, -1.0, -1.0)}, "bounds"),
        ({"upper": (1.0, 1.0)}, "bounds"),
        ({"upper": (1.0, 1.0, float("inf"))}, "bounds"),
        ({"shell": (1.0, 0.0)}, "shell"),
        ({"shell": (1.0,)}, "shell"),
    ],
)
def test_refused(change, message):
    """A value that makes no grid is refused with the value in the message."""
    with pytest.raises(ConfigError, match=message):
        VoxelParameters(**change)


def test_from_configuration():
    """The parameters can be merged from a configuration file, lists and all."""
    schema = OmegaConf.structured(VoxelParameters)
    merged = OmegaConf.merge(schema, {"size": 20, "shell": [1.0, 0.05], "lower": [-2, -2, -2]})
    parameters = OmegaConf.to_object(merged)
    assert isinstance(parameters, VoxelParameters)
    assert scene_voxels([SLAB], parameters, 0).shape == (20, 20, 20)
    assert OmegaConf.to_object(schema).shell is None
