"""Scenes and problems of the sphere are what the papers describe, judged by closed forms and by brute force."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.stats import chisquare, kstest

from pipeline.environments import (
    BANDS,
    BLOCKS,
    Band,
    SphereEnvironment,
    fibonacci_sphere,
)
from pipeline.errors import ConfigError, ProblemError
from pipeline.spec.scene import Scene, Split
from pipeline.tasks import set_up
from tests.environments import published as environments
from tests.robots.worlds import on_sphere, signed_distance

COUNTS = {Split.TRAIN: 2, Split.VALIDATION: 1, Split.TEST: 1}


def published(**changes) -> SphereEnvironment:
    """The environment of conf/environment/sphere.yaml, with changes."""
    return environments.published("sphere", **changes)


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
    checker = set_up(scene.statement).validity(environment.margin if margin is None else margin)
    clear = distance(scene, points) - environment.robot_radius - (environment.margin if margin is None else margin)
    told = np.array([checker.free(q) for q in points])
    decided = np.abs(clear) > 1e-6
    np.testing.assert_array_equal(told[decided], clear[decided] > 0)
    assert 1000 < told.sum() < 3500


def connected(scene: Scene, ends: np.ndarray, least: float, side: int = 80) -> np.ndarray:
    """Return the number of the connected piece of each of `ends` (N, 3), by brute force.

    On a grid other than the environment's and coarser, on the faces of a cube of `side` points each way; neighbours
    are linked where they and four points between them are at least `least` from all obstacles.
    """
    u = np.tan((np.arange(side) + 0.5) / side * np.pi / 2 - np.pi / 4)
    a, b = map(np.ravel, np.meshgrid(u, u))
    faces = [np.column_stack(c) for sign in (-np.ones_like(a), np.ones_like(a)) for c in permuted(a, b, sign)]
    grid = np.concatenate(faces)
    points = np.concatenate([ends, grid / np.linalg.norm(grid, axis=1)[:, None]])
    links = cKDTree(points).query_pairs(1.6 * np.pi / 2 / side, output_type="ndarray")
    links = links[(distance(scene, points) >= least)[links].all(axis=1)]
    first, second = points[links[:, 0]], points[links[:, 1]]
    between = np.concatenate([first + share * (second - first) for share in (0.2, 0.4, 0.6, 0.8)])
    between /= np.linalg.norm(between, axis=1)[:, None]
    links = links[(distance(scene, between) >= least).reshape(4, -1).all(axis=0)]
    graph = coo_array((np.ones(len(links)), links.T), shape=(len(points),) * 2)
    return connected_components(graph, directed=False)[1][: len(ends)]


def permuted(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    return [(c, a, b), (a, c, b), (a, b, c)]


@pytest.mark.parametrize("which", [1, 3, -1])
def test_starts_and_goals_are_free_and_connected(scenes, which):
    """Starts and goals lie on the sphere, keep the margin, and brute force finds a way between them that keeps it."""
    environment, scene, count = published(), scenes[which], 150
    problems = environment.tasks(scene, count)
    assert problems["problem"].tolist() == list(range(count))
    for column, value in (("scenario", scene.scenario), ("scene", scene.name), ("split", scene.split.value)):
        assert set(problems[column]) == {value}
    points = np.concatenate(ends(problems))
    assert np.abs(np.linalg.norm(points, axis=1) - 1).max() < 1e-12
    least = environment.margin + environment.robot_radius
    assert distance(scene, points).min() >= least
    anywhere = on_sphere(np.random.default_rng(3), 2000)
    anywhere = anywhere[distance(scene, anywhere) >= least]
    pieces = connected(scene, np.concatenate([points, anywhere]), least)
    assert (pieces[:count] == pieces[count : 2 * count]).all()
    if scene.scenario == BLOCKS:  # with pockets between the blocks that such pairs might have been drawn from
        assert len(set(pieces[2 * count :])) > 1


@pytest.mark.parametrize(("gap", "passable"), [(0.016, False), (0.1, True)])
def test_pairs_go_through_passable_gaps_only(gap, passable):
    """Start and goal lie on different sides of a belt where its gap is wider than the robot and its margins only."""
    belt = ({"low": -0.1, "high": 0.1, "gap_axis": "x", "side": 1, "gap": gap},)
    environment = published(blocks=0, bands=belt)
    (scene,) = (scene for scene in environment.scenes({}) if scene.scenario == BANDS)
    start, goal = ends(environment.tasks(scene, 60))
    assert (np.sign(start[:, 2]) != np.sign(goal[:, 2])).any() == passable
    assert {*np.sign(start[:, 2])} == {-1, 1}


def empty(**changes) -> tuple[SphereEnvironment, Scene]:
    """A sphere without obstacles, whose every grid point is free."""
    environment = published(grid=500, **changes)
    return environment, Scene(BLOCKS, "empty", Split.TRAIN, (environment.statement(()),))


def looks_uniform(points: np.ndarray) -> bool:
    """Archimedes: each coordinate is uniform; and the octants hold equal numbers."""
    octants = np.unique((points > 0) @ [1, 2, 4], return_counts=True)[1]
    tests = [kstest(points[:, axis], "uniform", args=(-1, 2)).pvalue for axis in range(3)]
    return min(*tests, chisquare(octants).pvalue) > 1e-3


def test_starts_and_goals_are_uniform():
    """On an empty sphere starts and goals are uniform and independent, which normalised points of a cube are not."""
    environment, scene = empty()
    start, goal = ends(environment.tasks(scene, 2000))
    assert looks_uniform(start) and looks_uniform(goal)
    assert kstest((start * goal).sum(axis=1), "uniform", args=(-1, 2)).pvalue > 1e-3
    cube = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
    assert not looks_uniform(cube / np.linalg.norm(cube, axis=1)[:, None])


def test_radius_scales_everything():
    """On a sphere of another radius starts, goals and blocks lie on that sphere."""
    environment, scene = empty(radius=0.5, blocks=20)
    np.testing.assert_allclose(np.linalg.norm(np.concatenate(ends(environment.tasks(scene, 5))), axis=1), 0.5)
    blocks = environment.scenes({Split.TRAIN: 1})[0].obstacles
    np.testing.assert_allclose(np.linalg.norm([o.position for o in blocks], axis=1), 0.5)
    assert set_up(environment.statement(())).constraint.value(np.array([0.5, 0.0, 0.0])) == pytest.approx(0.0)


def test_first_problems_are_the_same_for_every_count(blocks):
    """A smaller number of problems are the first of a larger one; another scene or seed has others."""
    environment = published(grid=5000)
    few, many = environment.tasks(blocks[0], 3), environment.tasks(blocks[0], 8)
    np.testing.assert_array_equal(ends(few), np.array(ends(many))[:, :3])
    assert len(environment.tasks(blocks[0], 0)) == 0
    others = [environment.tasks(blocks[1], 8), published(grid=5000, seed=1).tasks(blocks[0], 8)]
    starts = [tuple(q) for frame in (many, *others) for q in frame["start"]]
    assert len(set(starts)) == 24


def test_fibonacci_sphere_is_even():
    """Neighbours on the flood fill's grid are about sqrt(4 pi / N) apart, and all points are on the unit sphere."""
    grid = fibonacci_sphere(5000)
    assert np.abs(np.linalg.norm(grid, axis=1) - 1).max() < 1e-12
    spacing = cKDTree(grid).query(grid, k=2)[0][:, 1] / np.sqrt(4 * np.pi / 5000)
    assert 0.6 < spacing.min() and spacing.max() < 1.1
    cover = cKDTree(grid).query(on_sphere(np.random.default_rng(4), 20_000))[0].max()
    assert cover < 0.9 * np.sqrt(4 * np.pi / 5000)


NAN, INF = float("nan"), float("inf")
WRONG = {
    **dict.fromkeys(("radius", "robot_radius", "reach", "tolerance", "block_size", "latitude"), (0.0, -1.0, NAN, INF)),
    **dict.fromkeys(("margin", "slack"), (-0.001, NAN, INF)),
    "grid": (0, -1),
    **dict.fromkeys(("seed", "blocks"), (-1,)),
}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        *(({name: value}, f"environment.{name} is {value}; it must be") for name in WRONG for value in WRONG[name]),
        ({"reach": 0.9}, "environment.reach is 0.9 m; it must be above the radius, 1.0 m"),
        ({"latitude": 1.1}, "environment.latitude is 1.1; it must be at most 1"),
        ({"blocks": 2.5}, "environment.blocks is 2.5 (float); it must be of type int"),
        ({"bandz": []}, "unknown key 'bandz' in environment; did you mean 'bands'?"),
    ],
)
def test_wrong_parameters_are_refused(changes, said):
    """A parameter out of its bounds is refused with its name, value and bound."""
    with pytest.raises(ConfigError) as caught:
        published(**changes)
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"low": 0.3}, "low = 0.3 and high = 0.2"),
        ({"low": 0.2}, "low must be below high"),
        ({"low": float("nan")}, "low = nan"),
        ({"gap_axis": "z"}, "band.gap_axis is 'z'; choices: x, y"),
        ({"side": 0}, "band.side is 0; choices: -1, 1"),
        ({"gap": 0.0}, "band.gap is 0.0 m; it must be above 0 m"),
        ({"gap": float("nan")}, "band.gap is nan m"),
    ],
)
def test_wrong_bands_are_refused(changes, said):
    """A band with an empty range, no gap or an unknown side or axis is refused with the value."""
    with pytest.raises(ConfigError) as caught:
        Band(**{"low": -0.2, "high": 0.2, "gap_axis": "x", "side": 1, **changes})
    assert said in str(caught.value)


def test_negative_numbers_of_scenes_and_problems_are_refused():
    """A negative number of scenes or problems is refused with its value."""
    environment, scene = empty()
    with pytest.raises(ConfigError, match=r"scenes\.test is -1; it must be at least 0"):
        environment.scenes({Split.TRAIN: 1, Split.TEST: -1})
    with pytest.raises(ConfigError, match="number of problems is -1; it must be at least 0"):
        environment.tasks(scene, -1)


def test_scene_without_room_is_refused(scenes):
    """A scene that leaves no free state at the margin is refused by its name."""
    with pytest.raises(ProblemError, match=r"scene 'bands' has no free space at a margin of 1\.003 m"):
        published(margin=1.0, grid=500).tasks(scenes[-1], 1)


def test_robot_reaches_as_far_as_it_says():
    """The point mass has three joints within +-reach and a frame that the constraint holds on the sphere."""
    environment = published()
    setup = set_up(environment.statement(()))
    robot = setup.robot
    assert robot.lower.tolist() == [-1.1] * 3 and robot.upper.tolist() == [1.1] * 3
    constraint = setup.constraint
    q = np.array([0.6, 0.0, 0.7])
    assert constraint.value(q) == pytest.approx(np.linalg.norm(q) - 1)
    assert constraint.tolerance == environment.tolerance
