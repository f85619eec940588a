"""Planners find sound paths exactly where a flood fill says there are any, and the same ones every time."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pipeline.planners import FmtStar, PlanStatus, Query, Rrt, RrtConnect, Termination, path_length
from pipeline.planners.fmt import _Wave
from pipeline.samplers import UniformSampler
from tests.manifolds.spaces import METHODS, sphere_space
from tests.planners.scenes import (
    COVER,
    GRID,
    PLANNERS,
    Scene,
    assert_sound,
    judged,
    scene,
    solve,
    space_of,
)
from tests.robots.worlds import block, on_sphere

SOLVABLE = [scene(seed, 1.2) for seed in (0, 1, 2)]
UNSOLVABLE = [scene(seed, 0.0) for seed in (3, 4)]


def test_flood_fill_decides_the_scenes():
    """The grid is as dense as claimed; scenes with a gap are surely connected, those without are surely separated."""
    assert cKDTree(GRID).query(on_sphere(np.random.default_rng(0), 20_000))[0].max() < 0.95 * COVER
    assert [judged(s) for s in (*SOLVABLE, *UNSOLVABLE)] == [True] * 3 + [False] * 2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("planner", PLANNERS)
def test_solved_where_connected(planner, method):
    """Where start and goal are connected with slack a sound path is found, and said to be."""
    for s in SOLVABLE:
        result = solve(PLANNERS[planner], space_of(method, s), s)
        assert result.status is PlanStatus.SOLVED and result.solved
        assert_sound(result.path, s)
        assert 0 < result.iterations < 5000 and result.counters.samples > 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("planner", PLANNERS)
def test_not_solved_where_separated(planner, method):
    """Where they are separated the search ends at its iteration limit, with no path and no exception."""
    for s in UNSOLVABLE:
        result = solve(PLANNERS[planner], space_of(method, s), s, max_iterations=500)
        assert result.status is PlanStatus.ITERATION_LIMIT and not result.solved
        assert result.path.shape == (0, 3) and result.iterations == 500


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("planner", PLANNERS)
def test_same_seed_same_path(planner, method):
    """A seed gives the same path to the last bit and equal counters, again and in a fresh space; another does not."""
    s = SOLVABLE[0]
    space = space_of(method, s)
    first, again = (solve(PLANNERS[planner], space, s, seed=7) for _ in range(2))
    fresh, other = solve(PLANNERS[planner], space_of(method, s), s, seed=7), solve(PLANNERS[planner], space, s, seed=8)
    for result in (again, fresh):
        np.testing.assert_array_equal(result.path, first.path)
        assert (result.counters, result.iterations, result.seed) == (first.counters, first.iterations, 7)
    assert first.counters.collision_checks > 0 and first.counters.traversals > 0
    assert not np.array_equal(other.path, first.path)


@pytest.mark.parametrize("planner", PLANNERS)
def test_time_limit(planner):
    """A search without end stops at its time limit, or not much after, and says so."""
    s = UNSOLVABLE[0]
    problem = Query(space_of("projection", s), s.start, s.goal)
    result = PLANNERS[planner].plan(problem, UniformSampler(), Termination(time_limit=0.15), 0)
    assert result.status is PlanStatus.TIME_LIMIT and not result.solved
    assert 0.15 <= result.planning_time < 0.65 and result.iterations > 0


@pytest.mark.parametrize("planner", PLANNERS)
def test_first_of_two_limits(planner):
    """Of a time limit and an iteration limit the first to be reached ends the search."""
    s = UNSOLVABLE[0]
    problem = Query(space_of("projection", s), s.start, s.goal)
    result = PLANNERS[planner].plan(problem, UniformSampler(), Termination(time_limit=60, max_iterations=5), 0)
    assert result.status is PlanStatus.ITERATION_LIMIT and result.iterations == 5


@pytest.mark.parametrize("planner", PLANNERS)
def test_cost_bound(planner):
    """With a bound on the cost a search goes on until its path is shorter, and repeats; the first path was not."""
    start, goal = np.array([0.0, 0.6, 0.8]), np.array([0.6, -0.8, 0.0])
    wall = block(np.array([0.5, -0.1, 0.8]) / np.linalg.norm([0.5, -0.1, 0.8]), (0.6, 0.6, 0.4))
    s = Scene(start, goal, (wall,))
    space = space_of("projection", s)
    problem = Query(space, start, goal)
    firsts = [solve(PLANNERS[planner], space, s, seed) for seed in range(8)]
    lengths = [path_length(result.path) for result in firsts]
    seed = int(np.argmax(lengths))
    bound = (min(lengths) + max(lengths)) / 2
    wanted = Termination(max_iterations=50_000, cost_below=bound)
    result, again = (PLANNERS[planner].plan(problem, UniformSampler(), wanted, seed) for _ in range(2))
    assert result.solved and path_length(result.path) < bound <= lengths[seed]
    assert_sound(result.path, s)
    np.testing.assert_array_equal(again.path, result.path)
    assert result.iterations > firsts[seed].iterations


@pytest.mark.parametrize("planner", PLANNERS)
def test_cost_bound_out_of_reach(planner):
    """Where no path is as short as asked, the limit ends the search and the best path found is the result."""
    start, goal = np.array([0.0, 0.6, 0.8]), np.array([0.6, -0.8, 0.0])
    s = Scene(start, goal, ())
    space = space_of("projection", s)
    first = solve(PLANNERS[planner], space, s)
    limits = Termination(max_iterations=first.iterations + 400, cost_below=0.5 * np.linalg.norm(goal - start))
    result = PLANNERS[planner].plan(Query(space, start, goal), UniformSampler(), limits, 0)
    assert result.solved and result.iterations == first.iterations + 400
    assert path_length(result.path) <= path_length(first.path)


@pytest.mark.parametrize("heuristic", [True, False])
@pytest.mark.parametrize("method", METHODS)
def test_fmt_is_near_the_geodesic(method, heuristic):
    """On an empty sphere FMT*'s paths are at most a tenth longer than the great circle and shorter than RRT's mean."""
    rng, space = np.random.default_rng(5), sphere_space(method)
    for _ in range(3):
        start, goal = on_sphere(rng, 2)
        empty, angle = Scene(start, goal, ()), np.arccos(start @ goal)
        length = path_length(solve(FmtStar(samples=300, heuristic=heuristic), space, empty).path)
        trees = [path_length(solve(Rrt(), space, empty, seed).path) for seed in range(4)]
        assert 2 * np.sin(angle / 2) < length <= 1.1 * angle
        assert length <= np.mean(trees) * (1 + 1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("planner", PLANNERS)
def test_start_is_goal(planner, method):
    """A goal at the start, or a step from it, is reached by a path that is hardly longer than the way."""
    start = np.array([0.0, 0.6, 0.8])
    for goal in (start.copy(), np.array([0.03, 0.6, np.sqrt(1 - 0.36 - 0.0009)])):
        s = Scene(start, goal, ())
        result = solve(PLANNERS[planner], space_of(method, s), s)
        assert result.solved
        assert_sound(result.path, s)
        if planner == "fmt":
            assert path_length(result.path) < (0.05 if goal[0] else 0.5)


@pytest.mark.parametrize("planner", PLANNERS)
def test_result_is_a_flat_record(planner):
    """A trial's record holds the status in words, what was claimed, and every counter, all of them plain values."""
    s = SOLVABLE[1]
    result = solve(PLANNERS[planner], space_of("atlas", s), s, seed=3)
    row = result.row()
    assert row["status"] == "solved" and row["claimed"] is True and row["seed"] == 3
    assert row["planning_time"] == result.planning_time > 0 and row["network_time"] == 0
    assert row["charts"] == result.counters.charts > 2
    assert all(isinstance(value, (int, float, str)) for value in row.values())


class Recorder(UniformSampler):
    """A sampler that calls itself informed and remembers what it was asked."""

    informed = True

    def begin(self, asked, rng):
        super().begin(asked, rng)
        self.pairs = []

    def draw(self, current, target):
        self.pairs.append((current.copy(), target.copy()))
        return super().draw(current, target)


@pytest.mark.parametrize("planner", [Rrt(), RrtConnect(), FmtStar(samples=100)], ids=lambda p: type(p).__name__)
def test_informed_samplers_are_asked_from_the_tree(planner):
    """A sampler that wants them is given K free configurations to go on from, on the sphere, and targets to go to."""
    s, sampler = SOLVABLE[2], Recorder(batch=16)
    space = space_of("projection", s)
    result = planner.plan(Query(space, s.start, s.goal, "key"), sampler, Termination(max_iterations=3000), 0)
    assert result.solved and sampler.asked.scene == "key"
    assert_sound(result.path, s)
    if isinstance(planner, FmtStar):  # the sampler covers the manifold by itself, which was enough
        return
    for current, target in sampler.pairs:
        assert current.shape == target.shape == (1, 3)
        assert np.abs(np.linalg.norm(current, axis=1) - 1).max() < 1e-3
        assert all(space.validity.free(q) for q in current)
        if isinstance(planner, Rrt):
            np.testing.assert_array_equal(target, s.goal[None])
    np.testing.assert_array_equal(sampler.pairs[0][0], s.start[None])


@pytest.mark.parametrize("informed", [False, True])
def test_classical_late_samples_come_many_at_a_time(informed, monkeypatch):
    """A dead front gets K samples from who knows where to look, and a share of what there is from who does not."""
    monkeypatch.setattr("pipeline.planners.fmt._MOST_LATE", 120)
    s, sampler = SOLVABLE[2], Recorder(batch=16)
    sampler.informed = informed
    space, counts, widths, given = space_of("projection", s), [], [], []
    extend = _Wave.extend

    def counting(wave, Q):
        counts.append(wave.count)
        widths.append(wave.neighbours.shape[1])
        given.append(len(Q))
        extend(wave, Q)

    monkeypatch.setattr(_Wave, "extend", counting)
    planner = FmtStar(samples=5, radius_multiplier=0.4, late=1.5)
    assert planner.plan(Query(space, s.start, s.goal), sampler, Termination(max_iterations=3000), 0).solved
    asked = [len(current) for current, _ in sampler.pairs][-len(counts) :]
    assert len(counts) > 1 and given == np.diff([*counts, counts[-1] + given[-1]]).tolist()
    most = [min(int(1.5 * count), 120 // width) for count, width in zip(counts, widths, strict=True)]
    assert asked == [16 if informed else max(16, share) for share in most]
    assert informed or 16 < asked[-1] < int(1.5 * counts[-1])


def test_rrtconnect_asks_in_turn():
    """RRTConnect's moving start and target change places at every iteration (Algorithm 7)."""
    s, sampler = UNSOLVABLE[1], Recorder()
    space = space_of("projection", s)
    RrtConnect().plan(Query(space, s.start, s.goal), sampler, Termination(max_iterations=3), 0)
    (first, second), (third, fourth) = sampler.pairs[:2]
    np.testing.assert_array_equal([first[0], second[0]], [s.start, s.goal])
    np.testing.assert_array_equal(third[0], s.goal)
    assert not np.array_equal(fourth[0], s.start)  # the first tree has grown


@pytest.mark.parametrize("shape, length", [((0, 3), 0), ((1, 3), 0), ((5, 3), 4 * np.sqrt(3))])
def test_path_length(shape, length):
    """The length of a path is the sum of its chords, and nothing for fewer than two states."""
    path = np.arange(shape[0])[:, None] * np.ones(shape[1])
    assert path_length(path) == pytest.approx(length)
