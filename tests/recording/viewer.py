"""What a viewer makes of a recording, read by mcap's reader and the schemas inside the file, with no code of ours."""

from bisect import bisect_right
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation


def nanoseconds(stamp: Any) -> int:
    return stamp.seconds * 10**9 + stamp.nanos


def xyz(message: Any) -> list[float]:
    return [message.x, message.y, message.z]


def matrix(position: Any, orientation: Any) -> np.ndarray:
    """A pose as a matrix (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([*xyz(orientation), orientation.w]).as_matrix()
    T[:3, 3] = xyz(position)
    return T


def walk(message: Any) -> Iterator[Any]:
    """A message and every message inside it."""
    yield message
    for field, value in message.ListFields():
        if field.message_type is not None:
            for part in [value] if hasattr(value, "ListFields") else value:
                yield from walk(part)


class Viewer:
    """A recording on its time axis; times are log times [ns].

    Attributes:
        messages: topic -> [(log time, publish time, message)], in the order of the file.
        entities: id -> entity, each the last that was sent.
        clouds: topic -> frame and points (P, 3).
    """

    def __init__(self, path: Path) -> None:
        self.messages: dict[str, list[tuple[int, int, Any]]] = {}
        with path.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for _, channel, message, content in reader.iter_decoded_messages(log_time_order=False):
                self.messages.setdefault(channel.topic, []).append((message.log_time, message.publish_time, content))
        self.entities = {e.id: e for _, _, scene in self.messages["/scene"] for e in scene.entities}
        self.clouds = {
            topic: (content.frame_id, np.frombuffer(content.data, "<f4").reshape(-1, 3).astype(float))
            for topic, rows in self.messages.items()
            for _, _, content in rows
            if content.DESCRIPTOR.full_name == "foxglove.PointCloud"
        }
        self._sent: dict[str, list[tuple[int, str, np.ndarray]]] = {}  # frame -> its poses in its parent over time
        for _, _, content in self.messages["/tf"]:
            for t in content.transforms:
                T = matrix(t.translation, t.rotation)
                self._sent.setdefault(t.child_frame_id, []).append((nanoseconds(t.timestamp), t.parent_frame_id, T))

    @property
    def clock(self) -> list[int]:
        """Times at which the frames move."""
        return [time for time, _, _ in self.messages["/tf"]]

    @property
    def children(self) -> set[str]:
        """Frames that have a parent."""
        return set(self._sent)

    @property
    def root(self) -> str:
        """The one frame that has children and no parent."""
        (root,) = {parent for rows in self._sent.values() for _, parent, _ in rows} - self.children
        return root

    def in_root(self, frame: str, time: int) -> np.ndarray:
        """Pose of a frame in the root (4, 4): the last one that was sent by then, up to the root."""
        T, seen = np.eye(4), set()
        while frame != self.root:
            assert frame in self.children and frame not in seen
            seen.add(frame)
            rows = self._sent[frame]
            _, frame, step = rows[bisect_right(rows, time, key=lambda row: row[0]) - 1]
            T = step @ T
        return T

    def shown(self, entity: Any, time: int) -> np.ndarray:
        """Pose of the frame of an entity as it is drawn (4, 4): one that is not locked stays where its frame was."""
        return self.in_root(entity.frame_id, time if entity.frame_locked else nanoseconds(entity.timestamp))
