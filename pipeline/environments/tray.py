"""Trays in both hands of Baxter, kept level: the hands keep their relative pose (14 variables, 8 rows)."""

from collections.abc import Iterator
from functools import partial

import numpy as np
import pinocchio as pin

from pipeline.constraints import closed_chain, intersection, upright
from pipeline.environments.furniture import box, cylinder, random_object
from pipeline.environments.task import NEAR, NEAR_ITSELF, Task, two_ends
from pipeline.errors import ConfigError, ProblemError
from pipeline.robots import Obstacle, Placement, Robot, Shape, Validity, attach
from pipeline.robots.bodies import body_of
from pipeline.verification.statement import Carried, Joined, Level

LEFT, RIGHT = "left_gripper", "right_gripper"
_UP = (0.0, 0.0, 1.0)
_TRAY = (0.22, 0.3, 0.02)  # between the fingers of both hands [m]
_SPREAD = 0.7  # of the joints about rest, before they are projected [rad]
_LEAST = 1.5  # start and goal are at least this far apart [rad]
_TRIES = 200  # times fifty random configurations
_TABLE = -0.12  # its height [m]


class TwoArmTray:
    """Tasks of two arms that hold a tray as they do at rest, over a table with objects and pillars.

    Args:
        robot: Baxter with both arms.

    Raises:
        ConfigError: a robot without both grippers, or without a configuration of rest.
    """

    def __init__(self, robot: Robot) -> None:
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
        self.robot, self.carried = attach(robot, tray, LEFT, beside), (Carried(tray, LEFT, beside=beside),)
        axis = tuple(float(c) for c in left.rotation.T @ np.array(_UP))
        relative = left.actInv(right)
        self.says = (Joined(LEFT, RIGHT, Placement.of(relative)), Level(LEFT, axis, _UP))
        self.constraint = intersection(
            closed_chain(self.robot, LEFT, RIGHT, relative),
            upright(self.robot, LEFT, axis, _UP),
            name="tray",
        )

    def task(self, seed: int, number: int) -> Task:
        """See `Family`."""
        robot = self.robot
        for attempt in range(20):
            rng = np.random.default_rng([seed, number, attempt])
            obstacles = tuple(_scene(rng))
            validity = Validity(robot, obstacles, NEAR, NEAR_ITSELF)
            ends = two_ends(partial(self._draw, rng), validity.free, _LEAST, _TRIES)
            if ends is not None:
                return Task(f"tray {number}", robot, self.constraint, obstacles, *ends, self.says, carried=self.carried)
        raise ProblemError(f"no start and goal were found for tray {number}, seed {seed}")

    def _draw(self, rng: np.random.Generator) -> np.ndarray:
        robot = self.robot
        near = self.rest + _SPREAD * rng.normal(size=(50, robot.dimension))
        Q, converged = self.constraint.project_batch(near, 15)
        return Q[converged & ((Q >= robot.lower) & (Q <= robot.upper)).all(axis=1)]


def _scene(rng: np.random.Generator) -> Iterator[Obstacle]:
    yield box("table", (1.0, 0.0, _TABLE - 0.02), (1.0, 1.8, 0.04))
    for i in range(int(rng.integers(3, 7))):
        spot = (rng.uniform(0.55, 0.95), rng.uniform(-0.45, 0.45), _TABLE + 0.3)
        yield cylinder(f"pillar {i}", spot, rng.uniform(0.05, 0.1), 0.6)
    for i in range(int(rng.integers(6, 15))):
        spot = (rng.uniform(0.55, 1.2), rng.uniform(-0.7, 0.7), _TABLE)
        yield random_object(rng, f"object {i}", spot, (0.06, 0.25))
