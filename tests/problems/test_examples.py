"""Every example is solved, and what is written holds by pinocchio, coal and the file itself."""

import json
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest

from pipeline.errors import ProblemError
from pipeline.manifolds import Adherence
from pipeline.planners import RrtConnect, path_length
from pipeline.planning import Solution, solve
from pipeline.planning.output import write_solution
from pipeline.problems import read_problem
from pipeline.problems.file import Where
from pipeline.problems.parts import PARTS
from pipeline.recording import read_recording
from pipeline.robots import Shape
from tests.robots.test_arms_validity import plain

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))


@cache
def solution(path: Path) -> Solution:
    """The solution of an example, planned once per process; more time than a loaded machine needs."""
    return solve(read_problem(path, time_limit=60.0))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_solved_and_free(path):
    """The path leads from start to a goal, in small steps, within limits, and no state collides by plain coal."""
    found = solution(path)
    assert found.status == "solved"
    Q, robot = found.path, found.built.robot
    assert (found.built.starts == Q[0]).all(axis=1).any()
    assert np.linalg.norm(found.built.goals - Q[-1], axis=1).min() < 1e-9
    assert np.linalg.norm(np.diff(Q, axis=0), axis=1).max() < 2 * found.file.spacing
    assert (robot.lower <= Q).all() and (robot.upper >= Q).all()
    touching = found.built.exact.touching
    for q in Q[:: max(len(Q) // 40, 1)]:
        assert plain(robot, found.built.obstacles, q, touching=touching)
        assert all(condition.holds(q) for condition in found.built.exact.conditions)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_times_keep_velocity_limits(path):
    """Between two states no joint is faster than its limit, and at each moment one is at its limit."""
    found = solution(path)
    assert found.times[0] == 0 and (np.diff(found.times) > 0).all()
    share = np.abs(np.diff(found.path, axis=0)) / np.diff(found.times)[:, None] / found.built.robot.velocity
    assert share.max() <= 1
    assert np.median(share.max(axis=1)) > 0.99
    slow = solve(replace(found.file, speed=0.5))
    assert slow.times[-1] == pytest.approx(2 * found.times[-1], rel=1e-4)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_shortcuts_never_lengthen(path):
    """The path is at most as long as the planner's."""
    found = solution(path)
    assert path_length(found.path) <= found.raw_length * (1 + 1e-3)
    assert path_length(found.plan.path) == pytest.approx(found.raw_length)


def axis_angle(robot, q, frame, axis, direction) -> float:
    return float(np.arccos(np.clip(robot.pose(q, frame).rotation @ axis @ direction, -1, 1)))


def states(name: str):
    found = solution(next(p for p in EXAMPLES if p.stem == name))
    return found.built.robot, found.path, found


def test_cup_stays_level():
    """By pinocchio the hand's z axis points down to a milliradian along all of the path, and the cup moves with it."""
    robot, Q, _ = states("upright_panda")
    assert max(axis_angle(robot, q, "panda_hand_tcp", [0, 0, 1], [0, 0, -1]) for q in Q) < 1e-3


def test_door_swings_about_its_hinge():
    """By pinocchio the hand keeps its distance from the hinge and its height while the door opens by 0.8 rad."""
    robot, Q, _ = states("door_panda")
    hand = np.array([robot.pose(q, "panda_hand_tcp").translation for q in Q])
    radius = np.linalg.norm(hand[:, :2] - [0.75, 0.35], axis=1)
    np.testing.assert_allclose(radius, np.hypot(0.06, 0.4), atol=2e-3)
    np.testing.assert_allclose(hand[:, 2], 0.45, atol=2e-3)
    assert Q[0, 7] == pytest.approx(0, abs=1e-3) and Q[-1, 7] == pytest.approx(-0.8, abs=1e-3)


def test_tray_keeps_its_hands():
    """By pinocchio the relative pose of Baxter's hands and the tilt of the left one stay as at the start."""
    robot, Q, _ = states("tray_baxter")
    relative = [robot.pose(q, "left_gripper").actInv(robot.pose(q, "right_gripper")) for q in Q]
    assert max(np.linalg.norm(pin.log6(relative[0].actInv(T)).vector) for T in relative) < 3e-3
    wanted = robot.pose(Q[0], "left_gripper").rotation[:, 2]
    assert max(axis_angle(robot, q, "left_gripper", [0, 0, 1], wanted) for q in Q) < 2e-3


def test_reach_keeps_nothing():
    """Without a constraint the hand ends inside the shelf's compartment, and turned on the way there."""
    robot, Q, found = states("reach_panda")
    T = robot.pose(Q[-1], "panda_hand_tcp")
    assert 0.25 < T.translation[2] < 0.6 and T.rotation[0, 2] > 0.99
    assert np.ptp([robot.pose(q, "panda_hand_tcp").rotation[2, 2] for q in Q]) > 0.5
    assert found.summary()["rows"] == [] and found.summary()["largest_violation"] == 0


def test_line_is_straight():
    """By pinocchio Sawyer's hand is on the line through its start along y."""
    robot, Q, _ = states("line_sawyer")
    hand = np.array([robot.pose(q, "right_hand").translation for q in Q])
    assert np.abs(hand[:, [0, 2]] - hand[0, [0, 2]]).max() < 2e-3
    assert hand[-1, 1] - hand[0, 1] < -0.4


def test_palm_keeps_height_and_direction():
    """By pinocchio Olivia's palm is 1 m high and not turned."""
    robot, Q, _ = states("height_olivia")
    for q in Q:
        T = robot.pose(q, "right_palm")
        assert abs(T.translation[2] - 1.0) < 1e-3 and np.linalg.norm(pin.log3(T.rotation)) < 2e-3


def test_feet_stand_and_mass_is_over_them():
    """By pinocchio Pholus' feet do not move and its mass stays 2.4 cm inside their outline's bounding box."""
    robot, Q, found = states("balance_pholus")
    inside = 0.02 + found.file.margin - 1e-3  # between two states that planning looks at the mass may dip
    data = robot.model.createData()
    feet = np.array([[robot.pose(q, f"contact_{i}").translation for i in range(1, 5)] for q in Q])
    assert np.linalg.norm(feet - feet[0], axis=2).max() < 2e-3
    low, high = feet[0, :, :2].min(axis=0) + inside, feet[0, :, :2].max(axis=0) - inside
    for q in Q:
        com = pin.centerOfMass(robot.model, data, q)[:2]
        assert (com > low).all() and (com < high).all()


def test_what_is_written(tmp_path):
    """Path, summary and recording come back as the solution; a second writing gives the same bytes and replaces it."""
    _, Q, found = states("door_panda")
    folder = tmp_path / "out"
    write_solution(found, folder)
    frame = pd.read_csv(folder / "path.csv")
    assert list(frame.columns) == ["time_s", *found.built.robot.joint_names]
    np.testing.assert_allclose(frame.to_numpy(), np.column_stack([found.times, Q]), atol=1e-10)
    result = json.loads((folder / "result.json").read_text())
    assert result["status"] == "solved" and result["length"] == pytest.approx(path_length(Q))
    assert result["largest_violation"] < 1e-3 and result["smallest_clearance_m"] > 0
    stored = read_recording(folder / "recording.mcap")
    for times, Q_stored in ((frame["time_s"].to_numpy(), frame.to_numpy()[:, 1:]), (stored.times, stored.states)):
        # Times are whole nanoseconds, and the recording's states may be rounded. Both keep the velocity limits.
        assert (np.abs(np.diff(Q_stored, axis=0)) <= np.diff(times)[:, None] * found.built.robot.velocity).all()
    np.testing.assert_allclose(stored.states, Q, atol=1e-12)
    before = {
        name: (folder / name).read_bytes() for name in ("path.csv", "recording.mcap", "picture.png", "layout.json")
    }
    write_solution(found, folder)
    assert before == {name: (folder / name).read_bytes() for name in before}


def test_same_seed_same_path():
    """The same file and seed give the same path to the bit; another seed gives another."""
    path = next(p for p in EXAMPLES if p.stem == "upright_panda")
    again, other = solve(read_problem(path, time_limit=60.0)), solve(read_problem(path, time_limit=60.0, seed=1))
    np.testing.assert_array_equal(again.path, solution(path).path)
    assert other.solved and (other.path.shape != again.path.shape or not np.array_equal(other.path, again.path))


@pytest.mark.parametrize("planner", ["rrtconnect_arm", "fmt"])
@pytest.mark.parametrize("adherence", ["projection_arm", "atlas_arm", "tangent_bundle_arm"])
def test_two_planners_on_any_adherence(planner, adherence):
    """The cup is carried by RRTConnect and FMT* with every adherence method; FMT* with samples of the manifold."""
    path = next(p for p in EXAMPLES if p.stem == "upright_panda")
    sampler = "uniform" if planner == "fmt" else "directions"
    found = solve(read_problem(path, planner=planner, adherence=adherence, sampler=sampler, time_limit=60.0))
    assert found.solved


def test_ends_that_no_path_can_be_proven_from_are_left_out(monkeypatch):
    """Of a region's configurations those that nothing can be proven from are left out; where all are, it is said."""
    found = solution(next(p for p in EXAMPLES if p.stem == "upright_panda"))
    end = found.path[-1]
    monkeypatch.setattr(Adherence, "provable", lambda self, q: not np.array_equal(q, end))
    again = solve(found.file)
    assert len(found.built.goals) > 1 and again.solved and not np.array_equal(again.path[-1], end)
    monkeypatch.setattr(Adherence, "provable", lambda self, q: False)
    with pytest.raises(ProblemError, match="no path from there can be proven"):
        solve(found.file)


def test_a_start_is_several_configurations(monkeypatch):
    """A start given as a region is several configurations, from any of which a path may begin; an exact one is one."""
    asked = []
    plan = RrtConnect.plan

    def seen(self, problem, *rest):
        asked.append(problem)
        return plan(self, problem, *rest)

    monkeypatch.setattr(RrtConnect, "plan", seen)
    found = solve(solution(next(p for p in EXAMPLES if p.stem == "own_robot_ur5")).file)
    starts = asked[0].starts
    np.testing.assert_array_equal(starts, found.built.starts)
    assert len(starts) == found.summary()["starts"] > 1 and (starts == found.path[0]).all(axis=1).any()
    monkeypatch.setattr(Adherence, "provable", lambda self, q: not np.array_equal(q, found.path[0]))
    other = solve(found.file)
    assert other.solved and (starts == other.path[0]).all(axis=1).any() and (other.path[0] != found.path[0]).any()
    exact = solve(solution(next(p for p in EXAMPLES if p.stem == "shapes_panda")).file)
    assert len(exact.built.starts) == len(exact.built.goals) == 1


def test_closer_looks_stay_within_bounds():
    """A path looked along as closely as allowed is not searched for more closely than that."""
    fine = {"kind": "projection", "parameters": {"step": 0.01, "resolution": 1e-5}}
    file = solution(next(p for p in EXAMPLES if p.stem == "line_sawyer")).file
    assert solve(replace(file, adherence=fine, shortcuts=0, time_limit=1e-3)).status == "time limit"


def test_no_path_is_a_result(tmp_path):
    """A problem that is not solved in its time has that as its status, and only the summary is written."""
    found = solve(read_problem(EXAMPLES[0], time_limit=1e-6))
    assert found.status == "time limit" and not found.solved and found.path.shape[0] == 0
    write_solution(found, tmp_path / "out")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["result.json"]


def test_every_kind_of_constraint_has_an_example():
    """The examples together use every kind of constraint a file can ask for, and a chain."""
    files = [read_problem(path) for path in EXAMPLES]
    assert {entry["kind"] for file in files for entry in file.constraints} == set(PARTS)
    assert any(file.chain for file in files)


def test_every_kind_of_scene_and_end_has_an_example():
    """The examples together have every shape of obstacle and every way to say a start or goal."""
    files = [read_problem(path) for path in EXAMPLES]
    assert {body.shape for file in files for body in file.obstacles} == set(Shape)
    ends = [end for file in files for end in (file.start, file.goal)]
    ways = {field.name for field in fields(Where)} - {"frame", "project"}
    assert {way for end in ends for way in ways if getattr(end, way) is not None} == ways
    assert any(file.grasps for file in files)


def test_every_chord_is_proven():
    """Of every chord of an example's path the verdict says that it is proven, or that it was sampled."""
    found = solution(EXAMPLES[-1])
    verdict = found.verdict
    assert verdict.chords_proven + verdict.chords_sampled == len(found.path) - 1
    assert verdict.chords_proven == found.summary()["chords_proven"] > 0
