"""A gripper that is planned for: its second finger follows the first one by an equation."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.planning import solve
from pipeline.problems import read_problem
from pipeline.problems.build import statement_of
from pipeline.verification.judge import Judge
from pipeline.verification.verdict import Failure

ROOT = Path(__file__).parents[2]
FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]


@pytest.fixture(scope="module")
def problem(tmp_path_factory) -> Path:
    """Panda's hand moves at one height, upright, and opens on the way."""
    robot = yaml.safe_load((ROOT / "conf/robot/panda.yaml").read_text())
    robot["parameters"]["joints"] += FINGERS
    del robot["parameters"]["fixed"]
    asked = {
        "robot": robot,
        "constraints": [{"kind": "height", "value": 0.3}, {"kind": "upright", "direction": [0, 0, -1]}],
        "start": {"joints": {FINGERS[0]: 0.005}, "project": True},
        "goal": {"values": {"panda_joint1": 0.8, FINGERS[0]: 0.04}},
    }
    file = tmp_path_factory.mktemp("hand") / "hand.yaml"
    file.write_text(yaml.safe_dump(asked))
    return file


def test_fingers_move_together(problem):
    """Both fingers open from 5 to 40 mm side by side, all along the verified path; the summary names the equation."""
    found = solve(read_problem(problem, time_limit=60.0))
    assert found.solved, found.status
    np.testing.assert_allclose(found.path[:, 7], found.path[:, 8], atol=1e-3)
    assert found.path[0, 7] == pytest.approx(0.005, abs=1e-3) and found.path[-1, 7] == pytest.approx(0.04, abs=1e-3)
    assert any("panda_finger_joint2 beside where" in row for row in found.summary()["rows"])


def test_a_finger_that_stays_behind_is_refused(problem):
    """The verifier, which reads the followers itself, refuses a path on which the second finger lags by 2 mm."""
    file = read_problem(problem, time_limit=60.0)
    found = solve(file)
    judge = Judge(statement_of(file))
    path = found.path.copy()
    assert judge.verify(path, path[0], path[-1]).passed
    path[1:-1, 8] -= 0.002
    verdict = judge.verify(path, path[0], path[-1])
    assert verdict.failure is Failure.OFF_MANIFOLD
