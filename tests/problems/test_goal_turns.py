"""Problems of robots whose joints turn, or have limits more than a turn apart: goals at all turns, said where taken."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.errors import ProblemError
from pipeline.planning import solve
from pipeline.planning.solve import Solution
from pipeline.problems import read_problem
from pipeline.problems.build import build
from pipeline.robots.turning import TURN
from tests.robots.crane import CRANE

ROOT = Path(__file__).resolve().parents[2]
UR5 = ROOT / "examples" / "own_robot_ur5.yaml"
UPRIGHT = ROOT / "examples" / "upright_panda.yaml"
OPEN = {"obstacles": [], "time_limit": 30.0}


def crane(folder: Path, start: list[float], goal: dict, **settings) -> dict:
    """A problem of the crane, whose first two joints turn, as a file's content."""
    (folder / "crane.urdf").write_text(CRANE)
    parameters = {"name": "crane", "urdf": str(folder / "crane.urdf"), "joints": ["first", "second", "lift"]}
    robot = {"kind": "urdf", "parameters": {**parameters, "tool": "tip", **settings}}
    return {
        "robot": robot, "start": {"configuration": start}, "goal": goal,
        "constraints": [{"kind": "height", "value": 0.0}], "time_limit": 20.0, "shortcuts": 50,
    }  # fmt: skip


def solved(folder: Path, content: dict) -> Solution:
    """Solve a problem given by its content."""
    file = folder / "problem.yaml"
    file.write_text(yaml.safe_dump(content))
    found = solve(read_problem(file))
    assert found.solved, found.status
    return found


GOALS = {
    "configuration": {"configuration": [-3.1, 0.2, 0.0]},
    "joints": {"joints": {"first": -3.1, "second": 0.2}},
    "values": {"values": {"first": -3.1, "second": 0.2}},
}


@pytest.mark.parametrize("turns", [0, 1, -3])
@pytest.mark.parametrize("kind", GOALS)
def test_a_goal_at_any_turns_is_one_goal(kind, turns, tmp_path):
    """Said in three ways at any turns, the goal of a joint that turns is reached the short way round, which is told."""
    goal = {kind: GOALS[kind][kind]}
    if kind == "configuration":
        goal[kind] = [goal[kind][0] + turns * TURN, *goal[kind][1:]]
    else:
        goal[kind] = {**goal[kind], "first": -3.1 + turns * TURN}
    found = solved(tmp_path, crane(tmp_path, [3.1, 0.0, 0.0], goal))
    assert found.path[-1] == pytest.approx([TURN - 3.1, 0.2, 0.0], abs=1e-3)
    assert found.summary()["length"] < 0.4 and np.abs(np.diff(found.path, axis=0)).max() < 0.1
    notes = found.summary()["notes"]
    assert (turns == 1 and not notes) or (len(notes) == 1 and "goal: joint first ends at 3.18" in notes[0])
    assert found.times[-1] < 0.5  # at 1 rad/s


def test_a_pose_across_half_a_turn(tmp_path):
    """A goal pose is found by inverse kinematics at whatever turn, and gone to the short way."""
    goal = {"pose": {"xyz": [-0.8992216352459516, -0.037422596189961445, 0.0], "rpy": [0.0, 0.0, -3.1]}}
    found = solved(tmp_path, crane(tmp_path, [3.1, 0.0, 0.0], goal))
    assert found.summary()["length"] < 0.2 and found.path[-1][0] == pytest.approx(TURN - 3.1, abs=0.01)


def test_limits_of_cables(tmp_path):
    """With limits of its own a continuous joint goes to a turn of the goal within them, or the long way round."""
    goal = {"configuration": [-3.1, 0.0, 0.0]}
    near = solved(tmp_path, crane(tmp_path, [3.1, 0.0, 0.0], goal, continuous=3.5))
    assert near.path[-1][0] == pytest.approx(TURN - 3.1, abs=1e-9) and near.summary()["length"] < 0.2
    assert "first ends at 3.18319, 1 turn from the file's -3.1" in near.summary()["notes"][0]
    far = solved(tmp_path, crane(tmp_path, [3.1, 0.0, 0.0], goal, continuous=3.15))
    assert far.path[-1][0] == pytest.approx(-3.1) and far.summary()["length"] > 6.0 and not far.summary()["notes"]


def test_a_ur5_goes_to_the_nearest_turn():
    """Of a goal within limits of two turns all turns are offered, the nearest first; the path ends at one of them."""
    ends = build(read_problem(UR5, **OPEN))
    start, goal = ends.starts[0], ends.goals[0]
    assert (np.abs(ends.goals) <= TURN).all() and len(ends.goals) == 100
    distances = np.linalg.norm(ends.goals - start, axis=1)
    assert (np.diff(distances) >= 0).all()
    goal[5] = 1.0  # the tool may turn about its axis; its limits are not a turn away
    away = goal.copy()
    away[5] += TURN if away[5] < 0 else -TURN  # the same place, two and more radians farther
    for q in (goal, away):
        given = {"region": None, "configuration": q.tolist()}
        file = read_problem(UR5, start={"region": None, "configuration": start.tolist()}, goal=given, **OPEN)
        built = build(file)
        assert len(built.goals) == 32  # of five joints with limits of two turns, and the elbow's of one
        np.testing.assert_allclose(built.goals[0], goal, atol=1e-9)
        for other in built.goals:
            assert built.robot.pose(other, "tool0").isApprox(built.robot.pose(q, "tool0"), 1e-9)
    found = solve(file)
    assert found.solved and np.linalg.norm(found.path[-1] - found.built.goals, axis=1).min() < 1e-9


def test_a_goal_beyond_limits_of_more_than_a_turn():
    """A goal's angle beyond such limits is taken at a turn within; a start's, or one of a joint without, is refused."""
    start = build(read_problem(UR5, **OPEN)).starts[0]
    beyond = start.copy()
    beyond[5] += 3 * TURN
    given = {"region": None, "configuration": beyond.tolist()}
    begin = {"region": None, "configuration": start.tolist()}
    built = build(read_problem(UR5, start=begin, goal=given, **OPEN))
    np.testing.assert_allclose(built.goals[0], start, atol=1e-9)
    with pytest.raises(ProblemError, match=r"start: joint wrist_3_joint is .*, outside its limits"):
        build(read_problem(UR5, start=given, **OPEN))
    panda = build(read_problem(UPRIGHT, obstacles=[], grasps=[])).starts[0]
    panda[6] += TURN
    for end in ("start", "goal"):
        with pytest.raises(ProblemError, match=f"{end}: joint panda_joint7 is"):
            build(
                read_problem(
                    UPRIGHT,
                    obstacles=[],
                    grasps=[],
                    **{end: {"pose": None, "region": None, "configuration": panda.tolist()}},
                )
            )


def test_a_chain_with_a_free_yaw_has_no_walls():
    """A hand that is free to turn about the vertical does so past half a turn, its chain's angle without a jump."""
    low, high = 0.35, 0.45
    region = {"x": [low, high], "y": [-0.1, 0.1], "z": 0.4, "roll": np.pi, "pitch": 0.0}
    place = {"x": 0.4, "y": 0.0, "z": 0.4, "roll": np.pi, "pitch": 0.0}
    for turns in (0, 1):
        start, goal = ({"pose": None, "region": {**place, "yaw": yaw + turns * TURN}} for yaw in (2.9, -2.9))
        found = solve(
            read_problem(
                UPRIGHT, constraints=[], obstacles=[], grasps=[], chain={"regions": [region]}, start=start, goal=goal,
                time_limit=30.0,
            )
        )  # fmt: skip
        assert found.solved, found.status
        yaw = found.path[:, list(found.built.robot.joint_names).index("chain_0_yaw")]
        assert np.abs(np.diff(yaw)).max() < 0.1 and abs(yaw[-1] - yaw[0]) == pytest.approx(TURN - 5.8, abs=0.01)
        assert yaw.min() < -np.pi or yaw.max() > np.pi
