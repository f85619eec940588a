"""Which joints turn on a manifold: a constraint may tell turns apart that the robot does not."""

import numpy as np

from pipeline.constraints.base import Constraint
from pipeline.robots import Robot
from pipeline.robots.turning import TURN, Turning

_ASKED = 16  # configurations at which a constraint is asked
_UNCHANGED = 1e-6  # what is rounding there


def turns_on(constraint: Constraint, robot: Robot) -> Turning | None:
    """Return the joints of a robot that turn without end and whose turns do not change a constraint; None without any.

    Kinematics do not know turns. A constraint of another kind may (one joint follows another one, geared down): it is
    asked at random configurations.
    """
    if robot.turns is None or not constraint.k:
        return robot.turns
    Q = np.random.default_rng(0).uniform(*robot.box, (_ASKED, robot.dimension))
    F, mask = constraint.value_batch(Q), robot.turning.copy()
    for joint in robot.turns.places.tolist():
        later = constraint.value_batch(Q + TURN * np.eye(robot.dimension)[joint])
        mask[joint] = bool(np.abs(later - F).max() < _UNCHANGED)
    return Turning(mask) if mask.any() else None
