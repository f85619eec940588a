"""Messages along the path: frames, joints, the tool's way and the progress, all from pinocchio's kinematics."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Any

import numpy as np
import pinocchio as pin
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import Timestamp

from pipeline.recording.content import WORLD, Recording, moving_frames
from pipeline.robots import Robot


class Topic(StrEnum):
    """The topics of every recording; all are there even when a scene is empty. See `ROBOT_POINTS` for further ones."""

    TF = "/tf"
    SCENE = "/scene"
    PATH = "/path"
    OBSTACLE_POINTS = "/obstacle_points"
    JOINT_STATES = "/joint_states"
    COUNTERS = "/counters"
    LOG = "/log"


ROBOT_POINTS = "/robot_points/"  # begins the topic of each body of the robot, whose name follows


def stamp(clock: int) -> Timestamp:
    """Return a trajectory time [ns] as a protobuf timestamp."""
    return Timestamp(seconds=clock // 10**9, nanos=clock % 10**9)


def vector(xyz: Sequence[float] | np.ndarray) -> Vector3:
    """Return (3,) as a message."""
    x, y, z = (float(value) for value in xyz)
    return Vector3(x=x, y=y, z=z)


def pose(position: Sequence[float] | np.ndarray, quaternion: Sequence[float] | np.ndarray = (0, 0, 0, 1)) -> Pose:
    """Return a pose from a position (3,) [m] and a quaternion (x, y, z, w) of any length above 0."""
    x, y, z, w = (np.asarray(quaternion, float) / np.linalg.norm(quaternion)).tolist()
    return Pose(position=vector(position), orientation=Quaternion(x=x, y=y, z=z, w=w))


def placed(T: pin.SE3) -> Pose:
    """Return a pose of pinocchio's as a message."""
    return pose(T.translation, pin.Quaternion(T.rotation).coeffs())


class Kinematics:
    """Poses of all frames of a robot in the world."""

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self._data = robot.model.createData()
        self._frames = moving_frames(robot)

    def poses(self, q: np.ndarray) -> dict[str, Pose]:
        """Return frame name -> pose in the world at the configuration q (n,)."""
        pin.forwardKinematics(self._model, self._data, np.asarray(q, float))
        return {name: placed(self._data.oMi[f.parentJoint] * f.placement) for name, f in self._frames.items()}


def transforms(poses: dict[str, Pose], clock: int) -> FrameTransforms:
    """Return the frames at one time [ns], each a child of the world: no chain to follow, none to break."""
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=stamp(clock),
                parent_frame_id=WORLD,
                child_frame_id=name,
                translation=placed.position,
                rotation=placed.orientation,
            )
            for name, placed in poses.items()
        ]
    )


def velocities(states: np.ndarray, clock: Sequence[int]) -> np.ndarray:
    """Return the joint velocities (T, n) [rad/s or m/s] with which a path leaves its states, 0 at the last.

    A path is straight between its states (T, n) and passes each piece at constant speed: the velocity there is the
    difference of its ends over that of their times (T,) [ns].
    """
    leaving = np.diff(states, axis=0) / (np.diff(clock) / 1e9)[:, None]  # (T - 1, n)
    return np.concatenate([leaving, np.zeros((1, states.shape[1]))])


def joint_states(robot: Robot, q: np.ndarray, velocity: np.ndarray, clock: int) -> JointStates:
    """Return joint positions q (n,) [rad or m] and velocities (n,) [rad/s or m/s] at one time [ns]."""
    joints = [
        JointState(name=name, position=float(value), velocity=float(speed))
        for name, value, speed in zip(robot.joint_names, q, velocity, strict=True)
    ]
    return JointStates(timestamp=stamp(clock), joints=joints)


def tool_path(poses: Sequence[Pose]) -> PosesInFrame:
    """Return the tool's whole way in the world, sent once so that it is visible from the first moment."""
    return PosesInFrame(timestamp=stamp(0), frame_id=WORLD, poses=poses)


def summary(recording: Recording) -> Log:
    """Return metadata and counters as text, one `name: value` per line in alphabetical order."""
    parts = (recording.metadata, recording.counters)
    lines = [f"{key}: {value}" for part in parts for key, value in sorted(part.items())]
    return Log(timestamp=stamp(0), level=Log.INFO, name=recording.robot.name, message="\n".join(lines))


def _progress_class() -> Any:
    file = FileDescriptorProto(name="pipeline/PathProgress.proto", package="pipeline", syntax="proto3")
    message = file.message_type.add(name="PathProgress")
    for number, name in enumerate(("path_length", "step_length"), start=1):
        message.field.add(
            name=name,
            number=number,
            type=FieldDescriptorProto.TYPE_DOUBLE,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
        )
    pool = DescriptorPool()
    return GetMessageClass(pool.AddSerializedFile(file.SerializeToString()).message_types_by_name["PathProgress"])


# Protobuf rather than JSON, because Rerun plots unknown protobuf fields and does not decode JSON at all; two numbers
# per waypoint rather than the final counters, because a constant is no curve (those stand in /log and the metadata).
PathProgress = _progress_class()
