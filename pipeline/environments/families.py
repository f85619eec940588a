"""The families of problems, by name."""

from collections.abc import Callable, Mapping
from typing import Any

from pipeline.environments.corridor import PenCorridors
from pipeline.environments.door import DoorOpening
from pipeline.environments.reach import BalancedReach
from pipeline.environments.task import Family
from pipeline.environments.thicket import Thicket
from pipeline.environments.torus import Mazes
from pipeline.environments.transport import UprightTransport
from pipeline.environments.tray import TwoArmTray
from pipeline.errors import ConfigError
from pipeline.robots import UrdfRobot
from pipeline.schema import convert

_OF_ROBOTS: dict[str, Callable[[UrdfRobot], Family]] = {
    "transport": UprightTransport,
    "door": DoorOpening,
    "tray": TwoArmTray,
    "reach": BalancedReach,
    "corridor": PenCorridors,
    "thicket": Thicket,
}
KINDS = (*_OF_ROBOTS, "maze")


def make_family(kind: str, robot: UrdfRobot | None, parameters: Mapping[str, Any]) -> Family:
    """Return a family of tasks.

    Args:
        kind: one of KINDS.
        robot: settings of the one that acts; None for mazes, which have their own point.
        parameters: of a maze (see `Mazes`); the others have none.

    Raises:
        ConfigError: an unknown kind, a robot missing or one too many, or parameters that do not fit.
    """
    if kind not in KINDS:
        raise ConfigError(f"family is {kind!r}; choices: {', '.join(KINDS)}")
    if (robot is None) != (kind == "maze"):
        raise ConfigError(f"family {kind!r} {'needs a robot' if robot is None else 'takes no robot'}")
    if robot is None:
        mazes: Mazes = convert(dict(parameters), Mazes, "family")
        return mazes
    if parameters:
        raise ConfigError(f"family {kind!r} takes no parameters; it was given {', '.join(parameters)}")
    return _OF_ROBOTS[kind](robot)
