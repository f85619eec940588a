import io
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from pipeline.errors import ArtifactError
from pipeline.recording import Recording, read_recording, write_recording
from pipeline.recording.content import nanoseconds
from pipeline.robots import point_robot


def test_a_recording_comes_back_whole(recording, tmp_path):
    """States come back bit for bit, times to half a nanosecond, numbers with their types."""
    write_recording(tmp_path / "a.mcap", recording)
    stored = read_recording(tmp_path / "a.mcap")
    np.testing.assert_array_equal(stored.states, recording.states)
    np.testing.assert_allclose(stored.times, recording.times, rtol=0, atol=0.6e-9)
    assert nanoseconds(stored.times) == nanoseconds(recording.times)
    assert (stored.robot, stored.tool) == ("sample arm", "effector_body")
    assert stored.joint_names == recording.robot.joint_names
    assert stored.obstacle_count == 3
    assert stored.counters == recording.counters
    assert {key: type(value) for key, value in stored.counters.items()} == {
        key: type(value) for key, value in recording.counters.items()
    }
    assert stored.metadata == recording.metadata and stored.attachments == recording.attachments
    assert stored.versions == recording.versions and stored.files == recording.files
    assert stored.topics == {
        **dict.fromkeys(("/scene", "/path", "/obstacle_points", "/log"), 1),
        **dict.fromkeys(("/tf", "/joint_states", "/counters"), 12),
    }


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, np.float32("inf")])
def test_counters_are_json_by_the_letter(recording, tmp_path, value):
    """A counter that is not finite is null, as JSON has no word for it: other programs read what is written."""
    write_recording(tmp_path / "a.mcap", replace(recording, counters={"clearance": value, "length": 1 / 3}))
    with open(tmp_path / "a.mcap", "rb") as stream:
        (written,) = (r.metadata for r in make_reader(stream).iter_metadata() if r.name == "counters")
    assert written == {"clearance": "null", "length": repr(1 / 3)}
    assert read_recording(tmp_path / "a.mcap").counters == {"clearance": None, "length": 1 / 3}


def test_the_barest_recording_comes_back(tmp_path):
    """A point robot, one state, nothing around it: every topic is there, everything else is empty."""
    robot = point_robot(0.05, [-1] * 3, [1] * 3)
    q = np.array([[0, 0, 1]])
    write_recording(tmp_path / "a.mcap", Recording(robot, (), q, np.zeros(1), "point", q[0], q[0]))
    stored = read_recording(tmp_path / "a.mcap")
    np.testing.assert_array_equal(stored.states, q)
    assert len(stored.topics) == 8 and stored.obstacle_count == 0
    np.testing.assert_array_equal(stored.velocities, np.zeros((1, 3)))
    assert stored.counters == {} and stored.metadata == {} and stored.attachments == {}
    assert stored.versions == {} and stored.files == {}


def test_numbers_of_numpy_come_back_as_python_s(make, tmp_path):
    """Counters taken from a data frame are numpy scalars; they are written as the numbers they are."""
    write_recording(tmp_path / "a.mcap", make(counters={"n": np.int64(3), "t": np.float32(0.5), "ok": np.bool_(True)}))
    assert read_recording(tmp_path / "a.mcap").counters == {"n": 3, "t": 0.5, "ok": True}


def test_a_missing_file_is_named(tmp_path):
    """No file and a folder in its place are both refused with the path in the message."""
    for path in (tmp_path / "no.mcap", tmp_path):
        with pytest.raises(ArtifactError, match=path.name):
            read_recording(path)


def test_a_truncated_file_is_refused_wherever_it_ends(recording, tmp_path):
    """No cut gives a partial recording or another exception, even where the closing bytes are in place."""
    path = tmp_path / "a.mcap"
    write_recording(path, recording)
    content = path.read_bytes()
    for end in [*range(0, len(content) - 40, 97), *range(len(content) - 40, len(content))]:
        for part in (content[:end], content[: min(end, len(content) - 9)] + content[-8:]):
            path.write_bytes(part)
            with pytest.raises(ArtifactError, match="truncated or foreign"):
                read_recording(path)


def test_a_changed_byte_is_noticed(recording, tmp_path):
    """A flipped byte anywhere gives ArtifactError, in the messages as in the index that viewers jump by."""
    path = tmp_path / "a.mcap"
    write_recording(path, recording)
    content = path.read_bytes()
    for place in np.random.default_rng(3).integers(0, len(content), 150).tolist():
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        with pytest.raises(ArtifactError, match="truncated or foreign"):
            read_recording(path)


def _mcap(*metadata: dict[str, str]) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    for record in metadata:
        writer.add_metadata("recording", record)
    writer.finish()
    return stream.getvalue()


@pytest.mark.parametrize(
    "content, reason",
    [
        (b"", "begin and end"),
        (b"PK\x03\x04 some archive", "begin and end"),
        (_mcap()[:8], "truncated or foreign"),
        (_mcap()[:8] + b"\xff" * 64 + _mcap()[-8:], "truncated or foreign"),
        (_mcap(), "schema 'none'"),
        (_mcap({"schema": "recording", "version": "0"}), "version 0"),
        (_mcap({"schema": "recording", "version": "1"}), "truncated or foreign"),
    ],
)
def test_a_foreign_file_is_refused_with_the_reason(content, reason, tmp_path):
    """Archives, empty files, other people's MCAP and other versions are told apart in the message."""
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(ArtifactError, match=reason):
        read_recording(path)
