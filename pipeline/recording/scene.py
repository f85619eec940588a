"""What is drawn: obstacles, start, goal, path and manifold in the world, bodies in the frames that carry them."""

from collections.abc import Mapping, Sequence

import coal
import pinocchio as pin
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from google.protobuf.duration_pb2 import Duration

from pipeline.recording.content import WORLD, Recording, carrier, moving_frames
from pipeline.recording.messages import placed, pose, stamp, vector
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
    """Return the scene, which is sent once: viewers move the bodies with their frames.

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
    robot, frames = recording.robot, moving_frames(recording.robot)
    entities += [_body(robot, body, frames) for body in robot.geometry.geometryObjects]
    if recording.manifold_sphere_radius is not None:
        entities.append(_ball("manifold", pose((0, 0, 0)), 2 * recording.manifold_sphere_radius, SKY))
    return SceneUpdate(entities=entities)


def _obstacle(name: str, obstacle: Obstacle) -> SceneEntity:
    there, size = pose(obstacle.position, obstacle.quaternion), vector(obstacle.size)
    if obstacle.shape is Shape.BOX:
        return _entity(name, cubes=[CubePrimitive(pose=there, size=size, color=GREY)])
    if obstacle.shape is Shape.SPHERE:
        return _entity(name, spheres=[SpherePrimitive(pose=there, size=size, color=GREY)])
    if obstacle.shape in (Shape.MESH, Shape.OCTREE):
        return _entity(name, triangles=[_triangles(obstacle.geometry(), there, GREY)])
    # Both scales are 0 in an empty message, which would draw nothing.
    cylinder = CylinderPrimitive(pose=there, size=size, bottom_scale=1.0, top_scale=1.0, color=GREY)
    return _entity(name, cylinders=[cylinder])


def _body(robot: Robot, body: pin.GeometryObject, frames: Mapping[str, pin.Frame]) -> SceneEntity:
    """A body of the robot in the frame that carries it."""
    name, T = carrier(body, robot, frames)
    return _entity(f"{BODY_PREFIX}{body.name}", triangles=[_triangles(body.geometry, placed(T), LIGHT)], frame=name)


def _triangles(geometry: coal.CollisionGeometry, there: Pose, color: Color) -> TriangleListPrimitive:
    vertices, faces = triangles(geometry)
    points = [Point3(x=x, y=y, z=z) for x, y, z in vertices.tolist()]
    return TriangleListPrimitive(pose=there, points=points, color=color, indices=faces.ravel().tolist())


def _ball(name: str, there: Pose, diameter: float, color: Color) -> SceneEntity:
    ball = SpherePrimitive(pose=there, size=vector((diameter, diameter, diameter)), color=color)
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
        frame_locked=True,  # else it stays where its frame was at the timestamp, and the robot stands still
        cubes=cubes,
        spheres=spheres,
        cylinders=cylinders,
        lines=lines,
        triangles=triangles,
        metadata=metadata,
    )
