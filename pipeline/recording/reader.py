"""Reads back what `write_recording` wrote, and refuses everything else by name."""

import io
import json
import struct
import zlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.records import Attachment, Channel, DataEnd, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from pipeline.errors import ArtifactError
from pipeline.files import VERSION
from pipeline.recording.content import JSON
from pipeline.recording.messages import Topic
from pipeline.recording.scene import OBSTACLE_PREFIX
from pipeline.recording.writer import COUNTERS, METADATA, SCHEMA, VERSIONS


@dataclass(frozen=True)
class StoredRecording:
    """What a recording gives back.

    Attributes:
        robot: its name.
        tool: frame whose path is drawn.
        joint_names: in configuration order.
        states: path (T, n) [rad or m], bit for bit as written.
        velocities: with which it leaves its states (T, n) [rad/s or m/s], see `velocities` of the messages.
        times: of the states (T,) [s], rounded to 1 ns.
        topics: topic -> number of messages.
        obstacle_count: obstacles in the scene.
        counters, metadata, versions, attachments: as written; JSON knows no tuples, they come back as lists,
            and no infinities, they come back as None.
        files: further attachments, byte for byte.
    """

    robot: str
    tool: str
    joint_names: tuple[str, ...]
    states: np.ndarray
    velocities: np.ndarray
    times: np.ndarray
    topics: dict[str, int]
    obstacle_count: int
    counters: dict[str, float | int | str | None]
    metadata: dict[str, str]
    versions: dict[str, str]
    attachments: dict[str, Any]
    files: dict[str, bytes]


def read_recording(path: Path) -> StoredRecording:
    """Read a recording.

    Raises:
        ArtifactError: the file is missing, truncated, damaged, or not one of `write_recording`.
    """
    path = Path(path)
    if not path.is_file():
        raise ArtifactError(f"{path} does not exist: run the stage that writes it (`make repro`, its PROFILE)")
    try:
        return _decode(path.read_bytes())
    except Exception as error:  # mcap, zstd, protobuf and struct raise a dozen kinds; all mean the same to a reader
        reason = str(error) or type(error).__name__
        raise ArtifactError(f"{path} is not a readable recording (truncated or foreign): {reason}") from error


def _decode(content: bytes) -> StoredRecording:
    # mcap itself reads past the end without complaint, so the closing magic is what tells a whole file from a part.
    if not (content.startswith(MCAP0_MAGIC) and content.endswith(MCAP0_MAGIC)):
        raise ArtifactError("it does not begin and end as MCAP does")
    # mcap checks the data, not the index behind it that viewers jump by. The file ends: start of the index (8 bytes),
    # its offsets (8), its checksum (4), magic (8).
    index_start, _, checksum = struct.unpack_from("<QQI", content, len(content) - 28)
    if zlib.crc32(content[index_start:-12]) != checksum:
        raise ArtifactError("its index is damaged")
    channels: dict[int, str] = {}
    messages: list[tuple[str, Message]] = []
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, Any] = {}
    files: dict[str, bytes] = {}
    ended = False
    for record in StreamReader(io.BytesIO(content), validate_crcs=True).records:
        if isinstance(record, Channel):
            channels[record.id] = record.topic
        elif isinstance(record, Message):
            messages.append((channels[record.channel_id], record))
        elif isinstance(record, Metadata):
            metadata[record.name] = record.metadata
            if record.name == SCHEMA:
                _check(record.metadata)
        elif isinstance(record, Attachment) and record.name.endswith(JSON):
            attachments[record.name.removesuffix(JSON)] = json.loads(record.data)
        elif isinstance(record, Attachment):
            files[record.name] = record.data
        ended = ended or isinstance(record, DataEnd)
    if not ended:
        raise ArtifactError("its data section has no end, hence no checksum")
    head = metadata.get(SCHEMA, {})
    _check(head)
    joints = [
        (m.log_time, JointStates.FromString(m.data).joints) for topic, m in messages if topic == Topic.JOINT_STATES
    ]
    scenes = [SceneUpdate.FromString(m.data) for topic, m in messages if topic == Topic.SCENE]
    return StoredRecording(
        robot=head["robot"],
        tool=head["tool"],
        joint_names=tuple(joint.name for joint in joints[0][1]),
        states=np.array([[joint.position for joint in row] for _, row in joints], float),
        velocities=np.array([[joint.velocity for joint in row] for _, row in joints], float),
        times=np.array([clock for clock, _ in joints], float) / 1e9,
        topics=dict(Counter(topic for topic, _ in messages)),
        obstacle_count=sum(entity.id.startswith(OBSTACLE_PREFIX) for scene in scenes for entity in scene.entities),
        counters={key: json.loads(value) for key, value in metadata[COUNTERS].items()},
        metadata=metadata[METADATA],
        versions=metadata[VERSIONS],
        attachments=attachments,
        files=files,
    )


def _check(head: dict[str, str]) -> None:
    schema, version = head.get("schema", "none"), head.get("version", "none")
    if (schema, version) != (SCHEMA, str(VERSION)):
        raise ArtifactError(f"it holds schema {schema!r} version {version}, expected {SCHEMA!r} version {VERSION}")
