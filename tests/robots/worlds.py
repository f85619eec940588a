"""Small worlds known in closed form: what the tests of robots, constraints, manifolds and planners compare with."""

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pinocchio as pin

from pipeline.constraints import Constraint, sphere_constraint
from pipeline.robots import PRIMITIVES, Obstacle, Robot, Shape, point_robot

RADIUS = 0.002  # of the point robot [m]


def rotation(quaternion: Sequence[float]) -> np.ndarray:
    """Rotation matrix of a quaternion (x, y, z, w) of any length, written out."""
    x, y, z, w = np.asarray(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def signed_distance(obstacle: Obstacle, points: np.ndarray) -> np.ndarray:
    """Distance of points (N, 3) to the surface of an obstacle (N,), negative inside."""
    local = (np.atleast_2d(points) - obstacle.position) @ rotation(obstacle.quaternion)
    half = np.asarray(obstacle.size) / 2
    if obstacle.shape is Shape.SPHERE:
        return np.linalg.norm(local, axis=1) - half[0]
    if obstacle.shape is Shape.CYLINDER:
        beyond = np.stack([np.hypot(local[:, 0], local[:, 1]) - half[0], np.abs(local[:, 2]) - half[2]], axis=1)
    else:
        beyond = np.abs(local) - half
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def ball_clearance(obstacles: Sequence[Obstacle], points: np.ndarray, radius: float = RADIUS) -> np.ndarray:
    """Distance of balls at points (N, 3) to the nearest obstacle (N,); inf without any."""
    points = np.atleast_2d(points)
    distances = [signed_distance(obstacle, points) for obstacle in obstacles]
    return np.min(distances, axis=0) - radius if distances else np.full(len(points), np.inf)


def random_obstacles(rng: np.random.Generator, count: int, size: tuple[float, float] = (0.05, 0.4)) -> list[Obstacle]:
    """Obstacles of all shapes, anywhere in a cube of side 2, turned anyhow."""
    found = []
    for i in range(count):
        shape = PRIMITIVES[i % len(PRIMITIVES)]
        a, b, c = rng.uniform(*size, 3)
        extent = {Shape.BOX: (a, b, c), Shape.SPHERE: (a, a, a), Shape.CYLINDER: (a, a, c)}[shape]
        found.append(Obstacle(shape, tuple(rng.uniform(-1, 1, 3)), tuple(rng.normal(size=4)), extent))
    return found


def plate(centre: Sequence[float], normal: Sequence[float], size: Sequence[float]) -> Obstacle:
    """A box of extents `size` around `centre` whose z axis is along `normal`."""
    z = np.asarray(normal, float) / np.linalg.norm(normal)
    # The shortest turn of (0, 0, 1) to z; any turn serves where they are opposite.
    quaternion = (-z[1], z[0], 0.0, 1 + z[2]) if z[2] > -1 + 1e-9 else (1.0, 0.0, 0.0, 0.0)
    position, quaternion = (tuple(float(v) for v in values) for values in (centre, quaternion))
    return Obstacle(Shape.BOX, position, quaternion, tuple(size))


def block(point: Sequence[float], size: Sequence[float]) -> Obstacle:
    """A box of extents `size` around `point`, its z axis away from the origin."""
    return plate(point, point, size)


def fibonacci(count: int) -> np.ndarray:
    """Points spread evenly over the unit sphere (count, 3)."""
    i = np.arange(count) + 0.5
    z, angle = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)


def on_sphere(rng: np.random.Generator, count: int) -> np.ndarray:
    """Uniform samples of the unit sphere (count, 3)."""
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def ball(lower: Sequence[float] = (-1.5, -1.5, -1.5), upper: Sequence[float] = (1.5, 1.5, 1.5)) -> Robot:
    """The point robot of the sphere environment."""
    return point_robot(RADIUS, lower, upper)


def sphere(**settings: float) -> Constraint:
    """The unit sphere for the point robot."""
    return sphere_constraint(ball(), "point", **settings)


def torus(major: float = 0.8, minor: float = 0.4, **settings: float) -> Constraint:
    """A torus around z for the point robot: distance to a circle of radius `major` minus `minor`."""
    q = ca.SX.sym("q", 3)
    ring = ca.sqrt(q[0] ** 2 + q[1] ** 2) - major
    return Constraint("torus", q, ca.sqrt(ring**2 + q[2] ** 2) - minor, **settings)


def unit(rng: np.random.Generator) -> np.ndarray:
    """A random direction (3,)."""
    return on_sphere(rng, 1)[0]


def placement(rng: np.random.Generator, reach: float = 0.3) -> pin.SE3:
    """A random pose with a translation of at most `reach` per axis [m]."""
    return pin.SE3(rotation(rng.normal(size=4)), rng.uniform(-reach, reach, 3))


JOINTS = {
    "RX": lambda rng: pin.JointModelRX(),
    "RY": lambda rng: pin.JointModelRY(),
    "RZ": lambda rng: pin.JointModelRZ(),
    "revolute unaligned": lambda rng: pin.JointModelRevoluteUnaligned(unit(rng)),
    "PX": lambda rng: pin.JointModelPX(),
    "PY": lambda rng: pin.JointModelPY(),
    "PZ": lambda rng: pin.JointModelPZ(),
    "prismatic unaligned": lambda rng: pin.JointModelPrismaticUnaligned(unit(rng)),
}


def chain(rng: np.random.Generator, kinds: Sequence[str], balls: float = 0.0) -> Robot:
    """A serial chain of joints of `kinds` with random placements, a frame "tool", and a ball at every joint's frame.

    Args:
        rng: of placements and axes.
        kinds: keys of `JOINTS`.
        balls: their radius [m]; none for 0.
    """
    model, geometry, joint = pin.Model(), pin.GeometryModel(), 0
    for i, kind in enumerate(kinds):
        joint = model.addJoint(joint, JOINTS[kind](rng), placement(rng), f"joint{i}")
        if balls:
            shape = pin.hppfcl.Sphere(balls)
            geometry.addGeometryObject(pin.GeometryObject(f"ball{i}", joint, pin.SE3.Identity(), shape))
    model.addFrame(pin.Frame("tool", joint, 0, placement(rng), pin.FrameType.OP_FRAME))
    bound = np.full(len(kinds), np.pi)
    return Robot("chain", model, geometry, -bound, bound)


def pose_of(robot: Robot, q: np.ndarray, frame: str = "tool") -> pin.SE3:
    """Pose of a frame in the world, by pinocchio."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(frame)].copy()


def held_tool(robot: Robot, q0: np.ndarray, rows: int, **settings: float) -> Constraint:
    """The tool stays at its position at q0 (rows = 3), and in its orientation too (rows = 6)."""
    q, held = ca.SX.sym("q", robot.dimension), pose_of(robot, q0)
    R, p = robot.symbolic_pose(q, "tool")
    D = held.rotation.T @ R
    turn = ca.vertcat(D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]) / 2
    return Constraint("held tool", q, ca.vertcat(p - held.translation, turn)[:rows], **settings)


def held_tool_value(robot: Robot, q0: np.ndarray, rows: int, q: np.ndarray) -> np.ndarray:
    """The value of `held_tool` by pinocchio (rows,)."""
    held, pose = pose_of(robot, q0), pose_of(robot, q)
    D = held.rotation.T @ pose.rotation
    turn = np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]) / 2
    return np.concatenate([pose.translation - held.translation, turn])[:rows]


def differences(function, q: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Jacobian (k, n) of `function` at q by central differences."""
    columns = [(function(q + step * e) - function(q - step * e)) / (2 * step) for e in np.eye(len(q))]
    return np.stack(columns, axis=1)
