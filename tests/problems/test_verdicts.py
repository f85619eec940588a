"""A path counts when the verifier passes it: refused ones are searched for again, for as long as there is time."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.constraints import Constraint
from pipeline.errors import ProblemError
from pipeline.planning import solve
from pipeline.planning.output import write_solution
from pipeline.problems import read_problem
from pipeline.problems.build import build, statement_of
from pipeline.robots import Robot
from pipeline.tasks import equations, forget
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import Failure, Verdict
from tests.robots.crane import CRANE

EXAMPLES = Path(__file__).parents[2] / "examples"
REFUSED = Verdict(Failure.COLLISION, 0, "the judge is in a bad mood", 0.0, None, 1.0, 1)


@pytest.fixture
def moody(monkeypatch):
    """A judge that refuses the first paths, starts and goals aside, and lists all that it is asked."""
    honest, asked = Judge.verify, []

    def verify(self: Judge, path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> Verdict:
        if len(path) == 1:
            return honest(self, path, start, goal)
        asked.append(path)
        return honest(self, path, start, goal) if len(asked) > verify.refused else REFUSED

    verify.refused = 0
    monkeypatch.setattr(Judge, "verify", verify)
    return verify, asked


def test_refused_paths_are_searched_for_again(moody):
    """After three searches whose paths the verifier refuses, shortened or not, a fourth with its own seed counts."""
    verify, asked = moody
    verify.refused = 6
    found = solve(read_problem(EXAMPLES / "upright_panda.yaml", time_limit=60.0, seed=3))
    assert found.solved and len(asked) == 7 and found.plan.seed == 3 + 3
    assert len({path.tobytes() for path in asked}) > 3


def test_time_limit_is_used_before_giving_up(moody):
    """A verifier that refuses everything is asked until the time limit; then the result says why, without a path."""
    verify, asked = moody
    verify.refused = 10**9
    begin = time.perf_counter()
    found = solve(read_problem(EXAMPLES / "upright_panda.yaml", time_limit=2.0))
    assert found.seconds >= 1.9 and time.perf_counter() - begin < 60 and len(asked) > 3
    assert found.status == "refused: the judge is in a bad mood" and not len(found.path) and not found.solved
    assert found.summary()["chords_proven"] == 0


def test_mistakes_of_planning_are_refused(monkeypatch):
    """Where planning keeps a frame 5 mm above what is asked, by its own rows soundly, no search begins."""
    right = equations.plane

    def wrong(robot: Robot, frame: str, point: tuple[float, ...], *rest: Any, **keywords: Any) -> Constraint:
        return right(robot, frame, (point[0], point[1], point[2] + 0.005), *rest, **keywords)

    monkeypatch.setattr(equations, "plane", wrong)
    forget()
    with pytest.raises(ProblemError, match=r"start: the verifier refuses it: .* is off the manifold: \|\|F\|\| = 0.00"):
        solve(read_problem(EXAMPLES / "height_panda.yaml", time_limit=2.0))


@pytest.fixture(autouse=True)
def anew():
    """What a test has planning make wrongly is not kept for the next one."""
    yield
    forget()


def test_every_seed_of_a_six_joint_door_is_solved(tmp_path):
    """A door with as many joints as it needs is opened whatever the seed: limits hold where they are written."""
    ur5 = yaml.safe_load((EXAMPLES / "own_robot_ur5.yaml").read_text())["robot"]
    hinge = {"x": 0, "y": 0, "z": 0, "roll": 0, "pitch": 0, "yaw": [-1.2, 0], "origin": {"xyz": [0.75, 0.35, 0.45]}}
    handle = {"x": 0, "y": 0, "z": 0, "roll": 0, "pitch": [-0.5, 0.5], "yaw": 0}
    handle |= {"origin": {"xyz": [-0.06, -0.4, 0.0]}, "offset": {"rpy": [0.0, np.pi / 2, 0.0]}}
    door = {"robot": ur5, "chain": {"name": "door", "regions": [hinge, handle]}}
    door |= {"start": {"values": {"door_0_yaw": 0.0}}, "goal": {"values": {"door_0_yaw": -0.9}}}
    (tmp_path / "door.yaml").write_text(yaml.safe_dump(door))
    for seed in range(8):
        found = solve(read_problem(tmp_path / "door.yaml", seed=seed))
        assert found.solved, (seed, found.status)


def test_what_is_sampled_is_said():
    """Every chord of a result is proven or sampled, and the result has both numbers and a note where one is sampled."""
    found = solve(read_problem(EXAMPLES / "door_panda.yaml", time_limit=30.0))
    summary = found.summary()
    assert summary["chords_proven"] + summary["chords_sampled"] == summary["states"] - 1
    assert bool(summary["chords_sampled"]) == any("sampled" in note for note in summary["notes"])


def test_parts_of_the_path_pass_as_the_whole():
    """A solved path passes again, backwards and cut into its halves, each between its own ends."""
    file = read_problem(EXAMPLES / "tray_baxter.yaml", time_limit=60.0)
    found = solve(file)
    judge = Judge(statement_of(file))
    middle = len(found.path) // 2
    for part in (found.path, found.path[::-1], found.path[: middle + 1], found.path[middle:]):
        assert judge.verify(part, part[0], part[-1]).passed
    assert build(file).robot.joint_names == judge.kinematics.names


def test_written_states_on_a_limit_pass(tmp_path):
    """What `path.csv` holds is to the bit what was verified, and passes again: its ends are on limits of pi."""
    limits = f'type="revolute"><limit lower="{-np.pi}" upper="{np.pi}" velocity="1" effort="1"/>'
    (tmp_path / "crane.urdf").write_text(CRANE.replace('type="continuous">', limits))
    robot = {"name": "crane", "urdf": "crane.urdf", "joints": ["first", "second", "lift"], "tool": "tip"}
    content = {
        "robot": {"kind": "urdf", "parameters": robot},
        "constraints": [{"kind": "height", "value": 0.0}],
        "start": {"configuration": [np.pi, 0.0, 0.0]},
        "goal": {"configuration": [np.pi - 1.0, -np.pi, 0.0]},
    }
    (tmp_path / "problem.yaml").write_text(yaml.safe_dump(content))
    found = solve(read_problem(tmp_path / "problem.yaml", time_limit=20.0))
    write_solution(found, tmp_path / "out", picture=False)
    frame = pd.read_csv(tmp_path / "out" / "path.csv")
    written = frame.to_numpy()[:, 1:]
    np.testing.assert_array_equal(written, found.path)
    np.testing.assert_array_equal(frame["time_s"], found.times)
    verdict = Judge(statement_of(found.file)).verify(written, written[0], written[-1])
    assert verdict.passed and written.max() == np.pi, verdict.message
