import os
import subprocess
import sys
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from pipeline.recording import Topic, write_recording
from pipeline.recording.clouds import surface_points
from pipeline.recording.content import moving_frames

SCHEMAS = {
    "/tf": "foxglove.FrameTransforms",
    "/scene": "foxglove.SceneUpdate",
    "/path": "foxglove.PosesInFrame",
    "/obstacle_points": "foxglove.PointCloud",
    "/joint_states": "foxglove.JointStates",
    "/counters": "pipeline.PathProgress",
    "/log": "foxglove.Log",
}


@pytest.fixture
def decoded(recording, tmp_path):
    """Topic -> [(schema name, mcap message, decoded message)], decoded from the schemas inside the file alone."""
    write_recording(tmp_path / "a.mcap", recording)
    found = {}
    with open(tmp_path / "a.mcap", "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, content in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((schema.name, message, content))
    return found


def test_topics_carry_the_schemas_that_viewers_know(decoded):
    """Every topic has its one schema, under the exact name."""
    assert {topic: {name for name, _, _ in rows} for topic, rows in decoded.items()} == {
        topic: {name} for topic, name in SCHEMAS.items()
    }
    assert set(decoded) == {topic.value for topic in Topic}


def test_all_times_are_the_trajectory_s_own(decoded, recording):
    """Log, publish and message times agree and are those of the path; what stands still comes once, at 0."""
    clock = [round(t * 1e9) for t in recording.times]
    for topic, rows in decoded.items():
        times = [message.log_time for _, message, _ in rows]
        assert times == [message.publish_time for _, message, _ in rows]
        assert times == (clock if topic in ("/tf", "/joint_states", "/counters") else [0])
    for now, (_, _, joints) in zip(clock, decoded["/joint_states"], strict=True):
        assert joints.timestamp.seconds * 10**9 + joints.timestamp.nanos == now
    for now, (_, _, frames) in zip(clock, decoded["/tf"], strict=True):
        assert {t.timestamp.seconds * 10**9 + t.timestamp.nanos for t in frames.transforms} == {now}


def test_tf_equals_pinocchio(decoded, recording):
    """Every frame of the robot but the root is a child of the world, at the pose of pinocchio's kinematics."""
    model = recording.robot.model
    data = model.createData()
    for q, (_, _, message) in zip(recording.states, decoded["/tf"], strict=True):
        pin.forwardKinematics(model, data, q)
        found = {t.child_frame_id: t for t in message.transforms}
        assert set(found) == {frame.name for frame in model.frames} - {"universe"}
        for frame in model.frames[1:]:
            t = found[frame.name]
            expected = data.oMi[frame.parentJoint] * frame.placement
            quaternion = [t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w]
            assert t.parent_frame_id == "world" and np.isclose(np.linalg.norm(quaternion), 1)
            np.testing.assert_allclose(xyz(t.translation), expected.translation, atol=1e-12)
            np.testing.assert_allclose(Rotation.from_quat(quaternion).as_matrix(), expected.rotation, atol=1e-12)


def test_a_link_wins_over_a_joint_of_the_same_name_and_the_root_is_no_child(recording):
    """A URDF may call a joint like a link, and its root `world`; /tf must not hold a name twice or make a loop."""
    model = recording.robot.model.copy()
    model.addFrame(pin.Frame("wrist1_joint", 5, 0, pin.SE3.Random(), pin.FrameType.BODY))
    model.addFrame(pin.Frame("world", 0, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    robot = type(recording.robot)("named twice", model, pin.GeometryModel(), -np.ones(6), np.ones(6))
    frames = moving_frames(robot)
    assert "world" not in frames and "universe" not in frames
    assert frames["wrist1_joint"].type == pin.FrameType.BODY


def test_the_path_is_the_tool_s(decoded, recording):
    """/path, the line in /scene and the start and goal balls all lie where /tf has the tool."""
    way = np.array(
        [
            next(xyz(t.translation) for t in message.transforms if t.child_frame_id == recording.tool)
            for _, _, message in decoded["/tf"]
        ]
    )
    (_, _, path), (_, _, scene) = decoded["/path"][0], decoded["/scene"][0]
    entities = {entity.id: entity for entity in scene.entities}
    np.testing.assert_array_equal([xyz(p.position) for p in path.poses], way)
    np.testing.assert_array_equal([xyz(p) for p in entities["path"].lines[0].points], way)
    np.testing.assert_array_equal(xyz(entities["start"].spheres[0].pose.position), way[0])
    np.testing.assert_array_equal(xyz(entities["goal"].spheres[0].pose.position), way[-1])
    assert path.frame_id == "world" and {entity.frame_id for entity in scene.entities} == {"world"}


def test_the_scene_holds_each_obstacle_for_ever_under_its_own_id(decoded, recording):
    """Cube, sphere and cylinder have the obstacle's pose and full extents, ids are stable, lifetime is 0."""
    (_, _, scene) = decoded["/scene"][0]
    assert [entity.id for entity in scene.entities] == [
        *("obstacle/0000", "obstacle/0001", "obstacle/0002", "start", "goal", "path", "manifold")
    ]
    for obstacle, entity in zip(recording.obstacles, scene.entities, strict=False):
        (primitive,) = [*entity.cubes, *entity.spheres, *entity.cylinders]
        assert (
            type(primitive).__name__.lower().startswith({"box": "cube"}.get(obstacle.shape.value, obstacle.shape.value))
        )
        turn = primitive.pose.orientation
        np.testing.assert_allclose(Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix(), obstacle.rotation)
        np.testing.assert_array_equal(xyz(primitive.pose.position), obstacle.position)
        np.testing.assert_array_equal(xyz(primitive.size), obstacle.size)
    assert {(entity.lifetime.seconds, entity.lifetime.nanos) for entity in scene.entities} == {(0, 0)}
    (cylinder,) = scene.entities[2].cylinders
    assert cylinder.top_scale == cylinder.bottom_scale == 1
    (manifold,) = scene.entities[-1].spheres
    assert xyz(manifold.size) == [3, 3, 3] and manifold.color.a < 1
    assert {p.key: p.value for p in scene.entities[5].metadata}["iterations"] == "41"


def test_obstacle_points_lie_on_the_surface(decoded, recording):
    """Each point touches its obstacle by coal's measure, and the cloud holds them all as packed float32."""
    dot = coal.Sphere(1e-6)
    for obstacle in recording.obstacles:
        for point in surface_points(obstacle):
            placed = coal.CollisionObject(dot, np.eye(3), point)
            away = coal.distance(placed, obstacle.collision_object(), coal.DistanceRequest(), coal.DistanceResult())
            assert abs(away) < 1e-5
    (_, _, cloud) = decoded["/obstacle_points"][0]
    stored = np.frombuffer(cloud.data, "<f4").reshape(-1, cloud.point_stride // 4)
    np.testing.assert_allclose(stored, np.concatenate([surface_points(o) for o in recording.obstacles]), atol=1e-6)
    assert [(field.name, field.offset, field.type) for field in cloud.fields] == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]


def test_counters_plot_the_path_s_length(decoded, recording):
    """Step lengths are those of the path, and the length so far is their sum."""
    rows = np.array([(m.step_length, m.path_length) for _, _, m in decoded["/counters"]])
    np.testing.assert_allclose(rows[1:, 0], np.linalg.norm(np.diff(recording.states, axis=0), axis=1))
    np.testing.assert_allclose(rows[:, 1], np.cumsum(rows[:, 0]))
    assert "iterations: 41" in decoded["/log"][0][2].message.splitlines()


def test_bytes_depend_on_the_recording_only(recording, make, tmp_path):
    """Neither a second run nor another order of the dictionaries changes a byte; another state does."""
    names = ("counters", "metadata", "versions", "attachments", "files")
    shuffled = {name: dict(reversed(getattr(recording, name).items())) for name in names}
    write_recording(tmp_path / "a.mcap", recording)
    write_recording(tmp_path / "b.mcap", make(**shuffled))
    write_recording(tmp_path / "c.mcap", make(states=recording.states + 1e-15))
    a, b, c = ((tmp_path / f"{name}.mcap").read_bytes() for name in "abc")
    assert a == b and a != c
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "b.mcap", "c.mcap"]


def test_bytes_are_the_same_in_other_processes(recording, tmp_path):
    """Two processes with other hash seeds write what this one writes."""
    write_recording(tmp_path / "here.mcap", recording)
    program = (
        "import runpy, sys; from pathlib import Path; from pipeline.recording import write_recording;"
        "write_recording(Path(sys.argv[2]), runpy.run_path(sys.argv[1])['make_recording']())"
    )
    for seed in ("1", "2"):
        arguments = [str(Path(__file__).with_name("conftest.py")), str(tmp_path / f"{seed}.mcap")]
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(__file__).parents[2])}
        subprocess.run([sys.executable, "-c", program, *arguments], check=True, env=environment)
        assert (tmp_path / f"{seed}.mcap").read_bytes() == (tmp_path / "here.mcap").read_bytes()


def xyz(message) -> list[float]:
    return [message.x, message.y, message.z]
