"""Adherence methods on manifolds that are known in closed form, as the library has them and for the literal walks."""

import numpy as np

from pipeline.constraints import Constraint
from pipeline.manifolds import (
    Adherence,
    AdherenceParameters,
    AtlasAdherence,
    AtlasParameters,
    ProjectionAdherence,
    TangentBundleAdherence,
)
from pipeline.robots import Obstacle, Robot, Validity
from tests.manifolds.literal import World
from tests.robots.worlds import (
    ball,
    ball_clearance,
    block,
    chain,
    differences,
    held_tool,
    held_tool_value,
    sphere,
    torus,
)

METHODS = {"projection": ProjectionAdherence, "atlas": AtlasAdherence, "tangent bundle": TangentBundleAdherence}
CHARTED = ("atlas", "tangent bundle")
SHARP = 1e-9  # a tolerance so narrow that all ways to solve an equation end at the same place
MARGIN = 0.005  # half of the default resolution, as architecture.md demands


def make(method: str, constraint: Constraint, validity: Validity, **settings) -> Adherence:
    """The adherence method of a name with its default parameters but for `settings`."""
    parameters = AdherenceParameters if method == "projection" else AtlasParameters
    return METHODS[method](constraint, validity, parameters(**settings))


def sphere_space(method: str, obstacles=(), upper=(1.5, 1.5, 1.5), margin: float = MARGIN, **settings) -> Adherence:
    """The unit sphere with its default tolerance."""
    return make(method, sphere(), Validity(ball(upper=upper), list(obstacles), margin), **settings)


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
    """Points of the torus (count, 3)."""
    a, b = rng.uniform(-np.pi, np.pi, (2, count))
    return np.stack([(0.8 + 0.4 * np.cos(b)) * np.cos(a), (0.8 + 0.4 * np.cos(b)) * np.sin(a), 0.4 * np.sin(b)], axis=1)


def point_world(
    name: str, obstacles: list[Obstacle], tolerance: float = SHARP, high: float = 1.5
) -> tuple[Constraint, Validity, World]:
    """A manifold of the point robot among obstacles, bounded above in z: for the library, and for the literal walk."""
    robot = ball(upper=(1.5, 1.5, high))
    make_constraint, value, jacobian = {
        "sphere": (sphere, sphere_value, sphere_jacobian),
        "torus": (torus, torus_value, torus_jacobian),
    }[name]

    def free(q: np.ndarray) -> bool:
        return bool(ball_clearance(obstacles, q)[0] >= MARGIN)

    world = World(value, jacobian, free, robot.lower, robot.upper, tolerance)
    return make_constraint(tolerance=tolerance), Validity(robot, obstacles, MARGIN), world


def arm_world(rows: int, tolerance: float = SHARP) -> tuple[Constraint, Validity, World, np.ndarray]:
    """A random arm of 13 joints that holds its tool (see `held_tool`); also a configuration that does."""
    rng = np.random.default_rng(11)
    robot: Robot = chain(rng, rng.choice(["RX", "RY", "RZ", "revolute unaligned"], 13).tolist())
    q0 = rng.uniform(-1, 1, 13)

    def value(q: np.ndarray) -> np.ndarray:
        return held_tool_value(robot, q0, rows, q)

    world = World(value, lambda q: differences(value, q), lambda q: True, robot.lower, robot.upper, tolerance)
    return held_tool(robot, q0, rows, tolerance=tolerance), Validity(robot, []), world, q0


def blocks(rng: np.random.Generator, points: np.ndarray) -> list[Obstacle]:
    """A box of random extents around each of `points`."""
    return [block(p, rng.uniform(0.1, 0.3, 3)) for p in points]
