"""Walks computed several steps at a time are the algorithms of the paper, step by step."""

import numpy as np
import pytest

from pipeline.constraints import Constraint
from pipeline.manifolds import (
    Adherence,
    AdherenceParameters,
    AtlasAdherence,
    AtlasParameters,
    ProjectionAdherence,
    Stop,
    TangentBundleAdherence,
)
from pipeline.robots import Obstacle, Robot, Validity
from tests.manifolds.literal import LiteralAtlas, World, continuation_walk, projection_walk
from tests.robots.worlds import (
    ball,
    ball_clearance,
    block,
    chain,
    differences,
    held_tool,
    held_tool_value,
    on_sphere,
    sphere,
    torus,
)

METHODS = {"projection": ProjectionAdherence, "atlas": AtlasAdherence, "tangent bundle": TangentBundleAdherence}
SHARP = 1e-9  # a tolerance so narrow that all ways to solve an equation end at the same place


def make(method: str, constraint: Constraint, validity: Validity, **settings) -> Adherence:
    parameters = AdherenceParameters if method == "projection" else AtlasParameters
    return METHODS[method](constraint, validity, parameters(**settings))


def sphere_value(q: np.ndarray) -> np.ndarray:
    return np.array([np.linalg.norm(q) - 1])


def sphere_jacobian(q: np.ndarray) -> np.ndarray:
    return q[None] / np.linalg.norm(q)


def torus_value(q: np.ndarray) -> np.ndarray:
    return np.array([np.hypot(np.hypot(q[0], q[1]) - 0.8, q[2]) - 0.4])


def torus_jacobian(q: np.ndarray) -> np.ndarray:
    around = np.hypot(q[0], q[1])
    tube = np.hypot(around - 0.8, q[2])
    return np.array([[*((around - 0.8) / tube * q[:2] / around), q[2] / tube]])


def torus_points(rng: np.random.Generator, count: int) -> np.ndarray:
    a, b = rng.uniform(-np.pi, np.pi, (2, count))
    return np.stack([(0.8 + 0.4 * np.cos(b)) * np.cos(a), (0.8 + 0.4 * np.cos(b)) * np.sin(a), 0.4 * np.sin(b)], axis=1)


def point_world(
    name: str, obstacles: list[Obstacle], tolerance: float = SHARP, high: float = 1.5, margin: float = 0.005
) -> tuple[Constraint, Validity, World]:
    """A manifold of the point robot among obstacles, bounded above in z: for the library, and for the literal walk."""
    robot = ball(upper=(1.5, 1.5, high))
    make_constraint, value, jacobian = {
        "sphere": (sphere, sphere_value, sphere_jacobian),
        "torus": (torus, torus_value, torus_jacobian),
    }[name]
    free = lambda q: bool(ball_clearance(obstacles, q)[0] >= margin)  # noqa: E731
    world = World(value, jacobian, free, robot.lower, robot.upper, tolerance)
    return make_constraint(tolerance=tolerance), Validity(robot, obstacles, margin), world


def arm_world(rows: int, tolerance: float = SHARP) -> tuple[Constraint, Validity, World, np.ndarray]:
    """A random arm of 13 joints that holds its tool; also a configuration that holds it."""
    rng = np.random.default_rng(11)
    robot: Robot = chain(rng, rng.choice(["RX", "RY", "RZ", "revolute unaligned"], 13).tolist())
    q0 = rng.uniform(-1, 1, 13)
    value = lambda q: held_tool_value(robot, q0, rows, q)  # noqa: E731
    world = World(value, lambda q: differences(value, q), lambda q: True, robot.lower, robot.upper, tolerance)
    return held_tool(robot, q0, rows, tolerance=tolerance), Validity(robot, []), world, q0


def blocks(rng: np.random.Generator, points: np.ndarray) -> list[Obstacle]:
    return [block(p, rng.uniform(0.1, 0.3, 3), float(np.linalg.norm(p))) for p in points]


def literal_walk(method: str, world: World, parameters: AdherenceParameters, atlas: LiteralAtlas | None, a, b, limit):
    if atlas is None:
        return projection_walk(world, parameters, a, b, limit)
    return continuation_walk(atlas, method == "tangent bundle", a, b, limit)


def compare(method: str, adherence: Adherence, world: World, pairs, limit: int | None = None, atol: float = 1e-6):
    """Walk all pairs in turn both ways, charts being kept from one to the next; return why the walks stopped."""
    parameters, stops = adherence.parameters, []
    atlas = None if method == "projection" else LiteralAtlas(world, parameters, separate=method == "atlas")
    for a, b in pairs:
        expected, why = literal_walk(method, world, parameters, atlas, a, b, limit)
        walk = adherence.traverse(a, b, limit)
        assert walk.stop is why
        assert walk.states.shape == (len(expected), len(a))
        np.testing.assert_allclose(walk.states, np.array(expected).reshape(walk.states.shape), atol=atol)
        if atlas is not None:
            assert len(adherence.atlas) == len(atlas.charts)
        stops.append(walk.stop)
    return stops


@pytest.mark.parametrize("lookahead", [1, 3, 8])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["sphere", "torus"])
def test_walk_is_the_algorithm(name, method, lookahead):
    """Among obstacles and within bounds every walk has the states and the end of the literal one, and its charts."""
    rng = np.random.default_rng(0)
    draw = on_sphere if name == "sphere" else torus_points
    high = {"sphere": 0.9, "torus": 0.38}[name]
    constraint, validity, world = point_world(name, blocks(rng, draw(rng, 8)), high=high)
    points = [q for q in draw(rng, 200) if world.free(q) and world.inside(q)]
    pairs = list(zip(points[:30], points[30:60], strict=True))
    stops = compare(method, make(method, constraint, validity, lookahead=lookahead), world, pairs)
    assert {Stop.REACHED, Stop.COLLISION, Stop.OUT_OF_BOUNDS} <= set(stops)
