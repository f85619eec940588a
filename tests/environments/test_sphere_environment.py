"""Scenes and problems of the sphere are what the papers describe, judged by closed forms and by brute force."""

from itertools import product

import numpy as np
import pytest
from omegaconf import OmegaConf
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.stats import chisquare, kstest

from pipeline.config import compose, load
from pipeline.environments import (
    BANDS,
    BLOCKS,
    ENVIRONMENTS,
    Band,
    Scene,
    SphereEnvironment,
    Split,
    fibonacci_sphere,
    validity,
)
from pipeline.errors import ConfigError, ProblemError, RobotError
from pipeline.schema import Choice
from tests.robots.worlds import on_sphere, signed_distance

COUNTS = {Split.TRAIN: 2, Split.VALIDATION: 1, Split.TEST: 1}


def published(**changes) -> SphereEnvironment:
    """The environment of conf/environment/sphere.yaml, with changes."""
    choice = load(OmegaConf.to_container(compose("scenes").environment), Choice)
    return Choice(choice.kind, {**choice.parameters, **changes}).make(ENVIRONMENTS, "environment")


def distance(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Distance of points (N, 3) to the nearest obstacle where it is below 0.05 m (N,), otherwise inf."""
    found, tree = np.full(len(points), np.inf), cKDTree(points)
    for obstacle in scene.obstacles:
        near = tree.query_ball_point(obstacle.position, np.linalg.norm(obstacle.size) / 2 + 0.05)
        if near:
            found[near] = np.minimum(found[near], signed_distance(obstacle, points[near]))
    return np.where(found < 0.05, found, np.inf)


def ends(problems) -> tuple[np.ndarray, np.ndarray]:
    return np.array(problems["start"].tolist()), np.array(problems["goal"].tolist())


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return published().scenes(COUNTS)


@pytest.fixture(scope="module")
def blocks(scenes) -> list[Scene]:
    return [scene for scene in scenes if scene.scenario == BLOCKS]


def test_scenes_are_numbered_per_split(scenes):
    """There are as many scenes of blocks per split as asked for, and the bands once, in the test split."""
    found = [(scene.scenario, scene.name, scene.split) for scene in scenes]
    assert found == [
        (BLOCKS, "blocks-train-000", Split.TRAIN),
        (BLOCKS, "blocks-train-001", Split.TRAIN),
        (BLOCKS, "blocks-validation-000", Split.VALIDATION),
        (BLOCKS, "blocks-test-000", Split.TEST),
        (BANDS, BANDS, Split.TEST),
    ]


def test_blocks_are_tangent_cubes_on_the_sphere(blocks):
    """Every scene has 500 cubes of 0.1 m, centred on the sphere within |z| <= 0.75, one axis along the radius."""
    for scene in blocks:
        centres = np.array([o.position for o in scene.obstacles])
        radial = np.array([o.rotation[:, 2] for o in scene.obstacles])
        assert len(scene.obstacles) == 500
        assert {o.size for o in scene.obstacles} == {(0.1, 0.1, 0.1)}
        assert np.abs(np.linalg.norm(centres, axis=1) - 1).max() < 1e-12
        assert np.abs(centres[:, 2]).max() <= 0.75
        np.testing.assert_allclose(radial, centres, atol=1e-12)
        meridian = np.array([o.rotation[:, 0] for o in scene.obstacles])  # points south along the meridian
        across = np.cross([0.0, 0.0, 1.0], centres)
        assert np.abs((meridian * across).sum(axis=1)).max() < 1e-12
        assert meridian[:, 2].max() < 0


def test_blocks_are_placed_as_published(blocks):
    """z of the centres is uniform in +-0.75 and their azimuth uniform; both say so in all scenes together."""
    centres = np.array([o.position for scene in blocks for o in scene.obstacles])
    assert kstest(centres[:, 2], "uniform", args=(-0.75, 1.5)).pvalue > 0.01
    assert kstest(np.arctan2(centres[:, 1], centres[:, 0]), "uniform", args=(-np.pi, 2 * np.pi)).pvalue > 0.01
    assert kstest(centres[:, 2], "uniform", args=(-1, 2)).pvalue < 1e-6  # the test can tell


def test_scenes_differ(blocks):
    """No two scenes share a block, of whatever splits; another seed gives other scenes, the same seed the same."""
    positions = [o.position for scene in blocks for o in scene.obstacles]
    assert len(set(positions)) == len(positions) == 2000
    assert published().scenes(COUNTS)[:4] == blocks
    assert not {o.position for scene in published(seed=1).scenes(COUNTS)[:4] for o in scene.obstacles} & set(positions)


def test_smaller_profile_has_the_first_scenes(scenes):
    """Scenes of each split are the first ones of a larger number of them, whatever the numbers of the other splits."""
    larger = {s.name: s for s in published().scenes({Split.TRAIN: 4, Split.VALIDATION: 3, Split.TEST: 2})}
    assert {scene.name: scene for scene in scenes}.items() <= larger.items()
    assert len(larger) == 10


def forbidden(p: np.ndarray) -> np.ndarray:
    """The inequalities of OMPL's ConstrainedPlanningSphere.cpp: which of the points (N, 3) are in a band."""
    x, y, z = p.T
    low = (-0.80 < z) & (z < -0.6) & ~((-0.05 < y) & (y < 0.05) & (x > 0))
    middle = (-0.1 < z) & (z < 0.1) & ~((-0.05 < x) & (x < 0.05) & (y < 0))
    high = (0.6 < z) & (z < 0.80) & ~((-0.05 < y) & (y < 0.05) & (x < 0))
    return low | middle | high


def test_bands_are_the_published_regions(scenes):
    """A point of the sphere is inside an obstacle exactly where OMPL's sphere demo forbids it, gaps included."""
    points = on_sphere(np.random.default_rng(0), 50_000)
    narrow = on_sphere(np.random.default_rng(1), 50_000) * [1, 0.08, 1]  # around the gaps: small x or small y
    points = np.concatenate([points, *(n / np.linalg.norm(n, axis=1)[:, None] for n in (narrow, narrow[:, [1, 0, 2]]))])
    inside = np.min([signed_distance(o, points) for o in scenes[-1].obstacles], axis=0) < 0
    np.testing.assert_array_equal(inside, forbidden(points))
    for low, high, small, side in ((-0.8, -0.6, 1, 1), (-0.1, 0.1, 0, -1), (0.6, 0.8, 1, -1)):
        here = (low < points[:, 2]) & (points[:, 2] < high) & (np.abs(points[:, small]) < 0.05)
        across = points[here][:, 1 - small] * side > 0
        assert not inside[here][across].any() and across.sum() > 500  # the gap
        assert inside[here][~across].all() and (~across).sum() > 500  # the other side has none


@pytest.mark.parametrize("margin", [None, 0.0])
@pytest.mark.parametrize("which", [0, -1], ids=[BLOCKS, BANDS])
def test_verdicts_are_those_of_the_distance(scenes, which, margin):
    """A state is free exactly where its distance to the obstacles is the point's radius and the margin, or more."""
    environment, scene = published(), scenes[which]
    points = on_sphere(np.random.default_rng(2), 4000)
    checker = validity(environment, scene, environment.robot(), margin)
    clear = distance(scene, points) - environment.robot_radius - (environment.margin if margin is None else margin)
    told = np.array([checker.collision_free(q) for q in points])
    decided = np.abs(clear) > 1e-6
    np.testing.assert_array_equal(told[decided], clear[decided] > 0)
    assert 1000 < told.sum() < 3500


@pytest.mark.parametrize("which", [0, 3, -1])
def test_starts_and_goals_are_free_and_connected(scenes, which):
    """Starts and goals lie on the sphere, keep the margin, and brute force finds a way between them.

    Brute force: a grid other than the environment's and coarser, on the faces of a cube; neighbours are linked where
    four points between them keep the margin of planning too.
    """
    environment, scene = published(), scenes[which]
    problems = environment.problems(scene, 40)
    start, goal = ends(problems)
    assert problems["problem"].tolist() == list(range(40))
    assert set(problems["scene"]) == {scene.name} and set(problems["split"]) == {scene.split.value}
    both = np.concatenate([start, goal])
    assert np.abs(np.linalg.norm(both, axis=1) - 1).max() < 1e-12
    least = environment.margin + environment.robot_radius
    assert distance(scene, both).min() >= least
    side = 80
    u = np.tan((np.arange(side) + 0.5) / side * np.pi / 2 - np.pi / 4)
    a, b = map(np.ravel, np.meshgrid(u, u))
    one = np.ones_like(a)
    faces = [np.column_stack(np.roll([a, b, sign * one], axis, axis=0)) for axis in range(3) for sign in (-1, 1)]
    grid = np.concatenate(faces)
    assert len(grid) < environment.grid / 2
    points = np.concatenate([both, grid / np.linalg.norm(grid, axis=1)[:, None]])
    links = cKDTree(points).query_pairs(1.6 * np.pi / 2 / side, output_type="ndarray")
    links = links[(distance(scene, points) >= least)[links].all(axis=1)]
    between = np.concatenate([points[links] @ [1 - share, share] if False else share * points[links[:, 1]] + (1 - share) * points[links[:, 0]] for share in (0.2, 0.4, 0.6, 0.8)])
    between /= np.linalg.norm(between, axis=1)[:, None]
    links = links[(distance(scene, between) >= least).reshape(4, -1).all(axis=0)]
    graph = coo_array((np.ones(len(links)), links.T), shape=(len(points),) * 2)
    _, pieces = connected_components(graph, directed=False)
    assert (pieces[:40] == pieces[40:80]).all()
    assert len(set(pieces[:80])) < len(set(pieces)) - 1  # there are pockets that pairs were kept out of
