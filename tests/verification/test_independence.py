"""Mistakes planted in planning's own code change nothing that the verifier says."""

import numpy as np
import pinocchio as pin
import pytest
from arms import PANDA

from pipeline.constraints import Constraint, upright
from pipeline.robots import Obstacle, Robot, Shape, Validity, collision, urdf
from pipeline.spec.statement import Carried, Level, Pinned, Statement
from pipeline.verification import judge
from pipeline.verification.verdict import Failure

UP = Level("panda_hand_tcp", (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
FLAT = (0.0, 0.0, 0.0, 1.0)
Q = np.array([0.1, -0.6, -0.2, -2.3, 0.1, 1.7, 0.5])


def tasks() -> list[tuple[Statement, np.ndarray]]:
    """A sound path, one into a post, one that tilts, one that leaves its point, and one through the robot."""
    robot = PANDA.robot()
    q, converged = upright(robot, UP.frame, direction=UP.direction).project_batch(Q[None], tolerance=1e-9)
    assert converged[0]
    path = q + np.linspace(0, 0.6, 13)[:, None] * np.eye(7)[0]  # the hand turns about a vertical axis
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, path[8])
    at = tuple(pin.updateFramePlacement(robot.model, data, robot.model.getFrameId(UP.frame)).translation)
    post = Obstacle(Shape.CYLINDER, at, FLAT, (0.002, 0.002, 0.1), name="post")
    cup = Carried(Obstacle(Shape.CYLINDER, (0.0, 0.0, 0.02), FLAT, (0.05, 0.05, 0.1), name="cup"), UP.frame)
    folded = np.linspace(path[0], np.array([0.1, -0.6, -0.2, -3.0, 0.1, 0.1, 0.5]), 40)
    return [
        (Statement(PANDA, (UP,), 1e-3), path),
        (Statement(PANDA, (UP,), 1e-3, (post,)), path),
        (Statement(PANDA, (UP,), 1e-3), path + np.linspace(0, 0.02, 13)[:, None] * np.eye(7)[5]),
        (Statement(PANDA, (Pinned(UP.frame, at),), 1e-3), path),
        (Statement(PANDA, (UP,), 10.0, carried=(cup,)), folded),
    ]


def verdicts(asked: list[tuple[Statement, np.ndarray]]) -> list[tuple[Failure | None, int | None, int, int]]:
    """What the verifier says of tasks, with robots read anew."""
    found = []
    for statement, path in asked:
        judge._robots.clear()
        verdict = judge.Judge(statement).verify(path, path[0], path[-1])
        found.append((verdict.failure, verdict.segment, verdict.chords_proven, verdict.chords_sampled))
    return found


def _no_pairs(model, geometry, disabled, neighbours) -> None:
    geometry.removeAllCollisionPairs()


def _elsewhere(self, name: str) -> int:
    return int(self.model.getFrameId("panda_link3"))


MISTAKES = {
    "checker": (Validity, "free", lambda self, q: True),
    "chord proof": (collision.BroadPhase, "collides", lambda self, q: False),
    "pairs": (urdf, "_add_pairs", _no_pairs),
    "frame": (Robot, "frame_id", _elsewhere),
    "compiled row": (Constraint, "value_batch", lambda self, rows: np.zeros((len(rows), self.k))),
    "limits": (Validity, "in_bounds", lambda self, q: True),
    "bodies": (urdf, "simplified", lambda geometry, kind: pin.GeometryModel()),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_of_planning_do_not_reach_the_verdict(mistake, monkeypatch):
    """A checker that passes all, pairs that are dropped, a wrong frame and wrong rows leave every verdict as it was."""
    asked = tasks()
    before = verdicts(asked)
    kinds = [None, Failure.COLLISION, Failure.OFF_MANIFOLD, Failure.OFF_MANIFOLD, Failure.COLLISION]
    assert [failure for failure, *_ in before] == kinds
    monkeypatch.setattr(*MISTAKES[mistake])
    assert verdicts(asked) == before
