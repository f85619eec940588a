"""Writes a recording as MCAP: the same recording gives the same bytes, on any day and in any process.

Every time in the file is the trajectory's own, from 0; the wall clock, the library's version string and the order of
dictionaries stay outside. Messages are protobuf with Foxglove's schemas, so that Foxglove, Lichtblick and Rerun show
them without a plug-in.
"""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from pipeline.atomic import atomic_file
from pipeline.files import VERSION, finite
from pipeline.recording.clouds import body_clouds, obstacle_cloud
from pipeline.recording.content import JSON, Recording, attachment_text, nanoseconds
from pipeline.recording.messages import (
    ROBOT_POINTS,
    Kinematics,
    PathProgress,
    Topic,
    joint_states,
    summary,
    tool_path,
    transforms,
    velocities,
)
from pipeline.recording.scene import scene_update

SCHEMA = "recording"
LIBRARY = "constrained planning recorder"  # fixed: the default names the installed version
METADATA, COUNTERS, VERSIONS = "planning", "counters", "versions"  # MCAP metadata records beside the one of SCHEMA
_MEDIA = {".yaml": "application/yaml", ".urdf": "application/xml", ".srdf": "application/xml"}


def write_recording(path: Path, recording: Recording) -> None:
    """Write the recording whole or not at all; see `Topic` and `ROBOT_POINTS` for what is in it.

    Raises:
        ProblemError: the recording is malformed (see `Recording.check`); no file is touched.
        RobotError: the robot has no such tool frame, or bodies that share a name; no file is touched.
    """
    recording.check()
    content = _encode(recording)
    with atomic_file(path) as temporary:
        temporary.write_bytes(content)


def _encode(recording: Recording) -> bytes:
    stream = io.BytesIO()
    # The checksum over the data section lets the reader notice any changed byte, not only a missing one.
    writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(library=LIBRARY)
    head = {"schema": SCHEMA, "version": str(VERSION), "robot": recording.robot.name, "tool": recording.tool}
    writer.add_metadata(SCHEMA, head)
    writer.add_metadata(METADATA, dict(sorted(recording.metadata.items())))
    writer.add_metadata(COUNTERS, {key: _json(value) for key, value in sorted(recording.counters.items())})
    writer.add_metadata(VERSIONS, dict(sorted(recording.versions.items())))
    for name, attached in sorted(recording.attachments.items()):
        writer.add_attachment(0, 0, name + JSON, "application/json", attachment_text(name, attached).encode())
    for name, content in sorted(recording.files.items()):
        media = _MEDIA.get(Path(name).suffix, "application/octet-stream")
        writer.add_attachment(0, 0, name, media, content)
    _write_messages(_Channels(writer), recording)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it without annotations
    return stream.getvalue()


def _write_messages(channels: "_Channels", recording: Recording) -> None:
    robot, tool = recording.robot, recording.tool
    states = np.asarray(recording.states, float)
    clock = nanoseconds(recording.times)
    kinematics = Kinematics(robot)
    poses = [kinematics.poses(q) for q in states]
    way = [frames[tool] for frames in poses]
    start, goal = kinematics.poses(recording.start)[tool], kinematics.poses(recording.goal)[tool]
    channels.write(Topic.SCENE, scene_update(recording, start, goal, way), 0)
    channels.write(Topic.OBSTACLE_POINTS, obstacle_cloud(recording.obstacles), 0)
    for name, cloud in body_clouds(robot).items():
        channels.write(f"{ROBOT_POINTS}{name}", cloud, 0)
    channels.write(Topic.PATH, tool_path(way), 0)
    channels.write(Topic.LOG, summary(recording), 0)
    steps = np.concatenate([[0.0], np.linalg.norm(np.diff(states, axis=0), axis=1)])  # (T,)
    lengths, speeds = np.cumsum(steps), velocities(states, clock)  # (T,) (T, n)
    for k, now in enumerate(clock):
        channels.write(Topic.TF, transforms(poses[k], now), now)
        channels.write(Topic.JOINT_STATES, joint_states(robot, states[k], speeds[k], now), now)
        progress = PathProgress(path_length=float(lengths[k]), step_length=float(steps[k]))
        channels.write(Topic.COUNTERS, progress, now)


class _Channels:
    """Opens a channel at the first message of a topic, with one schema for all topics of a kind."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._ids: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def write(self, topic: str, message: Any, clock: int) -> None:
        """Write one protobuf message at a trajectory time [ns]."""
        if topic not in self._ids:
            schema = self._schema(type(message))
            self._ids[topic] = self._writer.register_channel(str(topic), MessageEncoding.Protobuf, schema)
        data = message.SerializeToString(deterministic=True)
        self._writer.add_message(self._ids[topic], log_time=clock, publish_time=clock, data=data)

    def _schema(self, kind: Any) -> int:
        name = kind.DESCRIPTOR.full_name
        if name not in self._schemas:
            content = build_file_descriptor_set(kind).SerializeToString(deterministic=True)
            self._schemas[name] = self._writer.register_schema(name, SchemaEncoding.Protobuf, content)
        return self._schemas[name]


def _json(value: Any) -> str:
    """Text that gives the value back with its type; numpy's numbers become Python's, what is not finite null."""
    return json.dumps(finite(value.item() if isinstance(value, np.generic) else value), allow_nan=False)
