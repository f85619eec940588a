"""What families of tasks have in common."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from pipeline.constraints import TaskSpaceRegion
from pipeline.constraints.inverse import InverseKinematics, in_region
from pipeline.errors import ConfigError
from pipeline.robots import Obstacle, Placement, UrdfRobot
from pipeline.spec.statement import Carried, Level, OnPlane, Statement
from pipeline.spec.task import TaskSpec
from pipeline.tasks import Setup

DOWN = {"panda": (0.0, 0.0, -1.0)}  # robots that hold a tool downwards: direction of their frame's z axis then
_AXIS = (0.0, 0.0, 1.0)
# What start and goal keep from obstacles and from the robot itself [m], so that no planner's margin forbids them.
NEAR, NEAR_ITSELF = 0.02, 0.005


class Family(Protocol):
    """Makes tasks of one kind, by seed and number."""

    def task(self, seed: int, number: int) -> TaskSpec:
        """Return task `number` of a seed; the same every time.

        Raises:
            ProblemError: no start and goal are found.
        """
        ...


def two_ends(
    draw: Callable[[], np.ndarray], accept: Callable[[np.ndarray], bool], apart: float, tries: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return two accepted configurations (n,) at least `apart` from each other [rad]; None after `tries` draws.

    Args:
        draw: gives configurations on the manifold (m, n).
        accept: says which may be a start or goal.
        apart: see above.
        tries: calls of `draw`.
    """
    first: np.ndarray | None = None
    for _ in range(tries):
        for q in draw():
            if first is not None and np.linalg.norm(q - first) <= apart:
                continue
            if not accept(q):
                continue
            if first is not None:
                return first, q
            first = q
    return None


def held_down(settings: UrdfRobot, tool: Obstacle, height: float, touches: Sequence[str] = ()) -> Statement:
    """Return what is asked of an arm that holds a tool downwards at a fixed height.

    Args:
        settings: of the arm, one of `DOWN`.
        tool: what it holds, in the frame of its hand.
        height: of that frame [m].
        touches: obstacles that the tool may touch.

    Raises:
        ConfigError: another arm.
    """
    if settings.name not in DOWN:
        raise ConfigError(f"tools are held downwards by {', '.join(DOWN)}, not by {settings.name!r}")
    equations = (Level(settings.tool, _AXIS, DOWN[settings.name]), OnPlane(settings.tool, _AXIS, height))
    carried = Carried(tool, settings.tool, touches=dict.fromkeys(touches))
    return Statement(settings, equations, carried=(carried,))


def over(setup: Setup, spot: tuple[float, float, float]) -> InverseKinematics:
    """Return what finds configurations with the robot's tool frame at a place [m], turned as the constraint lets it."""
    free = np.full(4, np.inf)  # height and tilt are the constraint's, the yaw is free
    region = TaskSpaceRegion((0, 0, *-free), (0, 0, *free), Placement(spot))
    return InverseKinematics(setup.robot, setup.constraint, in_region(setup.robot, setup.robot.tool, region))
