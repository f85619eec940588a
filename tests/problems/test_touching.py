"""What a problem file says of contact and loads arrives, and what comes of it is in the result."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from pipeline.errors import PipelineError
from pipeline.planning import solve
from pipeline.problems import read_problem
from pipeline.problems.build import build
from tests.robots import meshes

EXAMPLES = Path(__file__).parents[2] / "examples"
DOWN = [np.pi, 0.0, 0.0]


def problem(folder: Path, example: str = "upright_panda", **changes):
    """An example with other entries, read from a file in a folder."""
    content = {**yaml.safe_load((EXAMPLES / f"{example}.yaml").read_text()), **changes}
    path = folder / "problem.yaml"
    path.write_text(yaml.safe_dump(content))
    return read_problem(path)


TABLE = {"name": "table", "shape": "box", "size": [0.9, 1.4, 0.04], "xyz": [0.65, 0.0, 0.18]}
CUP = {"name": "cup", "shape": "cylinder", "size": [0.07, 0.07, 0.1], "xyz": [0.0, 0.0, 0.02], "touches": ["table"]}


def test_a_bottle_in_the_table_is_refused(tmp_path):
    """A start at which a carried bottle is through the table that it may touch is none, and it is said how deep."""
    bottle = {**CUP, "size": [0.07, 0.07, 0.3], "xyz": [0.0, 0.0, 0.13]}
    file = problem(tmp_path, obstacles=[TABLE], grasps=[bottle], goals=2)
    with pytest.raises(
        PipelineError, match=r"cup with table \(0\.\d+ m deep, of at most 0.002 m, of which the margin keeps 0.0005 m\)"
    ):
        build(file)


@pytest.mark.parametrize("touches, depth", [(["table"], 0.002), ({"table": 0.005}, 0.005), ({"table": 0.0001}, 0.0001)])
def test_depths_arrive(touches, depth, tmp_path):
    """The depth of a file, or the usual one, is the pair's, for planning and for the check, and a goal keeps it."""
    file = problem(tmp_path, obstacles=[TABLE], grasps=[{**CUP, "touches": touches}], goals=3, margin=0.0)
    built = build(file)
    for validity in (built.validity, built.exact):
        (pair,) = [pair for pair in validity.pairs() if pair.depth]
        assert (pair.first, pair.second, pair.depth) == ("cup", "table", depth)
    contact = built.exact.deepest_contact(np.concatenate([built.starts, built.goals]))
    assert contact is None or contact.depth <= depth


def test_result_has_contact_and_surfaces(tmp_path):
    """The result has the deepest contact of the path by brute force, with its pair, and the open meshes."""
    points, faces = meshes.box((0.1, 0.1, 0.1))
    meshes.write(tmp_path / "lid.obj", (points, faces[:-1]))
    lid = {"name": "lid", "shape": "mesh", "size": 1, "file": "lid.obj", "xyz": [0.3, 0.7, 0.6]}
    low = {"pose": {"xyz": [0.55, -0.35, 0.2692], "rpy": DOWN}}
    found = solve(problem(tmp_path, obstacles=[TABLE, lid], grasps=[CUP], start=low))
    summary = found.summary()
    assert found.solved and summary["surfaces"] == ["lid"]
    assert summary["deepest_contact"] == ["cup", "table"]
    bottoms = [found.built.robot.pose(q, "panda_hand_tcp").act(np.array([0, 0, 0.07]))[2] for q in found.path]
    assert summary["deepest_contact_m"] == pytest.approx(0.2 - min(bottoms), abs=1e-4)  # the cup's tilt is within 1e-3
    assert 0.0005 < summary["deepest_contact_m"] <= 0.002
    above = solve(problem(tmp_path, obstacles=[TABLE], grasps=[{**CUP, "touches": []}], start={
        "pose": {"xyz": [0.55, -0.35, 0.29], "rpy": DOWN}}))  # fmt: skip
    assert above.summary()["deepest_contact_m"] == 0.0 and above.summary()["deepest_contact"] is None
    assert above.summary()["surfaces"] == []


def test_loads_arrive(tmp_path):
    """The mass of a file is in the robot's model, at the middle of what is carried, and in no other one's."""
    loaded = build(problem(tmp_path, grasps=[{**CUP, "mass": 3.0}], goals=1)).robot
    bare = build(problem(tmp_path, goals=1)).robot
    hand = loaded.model.frames[loaded.frame_id(loaded.tool)]
    masses = [[inertia.mass for inertia in robot.model.inertias] for robot in (loaded, bare)]
    assert np.flatnonzero(np.subtract(*masses)).tolist() == [hand.parentJoint]
    data = loaded.model.createData(), bare.model.createData()
    centres = [pin.centerOfMass(robot.model, d, loaded.rest) for robot, d in zip((loaded, bare), data, strict=True)]
    total = sum(masses[1][1:])
    cup = loaded.pose(loaded.rest, loaded.tool).act(np.array([0, 0, 0.02]))
    np.testing.assert_allclose(centres[0], (total * centres[1] + 3.0 * cup) / (total + 3.0), atol=1e-9)


BAD = {
    "not a name": ({**CUP, "touches": [1]}, r"grasp.touches\[0\] is 1"),
    "not a depth": ({**CUP, "touches": {"table": "deep"}}, "grasp.touches.table is 'deep'"),
    "no depth": ({**CUP, "touches": {"table": 0}}, "grasp.touches.table is 0.0 m; it must be above 0 m"),
    "a scalar": ({**CUP, "touches": "table"}, "grasp.touches is 'table'; it must be a list"),
    "too deep": ({**CUP, "touches": {"table": 0.03}}, "'table' 0.03 m deep; .* at most 0.02 m, half of the thinner"),
    "no such obstacle": ({**CUP, "touches": {"tabel": 0.001}}, "'tabel' .did you mean 'table'"),
    "no such body": ({**CUP, "beside": {"panda_link9": 0.001}}, "lacks: 'panda_link9'"),
    "mass": ({**CUP, "mass": -1}, "grasp.mass is -1.0 kg; it must be at least 0 kg"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_contact(case, tmp_path):
    """Whom a body may touch is a list of names or a mapping to depths within their bounds; masses are not negative."""
    grasp, message = BAD[case]
    with pytest.raises(PipelineError, match=message):
        build(problem(tmp_path, obstacles=[TABLE], grasps=[grasp]))
