from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pipeline.errors import ProblemError, RobotError
from pipeline.recording import time_parameterise, write_recording
from pipeline.robots import Obstacle, Shape
from tests.recording.viewer import Viewer


def test_times_walk_the_path_at_uniform_speed():
    """Between different states the joint velocity has the wanted norm, and the total is length / velocity."""
    path = np.random.default_rng(0).normal(size=(30, 7))
    times = time_parameterise(path, 0.4)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / np.diff(times)
    assert times[0] == 0 and times.shape == (30,)
    np.testing.assert_allclose(speed, 0.4)


@pytest.mark.parametrize("path", [np.zeros((5, 3)), np.full((2, 3), 1e8), np.array([[0.0], [1e-300], [1e8], [1e8]])])
def test_repeated_states_keep_times_increasing(path):
    """Standing still takes a shortest step, also in integer nanoseconds after a long way."""
    times = time_parameterise(path, 1.0)
    assert (np.diff(np.round(1e9 * times)) > 0).all()


def test_a_single_state_takes_no_time():
    """A path of one state is a still picture at t = 0."""
    np.testing.assert_array_equal(time_parameterise(np.ones((1, 3)), 1.0), [0.0])


@pytest.mark.parametrize("velocity", [0.0, -1.0, np.nan, np.inf])
def test_a_bad_velocity_is_refused(velocity):
    """No time axis is made of a velocity that is not finite and positive."""
    with pytest.raises(ProblemError, match="velocity"):
        time_parameterise(np.zeros((2, 3)), velocity)


BAD_BOX = Obstacle(Shape.BOX, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
NO_TURN = Obstacle(Shape.BOX, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
LOST = Obstacle(Shape.BOX, (0.0, np.nan, 0.0), (0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"states": np.zeros((0, 6)), "times": np.zeros(0)}, "at least one state"),
        ({"states": np.zeros(6)}, "shape"),
        ({"states": np.zeros((12, 5))}, "shape"),
        ({"states": np.array([[0.0] * 6] * 11 + [[np.nan] * 6])}, "state 11"),
        ({"times": np.arange(11.0)}, "times"),
        ({"times": np.arange(12.0) + 1}, "times"),
        ({"times": np.array([0.0, 1, 2, 3, 4, 4, *range(5, 11)])}, r"times\[5\]"),
        ({"times": np.array([0.0, 1, 2, 3, 4, 4 + 1e-10, *range(5, 11)])}, "1 ns"),
        ({"times": np.array([*range(11), np.inf])}, "times"),
        ({"times": np.array([*range(11), 1e10])}, "times"),
        ({"start": np.zeros(5)}, "start"),
        ({"goal": np.full(6, np.inf)}, "goal"),
        ({"obstacles": (BAD_BOX,)}, "obstacle 0"),
        ({"obstacles": (NO_TURN,)}, "obstacle 0"),
        ({"obstacles": (LOST,)}, "obstacle 0"),
        ({"manifold_sphere_radius": 0.0}, "radius"),
        ({"counters": {"charts": [1]}}, "counters"),
        ({"metadata": {"seed": 7}}, "metadata"),
        ({"metadata": {7: "seed"}}, "metadata"),
        ({"versions": {"numpy": 2}}, "versions"),
        ({"files": {"robot.urdf": "<robot/>"}}, "files"),
        ({"files": {"config.json": b"{}"}}, "attachments"),
        ({"attachments": {"config": {"x": np.zeros(2)}}}, "config"),
        ({"attachments": {"config": {"x": np.nan}}}, "config"),
    ],
)
def test_a_malformed_recording_touches_no_file(changes, message, make, tmp_path):
    """Every malformed input is refused by name, and neither the file nor its folder appears."""
    with pytest.raises(ProblemError, match=message):
        write_recording(tmp_path / "new" / "a.mcap", make(**changes))
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_tool_names_the_frames_there_are(make, tmp_path):
    """The message of a wrong frame lists the right ones; an older file stays as it was."""
    path = tmp_path / "a.mcap"
    path.write_bytes(b"before")
    with pytest.raises(RobotError, match="effector_body"):
        write_recording(path, make(tool="hand"))
    assert path.read_bytes() == b"before" and list(tmp_path.iterdir()) == [path]


def test_bodies_that_share_a_name_are_refused(recording, tmp_path):
    """A viewer shows one entity per name: of two bodies it would show one."""
    geometry = pin.GeometryModel()
    for joint in (1, 2):
        geometry.addGeometryObject(pin.GeometryObject("ball", joint, pin.SE3.Identity(), pin.hppfcl.Sphere(0.1)))
    robot = replace(recording.robot, geometry=geometry)
    with pytest.raises(RobotError, match="ball"):
        write_recording(tmp_path / "a.mcap", replace(recording, robot=robot))


def test_a_mirrored_mesh_is_drawn_mirrored(make, tmp_path):
    """A mesh with a negative scale has the vertices of the other, mirrored."""
    file = str(Path(__file__).parents[2] / "examples" / "shapes" / "wedge.obj")
    found = []
    for x in (1.0, -1.0):
        wedge = Obstacle(Shape.MESH, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (x, 1.0, 1.0), file=file)
        write_recording(tmp_path / "a.mcap", make(obstacles=(wedge,)))
        (drawn,) = Viewer(tmp_path / "a.mcap").entities["obstacle/0000"].triangles
        found.append(np.array([[p.x, p.y, p.z] for p in drawn.points]))
    assert np.ptp(found[0]) > 0
    np.testing.assert_allclose(found[1], found[0] * [-1, 1, 1])
