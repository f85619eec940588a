"""Trays in both hands of Baxter, kept level: the hands keep their relative pose (14 variables, 8 rows)."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin

from pipeline.environments.furniture import box, cylinder, random_object
from pipeline.environments.task import NEAR, NEAR_ITSELF, Ends, Family, Pair, two_ends
from pipeline.errors import ConfigError
from pipeline.robots import Obstacle, Placement, Shape, UrdfRobot
from pipeline.robots.bodies import body_of
from pipeline.spec.statement import Carried, Joined, Level, Statement
from pipeline.tasks import Setup, robot_of

LEFT, RIGHT = "left_gripper", "right_gripper"
_UP = (0.0, 0.0, 1.0)
_TRAY = (0.22, 0.3, 0.02)  # between the fingers of both hands [m]
_SPREAD = 0.7  # of the joints about rest, before they are projected [rad]
_LEAST = 1.5  # start and goal are at least this far apart [rad]
_TRIES = 200  # times fifty random configurations
_TABLE = -0.12  # its height [m]


class TwoArmTray(Family):
    """Tasks of two arms that hold a tray as they do at rest, over a table with objects and pillars.

    Args:
        settings: of Baxter with both arms.

    Raises:
        ConfigError: a robot without both grippers, or without a configuration of rest.
    """

    def __init__(self, settings: UrdfRobot) -> None:
        robot = robot_of(settings)
        if robot.rest is None or not all(robot.model.existFrame(frame) for frame in (LEFT, RIGHT)):
            raise ConfigError(f"{robot.name!r} cannot hold a tray: it needs {LEFT}, {RIGHT} and a rest configuration")
        left, right = (robot.pose(robot.rest, frame) for frame in (LEFT, RIGHT))
        middle = pin.SE3(np.eye(3), (left.translation + right.translation) / 2)
        x, y, z, *quaternion = pin.SE3ToXYZQUAT(left.actInv(middle)).tolist()
        tray = Obstacle(
            Shape.BOX, (x, y, z), (quaternion[0], quaternion[1], quaternion[2], quaternion[3]), _TRAY, "tray"
        )
        self.rest: np.ndarray = robot.rest
        beside = dict.fromkeys(body_of(name) for name in robot.body_names if name.startswith("r_gripper"))
        axis = tuple(float(c) for c in left.rotation.T @ np.array(_UP))
        relative = Placement.of(left.actInv(right))
        self._asked = Statement(
            settings,
            (Joined(LEFT, RIGHT, relative), Level(LEFT, axis, _UP)),
            carried=(Carried(tray, LEFT, beside=beside),),
        )

    def scene(self, number: int, rng: np.random.Generator) -> tuple[Statement, Ends] | None:
        """See `Family`."""
        del number
        return replace(self._asked, obstacles=tuple(_scene(rng))), self._ends

    def name(self, number: int) -> str:
        """See `Family`."""
        return f"tray {number}"

    def _ends(self, setup: Setup, rng: np.random.Generator) -> Pair | None:
        return two_ends(partial(self._draw, rng, setup), setup.validity(NEAR, NEAR_ITSELF).free, _LEAST, _TRIES)

    def _draw(self, rng: np.random.Generator, setup: Setup) -> np.ndarray:
        robot = setup.robot
        near = self.rest + _SPREAD * rng.normal(size=(50, robot.dimension))
        Q, converged = setup.constraint.project_batch(near, 15)
        return Q[converged & ((Q >= robot.lower) & (Q <= robot.upper)).all(axis=1)]


def _scene(rng: np.random.Generator) -> Iterator[Obstacle]:
    yield box("table", (1.0, 0.0, _TABLE - 0.02), (1.0, 1.8, 0.04))
    for i in range(int(rng.integers(3, 7))):
        spot = (rng.uniform(0.55, 0.95), rng.uniform(-0.45, 0.45), _TABLE + 0.3)
        yield cylinder(f"pillar {i}", spot, rng.uniform(0.05, 0.1), 0.6)
    for i in range(int(rng.integers(6, 15))):
        spot = (rng.uniform(0.55, 1.2), rng.uniform(-0.7, 0.7), _TABLE)
        yield random_object(rng, f"object {i}", spot, (0.06, 0.25))
