"""A thicket for a long stick: wires and plates a millimetre thick, meshes, and a table that the stick slides on."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.environments.furniture import box, cylinder
from pipeline.environments.task import NEAR, NEAR_ITSELF, Ends, Family, Pair, held_down, over, two_ends
from pipeline.robots import Obstacle, Shape, UrdfRobot
from pipeline.spec.statement import Statement
from pipeline.tasks import Setup

_BRACKET = Path(__file__).with_name("shapes") / "bracket.obj"
_TABLE = 0.02  # height of its top [m]
_STICK = 0.02  # thickness [m]
_LENGTH = 0.4  # below the fingers [m]
_DEEP = 0.0005  # the stick's end is in the table [m]: with the tolerance it stays within the 2 mm that touching allows
_THIN = 0.001  # wires and plates [m]
_WIDE = (0.3, 0.75, -0.55, 0.55)  # where things stand, and where the stick may be: x and y [m]
_APART = 1.0  # start and goal [rad]
_TRIES = 10  # of inverse kinematics


class Thicket(Family):
    """Tasks of an arm that slides the end of a long stick over a table among wires, thin plates and brackets.

    Args:
        settings: of an arm that stands before the table.

    Raises:
        ConfigError: another one.
    """

    def __init__(self, settings: UrdfRobot) -> None:
        stick = Obstacle(
            Shape.CYLINDER, (0.0, 0.0, _LENGTH / 2), (0.0, 0.0, 0.0, 1.0), (_STICK, _STICK, _LENGTH), "stick"
        )
        self.height = _TABLE + _LENGTH - _DEEP  # of the tool
        self._asked = held_down(settings, stick, self.height, ("table",))
        self._arm = settings.name

    def scene(self, number: int, rng: np.random.Generator) -> tuple[Statement, Ends] | None:
        """See `Family`."""
        del number
        return replace(self._asked, obstacles=tuple(_things(rng))), self._ends

    def name(self, number: int) -> str:
        """See `Family`."""
        return f"thicket {self._arm} {number}"

    def _ends(self, setup: Setup, rng: np.random.Generator) -> Pair | None:
        return two_ends(partial(self._draw, rng, setup), setup.validity(NEAR, NEAR_ITSELF).free, _APART, _TRIES)

    def _draw(self, rng: np.random.Generator, setup: Setup) -> np.ndarray:
        """Return configurations (m, n) with the stick somewhere on the table."""
        spot = (rng.uniform(*_WIDE[:2]), rng.uniform(*_WIDE[2:]), self.height)
        found = over(setup, spot).solutions(rng, _TRIES, setup.robot.rest)
        return np.array(list(found)).reshape(-1, setup.robot.dimension)


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
