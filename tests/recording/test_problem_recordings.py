"""A recording of the one-problem command says what it came from, and depends on that alone."""

import shutil
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from pipeline.planning import solve
from pipeline.planning.output import RECORDING, write_solution
from pipeline.planning.resolved import documents, resolved
from pipeline.problems import read_problem
from pipeline.provenance import commit
from pipeline.recording import read_recording
from pipeline.robots.description import SHARE

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))
DOOR = next(path for path in EXAMPLES if path.stem == "door_panda")
PANDA = SHARE / "example-robot-data/robots/panda_description"


def planned(path: Path, folder: Path) -> Path:
    """The recording of a problem, planned and written anew."""
    write_solution(solve(read_problem(path, time_limit=60.0)), folder, picture=False)
    return folder / RECORDING


@pytest.fixture(scope="module")
def door(tmp_path_factory) -> Path:
    return planned(DOOR, tmp_path_factory.mktemp("door") / "out")


def test_same_seed_same_bytes(door, tmp_path):
    """Planned twice, which no clock measures alike, a problem has the same recording to the last byte."""
    assert planned(DOOR, tmp_path / "again").read_bytes() == door.read_bytes()


def test_the_problem_inside_has_the_same_path(door, tmp_path):
    """The recorded problem, taken out and planned, gives the recorded path and says the same of itself."""
    stored = read_recording(door)
    (tmp_path / "problem.yaml").write_bytes(stored.files["problem.yaml"])
    again = read_recording(planned(tmp_path / "problem.yaml", tmp_path / "out"))
    np.testing.assert_array_equal(again.states, stored.states)
    np.testing.assert_array_equal(again.times, stored.times)
    assert again.files == stored.files and again.metadata == stored.metadata and again.counters == stored.counters


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_resolved_problems_stand_for_themselves(path, tmp_path):
    """What is resolved reads as the same problem, changes of the command line included."""
    file = read_problem(path, seed=7, planner="fmt", sampler="uniform")
    (tmp_path / "problem.yaml").write_bytes(documents(file)["problem.yaml"])
    again = read_problem(tmp_path / "problem.yaml")
    assert again.seed == 7 and again.planner["kind"] == "fmt" and again.time_limit == file.time_limit
    assert resolved(again) == resolved(file)
    assert again.obstacles == file.obstacles and again.goal.values == file.goal.values


def test_defaults_are_filled_in():
    """Settings, frames and parameters that the file leaves out are there by value."""
    found = resolved(read_problem(next(path for path in EXAMPLES if path.stem == "height_panda")))
    assert found["margin"] == 0.005 and found["goals"] == 10 and found["robot"]["parameters"]["geometry"] == "hulls"
    assert found["constraints"][1] == {
        "kind": "upright", "frame": "panda_hand_tcp", "axis": [0.0, 0.0, 1.0], "direction": [0.0, 0.0, -1.0],
    }  # fmt: skip
    assert found["start"]["frame"] == "panda_hand_tcp" and found["start"]["region"]["z"] is None
    assert found["adherence"]["parameters"]["max_steps"] == 200


def test_joints_that_are_called_frame_keep_their_values():
    """Only a frame that is left out is the tool: a value of 0 under the same word stays."""
    file = read_problem(DOOR)
    assert resolved(replace(file, goal=replace(file.goal, values={"frame": 0.0})))["goal"]["values"] == {"frame": 0.0}


def test_the_robot_s_description_is_inside(door):
    """URDF and SRDF are the files that were read, byte for byte."""
    files = read_recording(door).files
    assert files["robot.urdf"] == (PANDA / "urdf/panda.urdf").read_bytes()
    assert files["robot.srdf"] == (PANDA / "srdf/panda.srdf").read_bytes()


def test_a_robot_beside_the_problem_is_inside_without_the_place(tmp_path):
    """The description of a robot that lies beside the problem is found, and the problem names it as the file does."""
    shutil.copy(PANDA / "urdf/panda.urdf", tmp_path / "mine.urdf")
    problem = tmp_path / "problem.yaml"
    problem.write_text(
        "robot: {kind: urdf, parameters: {name: mine, urdf: mine.urdf, joints: [panda_joint1], tool: panda_hand}}\n"
        "start: {joints: {}}\ngoal: {joints: {panda_joint1: 1}}\nconstraints: [{kind: height}]\n"
    )
    found = documents(read_problem(problem))
    assert found.keys() == {"problem.yaml", "robot.urdf"}
    assert found["robot.urdf"] == (PANDA / "urdf/panda.urdf").read_bytes()
    assert b"urdf: mine.urdf" in found["problem.yaml"] and str(tmp_path).encode() not in found["problem.yaml"]


def test_versions_and_commit(door):
    """Versions are those that are installed, the commit that of the code."""
    stored = read_recording(door)
    assert {"python", "numpy", "pin", "coal", "casadi", "ompl"} <= stored.versions.keys()
    assert all(stored.versions[name] == version(name) for name in stored.versions if name != "python")
    assert stored.metadata["commit"] == commit() and stored.metadata["seed"] == "0"
    assert stored.metadata["planner"] == "rrtconnect" and stored.metadata["status"] == "solved"


def test_velocities_carry_each_state_to_the_next(door):
    """With its velocity a state reaches the next in the time between them; the last one stands."""
    stored = read_recording(door)
    reached = stored.states[:-1] + stored.velocities[:-1] * np.diff(stored.times)[:, None]
    np.testing.assert_allclose(reached, stored.states[1:], atol=1e-12)
    np.testing.assert_array_equal(stored.velocities[-1], 0)
    assert np.abs(stored.velocities).max() > 0.1
