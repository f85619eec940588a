"""A thicket for a long stick: wires and plates a millimetre thick, meshes, and a table that the stick slides on."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.constraints import height, intersection, upright
from pipeline.constraints.inverse import InverseKinematics, in_region
from pipeline.constraints.regions import TaskSpaceRegion
from pipeline.environments.furniture import box, cylinder
from pipeline.environments.task import NEAR, NEAR_ITSELF, Task, two_ends
from pipeline.errors import ConfigError, ProblemError
from pipeline.robots import Obstacle, Placement, Robot, Shape, Validity, attach
from pipeline.verification.statement import Carried, Level, OnPlane

_BRACKET = Path(__file__).with_name("shapes") / "bracket.obj"
_TABLE = 0.02  # height of its top [m]
_STICK = 0.02  # thickness [m]
_LENGTH = 0.4  # below the fingers [m]
_DEEP = 0.0005  # the stick's end is in the table [m]: with the tolerance it stays within the 2 mm that touching allows
_THIN = 0.001  # wires and plates [m]
_WIDE = (0.3, 0.75, -0.55, 0.55)  # where things stand, and where the stick may be: x and y [m]
_APART = 1.0  # start and goal [rad]
_STATIONS = {"panda": (0.0, 0.0, -1.0)}  # direction of the tool's z axis while the stick hangs down
_TRIES = 10  # of inverse kinematics


class Thicket:
    """Tasks of an arm that slides the end of a long stick over a table among wires, thin plates and brackets.

    Args:
        robot: one that stands before the table.

    Raises:
        ConfigError: another one.
    """

    def __init__(self, robot: Robot) -> None:
        if robot.name not in _STATIONS:
            raise ConfigError(f"thickets are set up for {', '.join(_STATIONS)}, not for {robot.name!r}")
        down = _STATIONS[robot.name]
        stick = Obstacle(
            Shape.CYLINDER, (0.0, 0.0, _LENGTH / 2), (0.0, 0.0, 0.0, 1.0), (_STICK, _STICK, _LENGTH), "stick"
        )
        self.robot, self.carried = attach(robot, stick, robot.tool), (Carried(stick, robot.tool),)
        self.height = _TABLE + _LENGTH - _DEEP  # of the tool
        self.constraint = intersection(
            upright(self.robot, robot.tool, direction=down), height(self.robot, robot.tool, self.height)
        )
        self.says = (Level(robot.tool, (0.0, 0.0, 1.0), down), OnPlane(robot.tool, (0.0, 0.0, 1.0), self.height))

    def task(self, seed: int, number: int) -> Task:
        """See `Family`."""
        for attempt in range(20):
            rng = np.random.default_rng([seed, number, attempt])
            obstacles = tuple(_things(rng))
            touching = (("stick", "table"),)
            validity = Validity(self.robot, obstacles, NEAR, NEAR_ITSELF, touching)
            ends = two_ends(lambda rng=rng: self._draw(rng), validity.free, _APART, _TRIES)  # type: ignore[misc]
            if ends is not None:
                name = f"thicket {self.robot.name} {number}"
                return Task(
                    name, self.robot, self.constraint, obstacles, *ends, self.says, touching, carried=self.carried
                )
        raise ProblemError(f"no start and goal were found for thicket {number}, {self.robot.name!r}, seed {seed}")

    def _draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return configurations (m, n) with the stick somewhere on the table."""
        spot = (rng.uniform(*_WIDE[:2]), rng.uniform(*_WIDE[2:]), self.height)
        free = np.full(4, np.inf)  # height and tilt are the constraint's, the yaw is free
        region = TaskSpaceRegion((0, 0, *-free), (0, 0, *free), Placement(spot))
        inverse = InverseKinematics(self.robot, self.constraint, in_region(self.robot, self.robot.tool, region))
        return np.array(list(inverse.solutions(rng, _TRIES, self.robot.rest))).reshape(-1, self.robot.dimension)


def _things(rng: np.random.Generator) -> Iterator[Obstacle]:
    """The table, wires and plates that stand on it, wires across, and brackets."""
    x, y = (np.mean(_WIDE[:2]), np.mean(_WIDE[2:]))
    yield box("table", (x, y, _TABLE - 0.02), (_WIDE[1] - _WIDE[0] + 0.2, _WIDE[3] - _WIDE[2] + 0.2, 0.04))
    for number in range(int(rng.integers(6, 16))):
        tall = rng.uniform(0.1, 0.9)
        yield cylinder(f"wire {number}", (*_spot(rng), _TABLE + tall / 2), _THIN, tall)
    for number in range(int(rng.integers(1, 4))):
        size, high = (_THIN, rng.uniform(0.05, 0.2), rng.uniform(0.05, 0.3)), rng.uniform(0.0, 0.2)
        yield box(f"plate {number}", (*_spot(rng), _TABLE + high + size[2] / 2), size, rng.uniform(-np.pi, np.pi))
    for number in range(int(rng.integers(1, 4))):
        size = (_THIN, rng.uniform(0.1, 0.4), _THIN)  # a wire across
        middle = (*_spot(rng), _TABLE + rng.uniform(0.1, 0.9))
        yield box(f"wire across {number}", middle, size, rng.uniform(-np.pi, np.pi))
    for number in range(int(rng.integers(1, 3))):
        turn = rng.uniform(-np.pi, np.pi)
        quaternion = (0.0, 0.0, float(np.sin(turn / 2)), float(np.cos(turn / 2)))
        scale = rng.uniform(0.5, 1.2)
        at = (*_spot(rng), _TABLE)
        yield Obstacle(Shape.MESH, at, quaternion, (scale, scale, scale), f"bracket {number}", str(_BRACKET))


def _spot(rng: np.random.Generator) -> tuple[float, float]:
    """Return a place on the table [m]."""
    return float(rng.uniform(*_WIDE[:2])), float(rng.uniform(*_WIDE[2:]))
