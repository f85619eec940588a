"""What searches for arms have besides: several goals, a direct first walk, directions that are not landed on."""

import numpy as np
import pytest

from pipeline.errors import ConfigError, ProblemError
from pipeline.manifolds import Stop
from pipeline.planners import FmtStar, PlanStatus, Query, Rrt, RrtConnect, Termination
from pipeline.planners.dynamic_domain import DynamicDomainRrtConnect
from pipeline.planners.tree import Tree
from pipeline.samplers import UniformSampler
from tests.manifolds.spaces import METHODS, sphere_space
from tests.planners.scenes import Scene, assert_sound, plated, space_of
from tests.robots.worlds import ball_clearance, block, on_sphere

POLE, EQUATOR = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
LIMIT = Termination(max_iterations=2000)


def walled(method):
    """The sphere with EQUATOR walled in."""
    walls = [block(EQUATOR + 0.25 * d, (0.16, 0.16, 0.16)) for d in np.vstack([np.eye(3)[1:], -np.eye(3)[1:]])]
    ring = [EQUATOR + 0.25 * np.array([0, np.cos(t), np.sin(t)]) for t in np.arange(0, 2 * np.pi, 0.3)]
    return sphere_space(method, [*walls, *(block(p / np.linalg.norm(p), (0.16, 0.16, 0.16)) for p in ring)])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("planner", [RrtConnect(), DynamicDomainRrtConnect(), Rrt()], ids=lambda p: type(p).__name__)
def test_any_start_will_do(planner, method):
    """With the first start walled in, the path begins at the other one."""
    other = np.array([0.0, -1.0, 0.0])
    problem = Query(walled(method), [EQUATOR, other], POLE)
    result = planner.plan(problem, UniformSampler(), Termination(max_iterations=20_000), 0)
    assert result.solved
    np.testing.assert_array_equal(result.path[[0, -1]], [other, POLE])


@pytest.mark.parametrize("method", METHODS)
def test_any_goal_will_do(method):
    """With the first goal walled in, the path ends at the other one."""
    space = walled(method)
    other = np.array([0.0, -1.0, 0.0])
    problem = Query(space, POLE, [EQUATOR, other])
    result = RrtConnect().plan(problem, UniformSampler(), LIMIT, 0)
    assert result.solved
    np.testing.assert_array_equal(result.path[-1], other)
    alone = RrtConnect().plan(Query(space, POLE, EQUATOR), UniformSampler(), Termination(max_iterations=200), 0)
    assert alone.status is PlanStatus.ITERATION_LIMIT


def test_every_start_and_goal_is_checked():
    """A further start or goal off the manifold is refused by its number."""
    problem = Query(sphere_space("projection"), [POLE, [0, 2.0, 0]], EQUATOR)
    with pytest.raises(ProblemError, match="start 2"):
        RrtConnect().plan(problem, UniformSampler(), LIMIT, 0)
    problem = Query(sphere_space("projection"), POLE, [EQUATOR, [0, 1, 0], [0, 2.0, 0]])
    with pytest.raises(ProblemError, match="goal 3"):
        RrtConnect().plan(problem, UniformSampler(), LIMIT, 0)


@pytest.mark.parametrize("method", METHODS)
def test_direct_walk_needs_no_sample(method):
    """Where the walk from start to goal is free, a direct search takes no sample; where it is not, it searches on."""
    free = RrtConnect(direct=True).plan(Query(sphere_space(method), POLE, EQUATOR), UniformSampler(), LIMIT, 0)
    assert free.solved and free.counters.samples == 0 and free.counters.traversals == 1
    middle = (POLE + EQUATOR) / np.sqrt(2)
    space = sphere_space(method, [block(middle, (0.3, 0.3, 0.3))])
    blocked = RrtConnect(direct=True).plan(Query(space, POLE, EQUATOR), UniformSampler(), LIMIT, 0)
    assert blocked.solved and blocked.counters.samples > 0


@pytest.mark.parametrize("method", METHODS)
def test_walk_without_landing(method):
    """A walk that is not to land ends within a step of its target, on the manifold or off it, without taking it."""
    space = sphere_space(method)
    space.anchor(POLE)
    for target in (EQUATOR, 1.04 * EQUATOR):
        walk = space.traverse(POLE, target, land=False)
        assert walk.stop is Stop.ARRIVED
        assert np.linalg.norm(walk.states[-1] - target) < 2 * space.parameters.step
        assert not (walk.states == target).all(axis=1).any()
    near = space.traverse(POLE, np.add(POLE, [0.01, 0, 0]), land=False)
    assert near.stop is Stop.ARRIVED and not len(near.states)


def test_directions_are_samples_where_there_are_any():
    """On the sphere almost all directions are on the manifold; where it is out of reach they are configurations."""
    rng = np.random.default_rng(0)
    space = sphere_space("projection")
    Q = space.directions(rng, 200)
    assert Q.shape == (200, 3)
    assert (np.abs(np.linalg.norm(Q, axis=1) - 1) < 1e-3).mean() > 0.9
    assert ((space.lower <= Q) & (space.upper >= Q)).all()


@pytest.mark.parametrize(
    "planner",
    [RrtConnect(), Rrt(), RrtConnect(range=2.0, direct=True), RrtConnect(outward=0.5), RrtConnect(outward=1.0)],
    ids=["connect", "rrt", "direct", "outward", "outward only"],
)
@pytest.mark.parametrize("method", METHODS)
def test_searches_with_directions_are_sound(planner, method):
    """Among plates, searches towards directions find paths that are on the sphere and free by the closed form."""
    s = plated()
    space = space_of(method, s)
    for seed in range(3):
        result = planner.plan(
            Query(space, s.start, s.goal), UniformSampler(directions=True), Termination(max_iterations=5000), seed
        )
        assert result.solved
        assert_sound(result.path, s)


def test_outward_targets_lie_around_nodes():
    """A target lies as far from its node as asked, within the limits, in all directions alike, as often as asked."""
    space, tree, rng = sphere_space("projection"), Tree(POLE), np.random.default_rng(0)
    planner = RrtConnect(outward=0.25, outward_distance=0.05)
    found = [planner._outward(space, tree, rng) for _ in range(4000)]
    targets = np.array([target for target in found if target is not None])
    assert len(targets) == pytest.approx(1000, abs=110)  # four standard deviations
    np.testing.assert_allclose(np.linalg.norm(targets - POLE, axis=1), 0.05)
    assert np.linalg.norm((targets - POLE).mean(axis=0)) < 0.05 * 0.1
    far = RrtConnect(outward=1.0, outward_distance=50.0)
    clipped = np.array([far._outward(space, tree, rng) for _ in range(50)])
    assert ((clipped >= space.lower) & (clipped <= space.upper)).all()
    node = tree.add(0, EQUATOR[None])
    tree.remove(node)
    assert sum(far._outward(space, tree, rng) is None for _ in range(100)) > 20


def test_outward_needs_no_samples():
    """A search by outward extensions alone asks for no sample; a share that is none is refused."""
    s = plated()
    result = RrtConnect(outward=1.0).plan(
        Query(space_of("projection", s), s.start, s.goal), UniformSampler(), Termination(max_iterations=5000), 0
    )
    assert result.solved and result.counters.samples == 0 and result.iterations > 1
    for bad, message in (({"outward": 1.5}, "outward is 1.5"), ({"outward_distance": 0.0}, "outward_distance is 0")):
        with pytest.raises(ConfigError, match=message):
            RrtConnect(**bad)
    with pytest.raises(ConfigError, match=r"outward is 0\.5"):
        DynamicDomainRrtConnect(outward=0.5)


def test_fmt_refuses_directions():
    """FMT* connects its samples: directions are refused before it begins."""
    with pytest.raises(ConfigError, match="draws from the manifold"):
        FmtStar().plan(Query(sphere_space("projection"), POLE, EQUATOR), UniformSampler(directions=True), LIMIT, 0)


def test_coarse_walks_are_refined():
    """With a coarse resolution and a refinement, paths among plates that walks step over are still free in between."""
    rng = np.random.default_rng(1)
    start, goal = on_sphere(rng, 2)
    walls = [block(p, (0.02, 0.3, 0.2)) for p in on_sphere(rng, 60)]

    s = Scene(start, goal, tuple(o for o in walls if ball_clearance([o], np.stack([start, goal])).min() > 0.02))
    space, repairs = space_of("projection", s, resolution=0.05, refinement=0.005, margin=0.004), 0
    for seed in range(6):
        result = RrtConnect().plan(Query(space, start, goal), UniformSampler(), Termination(max_iterations=5000), seed)
        assert result.solved
        repairs += result.counters.repairs
        share = np.linspace(0, 1, 20)[:, None, None]
        points = (result.path[:-1] + share * np.diff(result.path, axis=0)).reshape(-1, 3)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        assert ball_clearance(s.obstacles, points).min() > 0
    assert repairs > 0
