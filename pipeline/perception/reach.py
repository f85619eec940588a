"""The space that a robot reaches: where obstacles matter to it."""

import numpy as np
import pinocchio as pin

from pipeline.robots import UrdfRobot
from pipeline.spec.statement import Point

_DRAWN = 2000  # configurations; with ten times as many the boxes of five robots grow by 9 cm at most


def reached(robot: UrdfRobot | Point) -> np.ndarray:
    """Return corners of the box that holds a robot's joints and its tool at random configurations (2, 3) [m].

    The same for the same robot. What a hand holds may reach out of it.
    """
    if isinstance(robot, Point):
        return np.array([robot.lower, robot.upper], float)
    made = robot.robot()
    data, tool, places = made.model.createData(), made.frame_id(made.tool), []
    for q in np.random.default_rng(0).uniform(*made.box, (_DRAWN, made.dimension)):
        pin.forwardKinematics(made.model, data, q)
        places += [pin.updateFramePlacement(made.model, data, tool).translation.copy()]
        places += [place.translation.copy() for place in list(data.oMi)[1:]]
    return np.array([np.min(places, axis=0), np.max(places, axis=0)])
