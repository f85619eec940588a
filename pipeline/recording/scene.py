"""What stands still: obstacles, start, goal, path and manifold as primitives, and obstacles once more as points."""

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from google.protobuf.duration_pb2 import Duration

from pipeline.recording.content import WORLD, Recording, frame_ids
from pipeline.recording.messages import pose, stamp, vector
from pipeline.robots import Obstacle, Robot, Shape
from pipeline.robots.surfaces import triangles

OBSTACLE_PREFIX, BODY_PREFIX = "obstacle/", "body/"
MARKER = 0.04  # diameter of the start and goal balls [m]: seen beside an arm, smaller than any obstacle of ours
LINE_WIDTH = 3.0  # [px]
# Okabe and Ito's palette, told apart by colour-blind readers too.
GREY, LIGHT, GREEN, RED, BLUE, SKY = (
    Color(r=0.6, g=0.6, b=0.6, a=1.0),
    Color(r=0.85, g=0.85, b=0.82, a=1.0),
    Color(r=0.0, g=0.62, b=0.45, a=1.0),
    Color(r=0.84, g=0.37, b=0.0, a=1.0),
    Color(r=0.0, g=0.45, b=0.7, a=1.0),
    Color(r=0.34, g=0.71, b=0.91, a=0.25),
)


def scene_update(recording: Recording, start: Pose, goal: Pose, path: Sequence[Pose]) -> SceneUpdate:
    """Return the still scene in the world.

    Args:
        recording: holds the obstacles and the manifold; its counters and metadata become the path's properties.
        start: pose of the tool there.
        goal: pose of the tool there.
        path: poses of the tool.
    """
    entities = [_obstacle(f"{OBSTACLE_PREFIX}{k:04d}", obstacle) for k, obstacle in enumerate(recording.obstacles)]
    entities.append(_ball("start", start, MARKER, GREEN))
    entities.append(_ball("goal", goal, MARKER, RED))
    points = [Point3(x=p.position.x, y=p.position.y, z=p.position.z) for p in path]
    line = LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=pose((0, 0, 0)),
        thickness=LINE_WIDTH,
        scale_invariant=True,
        points=points,
        color=BLUE,
    )
    facts = sorted({**recording.metadata, **recording.counters}.items())  # a viewer shows them on a click on the path
    properties = [KeyValuePair(key=key, value=str(value)) for key, value in facts]
    entities.append(_entity("path", lines=[line], metadata=properties))
    bodies = [_body(recording.robot, body) for body in recording.robot.geometry.geometryObjects]
    entities += [body for body in bodies if body is not None]
    if recording.manifold_sphere_radius is not None:
        entities.append(_ball("manifold", pose((0, 0, 0)), 2 * recording.manifold_sphere_radius, SKY))
    return SceneUpdate(entities=entities)


def obstacle_cloud(obstacles: Sequence[Obstacle]) -> PointCloud:
    """Return points on the obstacles' surfaces in the world, packed float32 (x, y, z) [m]; empty without obstacles."""
    points = np.concatenate([np.empty((0, 3)), *(surface_points(obstacle) for obstacle in obstacles)])  # (P, 3)
    return PointCloud(
        timestamp=stamp(0),
        frame_id=WORLD,
        pose=pose((0, 0, 0)),
        point_stride=12,
        fields=[
            PackedElementField(name=name, offset=4 * k, type=PackedElementField.FLOAT32) for k, name in enumerate("xyz")
        ],
        data=points.astype("<f4").tobytes(),
    )


def surface_points(obstacle: Obstacle) -> np.ndarray:
    """Return evenly spread points (P, 3) on the surface in the world [m], the same at every call."""
    if obstacle.shape in _UNIT_SURFACE:
        local = _UNIT_SURFACE[obstacle.shape] * obstacle.size  # (P, 3)
    else:
        local = triangles(obstacle.geometry())[0]
    return local @ obstacle.rotation.T + obstacle.position


def _obstacle(name: str, obstacle: Obstacle) -> SceneEntity:
    placed, size = pose(obstacle.position, obstacle.quaternion), vector(obstacle.size)
    if obstacle.shape is Shape.BOX:
        return _entity(name, cubes=[CubePrimitive(pose=placed, size=size, color=GREY)])
    if obstacle.shape is Shape.SPHERE:
        return _entity(name, spheres=[SpherePrimitive(pose=placed, size=size, color=GREY)])
    if obstacle.shape in (Shape.MESH, Shape.OCTREE):
        return _entity(name, triangles=[_triangles(obstacle.geometry(), placed, GREY)])
    # Both scales are 0 in an empty message, which would draw nothing.
    cylinder = CylinderPrimitive(pose=placed, size=size, bottom_scale=1.0, top_scale=1.0, color=GREY)
    return _entity(name, cylinders=[cylinder])


def _body(robot: Robot, body: pin.GeometryObject) -> SceneEntity | None:
    """A body of the robot, fixed in a frame that moves with it, as viewers want it; None where no frame does."""
    name, placement = WORLD, body.placement
    if body.parentJoint:
        frames = robot.model.frames
        fixed = [i for i in frame_ids(robot).values() if frames[i].parentJoint == body.parentJoint]
        if not fixed:
            return None
        frame = frames[body.parentFrame if body.parentFrame in fixed else fixed[0]]
        name, placement = frame.name, frame.placement.actInv(body.placement)
    placed = pose(placement.translation, pin.Quaternion(placement.rotation).coeffs())
    return _entity(f"{BODY_PREFIX}{body.name}", triangles=[_triangles(body.geometry, placed, LIGHT)], frame=name)


def _triangles(geometry: coal.CollisionGeometry, placed: Pose, color: Color) -> TriangleListPrimitive:
    vertices, faces = triangles(geometry)
    points = [Point3(x=x, y=y, z=z) for x, y, z in vertices.tolist()]
    return TriangleListPrimitive(pose=placed, points=points, color=color, indices=faces.ravel().tolist())


def _ball(name: str, placed: Pose, diameter: float, color: Color) -> SceneEntity:
    ball = SpherePrimitive(pose=placed, size=vector((diameter, diameter, diameter)), color=color)
    return _entity(name, spheres=[ball])


def _entity(
    name: str,
    cubes: Sequence[CubePrimitive] = (),
    spheres: Sequence[SpherePrimitive] = (),
    cylinders: Sequence[CylinderPrimitive] = (),
    lines: Sequence[LinePrimitive] = (),
    triangles: Sequence[TriangleListPrimitive] = (),
    frame: str = WORLD,
    metadata: Sequence[KeyValuePair] = (),
) -> SceneEntity:
    return SceneEntity(
        timestamp=stamp(0),
        frame_id=frame,
        id=name,
        lifetime=Duration(),  # 0: until replaced
        cubes=cubes,
        spheres=spheres,
        cylinders=cylinders,
        lines=lines,
        triangles=triangles,
        metadata=metadata,
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
