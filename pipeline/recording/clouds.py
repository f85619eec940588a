"""Obstacles and bodies of the robot as points on their surfaces, for viewers that draw no scenes (Rerun)."""

from collections.abc import Sequence

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from pipeline.recording.content import WORLD, carrier, moving_frames
from pipeline.recording.messages import pose, stamp
from pipeline.robots import Obstacle, Robot, Shape
from pipeline.robots.surfaces import triangles

POINTS = 300  # on a body or mesh: its shape is seen, and a robot of sixty bodies stays below a quarter of a megabyte
_TURNS = (
    0.7548776662466927,
    0.5698402909980532,
)  # 1/p and 1/p^2 of the plastic number p: points spread evenly in a square


def obstacle_cloud(obstacles: Sequence[Obstacle]) -> PointCloud:
    """Return points on the obstacles' surfaces in the world; empty without obstacles."""
    return _cloud(np.concatenate([np.empty((0, 3)), *(surface_points(obstacle) for obstacle in obstacles)]), WORLD)


def body_clouds(robot: Robot) -> dict[str, PointCloud]:
    """Return body name -> points on its surface in the frame that carries it: they move as that frame does."""
    frames, found = moving_frames(robot), {}
    for body in robot.geometry.geometryObjects:
        name, T = carrier(body, robot, frames)
        local = spread(*triangles(body.geometry), POINTS)
        found[body.name] = _cloud(local @ T.rotation.T + T.translation, name)
    return found


def surface_points(obstacle: Obstacle) -> np.ndarray:
    """Return evenly spread points (P, 3) on the surface in the world [m], the same at every call."""
    if obstacle.shape in _UNIT_SURFACE:
        local = _UNIT_SURFACE[obstacle.shape] * obstacle.size  # (P, 3)
    elif obstacle.shape is Shape.MESH:
        local = spread(*triangles(obstacle.geometry()), POINTS)
    else:
        local = triangles(obstacle.geometry())[0]
    return local @ obstacle.rotation.T + obstacle.position


def spread(vertices: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """Return points (count, 3) spread evenly by area over triangles, the same at every call; none without any area.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3), indices into them.
        count: of points.
    """
    a, b, c = (vertices[faces[:, i]] for i in range(3))  # (F, 3) each
    until = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))  # (F,) twice the area up to each triangle
    if not len(until) or not until[-1] > 0:
        return np.empty((0, 3))
    k = np.arange(count)
    face = np.searchsorted(until, (k + 0.5) / count * until[-1])  # (count,)
    s, t = ((0.5 + k * turn) % 1 for turn in _TURNS)
    outside = s + t > 1  # of the triangle: the square's other half is folded onto it
    s, t = (np.where(outside, 1 - x, x)[:, None] for x in (s, t))  # (count, 1) each
    return a[face] + s * (b - a)[face] + t * (c - a)[face]


def _cloud(points: np.ndarray, frame: str) -> PointCloud:
    """Points (P, 3) [m] in a frame, packed as float32 x, y, z."""
    return PointCloud(
        timestamp=stamp(0),
        frame_id=frame,
        pose=pose((0, 0, 0)),
        point_stride=12,
        fields=[
            PackedElementField(name=name, offset=4 * k, type=PackedElementField.FLOAT32) for k, name in enumerate("xyz")
        ],
        data=points.astype("<f4").tobytes(),
    )


def _box() -> np.ndarray:
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.abs(grid).max(axis=1) == 0.5]  # (56, 3)


def _sphere(count: int = 64) -> np.ndarray:
    """Fibonacci's lattice."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    turn, r = np.pi * (3 - np.sqrt(5)) * k, np.sqrt(1 - z**2)
    return 0.5 * np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)  # (count, 3)


def _cylinder() -> np.ndarray:
    turn, z = np.meshgrid(np.linspace(0, 2 * np.pi, 16, endpoint=False), np.linspace(-0.5, 0.5, 4), indexing="ij")
    return np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), z], axis=-1).reshape(-1, 3)  # (64, 3)


# Of shapes of size (1, 1, 1) about the origin. Some sixty points each keep a scene of 500 blocks below half a megabyte.
_UNIT_SURFACE = {Shape.BOX: _box(), Shape.SPHERE: _sphere(), Shape.CYLINDER: _cylinder()}
