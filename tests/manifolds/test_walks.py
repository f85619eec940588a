"""Walks computed several steps at a time are the algorithms of the paper, step by step."""

import numpy as np
import pytest

from pipeline.constraints import Constraint
from pipeline.manifolds import Stop
from pipeline.robots import Validity
from tests.manifolds.literal import LiteralAtlas, World, continuation_walk, projection_walk
from tests.manifolds.spaces import CHARTED, METHODS, arm_world, blocks, make, point_world, torus_points
from tests.robots.worlds import on_sphere


def compare(
    method: str, constraint: Constraint, validity: Validity, world: World, pairs, lookaheads=(1, 3, 8), **settings
) -> list[Stop]:
    """Walk all pairs in turn, keeping charts from one to the next, as literally; return why the walks stopped."""
    spaces = [make(method, constraint, validity, lookahead=lookahead, **settings) for lookahead in lookaheads]
    parameters, stops = spaces[0].parameters, []
    atlas = LiteralAtlas(world, parameters, separate=method == "atlas")
    for a, b in pairs:
        if method == "projection":
            states, stop = projection_walk(world, parameters, a, b)
        else:
            states, stop = continuation_walk(atlas, method == "tangent bundle", a, b)
        for space in spaces:
            walk = space.traverse(a, b)
            assert walk.stop is stop
            assert walk.states.shape == (len(states), len(a))
            np.testing.assert_allclose(walk.states, np.array(states).reshape(walk.states.shape), atol=1e-6)
            assert space.counted().charts == len(atlas.charts)
        stops.append(stop)
    return stops


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name, draw, high", [("sphere", on_sphere, 0.75), ("torus", torus_points, 0.38)])
def test_walk_is_the_algorithm(name, draw, high, method):
    """Among obstacles and bounds every walk has the states, the end and the charts of the literal one."""
    rng = np.random.default_rng(0)
    constraint, validity, world = point_world(name, blocks(rng, draw(rng, 8)), high=high)
    points = [q for q in draw(rng, 100) if world.free(q) and world.inside(q)]
    stops = compare(method, constraint, validity, world, zip(points[:25], points[25:50], strict=True))
    assert {Stop.REACHED, Stop.COLLISION, Stop.OUT_OF_BOUNDS} <= set(stops)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rows", [3, 6])
def test_walk_of_an_arm_is_the_algorithm(rows, method):
    """Walks of an arm of 13 joints that holds its tool are the literal ones, on manifolds of dimension 10 and 7."""
    constraint, validity, world, q0 = arm_world(rows)
    rng = np.random.default_rng(1)
    found = [constraint.project(q0 + rng.normal(scale=0.2, size=13)).q for _ in range(8)]
    stops = compare(method, constraint, validity, world, zip(found[:4], found[4:], strict=True), lookaheads=(1, 3))
    assert Stop.REACHED in stops


SETTINGS = [
    ({"leap": 1.0002}, Stop.LEAP),
    ({"wander": 1.05}, Stop.WANDERED),
    ({"max_steps": 7}, Stop.STEP_LIMIT),
    ({"step": 0.2, "resolution": 0.2}, Stop.REACHED),
    ({"step": 0.1, "resolution": 0.03}, Stop.REACHED),
]
CHART_SETTINGS = [
    ({"step": 0.1, "resolution": 0.03, "epsilon": 0.05}, Stop.REACHED),
    ({"epsilon": 0.04, "rho": 0.11}, Stop.REACHED),
    ({"epsilon": 0.04, "alpha": 0.1}, Stop.REACHED),
    ({"max_charts": 9}, Stop.NO_CHART),
]


@pytest.mark.parametrize(
    "method, settings, stop",
    [(method, *case) for method in METHODS for case in SETTINGS + CHART_SETTINGS * (method in CHARTED)],
)
def test_parameters_are_those_of_the_algorithm(method, settings, stop):
    """Whatever the parameters, walks are the literal ones, and those that limit a walk do."""
    rng = np.random.default_rng(2)
    constraint, validity, world = point_world("torus", [])
    points = torus_points(rng, 20)
    stops = compare(method, constraint, validity, world, zip(points[:10], points[10:], strict=True), (3,), **settings)
    assert stop in stops
