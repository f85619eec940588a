"""Reaching while balanced: Pholus on four feet, hands among shelves (after generative_manifolds.txt)."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin

from pipeline.environments.furniture import box, random_object
from pipeline.environments.task import NEAR, NEAR_ITSELF, Ends, Family, Pair, two_ends
from pipeline.errors import ConfigError
from pipeline.robots import Obstacle, UrdfRobot
from pipeline.spec.statement import Balanced, Pinned, Statement
from pipeline.tasks import Setup, robot_of

FEET = tuple(f"contact_{i}" for i in range(1, 5))
_MARGIN = 0.02  # of the centre of mass to the edges of the support polygon [m]
_SPREAD = 0.8  # of the joints after the legs, about rest [rad]
_LEGS = 0.15  # of the base and the legs [m and rad]
_LEAST = 2.0  # start and goal are at least this far apart [rad]
_TRIES = 200  # times twenty random configurations
_HAND = ((0.45, -0.7, 0.5), (1.1, 0.2, 1.4))  # where the hand begins and ends: bounds of x, y, z [m]


class BalancedReach(Family):
    """Tasks of a robot that stands as it does at rest: its hand moves between places in front of it.

    Args:
        settings: of Pholus, with the base's six virtual joints first, then the legs, then torso and arms.

    Raises:
        ConfigError: a robot without the feet, or without a configuration of rest.
    """

    def __init__(self, settings: UrdfRobot) -> None:
        robot = robot_of(settings)
        if robot.rest is None or not all(robot.model.existFrame(frame) for frame in FEET):
            raise ConfigError(f"{robot.name!r} cannot stand: it needs {', '.join(FEET)} and a rest configuration")
        contacts = {frame: tuple(robot.pose(robot.rest, frame).translation.tolist()) for frame in FEET}
        self._asked = Statement(
            settings,
            tuple(Pinned(frame, point) for frame, point in contacts.items()),
            conditions=(Balanced(tuple(contacts.values()), _MARGIN),),
        )
        upper_body = [joint.startswith(("torso", "j_arm")) for joint in robot.joint_names]
        self.rest: np.ndarray = robot.rest
        self._spread = np.where(upper_body, _SPREAD, _LEGS)

    def scene(self, number: int, rng: np.random.Generator) -> tuple[Statement, Ends] | None:
        """See `Family`."""
        del number
        return replace(self._asked, obstacles=tuple(_scene(rng))), self._ends

    def name(self, number: int) -> str:
        """See `Family`."""
        return f"reach {number}"

    def _ends(self, setup: Setup, rng: np.random.Generator) -> Pair | None:
        robot, validity = setup.robot, setup.validity(NEAR, NEAR_ITSELF)
        data, tool = robot.model.createData(), robot.frame_id(robot.tool)

        def fits(q: np.ndarray) -> bool:
            pin.forwardKinematics(robot.model, data, q)
            hand = pin.updateFramePlacement(robot.model, data, tool).translation
            return bool((hand > _HAND[0]).all() and (hand < _HAND[1]).all() and validity.free(q))

        return two_ends(partial(self._draw, rng, setup), fits, _LEAST, _TRIES)

    def _draw(self, rng: np.random.Generator, setup: Setup) -> np.ndarray:
        robot = setup.robot
        near = np.clip(self.rest + self._spread * rng.normal(size=(20, robot.dimension)), robot.lower, robot.upper)
        Q, converged = setup.constraint.project_batch(near, 15)
        return Q[converged & ((Q >= robot.lower) & (Q <= robot.upper)).all(axis=1)]


def _scene(rng: np.random.Generator) -> Iterator[Obstacle]:
    """A shelf of two boards in front, with objects on them, and posts beside it."""
    x, y, turn = rng.uniform(0.85, 1.05), rng.uniform(-0.5, 0.1), rng.uniform(-0.3, 0.3)
    heights = np.array([rng.uniform(0.5, 0.7), rng.uniform(1.0, 1.2)])
    for k, height in enumerate(heights):
        yield box(f"board {k}", (x, y, height), (0.4, 0.9, 0.03), turn)
    for i in range(int(rng.integers(5, 13))):
        along, across = rng.uniform(-0.4, 0.4), rng.uniform(-0.15, 0.15)
        spot = (
            x + across * np.cos(turn) - along * np.sin(turn),
            y + across * np.sin(turn) + along * np.cos(turn),
            heights[i % 2] + 0.015,
        )
        yield random_object(rng, f"object {i}", spot, (0.06, 0.25))
    for k, side in enumerate((-1.0, 1.0)):
        post = (rng.uniform(0.5, 0.8), y + side * rng.uniform(0.75, 0.95), 0.7)
        yield box(f"post {k}", post, (0.06, 0.06, 1.4))
