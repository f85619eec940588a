"""Free space is what is left of every room where nothing is asked of configurations but to be free."""

from itertools import pairwise

import numpy as np
import pytest

from pipeline.constraints import Unconstrained
from pipeline.manifolds import ADHERENCES, AdherenceParameters, FreeSpace, Stop, make_adherence
from pipeline.planners import PLANNERS, Query, Termination
from pipeline.robots import Obstacle, Shape, Validity
from pipeline.samplers import UniformSampler
from pipeline.schema import Choice
from pipeline.spec.statement import Point, Statement
from pipeline.verification.judge import Judge
from tests.robots.named import configurations, named
from tests.robots.worlds import ball

BALL = Obstacle(Shape.SPHERE, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.6, 0.6, 0.6), "ball")


def space(resolution: float = 0.01) -> FreeSpace:
    """A point around a ball."""
    robot = ball([-1] * 3, [1] * 3)
    return FreeSpace(Unconstrained(3), Validity(robot, (BALL,)), AdherenceParameters(resolution=resolution))


def test_walks_are_straight_and_end_at_the_ball():
    """States are on the line, at most a step apart; a walk arrives just where the line keeps off the ball."""
    walked, rng, seen = space(), np.random.default_rng(0), set()
    for _ in range(200):
        a, b = rng.uniform(-1, 1, (2, 3))
        if min(np.linalg.norm(a), np.linalg.norm(b)) < 0.31:
            continue
        walk = walked.traverse(a, b)
        states = np.vstack([a, walk.states])
        share = np.clip(((states - a) @ (b - a)) / ((b - a) @ (b - a)), 0, 1)
        np.testing.assert_allclose(states, a + share[:, None] * (b - a), atol=1e-12)
        assert np.linalg.norm(np.diff(states, axis=0), axis=1).max(initial=0) < 0.05 + 1e-12
        nearest = np.linalg.norm(a - np.clip(a @ (a - b) / ((b - a) @ (b - a)), 0, 1) * (a - b))
        if abs(nearest - 0.301) > 2e-3:
            assert walk.reached == (nearest > 0.301), nearest
            assert walk.reached or walk.stop is Stop.COLLISION
            seen.add(walk.reached)
            promising, lengths = walked.screen(a[None], b[None])
            if nearest > 0.31:
                assert promising[0] and lengths[0] == pytest.approx(np.linalg.norm(b - a))
        if walk.reached:
            assert np.array_equal(walk.states[-1], b)
    assert seen == {True, False}


def test_walks_stop_as_they_are_asked():
    """After so many states, at a limit, or within a step of what they need not land on."""
    walked = space()
    a, b = np.array([-0.9, 0.5, 0.5]), np.array([0.9, 0.5, 0.5])
    assert walked.traverse(a, b, max_states=3).stop is Stop.STEP_LIMIT
    assert len(walked.traverse(a, b, max_states=3).states) == 3
    short = walked.traverse(a, b, land=False)
    assert short.stop is Stop.ARRIVED and 0 < np.linalg.norm(short.states[-1] - b) <= 0.05 + 1e-9
    assert walked.traverse(a, np.array([1.2, 0.5, 0.5]), land=False).stop is Stop.OUT_OF_BOUNDS


@pytest.mark.parametrize("kind", ADHERENCES)
def test_every_method_is_free_space_there(kind):
    """Whichever adherence method is named: without a constraint it is the straight line."""
    robot = ball([-1] * 3, [1] * 3)
    made = make_adherence(Choice(kind, {}), Unconstrained(3), Validity(robot, (BALL,)))
    assert isinstance(made, FreeSpace) and made.counted().projections == 0


@pytest.mark.parametrize("planner", ["rrtconnect", "rrt", "fmt"])
def test_planners_go_around(planner):
    """Every planner finds a way around the ball, which the verifier passes; nothing was projected on the way."""
    start, goal = np.array([-0.8, 0.0, 0.05]), np.array([0.8, 0.02, 0.0])
    judge = Judge(Statement(Point(0.001, (-1.0,) * 3, (1.0,) * 3), (), obstacles=(BALL,)))
    for seed in range(3):
        walked = space()
        planned = PLANNERS[planner]()
        found = planned.plan(Query(walked, start, goal), UniformSampler(), Termination(max_iterations=20_000), seed)
        assert found.solved and found.counters.projections == 0
        verdict = judge.verify(found.path, start, goal)
        assert verdict.passed, verdict.message
        assert verdict.max_violation == 0
        assert 1.7 < verdict.length < 4


def test_joints_that_turn_go_the_short_way():
    """Kinova's first joint from 3.1 to -3.1 moves 0.08 rad."""
    robot = named("kinova")
    walked = FreeSpace(Unconstrained(robot.dimension), Validity(robot, ()), AdherenceParameters())
    turning = int(np.flatnonzero(robot.turning)[0])
    q = configurations(robot, np.random.default_rng(0), 1)[0]
    a, b = q.copy(), q.copy()
    a[turning], b[turning] = 3.1, -3.1
    walk = walked.traverse(a, b)
    way = sum(np.linalg.norm(y - x) for x, y in pairwise([a, *walk.states]))
    assert way == pytest.approx(2 * np.pi - 6.2, abs=1e-9) or walk.stop is Stop.COLLISION
