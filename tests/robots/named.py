"""The robots of conf/robot, read once per process."""

from functools import cache
from pathlib import Path

import numpy as np
import yaml

from pipeline.robots import ROBOTS, Robot, UrdfRobot
from pipeline.schema import Choice

FOLDER = Path(__file__).parents[2] / "conf" / "robot"
ROBOT_NAMES = sorted(path.stem for path in FOLDER.glob("*.yaml"))


@cache
def settings(name: str) -> UrdfRobot:
    """What a file in conf/robot says of a robot."""
    return Choice(**yaml.safe_load((FOLDER / f"{name}.yaml").read_text())).make(ROBOTS, "robot")


@cache
def named(name: str) -> Robot:
    """The robot of a file in conf/robot."""
    return settings(name).robot()


def configurations(robot: Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Uniform configurations within the limits, and one turn of joints that turn (count, n)."""
    return rng.uniform(*robot.box, (count, robot.dimension))
