"""Every reason to stop can be provoked by a plain situation, and is told as what it is."""

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Constraint
from pipeline.manifolds import Stop
from pipeline.robots import Validity
from tests.manifolds.literal import LiteralAtlas, continuation_walk
from tests.manifolds.spaces import CHARTED, METHODS, make, point_world, sphere_space, torus_points
from tests.robots.worlds import ball, block, plate

A, B = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])  # a quarter of a great circle apart
GAMMA = 0.05


def at(angle: float) -> np.ndarray:
    """The point of the equator at an angle from A towards B."""
    return np.array([np.cos(angle), np.sin(angle), 0.0])


@pytest.mark.parametrize("method", METHODS)
def test_reached(method):
    """Nothing in the way: reached, in about as many steps as the arc has."""
    walk = sphere_space(method).traverse(A, B)
    assert walk.stop is Stop.REACHED
    assert np.pi / 2 / 0.06 < len(walk.states) < np.pi / 2 / 0.04


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("distance", [0.0, 0.02, GAMMA])
def test_target_within_a_step(method, distance):
    """A target within one step, the first state itself included, is taken at once, without a chart."""
    space = sphere_space(method)
    target = at(2 * np.arcsin(distance / 2)) if distance else A
    walk = space.traverse(A, target)
    assert walk.stop is Stop.REACHED and space.counted().charts == 0
    np.testing.assert_array_equal(walk.states, [target])


@pytest.mark.parametrize("method", METHODS)
def test_collision(method):
    """A wall across the way: the walk ends in front of it, at most a step away."""
    walk = sphere_space(method, [block(at(0.8), (0.2, 0.2, 0.2))]).traverse(A, B)
    assert walk.stop is Stop.COLLISION
    last = np.arctan2(walk.states[-1][1], walk.states[-1][0])
    assert 0.8 - 0.1 - 2 * GAMMA < last < 0.8 - 0.1


@pytest.mark.parametrize("method", METHODS)
def test_collision_between_two_states(method):
    """A plate thinner than a step is seen between two states; at a resolution of a whole step it is stepped over."""
    free = sphere_space(method).traverse(A, B)
    p, q = free.states[9:11]
    across = plate((p + q) / 2, q - p, (0.3, 0.3, 0.002))
    walk = sphere_space(method, [across]).traverse(A, B)
    assert walk.stop is Stop.COLLISION and len(walk.states) == 10
    coarse = sphere_space(method, [across], resolution=GAMMA).traverse(A, B)
    assert coarse.stop is Stop.REACHED


@pytest.mark.parametrize("method", METHODS)
def test_target_or_the_way_to_it_in_collision(method):
    """The last stretch is checked as well: a target inside an obstacle, or behind a thin one, is not reached."""
    target = at(0.04)
    for obstacle in (block(target, (0.01, 0.01, 0.01)), plate(at(0.02), B, (0.3, 0.3, 0.004))):
        walk = sphere_space(method, [obstacle], margin=0.0).traverse(A, target)
        assert walk.stop is Stop.COLLISION and walk.states.shape == (0, 3)


@pytest.mark.parametrize("method", METHODS)
def test_out_of_bounds(method):
    """A joint limit on the way: the last state is within it, at most a step away from it."""
    walk = sphere_space(method, upper=(1.5, 0.6, 1.5)).traverse(A, B)
    assert walk.stop is Stop.OUT_OF_BOUNDS
    assert 0.6 - 2 * GAMMA < walk.states[-1][1] <= 0.6


def test_lifted_states_keep_the_bounds():
    """A state of the tangent bundle that is within the bounds only until it is lifted ends the walk."""
    stops = set()
    for low in np.linspace(0.7, 0.9, 11):
        space = make("tangent bundle", sphere_space("atlas").constraint, Validity(ball(lower=(-1.5, -1.5, low)), []))
        target = np.array([np.sin(1.0), 0.0, np.cos(1.0)])
        walk = space.traverse(np.array([0.0, 0.0, 1.0]), target)
        assert (walk.states[:, 2] >= low).all()
        stops.add(walk.stop)
    assert stops == {Stop.OUT_OF_BOUNDS}


@pytest.mark.parametrize("method", METHODS)
def test_leap(method):
    """With no step longer than 1.0001 gammas allowed, one along a chord that bends away is too long."""
    space = sphere_space(method, leap=1.0001)
    if method in CHARTED:
        space.anchor(
            at(-0.12)
        )  # so that the walk begins off the middle of a chart, where chart steps map to longer ones
    walk = space.traverse(A, B)
    assert walk.stop is Stop.LEAP
    steps = np.linalg.norm(np.diff(np.vstack([A, walk.states]), axis=0), axis=1)
    assert steps.max(initial=0) <= 1.0001 * GAMMA


@pytest.mark.parametrize("method", METHODS)
def test_wandered(method):
    """A quarter circle is 1.11 times its chord: 1.2 chords suffice, 1.05 do not."""
    assert sphere_space(method, wander=1.2).traverse(A, B).stop is Stop.REACHED
    walk = sphere_space(method, wander=1.05).traverse(A, B)
    assert walk.stop is Stop.WANDERED
    way = np.linalg.norm(np.diff(np.vstack([A, walk.states]), axis=0), axis=1).sum()
    assert 1.05 * np.sqrt(2) - 2 * GAMMA < way <= 1.05 * np.sqrt(2) + 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_step_limit(method):
    """Of the 35 or so steps to the target only max_steps are taken."""
    walk = sphere_space(method, max_steps=11).traverse(A, B)
    assert walk.stop is Stop.STEP_LIMIT and len(walk.states) == 11


def valley(**settings) -> Constraint:
    """A narrow parabolic trough, z = 20 x^2."""
    q = ca.SX.sym("q", 3)
    return Constraint("valley", q, q[2] - 20 * q[0] ** 2, **settings)


def test_away():
    """Down one side of a narrow valley towards the other: where the next step would be thrown back up, it ends."""
    space = make("projection", valley(), Validity(ball(), []))
    start, target = np.array([-0.15, 0.0, 0.45]), np.array([0.13, 0.1, 0.338])
    walk = space.traverse(start, target)
    assert walk.stop is Stop.AWAY
    distances = np.linalg.norm(np.vstack([start, walk.states]) - target, axis=1)
    assert (np.diff(distances) <= 0).all()
    q = walk.states[-1] + GAMMA * (target - walk.states[-1]) / distances[-1]
    while abs(q[2] - 20 * q[0] ** 2) >= 1e-3:
        J = np.array([-40 * q[0], 0.0, 1.0])
        q = q - J * (q[2] - 20 * q[0] ** 2) / (J @ J)
    assert np.linalg.norm(q - target) > distances[-1]


@pytest.mark.parametrize("method", CHARTED)
def test_away_in_a_chart(method):
    """On a torus some walks in charts come to recede from their target: they end there, as the literal ones do."""
    constraint, validity, world = point_world("torus", [])
    space, rng, found = make(method, constraint, validity), np.random.default_rng(0), 0
    for a, b in torus_points(rng, 1200).reshape(-1, 2, 3):
        space.reset()
        walk = space.traverse(a, b)
        if walk.stop is Stop.AWAY:
            atlas = LiteralAtlas(world, space.parameters, separate=method == "atlas")
            states, stop = continuation_walk(atlas, method == "tangent bundle", a, b)
            assert stop is Stop.AWAY and len(states) == len(walk.states)
            receded = np.diff(np.linalg.norm(walk.states - b, axis=1)) > 0
            assert method == "tangent bundle" or not receded.any()  # a state that is lifted may recede
            found += 1
    assert found >= 2


@pytest.mark.parametrize("method", CHARTED)
def test_folded(method):
    """The opposite point lies above the first chart's origin: over it in the chart, but on another fold."""
    space = sphere_space(method)
    for angle in (np.pi, np.pi - 0.03, np.pi - GAMMA + 0.001):
        walk = space.traverse(A, at(angle))
        assert walk.stop is Stop.FOLDED and len(walk.states) == 0


@pytest.mark.parametrize("method", CHARTED)
def test_no_chart_when_the_atlas_is_full(method):
    """A walk that needs more charts than there may be ends where the last one does."""
    space = sphere_space(method, max_charts=3)
    walk = space.traverse(A, B)
    assert walk.stop is Stop.NO_CHART
    assert len(space.atlas) == 3 and 3 < len(walk.states) < 20
    assert space.traverse(B, A).stop is Stop.NO_CHART


@pytest.mark.parametrize("method", CHARTED)
def test_no_chart_where_rank_is_lost(method):
    """A walk from a point where the Jacobian has lost rank cannot begin."""
    q = ca.SX.sym("q", 3)
    cross = Constraint("cross", q, q[0] * q[1])  # two planes; J = 0 along the z axis
    space = make(method, cross, Validity(ball(), []))
    assert space.traverse(np.zeros(3), np.array([1.0, 0.0, 0.0])).stop is Stop.NO_CHART
    assert space.traverse(np.array([1.0, 0.0, 0.0]), np.array([0.5, 0.0, 0.5])).stop is Stop.REACHED


@pytest.mark.parametrize("method", ["projection", "atlas"])
def test_not_converged(method):
    """One Newton step does not bring a step in a curved valley within a billionth of it."""
    space = make(method, valley(tolerance=1e-9), Validity(ball(), []), newton_steps=1)
    walk = space.traverse(np.array([-0.15, 0.0, 0.45]), np.array([-0.05, 0.1, 0.05]))
    assert walk.stop is Stop.NOT_CONVERGED and len(walk.states) == 0


def test_lift_that_does_not_converge():
    """Three Newton steps do not bring a state of the bundle from epsilon above a valley within rounding of it."""
    space = make("tangent bundle", valley(tolerance=1e-13), Validity(ball(), []), newton_steps=1, epsilon=0.04)
    walk = space.traverse(np.array([-0.15, 0.0, 0.45]), np.array([-0.05, 0.1, 0.05]))
    assert walk.stop is Stop.NOT_CONVERGED and 0 < len(walk.states) < 8
    deviations = np.abs(walk.states[:, 2] - 20 * walk.states[:, 0] ** 2)
    assert deviations.max() <= 0.04


@pytest.mark.parametrize("method", METHODS)
def test_undefined_ends_stop_the_walk(method):
    """A NaN in the target or the first state never gives a state, let alone a target reached."""
    for a, b in ((A, np.array([np.nan, 0.0, 1.0])), (np.array([0.0, np.nan, 1.0]), B)):
        walk = sphere_space(method).traverse(a, b)
        assert not walk.reached and len(walk.states) == 0
