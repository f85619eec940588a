"""Upright transport: a hand that stays level among boxes and cylinders on a table and in a shelf."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from pipeline.constraints import Constraint
from pipeline.environments.furniture import box, cylinder
from pipeline.environments.task import NEAR, NEAR_ITSELF, Ends, Family, Pair, two_ends
from pipeline.errors import ConfigError
from pipeline.robots import Obstacle, Robot, UrdfRobot, Validity, stands_clear
from pipeline.spec.statement import Level, Statement
from pipeline.tasks import Setup, robot_of

_TRIES = 80  # times fifty random configurations
_EDGE = 0.15  # from the shoulder to where objects may stand [m], less half of the widest
_LENGTH = 1.2  # of a table that begins there [m]
_LEAST = 1.0  # start and goal are at least this far apart [rad]


@dataclass(frozen=True)
class Station:
    """Where a robot works.

    Attributes:
        shoulder: of the arm, seen from above [m].
        sector: angles the objects stand at, seen from the shoulder [rad].
        reach: nearest and farthest objects [m].
        top: height of the table [m].
        level: direction of the tool's z axis in the world while it is level.
        edge: from the shoulder to the table [m]: it begins in front of the robot's own base.
    """

    shoulder: tuple[float, float]
    sector: tuple[float, float]
    reach: tuple[float, float]
    top: float
    level: tuple[float, float, float] = (0.0, 0.0, -1.0)
    edge: float = _EDGE


STATIONS = {
    "panda": Station((0.0, 0.0), (-1.3, 1.3), (0.38, 0.8), 0.0),
    "kinova": Station((0.0, 0.0), (-1.3, 1.3), (0.3, 0.65), 0.0),
    "baxter_right": Station((0.06, -0.26), (-1.1, 0.8), (0.45, 1.0), -0.15, edge=0.16),
}


class UprightTransport(Family):
    """Tasks of one robot: even ones on a table, odd ones with a shelf too; 15 to 40 obstacles.

    Start and goal are random configurations, projected, with the hand over the table among the objects.

    Args:
        settings: of a robot that a station is known for.

    Raises:
        ConfigError: another one.
    """

    def __init__(self, settings: UrdfRobot) -> None:
        if settings.name not in STATIONS:
            raise ConfigError(f"upright transport has stations for {', '.join(STATIONS)}, not for {settings.name!r}")
        self.settings, self.station = settings, STATIONS[settings.name]
        self.level = Level(settings.tool, (0.0, 0.0, 1.0), self.station.level)

    def scene(self, number: int, rng: np.random.Generator) -> tuple[Statement, Ends] | None:
        """See `Family`."""
        obstacles = tuple(_scene(rng, self.station, shelf=number % 2 == 1))
        if not stands_clear(robot_of(self.settings), obstacles):  # the other arm is in the way
            return None
        return Statement(self.settings, (self.level,), obstacles=obstacles), self._ends

    def name(self, number: int) -> str:
        """See `Family`."""
        return f"transport {self.settings.name} {number}"

    def _ends(self, setup: Setup, rng: np.random.Generator) -> Pair | None:
        robot, validity = setup.robot, setup.validity(NEAR, NEAR_ITSELF)
        accept = partial(_among, robot, validity, self.station, robot.model.createData())
        return two_ends(partial(_draw, rng, robot, setup.constraint), accept, _LEAST, _TRIES)


def _scene(rng: np.random.Generator, station: Station, shelf: bool) -> Iterator[Obstacle]:
    x, y = station.shoulder
    far = station.reach[1]
    length = _LENGTH - (station.edge - _EDGE)
    yield box("table", (x + station.edge + length / 2, y, station.top - 0.02), (length, 2.2, 0.04), 0.0)
    count = int(rng.integers(14, 39))
    boards: list[tuple[float, float, float, float]] = []
    if shelf:
        angle = rng.uniform(*(0.5 * np.array(station.sector)))
        place = np.array([x, y]) + 0.95 * far * np.array([np.cos(angle), np.sin(angle)])
        for k, height in enumerate((0.0, 0.32, 0.64)):
            yield box(f"board {k}", (*place, station.top + 0.01 + height), (0.3, 0.7, 0.02), angle)
        for k, side in enumerate((-0.35, 0.35)):
            offset = side * np.array([-np.sin(angle), np.cos(angle)])
            yield box(f"side {k}", (*(place + offset), station.top + 0.33), (0.3, 0.02, 0.66), angle)
        boards = [(*place, station.top + 0.02 + height, angle) for height in (0.0, 0.32)]
        count = max(count - 5, 10)
    for i in range(count):
        width, depth, height = rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.12), rng.uniform(0.08, 0.32)
        turn = rng.uniform(-np.pi, np.pi)
        if boards and i % 3 == 0:
            bx, by, bz, angle = boards[int(rng.integers(2))]
            along, across = rng.uniform(-0.27, 0.27), rng.uniform(-0.08, 0.08)
            px = bx + across * np.cos(angle) - along * np.sin(angle)
            py, pz = by + across * np.sin(angle) + along * np.cos(angle), bz
            height = min(height, 0.2)
        else:
            distance = rng.uniform(*station.reach)
            most = min(station.sector[1], np.arccos(min((_EDGE + 0.06) / distance, 1.0)))
            least = max(station.sector[0], -np.arccos(min((_EDGE + 0.06) / distance, 1.0)))
            bearing = rng.uniform(least, most)
            px, py, pz = x + distance * np.cos(bearing), y + distance * np.sin(bearing), station.top
        pose = (px, py, pz + height / 2)
        if rng.random() < 0.5:
            yield cylinder(f"object {i}", pose, width, height)
        else:
            yield box(f"object {i}", pose, (width, depth, height), turn)


def _draw(rng: np.random.Generator, robot: Robot, constraint: Constraint) -> np.ndarray:
    Q, converged = constraint.project_batch(rng.uniform(*robot.box, (50, robot.dimension)))
    return Q[converged & ((Q >= robot.lower) & (Q <= robot.upper)).all(axis=1)]


def _among(robot: Robot, validity: Validity, station: Station, data: pin.Data, q: np.ndarray) -> bool:
    """Tell whether the hand is low over the table, in front, and free."""
    pin.forwardKinematics(robot.model, data, q)
    px, py, pz = pin.updateFramePlacement(robot.model, data, robot.frame_id(robot.tool)).translation
    dx, dy = px - station.shoulder[0], py - station.shoulder[1]
    low, high = station.sector
    there = low < np.arctan2(dy, dx) < high and np.hypot(dx, dy) > station.reach[0]
    return bool(there and 0.03 < pz - station.top < 0.3 and validity.free(q))
