"""Problems on the unit sphere small enough for brute force: a flood fill decides which can be solved."""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.manifolds import Adherence
from pipeline.planners import FmtStar, Planner, PlanResult, Query, Rrt, RrtConnect, Termination
from pipeline.robots import Obstacle
from pipeline.samplers import UniformSampler
from tests.manifolds.spaces import sphere_space
from tests.robots.worlds import ball_clearance, block, fibonacci, on_sphere

PLANNERS: dict[str, Planner] = {"rrt": Rrt(), "rrtconnect": RrtConnect(), "fmt": FmtStar(samples=400)}
GRID = fibonacci(10_000)
COVER = 0.035  # no point of the sphere is farther from the grid
# Steps of 0.4 have chords 0.02 below the sphere: they pass under plates that lie flat on it.
LONG = {"step": 0.4, "resolution": 0.02, "wander": 3.0, "margin": 0.01}


@dataclass(frozen=True)
class Scene:
    """A start and a goal on the unit sphere among obstacles."""

    start: np.ndarray
    goal: np.ndarray
    obstacles: tuple[Obstacle, ...]


@cache
def scene(seed: int, gap: float) -> Scene:
    """A fence of blocks around the goal with a gap of an angle [rad], and two dozen blocks anywhere else."""
    rng = np.random.default_rng(seed)
    start, goal = on_sphere(rng, 2)
    while abs(start @ goal) > 0.5:
        start = on_sphere(rng, 1)[0]
    side = np.cross(goal, start) / np.linalg.norm(np.cross(goal, start))
    other, radius, turn = np.cross(goal, side), 0.5, rng.uniform(0, 2 * np.pi)
    angles = turn + np.linspace(gap / 2, 2 * np.pi - gap / 2, 40)
    fence = [
        block(np.cos(radius) * goal + np.sin(radius) * (np.cos(a) * side + np.sin(a) * other), (0.22, 0.22, 0.2))
        for a in angles
    ]
    scattered = [block(p, rng.uniform(0.1, 0.25, 3)) for p in on_sphere(rng, 24)]
    clear = [o for o in scattered if ball_clearance([o], np.stack([start, goal])).min() > 0.1]
    return Scene(start, goal, (*fence, *clear))


def plated(count: int = 70) -> Scene:
    """Flat plates on the sphere, clear of a start and a goal."""
    start, goal = np.array([0.6, 0.0, 0.8]), np.array([-0.6, 0.48, -0.64])
    plates = [block(p, (0.16, 0.16, 0.004)) for p in fibonacci(count)]
    return Scene(start, goal, tuple(o for o in plates if ball_clearance([o], np.stack([start, goal])).min() > 0.05))


def connected(scene: Scene, clearances: np.ndarray, least: float, reach: float) -> bool:
    """Flood fill: whether grid points of a clearance of at least `least`, linked within `reach`, connect the two."""
    free = GRID[clearances >= least]
    tree = cKDTree(free)
    pairs = tree.query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(free), len(free)))
    _, labels = connected_components(graph, directed=False)
    distances, nearest = tree.query(np.stack([scene.start, scene.goal]))
    assert distances.max() <= COVER
    return bool(labels[nearest[0]] == labels[nearest[1]])


def judged(scene: Scene) -> bool | None:
    """Whether start and goal are connected: True with slack, False not at all, None when the grid cannot tell.

    True: between two linked points no point of the arc is farther than COVER from one of them, so that there is a path
    of a clearance of 0.04. False: along any path the grid points within COVER have a clearance above -COVER and are
    linked.
    """
    clearances = ball_clearance(scene.obstacles, GRID)
    if connected(scene, clearances, 0.04 + COVER, 2 * COVER):
        return True
    return None if connected(scene, clearances, -COVER, 2.1 * COVER) else False


def solve(
    planner: Planner, space: Adherence, scene: Scene, seed: int = 0, max_iterations: int = 5000, **settings
) -> PlanResult:
    """Plan with uniform samples until solved or `max_iterations`."""
    problem = Query(space, scene.start, scene.goal)
    return planner.plan(problem, UniformSampler(**settings), Termination(max_iterations=max_iterations), seed)


def space_of(method: str, scene: Scene, **settings) -> Adherence:
    """The sphere among the scene's obstacles."""
    return sphere_space(method, scene.obstacles, **settings)


def chords(path: np.ndarray, step: float = 0.001) -> np.ndarray:
    """Points on the straight lines between the states of a path (T, 3), at most `step` apart."""
    pieces = [
        np.linspace(p, q, max(int(np.ceil(np.linalg.norm(q - p) / step)), 1), endpoint=False) for p, q in pairwise(path)
    ]
    return np.concatenate([*pieces, path[-1:]])


def arcs(path: np.ndarray, step: float = 0.001) -> np.ndarray:
    """Points of the sphere above `chords`."""
    points = chords(path, step)
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def assert_sound(path: np.ndarray, scene: Scene, leap: float = 0.1) -> None:
    """From start to goal to the last bit, in leaps at most; on the sphere and free along every chord."""
    np.testing.assert_array_equal(path[0], scene.start)
    np.testing.assert_array_equal(path[-1], scene.goal)
    between = chords(path)
    assert np.abs(np.linalg.norm(between, axis=1) - 1).max() < 1e-3
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= leap
    assert ball_clearance(scene.obstacles, between).min() > 0
