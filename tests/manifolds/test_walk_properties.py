"""What every walk keeps to, whichever the method: the manifold, its steps, obstacles, bounds and its target."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pipeline.errors import ConfigError
from pipeline.manifolds import AdherenceParameters, AtlasParameters, ProjectionAdherence, Stop
from pipeline.robots import Validity
from tests.manifolds.spaces import CHARTED, MARGIN, METHODS, arm_world, blocks, make, point_world, sphere_space
from tests.robots.worlds import ball, ball_clearance, block, chain, on_sphere, sphere

POLE, EQUATOR = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def obstructed(seed: int, method: str, count: int = 12, high: float = 0.8, **parameters):
    """A sphere with blocks and a bound on z: the space, its obstacles, and free points within the bounds."""
    rng = np.random.default_rng(seed)
    obstacles = blocks(rng, on_sphere(rng, count))
    points = on_sphere(rng, 120)
    points = points[(ball_clearance(obstacles, points) > MARGIN) & (points[:, 2] <= high)]
    return sphere_space(method, obstacles, upper=(1.5, 1.5, high), **parameters), obstacles, points


def pairs_of(points: np.ndarray, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    return list(zip(points[:count], points[count : 2 * count], strict=True))


@pytest.mark.parametrize("method", METHODS)
def test_states_keep_to_everything(method):
    """States are on the manifold, a leap apart at most, within bounds, and free at every check in between."""
    space, obstacles, points = obstructed(0, method)
    deviation = 1e-3 if method != "tangent bundle" else space.parameters.epsilon
    stops, deviations = [], []
    for a, b in pairs_of(points, 35):
        walk = space.traverse(a, b)
        stops.append(walk.stop)
        states = np.vstack([a, walk.states])
        deviations.append(np.abs(np.linalg.norm(states, axis=1) - 1).max())
        assert np.linalg.norm(np.diff(states, axis=0), axis=1).max(initial=0) <= 2 * 0.05
        assert (states[:, 2] <= 0.8).all()
        assert ball_clearance(obstacles, states).min() >= MARGIN
        between = np.concatenate([states, *(np.linspace(p, q, 6) for p, q in pairwise(states))])
        # A state lifted after the way to it was checked ends up to epsilon beside that way.
        slack = 0 if method != "tangent bundle" else space.parameters.epsilon
        assert ball_clearance(obstacles, between).min() >= MARGIN - slack
    assert max(deviations) < deviation
    assert {Stop.REACHED, Stop.COLLISION, Stop.OUT_OF_BOUNDS} <= set(stops)


@pytest.mark.parametrize("resolution, pieces", [(0.05, 1), (0.03, 2), (0.02, 3), (0.01, 5)])
@pytest.mark.parametrize("method", METHODS)
def test_collisions_are_checked_at_the_resolution(method, resolution, pieces, monkeypatch):
    """Along every step all points are checked that divide it into pieces of the resolution, its end included.

    So it is where no bound on the robot's travel lets one check stand for several.
    """
    space, checked = make(method, sphere(), Validity(ball(), [], MARGIN), resolution=resolution), []
    space._wide = None
    monkeypatch.setattr(space.validity, "free", lambda q: checked.append(q.copy()) or True)
    target = np.array([0.0, 0.6, 0.8])
    states = np.vstack([EQUATOR, space.traverse(EQUATOR, target).states])
    wanted = [p + i / pieces * (q - p) for p, q in pairwise(states) for i in range(1, pieces + 1)]
    distances = np.linalg.norm(np.array(checked)[None] - np.array(wanted)[:, None], axis=2)
    # The way to a state that is lifted was checked up to where it was before.
    assert distances.min(axis=1).max() <= (space.parameters.epsilon if method == "tangent bundle" else 1e-12)
    assert len(checked) == len(wanted)


@pytest.mark.parametrize("method", METHODS)
def test_travel_only_changes_the_price(method):
    """Walks of a robot whose travel is known take the same states and stops for fewer collision checks."""
    space, obstacles, points = obstructed(4, method)
    plain = make(method, sphere(), Validity(ball(upper=(1.5, 1.5, 0.8)), obstacles, MARGIN))
    plain._wide = None
    stops = []
    for a, b in pairs_of(points, 40):
        walk, other = space.traverse(a, b), plain.traverse(a, b)
        assert walk.stop is other.stop
        np.testing.assert_array_equal(walk.states, other.states)
        stops.append(walk.stop)
    assert {Stop.REACHED, Stop.COLLISION} <= set(stops)
    assert space.counted().collision_checks < 0.7 * plain.counted().collision_checks


@pytest.mark.parametrize(
    "count, step, resolution", [(1, 0.05, 0.01), (8, 0.05, 0.05), (50, 0.3, 0.3), (50, 0.05, 0.01)]
)
@pytest.mark.parametrize("method", METHODS)
def test_screen_halves_the_straight_line(method, count, step, resolution):
    """An edge is refused exactly when a point collides that halves its line to the resolution, or to sixteenths."""
    space, obstacles, points = obstructed(5, method, step=step, resolution=resolution)
    near = cKDTree(points).query(points, k=4)[1][:, 1:]
    pairs = [(points[i], points[j]) for i, row in enumerate(near) for j in row] + list(pairwise(points))
    ends = np.array(pairs[-count:] if count < 50 else pairs)
    sixteenths = ends[:, :1] + np.arange(1, 16)[:, None] / 16 * (ends[:, 1:] - ends[:, :1])
    sixteenths /= np.linalg.norm(sixteenths, axis=2, keepdims=True)
    clearance = ball_clearance(obstacles, sixteenths.reshape(-1, 3)).reshape(-1, 15)
    straight, pieces = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), []
    for i, long in enumerate(straight):
        pieces.append(next((count for count in (2, 4, 8) if long / count <= resolution), 16))
        clearance[i, [k - 1 for k in range(1, 16) if k % (16 // pieces[i])]] = np.inf
    verdicts, lengths = space.screen(ends[:, 0], ends[:, 1])
    assert verdicts.shape == lengths.shape == (len(ends),)
    decided = np.abs(clearance.min(axis=1) - MARGIN) > 1e-3  # the tolerance of the projection
    np.testing.assert_array_equal(verdicts[decided], (clearance.min(axis=1) > MARGIN)[decided])
    assert count < 50 or 3 < verdicts.sum() < len(ends) - 3
    assert resolution < 0.3 or {2, 4, 8} <= set(pieces)
    way = np.linalg.norm(np.diff(np.concatenate([ends[:, :1], sixteenths, ends[:, 1:]], axis=1), axis=1), axis=2)
    np.testing.assert_allclose(lengths, np.where(verdicts, way.sum(axis=1), np.inf), atol=16 * 2e-3)


def test_screen_counts_what_it_projects():
    """A middle for every edge, and all fifteen points of those whose middle is free."""
    space, obstacles, points = obstructed(5, "projection")
    ends = np.array(list(pairwise(points)))
    middles = ends.mean(axis=1)
    clearance = ball_clearance(obstacles, middles / np.linalg.norm(middles, axis=1, keepdims=True))
    assert (np.abs(clearance - MARGIN) > 1e-3).all()
    space.screen(ends[:, 0], ends[:, 1])
    free = (clearance > MARGIN).sum()
    assert space.counted().projections == len(ends) + 15 * free and 0 < free < len(ends)


def test_screen_lets_pass_what_it_cannot_judge(monkeypatch):
    """Where the straight line's points reach no manifold nothing is refused: the walk decides."""
    middle = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5)])
    space = sphere_space("projection", [block(middle, (0.3, 0.3, 0.3))])
    ends = EQUATOR[None], POLE[None]
    assert space.screen(*ends)[0].tolist() == [False]
    monkeypatch.setattr(space.constraint, "tolerance", 0.0)
    assert space.screen(*ends)[0].tolist() == [True]


@pytest.mark.parametrize("method", METHODS)
def test_target_is_the_last_state_exactly_when_reached(method):
    """A walk that reached has its target as last state to the last bit; no other walk has it anywhere."""
    space, _, points = obstructed(1, method)
    reached = 0
    for a, b in pairs_of(points, 30):
        walk = space.traverse(a, b)
        assert walk.reached == (walk.stop is Stop.REACHED)
        hits = [np.array_equal(state, b) for state in walk.states]
        assert hits == [False] * (len(hits) - 1) + [True] if walk.reached else not any(hits)
        reached += walk.reached
    assert 5 < reached < 30


@pytest.mark.parametrize("method", METHODS)
def test_free_sphere_is_walked_both_ways(method):
    """On a free sphere walks reach and come back, unless the points are nearly opposite, along the great circle."""
    space = sphere_space(method)
    rng = np.random.default_rng(2)
    for a, b in pairs_of(on_sphere(rng, 120), 60):
        angle = np.arccos(a @ b)
        if angle > 2.6:  # from there the charts of Algorithms 3 and 4 do not always lead straight on
            continue
        for p, q in ((a, b), (b, a)):
            walk = space.traverse(p, q)
            assert walk.reached
            length = np.linalg.norm(np.diff(np.vstack([p, walk.states]), axis=0), axis=1).sum()
            assert angle * 0.98 <= length <= angle * 1.12


@pytest.mark.parametrize("method", METHODS)
def test_way_back_is_as_free_as_the_way(method):
    """Between free ends the finer walk judges the states of a coarser one the same in either direction."""
    space, obstacles, points = obstructed(3, method)
    coarse = sphere_space(method, obstacles, margin=0.0, resolution=0.05)
    verdicts = []
    for a, b in pairs_of(points, 40):
        states = np.vstack([a, coarse.traverse(a, b).states])
        states = states[: 1 + np.flatnonzero(ball_clearance(obstacles, states) > 2 * MARGIN)[-1]]
        there, back = space.refine(states), space.refine(states[::-1])
        assert (there.invalid is None) == (back.invalid is None)
        np.testing.assert_array_equal(there.states, back.states[::-1])
        verdicts.append(there.invalid is None)
    assert 0 < np.mean(verdicts) < 1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [1, 2, 5, 8, 9, 30])
def test_max_states(method, count):
    """A limited walk is the beginning of the unlimited one, of as many states as may be; the target does not count."""
    space = sphere_space(method)
    for angle in (0.04, 0.06, 0.3, 0.52, 1.4):
        target = np.array([np.cos(angle), np.sin(angle), 0.0])
        full = space.traverse(EQUATOR, target)
        space.reset()
        walk = space.traverse(EQUATOR, target, count)
        space.reset()
        assert full.reached
        if len(full.states) - 1 > count:  # the target itself does not count
            assert walk.stop is Stop.STEP_LIMIT and len(walk.states) == count
        else:
            assert walk.reached
        np.testing.assert_array_equal(walk.states, full.states[: len(walk.states)])


@pytest.mark.parametrize("method", METHODS)
def test_walk_goes_on_from_its_states(method):
    """A walk cut off and continued from where it stopped has the states of the uncut one."""
    space = sphere_space(method)
    for seed in range(4):
        a, b = on_sphere(np.random.default_rng(seed), 2)
        whole = space.traverse(a, b)
        space.reset()
        parts = [a[None]]
        for _ in range(len(whole.states)):
            walk = space.traverse(parts[-1][-1], b, 7)
            parts.append(walk.states)
            if walk.reached:
                break
        assert whole.reached
        np.testing.assert_allclose(np.concatenate(parts[1:]), whole.states, atol=1e-9)
        space.reset()


@pytest.mark.parametrize("method", METHODS)
def test_lookahead_only_changes_the_price(method):
    """However many steps are computed ahead, an arm's walk with the usual tolerance has the same states."""
    constraint, validity, _, q0 = arm_world(3, tolerance=1e-3)
    rng = np.random.default_rng(5)
    ends = [constraint.project(q0 + rng.normal(scale=0.2, size=13)).q for _ in range(6)]
    walks = [
        [space.traverse(a, b) for a, b in pairwise(ends)]
        for space in (make(method, constraint, validity, lookahead=lookahead) for lookahead in (1, 2, 4))
    ]
    for others in walks[1:]:
        for one, other in zip(walks[0], others, strict=True):
            assert one.stop is other.stop
            np.testing.assert_allclose(one.states, other.states, atol=1e-9)
    assert max(len(walk.states) for walk in walks[0]) > 5


@pytest.mark.parametrize("method", METHODS)
def test_arm_stays_on_its_manifold(method):
    """The states of an arm's walk hold the tool within the tolerance by pinocchio, a leap apart at most."""
    constraint, validity, world, q0 = arm_world(6, tolerance=1e-3)
    space = make(method, constraint, validity, lookahead=3)
    bound = 1e-3 if method != "tangent bundle" else space.parameters.epsilon
    rng = np.random.default_rng(6)
    for _ in range(8):
        a, b = (constraint.project(q0 + rng.normal(scale=0.2, size=13)).q for _ in range(2))
        walk = space.traverse(a, b)
        assert len(walk.states) > 3
        assert max(np.linalg.norm(world.value(q)) for q in walk.states) <= bound
        assert np.linalg.norm(np.diff(np.vstack([a, walk.states]), axis=0), axis=1).max() <= 0.1


@pytest.mark.parametrize("method", METHODS)
def test_walks_count_their_work(method, monkeypatch):
    """Counters count traversals, collision checks and charts since the last reset, and a copy stays as it was."""
    space, _, points = obstructed(7, method)
    checks = []
    for checker in {space.validity, space.validity.widened(1.1 * 0.05 / 2)}:

        def counting(q, ask=checker.free):
            checks.append(q)
            return ask(q)

        monkeypatch.setattr(checker, "free", counting)
    for a, b in pairs_of(points, 5):
        space.traverse(a, b)
    counted = space.counted()
    assert counted.traversals == 5
    assert counted.collision_checks == len(checks) > 0
    assert (counted.charts > 1) == (method in CHARTED)
    space.traverse(points[0], points[1])
    assert counted.traversals == 5
    space.reset()
    assert space.counted() == type(counted)()


@pytest.mark.parametrize("method", METHODS)
def test_reset_forgets_and_moves_to_another_scene(method):
    """After a reset a walk is what it is in a fresh space; with other obstacles it heeds those."""
    (space, obstacles, points), (other, _, _) = obstructed(8, method), obstructed(9, method)
    pairs = pairs_of(points, 10)
    first = [space.traverse(a, b) for a, b in pairs]
    space.reset(other.validity)
    for a, b in pairs:
        expected, found = other.traverse(a, b), space.traverse(a, b)
        assert found.stop is expected.stop
        np.testing.assert_array_equal(found.states, expected.states)
    space.reset(Validity(space.validity.robot, obstacles, MARGIN))
    for (a, b), walk in zip(pairs, first, strict=True):
        np.testing.assert_array_equal(space.traverse(a, b).states, walk.states)


@pytest.mark.parametrize(
    "name, value",
    [
        *[(name, value) for name in ("step", "leap", "wander", "resolution") for value in (0.0, -1.0, np.nan, np.inf)],
        *[(name, 0) for name in ("max_steps", "newton_steps", "lookahead")],
        ("resolution", 0.06),
        ("epsilon", 0.0),
        ("alpha", np.pi / 2),
        ("alpha", 0.0),
        ("rho", -1.0),
        ("exploration", 1.0),
        ("exploration", -0.1),
        ("max_charts", 0),
        ("epsilon", np.nan),
    ],
)
def test_parameters_are_checked(name, value):
    """A parameter out of its range is refused with its name and value."""
    kinds = (AdherenceParameters, AtlasParameters) if hasattr(AdherenceParameters, name) else (AtlasParameters,)
    for kind in kinds:
        with pytest.raises(ConfigError, match=rf"adherence\.{name} is {value}"):
            kind(**{name: value})


def test_constraint_must_fit_the_robot():
    """A constraint on other variables than the robot's joints is refused with both counts."""
    arm = chain(np.random.default_rng(0), ["RX", "RY"])
    with pytest.raises(ConfigError, match=r"'sphere' has 3 variables, robot 'chain' has 2 joints"):
        ProjectionAdherence(sphere(), Validity(arm, []), AdherenceParameters())


def test_point_world_is_one_world():
    """The closed forms the literal walks use are those of the library's constraints."""
    rng = np.random.default_rng(0)
    for name in ("sphere", "torus"):
        constraint, _, world = point_world(name, [])
        for q in rng.uniform(-1.2, 1.2, (10, 3)):
            np.testing.assert_allclose(constraint.value(q), world.value(q), atol=1e-12)
            np.testing.assert_allclose(constraint.jacobian(q), world.jacobian(q), atol=1e-12)
